//! The monotonic clock, waiting on it, and the timer that ends a poll.

use nix::errno::Errno;
use nix::sys::prctl;
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{ClockId as TimerClock, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags};
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};
use std::io;
use std::os::fd::{AsFd, AsRawFd, RawFd};
use std::time::Duration;

/// The longest wait that is asked of the kernel: 100 years, far below where its types overflow.
const WAIT_SECONDS_MAX: u64 = 100 * 365 * 86_400;

/// CLOCK_MONOTONIC in nanoseconds since the machine was started.
pub(crate) fn monotonic_ns() -> u64 {
    // The call fails only for a clock that the kernel does not have, and every Linux has this one.
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("the kernel has CLOCK_MONOTONIC");
    // Neither is negative, and 64 bits of nanoseconds are 584 years.
    now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64
}

/// Waits for `span` from now on, whatever signal handlers run meanwhile.
pub(crate) fn sleep(span: Duration) {
    let span = span.min(Duration::from_secs(WAIT_SECONDS_MAX));
    let end_ns = monotonic_ns().saturating_add(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX));
    let request = TimeSpec::from_duration(span);
    if clock_nanosleep(ClockId::CLOCK_MONOTONIC, ClockNanosleepFlags::empty(), &request).is_err() {
        // Interrupted: the rest is waited for absolutely, so that repeated signals cannot stretch it.
        sleep_until(end_ns);
    }
}

/// Waits until CLOCK_MONOTONIC reads `end_ns`; returns at once if it is past.
pub(crate) fn sleep_until(end_ns: u64) {
    let request = TimeSpec::from_duration(absolute(end_ns));
    let flags = ClockNanosleepFlags::TIMER_ABSTIME;
    while clock_nanosleep(ClockId::CLOCK_MONOTONIC, flags, &request) == Err(Errno::EINTR) {}
}

/// A point of CLOCK_MONOTONIC in the kernel's shape, within what it can represent.
fn absolute(ns: u64) -> Duration {
    Duration::from_nanos(ns).min(Duration::from_secs(WAIT_SECONDS_MAX))
}

/// Lets the kernel wake this thread at most `slack_ns` late in order to join wake-ups; 1 is the least.
/// Needs no privilege. Threads of a real-time class have no slack whatever this says.
pub(crate) fn set_slack_ns(slack_ns: u32) -> io::Result<()> {
    Ok(prctl::set_timerslack(libc::c_ulong::from(slack_ns))?)
}

/// A timerfd: readable from the instant it was armed for.
///
/// It is never read. Arming sets its count of expirations back to zero, which is all that an
/// edge-triggered poll needs.
#[derive(Debug)]
pub(crate) struct PollTimer {
    timer: TimerFd,
}

impl PollTimer {
    pub(crate) fn new() -> io::Result<PollTimer> {
        let flags = TimerFlags::TFD_CLOEXEC | TimerFlags::TFD_NONBLOCK;
        Ok(PollTimer { timer: TimerFd::new(TimerClock::CLOCK_MONOTONIC, flags)? })
    }

    /// Expires when CLOCK_MONOTONIC reads `end_ns`, at once if that is past.
    pub(crate) fn arm(&self, end_ns: u64) -> io::Result<()> {
        // Zero would disarm it.
        let end = TimeSpec::from_duration(absolute(end_ns.max(1)));
        Ok(self.timer.set(Expiration::OneShot(end), TimerSetTimeFlags::TFD_TIMER_ABSTIME)?)
    }

    pub(crate) fn disarm(&self) -> io::Result<()> {
        Ok(self.timer.unset()?)
    }

    /// For the registration with a poll only.
    pub(crate) fn raw_fd(&self) -> RawFd {
        self.timer.as_fd().as_raw_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slack_of_this_thread_is_set() {
        set_slack_ns(1).unwrap();
        assert_eq!(prctl::get_timerslack(), Ok(1));
    }

    #[test]
    fn a_far_end_is_within_what_the_kernel_takes() {
        let timer = PollTimer::new().unwrap();
        timer.arm(u64::MAX).unwrap();
        timer.arm(0).unwrap();
        timer.disarm().unwrap();
    }
}
