//! Blocking work at simulated later times.

use super::{JOBS_WAITING_MAX, Job, Worker, run_contained};
use crate::world::{Clock, SimulatedClock, SimulatedRng};
use sk_flat::Instant;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A job takes from 1 ms …
const LATENCY_MIN: Duration = Duration::from_millis(1);
/// … to less than 5 ms, drawn from the seed: what a disk needs for a synchronisation.
const LATENCY_SPAN: Duration = Duration::from_millis(4);

/// Keeps each job until its virtual time has come and the scheduler runs it.
///
/// ```
/// use sk_core::world::{Clock, SimulatedWorld, Worker};
/// use std::sync::mpsc;
///
/// let world = SimulatedWorld::new(1);
/// let (done, outcome) = mpsc::channel();
/// assert!(world.worker().run(Box::new(move || done.send(42).expect("kept"))).is_ok());
/// let due = world.worker().next_due().expect("one job waits");
/// assert_eq!(world.worker().run_due(world.clock().now()), 0); // not yet
/// world.clock().set(due);
/// assert_eq!((world.worker().run_due(due), outcome.recv()), (1, Ok(42)));
/// ```
pub struct SimulatedWorker {
    clock: Arc<SimulatedClock>,
    jobs: Mutex<Jobs>,
}

struct Jobs {
    rng: SimulatedRng,
    taken: u64,
    waiting: BTreeMap<(Instant, u64), Job>,
}

impl SimulatedWorker {
    pub(crate) fn new(clock: Arc<SimulatedClock>, rng: SimulatedRng) -> SimulatedWorker {
        SimulatedWorker { clock, jobs: Mutex::new(Jobs { rng, taken: 0, waiting: BTreeMap::new() }) }
    }

    /// When the next job is to be run.
    pub fn next_due(&self) -> Option<Instant> {
        self.jobs().waiting.first_key_value().map(|(&(due, _), _)| due)
    }

    /// Runs the jobs that are due at `now`, in order of their due times, and answers how many.
    pub fn run_due(&self, now: Instant) -> usize {
        let mut count = 0;
        loop {
            // The lock ends with this statement: a job may hand over another one.
            let job = self.jobs().take_due(now);
            let Some(job) = job else { return count };
            run_contained(job);
            count += 1;
        }
    }

    /// Runs everything that waits, and what that hands over, whenever it would be due.
    pub(crate) fn finish(&self) {
        loop {
            let job = self.jobs().waiting.pop_first();
            let Some((_, job)) = job else { return };
            run_contained(job);
        }
    }

    /// The process ends: each job that waits is lost, done, or half done. For the last one `limit` is told how
    /// many operations of the disk it gets before the process is no more.
    pub(crate) fn give_up(&self, rng: &mut SimulatedRng, limit: impl Fn(u64)) {
        let waiting = std::mem::take(&mut self.jobs().waiting);
        for job in waiting.into_values() {
            match rng.below(4) {
                0 | 1 => drop(job),
                2 => run_contained(job),
                _ => {
                    limit(rng.below(6));
                    run_contained(job);
                }
            }
        }
    }

    fn jobs(&self) -> MutexGuard<'_, Jobs> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Jobs {
    fn take_due(&mut self, now: Instant) -> Option<Job> {
        let first = self.waiting.first_entry()?;
        (first.key().0 <= now).then(|| first.remove())
    }
}

impl Worker for SimulatedWorker {
    fn run(&self, job: Job) -> Result<(), Job> {
        let mut jobs = self.jobs();
        if jobs.waiting.len() >= JOBS_WAITING_MAX {
            return Err(job);
        }
        let extra_ns = jobs.rng.below(LATENCY_SPAN.as_nanos() as u64);
        let due = self.clock.now() + LATENCY_MIN + Duration::from_nanos(extra_ns);
        jobs.taken += 1;
        let number = jobs.taken;
        jobs.waiting.insert((due, number), job);
        Ok(())
    }
}

impl fmt::Debug for SimulatedWorker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SimulatedWorker")
            .field("waiting", &self.jobs().waiting.len())
            .finish()
    }
}
