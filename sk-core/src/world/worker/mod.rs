//! Blocking work: disk, hashing, name look-up.

mod real;
mod simulated;

pub use real::RealWorker;
pub use simulated::SimulatedWorker;

use std::panic::{AssertUnwindSafe, catch_unwind};

/// A piece of blocking work. What it finds it posts to a loop itself.
pub type Job = Box<dyn FnOnce() + Send>;

/// Runs jobs away from the loop: on a small pool of threads in the real world, at a simulated later
/// time in a simulated one. Jobs may run side by side and end in any order.
pub trait Worker: Send + Sync {
    /// Hands a job over.
    ///
    /// # Errors
    /// Gives the job back if too many are waiting ([`JOBS_WAITING_MAX`]).
    fn run(&self, job: Job) -> Result<(), Job>;
}

/// How many jobs may wait for a worker.
pub const JOBS_WAITING_MAX: usize = 1024;

/// Runs one job. A panic ends the job, not the thread, and is logged: whoever waits for what the job was
/// to find learns nothing from it.
fn run_contained(job: Job) {
    if let Err(payload) = catch_unwind(AssertUnwindSafe(job)) {
        let text = payload.downcast_ref::<&str>().copied();
        let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
        tracing::error!(message = text.unwrap_or("(not a text)"), "a job panicked");
    }
}
