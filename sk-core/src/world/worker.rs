//! Blocking work: disk, hashing, name look-up.

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
