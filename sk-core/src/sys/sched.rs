//! Scheduling of the calling thread, and the guard against a real-time thread that never sleeps.
#![allow(unsafe_code)]

use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use nix::sys::signal::{SaFlags, SigAction, SigHandler, SigSet, Signal, sigaction};
use nix::unistd::Pid;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// How the kernel chooses among threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Policy {
    /// SCHED_OTHER, the normal time-sharing class.
    #[default]
    Other,
    /// SCHED_FIFO with a priority of 1 to 99: runs before every thread of a lower one until it sleeps.
    Fifo(u8),
    /// SCHED_RR with a priority of 1 to 99: as `Fifo`, but threads of one priority take turns.
    RoundRobin(u8),
}

/// How many threads the guard has put back into the normal class since the process began.
static DEMOTIONS: AtomicU64 = AtomicU64::new(0);

/// The limit that was set last.
static RUN_MAX_US: AtomicU64 = AtomicU64::new(u64::MAX);

/// Sets the calling thread's class. A real-time class needs CAP_SYS_NICE or an RLIMIT_RTPRIO of at least
/// the priority; going back to `Other` needs nothing.
///
/// A real-time class is taken together with a guard: when a real-time thread of the process has run for
/// `run_max` without sleeping, the kernel signals it and the handler puts it back into the normal class,
/// counted by [`demotions`]. The limit is the process's (RLIMIT_RTTIME) and the last call decides it.
///
/// # Errors
/// `PermissionDenied` without the privilege, `InvalidInput` for a priority out of range. The class is
/// then as before.
pub(crate) fn set_policy(policy: Policy, run_max: Duration) -> io::Result<()> {
    let (class, priority) = match policy {
        Policy::Other => return set_class(libc::SCHED_OTHER, 0),
        Policy::Fifo(priority) => (libc::SCHED_FIFO, priority),
        Policy::RoundRobin(priority) => (libc::SCHED_RR, priority),
    };
    // The class first: a call that is refused must not change the limit of threads that have one.
    set_class(class, libc::c_int::from(priority))?;
    guard(u64::try_from(run_max.as_micros()).unwrap_or(u64::MAX)).inspect_err(|_| {
        // Never in a real-time class without the guard; leaving it is always allowed.
        let _ = set_class(libc::SCHED_OTHER, 0);
    })
}

fn set_class(class: libc::c_int, priority: libc::c_int) -> io::Result<()> {
    let parameters = scheduling_parameters(priority);
    // SAFETY: 0 names the calling thread, and the pointer is to a live, wholly initialised structure that
    // the kernel only reads.
    let outcome = unsafe { libc::sched_setscheduler(0, class, &raw const parameters) };
    if outcome == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

fn scheduling_parameters(priority: libc::c_int) -> libc::sched_param {
    // SAFETY: the structure consists of integers only (musl has more of them than glibc, which is why it
    // is not written out), and all zeros is a value of each.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = priority;
    parameters
}

/// How often the guard had to act.
pub(crate) fn demotions() -> u64 {
    DEMOTIONS.load(Ordering::Relaxed)
}

fn guard(run_max_us: u64) -> io::Result<()> {
    let action = SigAction::new(SigHandler::Handler(demote), SaFlags::SA_RESTART, SigSet::empty());
    // SAFETY: the handler does nothing but atomic accesses and bare system calls (no allocation, no lock),
    // and keeps errno. Nobody else in the process handles SIGXCPU.
    unsafe { sigaction(Signal::SIGXCPU, &action) }?;
    RUN_MAX_US.store(run_max_us, Ordering::Relaxed);
    set_limit(run_max_us)
}

/// The hard limit kills the process and cannot be raised again without privilege: left as it is.
fn set_limit(run_max_us: u64) -> io::Result<()> {
    let (_, hard) = getrlimit(Resource::RLIMIT_RTTIME)?;
    // Limits have 32 bits on some machines; the detour makes one conversion of both cases.
    let run_max_us = libc::rlim_t::try_from(u128::from(run_max_us)).unwrap_or(libc::rlim_t::MAX);
    Ok(setrlimit(Resource::RLIMIT_RTTIME, run_max_us.min(hard), hard)?)
}

/// Runs on the thread that exceeded the limit: the kernel prefers the offender for the signal.
extern "C" fn demote(_signal: libc::c_int) {
    let before = io::Error::last_os_error().raw_os_error();
    if set_class(libc::SCHED_OTHER, 0).is_ok() {
        DEMOTIONS.fetch_add(1, Ordering::Relaxed);
    }
    // With each signal the kernel moves the limit one second on, for all threads.
    let _ = set_limit(RUN_MAX_US.load(Ordering::Relaxed));
    nix::errno::Errno::set_raw(before.unwrap_or(0));
}

/// Binds the calling thread to the processors named by number. Needs no privilege.
///
/// # Errors
/// `InvalidInput` if none of them exists or may be used.
pub(crate) fn set_affinity(processors: &[usize]) -> io::Result<()> {
    let mut set = CpuSet::new();
    for &processor in processors {
        set.set(processor)?;
    }
    Ok(sched_setaffinity(Pid::from_raw(0), &set)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sched::sched_getaffinity;

    /// Each test has a thread of its own, so nothing has to be put back.
    #[test]
    fn a_thread_can_be_bound_to_one_of_its_processors() {
        let mine = sched_getaffinity(Pid::from_raw(0)).unwrap();
        let last = (0..CpuSet::count()).rfind(|&n| mine.is_set(n).unwrap()).unwrap();
        set_affinity(&[last]).unwrap();
        let bound = sched_getaffinity(Pid::from_raw(0)).unwrap();
        let count = (0..CpuSet::count()).filter(|&n| bound.is_set(n).unwrap()).count();
        assert_eq!((count, bound.is_set(last)), (1, Ok(true)));
        assert_eq!(set_affinity(&[]).unwrap_err().kind(), io::ErrorKind::InvalidInput);
    }

    #[test]
    fn a_priority_out_of_range_is_refused() {
        let second = Duration::from_secs(1);
        assert_eq!(set_policy(Policy::Fifo(0), second).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        assert_eq!(set_policy(Policy::Fifo(100), second).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        set_policy(Policy::Other, second).unwrap();
    }

    /// Without the privilege the refusal itself is what is shown.
    #[test]
    fn a_real_time_thread_that_never_sleeps_is_put_back_into_the_normal_class() {
        let before = demotions();
        if let Err(refused) = set_policy(Policy::Fifo(1), Duration::from_millis(20)) {
            assert_eq!(refused.kind(), io::ErrorKind::PermissionDenied);
            return;
        }
        let (limit, _) = getrlimit(Resource::RLIMIT_RTTIME).unwrap();
        for offence in 1..=2 {
            while demotions() < before + offence {
                std::hint::spin_loop();
            }
            // SAFETY: 0 names the calling thread; the call takes no pointer.
            assert_eq!(unsafe { libc::sched_getscheduler(0) }, libc::SCHED_OTHER);
            while getrlimit(Resource::RLIMIT_RTTIME).unwrap().0 != limit {
                std::hint::spin_loop();
            }
            set_policy(Policy::RoundRobin(1), Duration::from_millis(20)).unwrap();
        }
        set_policy(Policy::Other, Duration::ZERO).unwrap();
    }
}
