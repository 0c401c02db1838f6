//! Ending a wait from another thread, and the shorter sleep of a loop that has no descriptor to wait for.

use super::Wake;
use crate::sys::timer;
use std::io;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread::Thread;
use std::time::Duration;

/// What the loop is doing, so that a wake costs no system call that is not needed.
const AWAKE: u8 = 0;
/// It sleeps in the poll.
const POLLING: u8 = 1;
/// It sleeps as a thread of which nobody wants anything but a wake.
const PARKED: u8 = 2;

/// Wakes one loop. The loop says how it is about to sleep and then looks whether it was woken; who wakes it
/// says so and then looks how it sleeps. In the one order of these accesses one of the two sees the other.
#[derive(Debug)]
pub(super) struct RealWaker {
    poll: mio::Waker,
    sleeper: Thread,
    doing: AtomicU8,
    woken: AtomicBool,
}

impl RealWaker {
    /// For the loop of the calling thread.
    pub(super) fn new(poll: mio::Waker) -> RealWaker {
        RealWaker {
            poll,
            sleeper: std::thread::current(),
            doing: AtomicU8::new(AWAKE),
            woken: AtomicBool::new(false),
        }
    }

    /// Sleeps until a wake, or until the monotonic clock reads `end_ns`. It is the shortest way back from the
    /// kernel: a poll wakes its thread first, and then looks through its list for what was ready.
    pub(super) fn park(&self, end_ns: Option<u64>) {
        self.doing.store(PARKED, Ordering::SeqCst);
        // A thread may be unparked by anybody, and without a reason: what counts is the flag.
        while !self.woken.swap(false, Ordering::SeqCst) {
            match end_ns.map(|end| end.saturating_sub(timer::monotonic_ns())) {
                None => std::thread::park(),
                Some(0) => break,
                Some(left) => std::thread::park_timeout(Duration::from_nanos(left)),
            }
        }
        self.doing.store(AWAKE, Ordering::SeqCst);
    }

    /// Runs a poll that sleeps; answers `None` without it if a wake has come already.
    pub(super) fn while_polling<R>(&self, poll: impl FnOnce() -> R) -> Option<R> {
        self.doing.store(POLLING, Ordering::SeqCst);
        let polled = if self.woken.load(Ordering::SeqCst) { None } else { Some(poll()) };
        self.doing.store(AWAKE, Ordering::SeqCst);
        polled
    }

    /// Whether there was a wake since the last time this was asked, or since the last `park`.
    pub(super) fn take_wake(&self) -> bool {
        self.woken.load(Ordering::SeqCst) && self.woken.swap(false, Ordering::SeqCst)
    }
}

impl Wake for RealWaker {
    fn wake(&self) {
        self.woken.store(true, Ordering::SeqCst);
        let outcome = match self.doing.load(Ordering::SeqCst) {
            PARKED => {
                self.sleeper.unpark();
                Ok(())
            }
            POLLING => self.poll.wake(),
            // It looks at the flag before it sleeps again.
            _ => Ok::<(), io::Error>(()),
        };
        if let Err(error) = outcome {
            // An eventfd that is open can always be written; if not, the loop still comes round by its
            // own time-out.
            tracing::error!(%error, "a loop could not be woken");
        }
    }
}
