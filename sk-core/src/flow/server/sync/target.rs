//! How one target of a sync channel keeps up, measured on the hub's clock alone.

use super::super::ConnectionId;
use crate::flow::limits::{SYNC_GOOD_TIME_MAX, SYNC_GOOD_TIME_MIN};
use crate::testing::{Bug, is_planted};
use sk_flat::Instant;
use std::collections::VecDeque;
use std::time::Duration;

/// How many ticks without an answer are remembered, to tell how late a late one is.
const UNANSWERED_MAX: usize = 8;
/// A missed tick counts so much against a target, and a done one 1 for it: who misses more than a third fails.
const MISS_WEIGHT: u32 = 2;
/// Where it counts as failing.
const FAILING: u32 = 8;
/// The largest divisor.
const DIVISOR_MAX: u8 = 4;

/// A target of a sync channel.
#[derive(Debug)]
pub(super) struct Target {
    pub(in super::super) connection: ConnectionId,
    /// Of its subscription.
    pub(in super::super) slot: usize,
    /// Whether the hub chooses the divisor.
    auto: bool,
    divisor: u8,
    /// The last tick of the source, whether it was for this target or not.
    seen: Option<u64>,
    /// The tick that is still to be done in time.
    pending: Option<u64>,
    /// Ticks that were sent and not answered, oldest first.
    unanswered: VecDeque<(u64, Instant)>,
    done: u64,
    missed: u64,
    /// The longest since the last report.
    lag: Duration,
    reported: Instant,
    has_news: bool,
    against: u32,
    /// The ticks since then were all done in time, the slowest of them with this lag.
    good_since: Instant,
    good_lag: Duration,
    /// How long that must last before it gets more ticks.
    good_time: Duration,
    /// The source's interval.
    period: Duration,
}

/// What is told of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Report {
    pub(super) lag: Duration,
    pub(in super::super) done: u64,
    pub(in super::super) missed: u64,
    pub(in super::super) divisor: u8,
}

impl Target {
    pub(in super::super) fn new(connection: ConnectionId, slot: usize, wish: u8, now: Instant) -> Target {
        Target {
            connection,
            slot,
            auto: wish == 0,
            divisor: wish.max(1),
            seen: None,
            pending: None,
            unanswered: VecDeque::new(),
            done: 0,
            missed: 0,
            lag: Duration::ZERO,
            reported: now,
            has_news: false,
            against: 0,
            good_since: now,
            good_lag: Duration::ZERO,
            good_time: SYNC_GOOD_TIME_MIN,
            period: Duration::ZERO,
        }
    }

    /// The target wants another divisor.
    pub(in super::super) fn wish(&mut self, wish: u8, now: Instant) {
        self.auto = wish == 0;
        if !self.auto {
            self.divide_by(wish, now);
        }
    }

    /// A tick of the source; answers whether it is for this target. A tick that the target has not done by then
    /// is missed, and so is one that the source left out.
    pub(in super::super) fn tick(&mut self, sequence: u64, period: Duration, now: Instant) -> bool {
        self.period = period;
        let divisor = u64::from(self.divisor);
        let passed = match self.seen.replace(sequence) {
            Some(seen) => sequence / divisor - seen / divisor,
            None => u64::from(sequence.is_multiple_of(divisor)),
        };
        if passed == 0 {
            return false;
        }
        self.has_news = true;
        self.missed += passed - 1;
        if self.pending.take().is_some() {
            self.missed += u64::from(!(is_planted(Bug::MissUncounted) && sequence % 4 == 3));
            self.failed(now);
        }
        if self.unanswered.len() == UNANSWERED_MAX {
            self.unanswered.pop_front();
        }
        self.unanswered.push_back((sequence, now));
        self.pending = Some(sequence);
        true
    }

    /// The target has done a tick. One that comes late was counted as missed; only its lag is noted.
    pub(in super::super) fn done(&mut self, sequence: u64, now: Instant) {
        let Some(place) = self.unanswered.iter().position(|(sent, _)| *sent == sequence) else { return };
        let lag = now.since(self.unanswered[place].1);
        self.unanswered.drain(..=place);
        self.lag = self.lag.max(lag);
        if self.pending == Some(sequence) {
            self.pending = None;
            self.done += 1;
            self.kept_up(lag, now);
        }
    }

    fn failed(&mut self, now: Instant) {
        self.against = (self.against + MISS_WEIGHT).min(FAILING);
        self.good_since = now;
        self.good_lag = Duration::ZERO;
        if self.auto && self.against >= FAILING && self.divisor < DIVISOR_MAX {
            self.good_time = (self.good_time * 2).min(SYNC_GOOD_TIME_MAX);
            self.divide_by(self.divisor * 2, now);
        }
    }

    fn kept_up(&mut self, lag: Duration, now: Instant) {
        self.against = self.against.saturating_sub(1);
        self.good_lag = self.good_lag.max(lag);
        if now.since(self.good_since) < self.good_time {
            return;
        }
        // It must fit into the shorter time, with a quarter to spare.
        let shorter = self.period * u32::from(self.divisor) / 2;
        if self.auto && self.divisor > 1 && self.good_lag * 4 <= shorter * 3 {
            self.divide_by(self.divisor / 2, now);
        } else if self.divisor == 1 {
            self.good_time = SYNC_GOOD_TIME_MIN;
        }
        self.good_since = now;
        self.good_lag = Duration::ZERO;
    }

    fn divide_by(&mut self, divisor: u8, now: Instant) {
        self.divisor = divisor;
        self.against = 0;
        self.good_since = now;
        self.good_lag = Duration::ZERO;
        self.has_news = true;
    }

    /// What there is to tell, if something is and the last report is old enough. A tick that is not done yet
    /// shows in the lag, so that a target that hangs is seen to.
    pub(in super::super) fn report(&mut self, now: Instant, every: Duration) -> Option<Report> {
        if !self.has_news || now.since(self.reported) < every {
            return None;
        }
        self.has_news = false;
        self.reported = now;
        let overdue = self.unanswered.front().map_or(Duration::ZERO, |(_, sent)| now.since(*sent));
        let lag = std::mem::take(&mut self.lag);
        // The newest may well be on its way.
        let lag = if self.unanswered.len() > 1 { lag.max(overdue) } else { lag };
        let divisor = if is_planted(Bug::DivisorUntold) { 1 } else { self.divisor };
        Some(Report { lag, done: self.done, missed: self.missed, divisor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PERIOD: Duration = Duration::from_millis(10);

    fn at(us: u64) -> Instant {
        Instant::ZERO + Duration::from_micros(us)
    }

    fn target(wish: u8) -> Target {
        Target::new(ConnectionId::from_wire(1 << 32), 0, wish, at(0))
    }

    /// Runs so many ticks of 10 ms against a target that needs so long for each one it gets, does them one after
    /// the other and takes the newest. Answers the divisors it had.
    fn run(target: &mut Target, ticks: std::ops::Range<u64>, needs_us: u64) -> Vec<u8> {
        let (mut busy_until, mut waiting, mut running) = (0, None, None);
        let mut divisors = vec![target.divisor];
        for sequence in ticks {
            let now = sequence * 10_000;
            if let Some(done) = running.filter(|_| busy_until <= now) {
                target.done(done, at(busy_until));
                running = waiting.take();
                busy_until += needs_us;
            }
            if target.tick(sequence, PERIOD, at(now)) {
                if running.is_none() {
                    (running, busy_until) = (Some(sequence), now + needs_us);
                } else {
                    waiting = Some(sequence);
                }
            }
            if divisors.last() != Some(&target.divisor) {
                divisors.push(target.divisor);
            }
        }
        divisors
    }

    #[test]
    fn who_keeps_up_has_no_miss_and_its_lag_is_the_longest_since_the_report() {
        let mut target = target(1);
        run(&mut target, 0..100, 3000);
        let second = Duration::from_secs(1);
        let report = target.report(at(1_000_000), second).expect("a second has passed");
        assert_eq!(report, Report { lag: Duration::from_millis(3), done: 99, missed: 0, divisor: 1 });
        assert_eq!(target.report(at(3_000_000), second), None, "nothing happened since");
    }

    #[test]
    fn s164_who_is_too_slow_is_divided_down_only_if_it_left_that_to_the_hub() {
        for (wish, divisors) in [(0, vec![1, 2, 4]), (1, vec![1]), (2, vec![2])] {
            let mut target = target(wish);
            assert_eq!(run(&mut target, 0..300, 33_000), divisors);
            assert!(target.missed > 0);
        }
        let mut target = target(0);
        assert_eq!(run(&mut target, 0..300, 15_000), [1, 2]);
        let missed = target.missed;
        run(&mut target, 300..600, 15_000);
        assert!(target.missed <= missed + 1, "now it keeps up but for what is under way between two runs");
    }

    #[test]
    fn who_has_kept_up_for_a_while_gets_more_ticks_again_and_later_each_time_it_fails() {
        let mut target = target(0);
        run(&mut target, 0..100, 15_000);
        assert_eq!(target.good_time, SYNC_GOOD_TIME_MIN * 2);
        assert_eq!(run(&mut target, 100..1000, 3000), [2], "not yet");
        assert_eq!(run(&mut target, 1000..1300, 3000), [2, 1]);
        assert_eq!(run(&mut target, 1300..1400, 15_000), [1, 2]);
        assert_eq!(target.good_time, SYNC_GOOD_TIME_MIN * 4);
        assert_eq!(run(&mut target, 1400..9000, 9000), [2], "9 of 10 ms are too near");
    }

    #[test]
    fn what_the_source_left_out_is_missed_and_a_late_done_is_none() {
        let mut target = target(1);
        assert!(target.tick(5, PERIOD, at(0)));
        target.done(5, at(1));
        assert!(target.tick(9, PERIOD, at(40_000)));
        assert_eq!((target.done, target.missed), (1, 3));
        assert!(target.tick(10, PERIOD, at(50_000)));
        target.done(9, at(55_000));
        assert_eq!((target.done, target.missed, target.lag), (1, 4, Duration::from_millis(15)));
        target.done(9, at(56_000));
        target.done(7, at(56_000));
        assert_eq!((target.done, target.missed), (1, 4), "an unknown one changes nothing");
    }

    proptest! {
        #[test]
        fn every_tick_for_a_target_is_done_missed_or_pending(
            wish in prop::sample::select(vec![0_u8, 1, 2, 4]),
            steps in prop::collection::vec((1_u64..4, any::<bool>(), 0_u64..6), 1..300),
        ) {
            let mut target = target(wish);
            let (mut sequence, mut sent, mut left_out) = (0, 0_u64, 0_u64);
            for (step, does, late) in steps {
                let divisor = u64::from(target.divisor);
                let before = target.seen;
                sequence += step;
                if target.tick(sequence, PERIOD, at(sequence * 10_000)) {
                    sent += 1;
                    left_out += before.map_or(0, |before| sequence / divisor - before / divisor - 1);
                }
                if does {
                    target.done(sequence.saturating_sub(late), at(sequence * 10_000 + 1000));
                }
                let pending = u64::from(target.pending.is_some());
                prop_assert_eq!(target.done + target.missed + pending, sent + left_out);
                prop_assert!(target.unanswered.len() <= UNANSWERED_MAX && matches!(target.divisor, 1 | 2 | 4));
            }
        }
    }
}
