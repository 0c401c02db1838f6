//! Instants on a world's clock, and the passive timer that counts between them.

use std::fmt;
use std::ops::{Add, AddAssign, Sub};
use std::time::Duration;

/// A point in time: nanoseconds since the clock it was read from began.
///
/// Instants of different clocks must not be compared; a program has one clock, real or simulated.
/// Arithmetic saturates at both ends instead of wrapping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(u64);

impl Instant {
    /// The beginning of the clock.
    pub const ZERO: Instant = Instant(0);
    /// The farthest instant: it never comes.
    pub const FAR: Instant = Instant(u64::MAX);

    /// The instant `ns` nanoseconds after the clock began.
    pub const fn from_nanos(ns: u64) -> Instant {
        Instant(ns)
    }

    /// Nanoseconds since the clock began.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// The time from `earlier` to this instant; zero if `earlier` is later.
    pub const fn since(self, earlier: Instant) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Duration> for Instant {
    type Output = Instant;
    fn add(self, later: Duration) -> Instant {
        Instant(self.0.saturating_add(u64::try_from(later.as_nanos()).unwrap_or(u64::MAX)))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, later: Duration) {
        *self = *self + later;
    }
}

impl Sub<Duration> for Instant {
    type Output = Instant;
    fn sub(self, before: Duration) -> Instant {
        Instant(self.0.saturating_sub(u64::try_from(before.as_nanos()).unwrap_or(u64::MAX)))
    }
}

impl fmt::Display for Instant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:09} s", self.0 / 1_000_000_000, self.0 % 1_000_000_000)
    }
}

/// A passive timer with nanosecond resolution (`SkElapsedTime` of the papers): it holds a start and
/// answers how long ago that was, given the present. It never reads a clock itself.
///
/// ```
/// use sk_flat::{Instant, SkElapsedTime};
/// use std::time::Duration;
///
/// let mut slow = SkElapsedTime::started(Instant::from_nanos(0));
/// let interval = Duration::from_millis(250);
/// assert!(!slow.restart_if_passed(Instant::from_nanos(200_000_000), interval));
/// assert!(slow.restart_if_passed(Instant::from_nanos(251_000_000), interval));
/// assert_eq!(slow.elapsed(Instant::from_nanos(252_000_000)), Duration::from_millis(1));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkElapsedTime {
    start: Instant,
}

impl SkElapsedTime {
    /// A timer that began at `now`.
    pub const fn started(now: Instant) -> SkElapsedTime {
        SkElapsedTime { start: now }
    }

    /// When the timer began.
    pub const fn start(&self) -> Instant {
        self.start
    }

    /// Begins anew at `now` and answers how long the last span was.
    pub fn restart(&mut self, now: Instant) -> Duration {
        let span = self.elapsed(now);
        self.start = now;
        span
    }

    /// The time from the start to `now`.
    pub const fn elapsed(&self, now: Instant) -> Duration {
        now.since(self.start)
    }

    /// If `interval` has passed at `now`, begins anew at `now` and answers `true`.
    pub fn restart_if_passed(&mut self, now: Instant, interval: Duration) -> bool {
        let passed = self.elapsed(now) >= interval;
        if passed {
            self.start = now;
        }
        passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arithmetic_saturates_at_both_ends() {
        assert_eq!(Instant::FAR + Duration::from_secs(1), Instant::FAR);
        assert_eq!(Instant::ZERO - Duration::from_secs(1), Instant::ZERO);
        assert_eq!(Instant::ZERO.since(Instant::FAR), Duration::ZERO);
        assert_eq!(Instant::ZERO + Duration::MAX, Instant::FAR);
    }

    #[test]
    fn an_instant_prints_seconds() {
        assert_eq!(Instant::from_nanos(1_500_000_000).to_string(), "1.500000000 s");
    }
}
