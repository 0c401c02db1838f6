//! What a follower of ticks knows itself of how it keeps up, to be compared with what the hub tells it.
//!
//! All moments are the hub's: the way to it is without fault, so that it is known when a tick left there and when an
//! answer arrived. Where two things came to the hub at the same moment, nobody outside knows which was first: then
//! nothing is compared until the next report.

use std::collections::VecDeque;
use std::time::Duration;

use sk_core::flow::satellite::TickReport;
use sk_flat::Instant;

/// How many ticks without an answer the hub remembers.
const UNANSWERED_MAX: usize = 8;
/// How long ticks may come by another divisor than the last one that was told: a report each second, and some more.
const UNTOLD_MAX: Duration = Duration::from_millis(1600);

/// One follower's own account.
#[derive(Debug, Default)]
pub(crate) struct Pace {
    /// What it asked for; 0 leaves it to the hub.
    wish: u8,
    last: Option<u64>,
    pending: Option<u64>,
    unanswered: VecDeque<(u64, Instant)>,
    /// Answers that had not arrived at the hub when it was last heard of.
    under_way: VecDeque<(u64, Instant)>,
    /// Since the last report.
    done: u64,
    missed: u64,
    /// Ticks that may have been missed, for all that is known here.
    perhaps_missed: u64,
    lag: Duration,
    /// Ticks since one was left out: until all of those that the hub remembers are known here, no lag is.
    complete: usize,
    unsure: bool,
    reported: Option<TickReport>,
    /// What is wrong with the last report, unless a tick came to be at the same moment.
    verdict: Option<(Instant, Option<String>)>,
    /// When the last tick left the hub.
    ticked: Option<Instant>,
    stride: Option<Stride>,
}

/// Ticks of the same distance.
#[derive(Clone, Copy, Debug)]
struct Stride {
    distance: u64,
    since: Instant,
    until: Instant,
    /// The hub has told it.
    told: bool,
}

impl Pace {
    /// A subscription begins.
    pub(crate) fn begin(wish: u8) -> Pace {
        Pace { wish, unsure: true, ..Pace::default() }
    }

    /// Its divisor is another one from now on. What it has not answered is still to be answered.
    pub(crate) fn change(&mut self, wish: u8) {
        self.wish = wish;
        self.unsure = true;
        (self.last, self.stride) = (None, None);
    }

    /// A tick left the hub. Answers what is wrong.
    pub(crate) fn tick(&mut self, sequence: u64, left: Instant) -> Option<String> {
        self.arrived_before(left);
        self.ticked = Some(left);
        let untold = self.untold();
        let wrong = match self.verdict.take() {
            Some((told, _)) if told == left => {
                self.unsure = true;
                None
            }
            verdict => verdict.and_then(|(_, wrong)| wrong),
        };
        if let Some(last) = self.last.replace(sequence) {
            let distance = sequence.saturating_sub(last);
            match u64::from(self.wish) {
                0 => self.perhaps_missed += distance.saturating_sub(1),
                divisor => {
                    let left_out = (sequence / divisor).saturating_sub(last / divisor).saturating_sub(1);
                    self.missed += left_out;
                    self.complete = if left_out > 0 { 0 } else { self.complete + 1 };
                }
            }
            match &mut self.stride {
                Some(stride) if stride.distance == distance => stride.until = left,
                stride => {
                    let told = self.reported.is_some_and(|report| u64::from(report.divisor) == distance);
                    *stride = Some(Stride { distance, since: left, until: left, told });
                }
            }
        }
        if self.pending.replace(sequence).is_some() {
            self.missed += 1;
        }
        if self.unanswered.len() == UNANSWERED_MAX {
            self.unanswered.pop_front();
        }
        self.unanswered.push_back((sequence, left));
        wrong.or(untold)
    }

    /// Ticks came by a divisor that the hub did not tell for too long. The newest tick does not count: it may be the first
    /// by another divisor.
    fn untold(&self) -> Option<String> {
        let stride = self.stride.filter(|stride| matches!(stride.distance, 1 | 2 | 4))?;
        let is_long = stride.until.since(stride.since) > UNTOLD_MAX;
        (is_long && !stride.told).then(|| {
            format!("every tick of {} came since {}, and that was not told", stride.distance, stride.since)
        })
    }

    /// The answer to a tick arrives at the hub.
    pub(crate) fn done(&mut self, sequence: u64, arrives: Instant) {
        self.under_way.push_back((sequence, arrives));
    }

    /// Takes account of the answers that arrived before something else happened at the hub.
    fn arrived_before(&mut self, moment: Instant) {
        while let Some((sequence, arrived)) = self.under_way.front().copied().filter(|(_, at)| *at <= moment)
        {
            self.unsure |= arrived == moment;
            self.under_way.pop_front();
            let Some(place) = self.unanswered.iter().position(|(sent, _)| *sent == sequence) else {
                continue;
            };
            self.lag = self.lag.max(arrived.since(self.unanswered[place].1));
            self.unanswered.drain(..=place);
            if self.pending == Some(sequence) {
                self.pending = None;
                self.done += 1;
            }
        }
    }

    /// The hub told how this follower keeps up, as it was when that left. What is wrong with it is known at the next
    /// tick.
    pub(crate) fn told(&mut self, report: TickReport, left: Instant) {
        self.arrived_before(left);
        self.unsure |= self.ticked == Some(left);
        if let Some(stride) = &mut self.stride {
            stride.told |= u64::from(report.divisor) == stride.distance;
        }
        let wrong = self.compare(report, left);
        self.unsure = self.ticked == Some(left);
        self.verdict = Some((left, wrong));
    }

    fn compare(&mut self, report: TickReport, left: Instant) -> Option<String> {
        let before = self.reported.replace(report);
        let (done, missed) = (std::mem::take(&mut self.done), std::mem::take(&mut self.missed));
        let perhaps = std::mem::take(&mut self.perhaps_missed);
        let overdue = self.unanswered.front().map_or(Duration::ZERO, |(_, sent)| left.since(*sent));
        let lag = std::mem::take(&mut self.lag);
        let lag = if self.unanswered.len() > 1 { lag.max(overdue) } else { lag };
        let (is_unsure, before) = (std::mem::take(&mut self.unsure), before?);
        let told_done = report.done.checked_sub(before.done);
        let told_missed = report.missed.checked_sub(before.missed);
        if is_unsure {
            return None;
        }
        let is_right = told_done == Some(done)
            && told_missed.is_some_and(|told| (missed..=missed + perhaps).contains(&told));
        if !is_right {
            return Some(format!(
                "{told_done:?} ticks were told done and {told_missed:?} missed; {done} and {missed} to {} were",
                missed + perhaps
            ));
        }
        let knows_lag = self.wish != 0 && self.complete >= UNANSWERED_MAX;
        (knows_lag && report.lag != lag)
            .then(|| format!("a lag of {:?} was told, {lag:?} it was", report.lag))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sk_core::flow::ChannelRef;

    fn at(us: u64) -> Instant {
        Instant::ZERO + Duration::from_micros(us)
    }

    fn report(done: u64, missed: u64, lag_us: u64) -> TickReport {
        TickReport {
            channel: ChannelRef { id: 1024, epoch: 1 },
            target: 1,
            is_own: true,
            lag: Duration::from_micros(lag_us),
            done,
            missed,
            divisor: 1,
        }
    }

    /// What is wrong with a report, as the next tick shows it.
    fn wrong(mut pace: Pace, report: TickReport, left: Instant) -> bool {
        pace.told(report, left);
        pace.tick(21, at(210_000)).is_some()
    }

    /// A follower of ticks every 10 ms that is done after 1 ms, but for one that it is never done with.
    fn followed() -> Pace {
        let mut pace = Pace::begin(1);
        pace.told(report(5, 1, 0), at(1));
        for sequence in 1..=20 {
            assert_eq!(pace.tick(sequence, at(sequence * 10_000)), None);
            if sequence != 3 {
                pace.done(sequence, at(sequence * 10_000 + 1000));
            }
        }
        pace
    }

    #[test]
    fn what_is_so_may_be_told_and_nothing_else() {
        assert!(!wrong(followed(), report(24, 2, 1000), at(205_000)));
        for told in [report(23, 2, 1000), report(24, 1, 1000), report(24, 3, 1000), report(24, 2, 999)] {
            assert!(wrong(followed(), told, at(205_000)), "{told:?}");
        }
        for moment in [at(200_000), at(201_000), at(210_000)] {
            assert!(!wrong(followed(), report(0, 0, 0), moment), "something else happened at {moment}");
        }
    }

    #[test]
    fn a_divisor_is_told_in_time() {
        let mut pace = followed();
        let mut ticks = (11..200).map(|half| pace.tick(half * 2, at(half * 20_000)));
        assert!(ticks.any(|wrong| wrong.is_some()));
    }
}
