//! Several processes of this program side by side, one for each core, and what they found together.

use sk_core::world::{Clock, RealClock};
use sk_flat::Instant;
use std::io::{self, BufRead, BufReader};
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread;
use std::time::Duration;

/// What a process says of itself at its end, for the one that started it.
const SUM_WORD: &str = "sum:";

/// Counts of runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Sum {
    pub(crate) runs: u64,
    pub(crate) failed: u64,
    pub(crate) virtual_time: Duration,
    pub(crate) published: u64,
    pub(crate) heard: u64,
}

impl Sum {
    fn add(&mut self, other: Sum) {
        self.runs += other.runs;
        self.failed += other.failed;
        self.virtual_time += other.virtual_time;
        self.published += other.published;
        self.heard += other.heard;
    }

    /// One line for people.
    pub(crate) fn line(&self, spent: Duration) -> String {
        let seconds = spent.as_secs_f64().max(1e-9);
        format!(
            "{} seeds in {seconds:.1} s: {:.1} seeds/s, {:.0} times real time, {} failed; {} messages published, \
             {} heard",
            self.runs,
            self.runs as f64 / seconds,
            self.virtual_time.as_secs_f64() / seconds,
            self.failed,
            self.published,
            self.heard
        )
    }

    /// One line for the process that started this one.
    pub(crate) fn for_parent(&self) -> String {
        let Sum { runs, failed, virtual_time, published, heard } = self;
        format!("{SUM_WORD} {runs} {failed} {} {published} {heard}", virtual_time.as_millis())
    }

    fn from_child(line: &str) -> Option<Sum> {
        let mut numbers = line.strip_prefix(SUM_WORD)?.split_ascii_whitespace().map(str::parse);
        let mut next = || numbers.next()?.ok();
        Some(Sum {
            runs: next()?,
            failed: next()?,
            virtual_time: Duration::from_millis(next()?),
            published: next()?,
            heard: next()?,
        })
    }
}

/// Starts that many processes, each with every so many of the seeds, and waits for all.
pub(crate) fn run(count: u64, from: u64, seeds: u64, rest: &[String]) -> io::Result<ExitCode> {
    let program = std::env::current_exe()?;
    let clock = RealClock::new();
    let mut children = Vec::new();
    for index in 0..count {
        let share = seeds / count + u64::from(index < seeds % count);
        let mut command = Command::new(&program);
        command.args(["--jobs", "1", "--child", "--step", &count.to_string()]);
        command.args(["--from", &(from + index).to_string(), "--seeds", &share.to_string()]);
        children.push(command.args(rest).stdin(Stdio::null()).stdout(Stdio::piped()).spawn()?);
    }
    let listeners: Vec<_> = children
        .iter_mut()
        .filter_map(|child| child.stdout.take())
        .map(|from| thread::spawn(move || listen(from)))
        .collect();
    let mut sum = Sum::default();
    let mut well = true;
    for child in &mut children {
        well &= Child::wait(child)?.success();
    }
    for listener in listeners {
        match listener.join() {
            Ok(Some(of_child)) => sum.add(of_child),
            // It ended before it could say.
            _ => well = false,
        }
    }
    println!("{}", sum.line(clock.now().since(Instant::ZERO)));
    Ok(if well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Passes a child's lines on, and keeps its sum.
fn listen(from: impl io::Read) -> Option<Sum> {
    let mut sum = None;
    for line in BufReader::new(from).lines().map_while(Result::ok) {
        match Sum::from_child(&line) {
            Some(of_child) => sum = Some(of_child),
            None => println!("{line}"),
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_passes_from_process_to_process() {
        let sum = Sum { runs: 3, failed: 1, virtual_time: Duration::from_secs(9), published: 70, heard: 60 };
        assert_eq!(Sum::from_child(&sum.for_parent()), Some(sum));
        assert_eq!(Sum::from_child("FAILED seed 3: something"), None);
    }
}
