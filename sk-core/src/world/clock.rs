//! Time.

use crate::sys::timer;
use sk_flat::Instant;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// A monotonic clock and the two ways of waiting on it.
///
/// Reading the real clock costs tens of nanoseconds: a loop reads it at the steps of a round and hands the
/// instant on.
pub trait Clock: Send + Sync {
    /// The present.
    fn now(&self) -> Instant;

    /// Time since 1970-01-01 00:00 UTC. It may jump when the operator sets the machine's clock; use it
    /// for labels only.
    fn since_epoch(&self) -> Duration;

    /// Waits for `span`, as the papers' `usleep`: never shorter, as much longer as the kernel likes.
    fn sleep(&self, span: Duration);

    /// Waits until the absolute instant `until`; returns at once if it has passed.
    fn sleep_until(&self, until: Instant);
}

/// The machine's CLOCK_MONOTONIC, counted from the moment this value was made.
///
/// Instants of two of them must not be compared: the loops of an application share one.
///
/// ```
/// use sk_core::world::{Clock, RealClock};
/// use std::time::Duration;
///
/// let clock = RealClock::new();
/// let due = clock.now() + Duration::from_micros(50);
/// clock.sleep_until(due);
/// assert!(clock.now() >= due);
/// ```
#[derive(Debug)]
pub struct RealClock {
    origin_ns: u64,
}

impl RealClock {
    /// A clock that begins now.
    pub fn new() -> RealClock {
        RealClock { origin_ns: timer::monotonic_ns() }
    }
}

impl Default for RealClock {
    fn default() -> RealClock {
        RealClock::new()
    }
}

impl Clock for RealClock {
    fn now(&self) -> Instant {
        Instant::from_nanos(timer::monotonic_ns().saturating_sub(self.origin_ns))
    }

    fn since_epoch(&self) -> Duration {
        // A machine whose clock stands before 1970 has not been set; zero is as good a label as any.
        SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default()
    }

    fn sleep(&self, span: Duration) {
        if !span.is_zero() {
            timer::sleep(span);
        }
    }

    fn sleep_until(&self, until: Instant) {
        timer::sleep_until(self.origin_ns.saturating_add(until.as_nanos()));
    }
}

/// Where the calendar of simulated worlds begins: 2024-01-01 00:00 UTC.
const SIMULATED_EPOCH: Duration = Duration::from_secs(1_704_067_200);

/// A clock that moves only when it is told to, and never back.
///
/// Waiting on it returns at once with the clock at the end of the wait, so a slot that sleeps takes
/// exactly that much virtual time.
///
/// ```
/// use sk_core::world::{Clock, SimulatedClock};
/// use std::time::Duration;
///
/// let clock = SimulatedClock::new();
/// clock.sleep(Duration::from_secs(3600));
/// assert_eq!(clock.now().as_nanos(), 3_600_000_000_000);
/// ```
#[derive(Debug, Default)]
pub struct SimulatedClock {
    now_ns: AtomicU64,
}

impl SimulatedClock {
    /// A clock that stands at [`Instant::ZERO`].
    pub fn new() -> SimulatedClock {
        SimulatedClock::default()
    }

    /// Moves it on by `span`.
    pub fn advance(&self, span: Duration) {
        self.set(self.now() + span);
    }

    /// Moves it on to `to`; does nothing if that is past.
    pub fn set(&self, to: Instant) {
        // One thread steps a simulation, so the order against other memory does not matter.
        self.now_ns.fetch_max(to.as_nanos(), Ordering::Relaxed);
    }
}

impl Clock for SimulatedClock {
    fn now(&self) -> Instant {
        Instant::from_nanos(self.now_ns.load(Ordering::Relaxed))
    }

    fn since_epoch(&self) -> Duration {
        SIMULATED_EPOCH + self.now().since(Instant::ZERO)
    }

    fn sleep(&self, span: Duration) {
        self.advance(span);
    }

    fn sleep_until(&self, until: Instant) {
        self.set(until);
    }
}
