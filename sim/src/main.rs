//! Runs seeds or scripts of the network in a box; `cargo xtask sim` builds and starts it, one process for each core.
#![forbid(unsafe_code)]

use clap::Parser;
use sk_sim::run::{Outcome, run};
use sk_sim::script::Script;
use sk_sim::shrink::shrink;
use sk_sim::{generate, log};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Runs that a shrinker may make.
const SHRINK_RUNS_MAX: usize = 4000;
/// How often it is said how far the runs are.
const REPORT_EVERY: Duration = Duration::from_secs(10);

/// Runs the network in a box.
#[derive(Parser)]
#[command(name = "sk-sim")]
struct Arguments {
    /// How many seeds to run.
    #[arg(long, default_value_t = 100)]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    from: u64,
    /// Every how many seeds one is this process's.
    #[arg(long, default_value_t = 1)]
    step: u64,
    /// Stop after that many seconds of real time, whatever seeds are left.
    #[arg(long)]
    seconds: Option<u64>,
    /// Run each seed twice and compare what happened.
    #[arg(long)]
    twice: bool,
    /// Print the script of the first seed, run it with its log, and say what became of it.
    #[arg(long)]
    show: bool,
    /// Run this script instead of seeds.
    #[arg(long)]
    replay: Option<PathBuf>,
    /// Do not shrink what fails.
    #[arg(long)]
    no_shrink: bool,
    /// Go on after a failure.
    #[arg(long)]
    keep_going: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    log::listen();
    match &arguments.replay {
        Some(file) => replay(file),
        None if arguments.show => show(&generate::script(arguments.from)),
        None => seeds(&arguments),
    }
}

fn replay(file: &PathBuf) -> ExitCode {
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(error) => {
            eprintln!("{} cannot be read: {error}", file.display());
            return ExitCode::FAILURE;
        }
    };
    match text.parse::<Script>() {
        Ok(script) => show(&script),
        Err(error) => {
            eprintln!("{}: {error}", file.display());
            ExitCode::FAILURE
        }
    }
}

fn show(script: &Script) -> ExitCode {
    log::aloud();
    print!("{script}");
    let outcome = run(script);
    println!(
        "{} messages published, {} heard, hash {:016x}",
        outcome.published, outcome.heard, outcome.hash
    );
    match outcome.complaint {
        None => {
            println!("no rule was broken");
            ExitCode::SUCCESS
        }
        Some(complaint) => {
            println!("FAILED {complaint}");
            ExitCode::FAILURE
        }
    }
}

fn seeds(arguments: &Arguments) -> ExitCode {
    let started = Instant::now();
    let mut sum = Sum::default();
    let mut reported = started;
    for index in 0..arguments.seeds {
        let seed = arguments.from + index * arguments.step.max(1);
        let script = generate::script(seed);
        let outcome = run(&script);
        if arguments.twice && outcome != run(&script) {
            println!("FAILED seed {seed}: two runs of it differ");
            return ExitCode::FAILURE;
        }
        sum.add(&outcome);
        if outcome.complaint.is_some() {
            sum.failed += 1;
            fail(arguments, &script, &outcome);
            if !arguments.keep_going {
                break;
            }
        }
        if reported.elapsed() > REPORT_EVERY {
            reported = Instant::now();
            sum.say(started, seed);
        }
        if arguments.seconds.is_some_and(|seconds| started.elapsed().as_secs() >= seconds) {
            break;
        }
    }
    sum.say(started, arguments.from + sum.runs.saturating_sub(1) * arguments.step.max(1));
    if sum.failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn fail(arguments: &Arguments, script: &Script, outcome: &Outcome) {
    if let Some(complaint) = &outcome.complaint {
        println!("FAILED seed {}: {complaint}", script.seed);
    }
    if arguments.no_shrink {
        return;
    }
    if let Some(shrunk) = shrink(script, SHRINK_RUNS_MAX) {
        let (before, after) = (script.steps.len(), shrunk.script.steps.len());
        println!("# shrunk from {before} to {after} steps in {} runs", shrunk.runs);
        if let Some(complaint) = &shrunk.outcome.complaint {
            println!("# {complaint}");
        }
        print!("{}", shrunk.script);
    }
}

#[derive(Default)]
struct Sum {
    runs: u64,
    failed: u64,
    virtual_time: Duration,
    published: u64,
    heard: u64,
}

impl Sum {
    fn add(&mut self, outcome: &Outcome) {
        self.runs += 1;
        self.virtual_time += outcome.virtual_time;
        self.published += outcome.published;
        self.heard += outcome.heard;
    }

    fn say(&self, started: Instant, last: u64) {
        let seconds = started.elapsed().as_secs_f64().max(1e-9);
        println!(
            "{} seeds to {last} in {seconds:.1} s: {:.1} seeds/s, {:.0} times real time, {} failed; {} messages \
             published, {} heard",
            self.runs,
            self.runs as f64 / seconds,
            self.virtual_time.as_secs_f64() / seconds,
            self.failed,
            self.published,
            self.heard
        );
    }
}
