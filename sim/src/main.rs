//! Runs seeds or scripts of the network in a box; `cargo xtask sim` builds and starts it, one process for each core.
#![forbid(unsafe_code)]

#[cfg(feature = "planted-bugs")]
mod proof;

mod jobs;

use clap::Parser;
use jobs::Sum;
use sk_core::world::{Clock, RealClock};
use sk_flat::Instant;
use sk_sim::run::{Outcome, run};
use sk_sim::script::Script;
use sk_sim::shrink::shrink;
use sk_sim::{generate, log};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

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
    /// How many processes run side by side.
    #[arg(long, default_value_t = 1)]
    jobs: u64,
    /// Every how many seeds one is this process's.
    #[arg(long, default_value_t = 1, hide = true)]
    step: u64,
    /// Say the sum to the process that started this one.
    #[arg(long, hide = true)]
    child: bool,
    /// Run seeds until one fails.
    #[arg(long)]
    forever: bool,
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
    /// Switch on a bug that is planted in the code, to see it found; `all` tries each.
    #[cfg(feature = "planted-bugs")]
    #[arg(long, value_name = "NAME")]
    planted: Option<String>,
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
    #[cfg(feature = "planted-bugs")]
    if let Some(name) = &arguments.planted {
        return proof::find(name, arguments.from, arguments.seeds);
    }
    match &arguments.replay {
        Some(file) => replay(file),
        None if arguments.show => show(&generate::script(arguments.from)),
        None if arguments.jobs > 1 => side_by_side(&arguments),
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

fn side_by_side(arguments: &Arguments) -> ExitCode {
    let mut rest = Vec::new();
    let switches = [
        ("--twice", arguments.twice),
        ("--no-shrink", arguments.no_shrink),
        ("--keep-going", arguments.keep_going),
        ("--forever", arguments.forever),
    ];
    rest.extend(switches.iter().filter(|(_, on)| *on).map(|(name, _)| (*name).to_owned()));
    if let Some(seconds) = arguments.seconds {
        rest.extend(["--seconds".to_owned(), seconds.to_string()]);
    }
    jobs::run(arguments.jobs, arguments.from, arguments.seeds, &rest).unwrap_or_else(|error| {
        eprintln!("the processes cannot be started: {error}");
        ExitCode::FAILURE
    })
}

fn seeds(arguments: &Arguments) -> ExitCode {
    let clock = RealClock::new();
    let mut sum = Sum::default();
    let mut reported = clock.now();
    let count = if arguments.forever { u64::MAX } else { arguments.seeds };
    for index in 0..count {
        let seed = arguments.from.wrapping_add(index.wrapping_mul(arguments.step.max(1)));
        let script = generate::script(seed);
        let outcome = run(&script);
        if arguments.twice && outcome != run(&script) {
            println!("FAILED seed {seed}: two runs of it differ");
            return ExitCode::FAILURE;
        }
        sum.runs += 1;
        sum.virtual_time += outcome.virtual_time;
        sum.published += outcome.published;
        sum.heard += outcome.heard;
        if outcome.complaint.is_some() {
            sum.failed += 1;
            fail(arguments, &script, &outcome);
            if !arguments.keep_going {
                break;
            }
        }
        if clock.now().since(reported) > REPORT_EVERY {
            reported = clock.now();
            println!("to seed {seed}: {}", sum.line(spent(&clock)));
        }
        if arguments.seconds.is_some_and(|seconds| spent(&clock).as_secs() >= seconds) {
            break;
        }
    }
    println!("{}", if arguments.child { sum.for_parent() } else { sum.line(spent(&clock)) });
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

fn spent(clock: &RealClock) -> Duration {
    clock.now().since(Instant::ZERO)
}
