//! Running the sides of a bench in turn.

use crate::limited::{self, Ended};
use crate::sheet::{Line, Sheet};
use crate::{Options, Report, Spread, peers};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

/// Why a bench did not come to an end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A program could not be started, read or written to.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// Our own side failed.
    #[error("our side failed: {0}")]
    Ours(String),
    /// A side was killed because it had not ended by then.
    #[error("timed out after {0} s")]
    TimedOut(u64),
    /// A side was asked for that the bench does not have.
    #[error("there is no side {0:?}")]
    NoSuchSide(String),
}

/// How long a side is expected to run unless the bench says otherwise.
const EXPECTED: Duration = Duration::from_secs(60);
/// A side that runs longer than this many times what was expected of it, and this much more, hangs.
const EXPECTED_TIMES_MAX: u32 = 3;
const GRACE: Duration = Duration::from_secs(30);

/// What a side of ours does with its sheet.
type Work<'a> = Box<dyn Fn(&mut Sheet) -> Result<(), BenchError> + 'a>;

/// One of those that are compared.
pub struct Side<'a> {
    peer: Option<&'static str>,
    work: How<'a>,
    /// A program in front of which it is started, such as the one that sets the scheduling class.
    before: Vec<String>,
    /// Which part of the bench it is, where parts need processes of their own.
    part: Option<&'static str>,
    /// The case whose processor time it is.
    cpu_case: Option<String>,
}

enum How<'a> {
    /// This program, started anew.
    Here(Work<'a>),
    /// A program of its own, and its arguments.
    There { program: Option<PathBuf>, arguments: Vec<String> },
}

impl<'a> Side<'a> {
    fn new(peer: Option<&'static str>, work: How<'a>) -> Side<'a> {
        Side { peer, work, before: Vec::new(), part: None, cpu_case: None }
    }

    /// Ours.
    pub fn ours(work: impl Fn(&mut Sheet) -> Result<(), BenchError> + 'a) -> Side<'a> {
        Side::new(None, How::Here(Box::new(work)))
    }

    /// A peer whose work is written in Rust within the bench itself.
    pub fn built_in(
        peer: &'static str,
        work: impl Fn(&mut Sheet) -> Result<(), BenchError> + 'a,
    ) -> Side<'a> {
        Side::new(Some(peer), How::Here(Box::new(work)))
    }

    /// A peer that `cargo xtask bench-peers` builds as the program `name`.
    pub fn program(peer: &'static str, name: &str, arguments: &[&str]) -> Side<'a> {
        let arguments = arguments.iter().map(|&argument| argument.to_owned()).collect();
        Side::new(Some(peer), How::There { program: peers::program(name), arguments })
    }

    /// Starts it by another program, which gets the side's command line as its last arguments.
    pub fn started_by(mut self, before: &[String]) -> Side<'a> {
        self.before = before.to_vec();
        self
    }

    /// Makes it one part of several with the same peer; each part has a process of its own.
    pub fn part(mut self, part: &'static str) -> Side<'a> {
        self.part = Some(part);
        self
    }

    /// Measures from outside how much of a core it used, as the metric `cpu` of this case.
    pub fn with_cpu(mut self, case: &str) -> Side<'a> {
        self.cpu_case = Some(case.to_owned());
        self
    }

    fn name(&self) -> &'static str {
        self.peer.unwrap_or("ours")
    }

    fn command(&self) -> Result<Command, BenchError> {
        let (program, arguments) = match &self.work {
            How::Here(_) => {
                let mut arguments: Vec<String> = std::env::args().skip(1).collect();
                arguments.extend(["--side".to_owned(), self.name().to_owned()]);
                arguments.extend(self.part.iter().flat_map(|part| ["--part".to_owned(), (*part).to_owned()]));
                (std::env::current_exe()?, arguments)
            }
            How::There { program, arguments } => {
                let missing = || io::Error::new(io::ErrorKind::NotFound, "it is not installed");
                (program.clone().ok_or_else(missing)?, arguments.clone())
            }
        };
        let mut words: Vec<std::ffi::OsString> = self.before.iter().map(Into::into).collect();
        words.push(program.into());
        words.extend(arguments.into_iter().map(Into::into));
        let mut command = Command::new(&words[0]);
        command.args(&words[1..]);
        Ok(command)
    }
}

/// What one process of a side told.
#[derive(Default)]
struct Told {
    lines: Vec<Line>,
    spreads: BTreeMap<(String, String), Spread>,
}

/// A side, and what its runs have told so far.
struct Running<'a, 'b> {
    side: &'b Side<'a>,
    told: Vec<Told>,
    left_out: bool,
}

/// A bench: its name, its sides, and what is done with the report.
///
/// ```no_run
/// use clap::Parser;
/// use sk_benches::{Bench, Options, Side};
///
/// #[derive(Parser)]
/// struct Mine { #[command(flatten)] shared: Options }
///
/// let mine = Mine::parse();
/// let ours = Side::ours(|sheet| { sheet.figure("sum", "ns_per_call", "ns", 0.3); Ok(()) });
/// Bench::new("sums", &mine.shared).side(ours).run()?;
/// # Ok::<(), sk_benches::BenchError>(())
/// ```
pub struct Bench<'a> {
    name: &'static str,
    options: &'a Options,
    sides: Vec<Side<'a>>,
    growth: Vec<(String, String, String)>,
    expected: Duration,
    grace: Duration,
    notes: Vec<String>,
}

impl<'a> Bench<'a> {
    /// A bench without sides.
    pub fn new(name: &'static str, options: &'a Options) -> Bench<'a> {
        Bench {
            name,
            options,
            sides: Vec::new(),
            growth: Vec::new(),
            expected: EXPECTED,
            grace: GRACE,
            notes: Vec::new(),
        }
    }

    /// One more side. In each run they are started in the order in which they were given.
    pub fn side(mut self, side: Side<'a>) -> Bench<'a> {
        self.sides.push(side);
        self
    }

    /// Below the table, tells for every side the quotient of one metric in two cases.
    pub fn growth(mut self, metric: &str, of: &str, over: &str) -> Bench<'a> {
        self.growth.push((metric.to_owned(), of.to_owned(), over.to_owned()));
        self
    }

    /// A remark for the reader of the table.
    pub fn note(mut self, text: &str) -> Bench<'a> {
        self.notes.push(text.to_owned());
        self
    }

    /// How long a side is expected to run. One that takes three times as long and half a minute more is
    /// killed, and told as timed out.
    pub fn expected(mut self, expected: Duration) -> Bench<'a> {
        self.expected = expected;
        self
    }

    /// Plays one side, if this process was started for it; else runs all sides in turn and tells what came
    /// out. Peers that are not there, and those that fail, are named and left out; so is any side that does
    /// not end in time.
    ///
    /// # Errors
    /// If our own side fails, or nothing can be written.
    pub fn run(self) -> Result<Report, BenchError> {
        self.run_part(None)
    }

    /// As [`run`](Bench::run), for a bench with parts: `part` is what its hidden option `--part` says.
    ///
    /// # Errors
    /// As [`run`](Bench::run).
    pub fn run_part(self, part: Option<&str>) -> Result<Report, BenchError> {
        if let Some(name) = &self.options.side {
            self.play(name, part)?;
            return Ok(Report::new(self.name));
        }
        let report = self.measure()?;
        let table = report.table(&self.growth);
        if self.options.json {
            eprint!("{table}");
            io::stdout().write_all(report.json_lines().as_bytes())?;
        } else {
            io::stdout().write_all(table.as_bytes())?;
        }
        Ok(report)
    }

    fn play(&self, name: &str, part: Option<&str>) -> Result<(), BenchError> {
        let side = self.sides.iter().find(|side| side.name() == name && side.part == part);
        match side.map(|side| &side.work) {
            Some(How::Here(work)) => {
                let mut sheet = Sheet::new();
                work(&mut sheet)?;
                Ok(sheet.close()?)
            }
            _ => Err(BenchError::NoSuchSide(name.to_owned())),
        }
    }

    fn measure(&self) -> Result<Report, BenchError> {
        let mut report = Report::new(self.name);
        self.notes.iter().for_each(|note| report.note(note));
        let sides = self.sides.iter().filter(|side| self.options.wants(side.peer));
        let mut sides: Vec<Running<'_, '_>> =
            sides.map(|side| Running { side, told: Vec::new(), left_out: false }).collect();
        for run in 1..=self.options.runs() {
            for running in sides.iter_mut().filter(|running| !running.left_out) {
                let side = running.side;
                match self.one_process(side) {
                    Ok(told) => running.told.push(told),
                    Err(BenchError::TimedOut(limit_s)) => {
                        // Nothing is told of a side that hangs now and then.
                        running.told.clear();
                        running.left_out = true;
                        report.time_out(side.name(), side.part, limit_s);
                    }
                    Err(error) if side.peer.is_none() => return Err(error),
                    Err(error) => {
                        running.left_out = true;
                        report.note(&format!("{} is left out: {error}", side.name()));
                    }
                }
            }
            eprintln!("{}: run {run} of {} done", self.name, self.options.runs());
        }
        for running in sides {
            running
                .told
                .into_iter()
                .for_each(|told| take(&mut report, running.side.peer, told));
        }
        Ok(report)
    }

    fn one_process(&self, side: &Side<'_>) -> Result<Told, BenchError> {
        let cpu_before = children_cpu_s();
        let began = Instant::now();
        let limit = self.expected * EXPECTED_TIMES_MAX + self.grace;
        let (status, output) = match limited::run(&mut side.command()?, limit)? {
            Ended::Itself(status, output) => (status, output),
            Ended::Killed => return Err(BenchError::TimedOut(limit.as_secs())),
        };
        let lasted_s = began.elapsed().as_secs_f64();
        if !status.success() {
            return Err(BenchError::Ours(format!("{} ended with {status}", side.name())));
        }
        let mut told = Told::default();
        for line in String::from_utf8_lossy(&output).lines().filter_map(Line::read) {
            match line {
                Line::Sample { case, metric, ns, count } => {
                    told.spreads.entry((case, metric)).or_default().add(ns, count);
                }
                line => told.lines.push(line),
            }
        }
        if let Some(case) = &side.cpu_case {
            let value = (children_cpu_s() - cpu_before) / lasted_s * 100.0;
            let (case, metric, unit) = (case.clone(), "cpu".to_owned(), "%".to_owned());
            told.lines.push(Line::Figure { case, metric, unit, value });
        }
        Ok(told)
    }
}

/// Processor time of all processes this one has started and waited for.
fn children_cpu_s() -> f64 {
    getrusage(UsageWho::RUSAGE_CHILDREN)
        .map_or(0.0, |usage| (usage.user_time() + usage.system_time()).num_microseconds() as f64 / 1e6)
}

fn take(report: &mut Report, peer: Option<&'static str>, told: Told) {
    for line in told.lines {
        match line {
            Line::Figure { case, metric, unit, value } => report.add(&case, &metric, &unit, peer, value),
            Line::Note(text) => report.note(&format!("{}: {text}", peer.unwrap_or("ours"))),
            Line::Sample { .. } => {}
        }
    }
    for ((case, metric), spread) in told.spreads {
        report.add_spread(&case, &metric, peer, &spread);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Mine {
        #[command(flatten)]
        shared: Options,
    }

    fn shell<'a>(peer: &'static str, script: &str) -> Side<'a> {
        let arguments = vec!["-c".to_owned(), script.to_owned()];
        Side::new(Some(peer), How::There { program: Some("/bin/sh".into()), arguments })
    }

    #[test]
    fn a_side_that_hangs_is_told_as_timed_out_and_the_others_go_on() {
        let mine = Mine::parse_from(["bench", "--runs", "2"]);
        let figure = r"printf 'figure\tc\tm\tns\t2\n'";
        let mut bench = Bench::new("b", &mine.shared)
            .side(shell("hangs", &format!("{figure}; exec tail -f /dev/null")).part("late"))
            .side(shell("fails", "exit 1"))
            .side(shell("works", figure))
            .expected(Duration::ZERO);
        bench.grace = Duration::from_millis(300);
        let report = bench.measure().unwrap();
        let peers: Vec<_> = report.figures().iter().map(|figure| figure.peer).collect();
        assert_eq!(peers, [Some("works")]);
        let table = report.table(&[]);
        assert!(table.contains("hangs (late): timed out after 0 s"), "{table}");
        assert!(table.contains("fails is left out"), "{table}");
        assert!(!report.json_lines().contains("hangs"));
    }
}
