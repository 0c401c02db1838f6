//! Makes a script that breaks a rule as short as it can.

use crate::action::Action;
use crate::rule::Rule;
use crate::run::{Outcome, run};
use crate::script::{Role, Script};

/// A script with its complaint, made shorter.
#[derive(Clone, Debug)]
pub struct Shrunk {
    /// The shortest script that was found.
    pub script: Script,
    /// What became of it.
    pub outcome: Outcome,
    /// How many runs it took.
    pub runs: usize,
}

/// Deletes steps and nodes, and makes numbers smaller, as long as the same rule is broken; at most `runs_max` runs.
/// `None` if the script breaks no rule.
pub fn shrink(script: &Script, runs_max: usize) -> Option<Shrunk> {
    let outcome = run(script);
    let rule = outcome.complaint.as_ref()?.rule;
    let mut search = Search { rule, runs_max, best: Shrunk { script: script.clone(), outcome, runs: 1 } };
    // What one pass makes superfluous the next one deletes.
    loop {
        let before = search.size();
        search.cut_the_end();
        search.delete_steps();
        search.delete_nodes();
        search.lessen_numbers();
        if search.size() == before || search.best.runs >= runs_max {
            return Some(search.best);
        }
    }
}

struct Search {
    rule: Rule,
    runs_max: usize,
    best: Shrunk,
}

impl Search {
    fn size(&self) -> (usize, usize, u64) {
        let script = &self.best.script;
        (
            script.steps.len(),
            script.nodes.len(),
            script.steps.iter().map(|step| weight(step.action)).sum(),
        )
    }

    /// Takes the candidate if it breaks the same rule.
    fn try_this(&mut self, candidate: Script) -> bool {
        if self.best.runs >= self.runs_max {
            return false;
        }
        self.best.runs += 1;
        let outcome = run(&candidate);
        let same = outcome.complaint.as_ref().is_some_and(|complaint| complaint.rule == self.rule);
        if same {
            self.best.script = candidate;
            self.best.outcome = outcome;
        }
        same
    }

    /// Steps after the complaint cannot have caused it.
    fn cut_the_end(&mut self) {
        let Some(complaint) = &self.best.outcome.complaint else { return };
        let end_us = complaint.at.as_nanos() / 1000;
        let mut candidate = self.best.script.clone();
        candidate.steps.retain(|step| step.at_us <= end_us);
        if candidate.steps.len() < self.best.script.steps.len() {
            self.try_this(candidate);
        }
    }

    /// Deletes runs of steps, long ones first.
    fn delete_steps(&mut self) {
        let mut length = self.best.script.steps.len().div_ceil(2);
        while length > 0 {
            let mut at = 0;
            while at < self.best.script.steps.len() {
                let mut candidate = self.best.script.clone();
                let end = (at + length).min(candidate.steps.len());
                candidate.steps.drain(at..end);
                if !self.try_this(candidate) {
                    at += length;
                }
            }
            length /= 2;
        }
    }

    fn delete_nodes(&mut self) {
        // Whoever has a satellite stays as long as that.
        let with_hubs = self.best.script.nodes.iter().rev();
        let numbers: Vec<u16> = with_hubs.map(|(number, _)| *number).collect();
        for number in numbers {
            let nodes = &self.best.script.nodes;
            let is_needed = |(_, role): &(u16, Role)| !role.is_hub() && role.hub() == number;
            if number == 0 || nodes.iter().any(is_needed) {
                continue;
            }
            let mut candidate = self.best.script.clone();
            candidate.nodes.retain(|(node, _)| *node != number);
            candidate.steps.retain(|step| step.node != number);
            self.try_this(candidate);
        }
    }

    fn lessen_numbers(&mut self) {
        for at in 0..self.best.script.steps.len() {
            let mut step = self.best.script.steps[at].action;
            while let Some(less) = lessened(step) {
                let mut candidate = self.best.script.clone();
                candidate.steps[at].action = less;
                if !self.try_this(candidate) {
                    break;
                }
                step = less;
            }
        }
    }
}

fn weight(action: Action) -> u64 {
    match action {
        Action::Burst(_, count, bytes) => u64::from(count) * u64::from(bytes),
        Action::Abort(_, bytes) => bytes.into(),
        Action::Write(count) => count.into(),
        Action::Put(.., bytes) => bytes.into(),
        Action::Lossy(loss, twice, jitter) => u64::from(loss) + u64::from(twice) + u64::from(jitter),
        Action::Link(delay, jitter, _) => u64::from(delay) + u64::from(jitter),
        _ => 0,
    }
}

/// The same with smaller numbers.
fn lessened(action: Action) -> Option<Action> {
    match action {
        Action::Burst(channel, count @ 2.., bytes) => Some(Action::Burst(channel, count / 2, bytes)),
        Action::Burst(channel, count, bytes @ 64..) => Some(Action::Burst(channel, count, bytes / 2)),
        Action::Abort(channel, bytes @ 2..) => Some(Action::Abort(channel, bytes / 2)),
        Action::Put(path, version, bytes @ 64..) => Some(Action::Put(path, version, bytes / 2)),
        Action::Lossy(loss @ 1.., twice, jitter) => Some(Action::Lossy(loss / 2, twice, jitter)),
        Action::Lossy(loss, twice @ 1.., jitter) => Some(Action::Lossy(loss, twice / 2, jitter)),
        Action::Lossy(loss, twice, jitter @ 1000..) => Some(Action::Lossy(loss, twice, jitter / 2)),
        Action::Write(count @ 2..) => Some(Action::Write(count / 2)),
        Action::Link(delay @ 1000.., jitter, piece) => Some(Action::Link(delay / 2, jitter, piece)),
        Action::Link(delay, jitter @ 1000.., piece) => Some(Action::Link(delay, jitter / 2, piece)),
        _ => None,
    }
}
