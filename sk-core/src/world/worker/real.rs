//! A small pool of threads.

use super::{JOBS_WAITING_MAX, Job, Worker, run_contained};
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, JoinHandle};

/// How many jobs run side by side: one slow disk does not hold up a password check.
const THREADS: usize = 2;

/// Runs jobs on up to two threads named `sk-worker-0` and `-1`, which start with the first jobs.
///
/// A job that panics is logged and costs nobody else anything. Dropping the pool first runs what still
/// waits, because a save that was asked for is to happen, and then joins the threads.
///
/// ```
/// use sk_core::world::{RealWorker, Worker};
/// use std::sync::mpsc;
///
/// let (done, outcome) = mpsc::channel();
/// let worker = RealWorker::new();
/// let taken = worker.run(Box::new(move || done.send(6 * 7).expect("the test waits")));
/// assert!(taken.is_ok());
/// assert_eq!(outcome.recv(), Ok(42));
/// ```
#[derive(Debug)]
pub struct RealWorker {
    /// `None` only while it is being dropped.
    jobs: Option<Sender<Job>>,
    waiting: Receiver<Job>,
    started: AtomicUsize,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

impl RealWorker {
    /// A pool without threads as yet.
    pub fn new() -> RealWorker {
        let (jobs, waiting) = bounded(JOBS_WAITING_MAX);
        let threads = Mutex::new(Vec::with_capacity(THREADS));
        RealWorker { jobs: Some(jobs), waiting, started: AtomicUsize::new(0), threads }
    }

    /// Starts one more thread, if there are too few; answers whether there is any.
    fn start_thread(&self) -> bool {
        let mut threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
        if threads.len() < THREADS {
            let waiting = self.waiting.clone();
            let name = format!("sk-worker-{}", threads.len());
            match thread::Builder::new()
                .name(name)
                .spawn(move || waiting.iter().for_each(run_contained))
            {
                Ok(thread) => threads.push(thread),
                Err(error) => tracing::error!(%error, "no thread could be started for blocking work"),
            }
            self.started.store(threads.len(), Ordering::Release);
        }
        !threads.is_empty()
    }
}

impl Default for RealWorker {
    fn default() -> RealWorker {
        RealWorker::new()
    }
}

impl Worker for RealWorker {
    fn run(&self, job: Job) -> Result<(), Job> {
        if self.started.load(Ordering::Acquire) < THREADS && !self.start_thread() {
            return Err(job);
        }
        let Some(jobs) = &self.jobs else { return Err(job) };
        jobs.try_send(job).map_err(TrySendError::into_inner)
    }
}

impl Drop for RealWorker {
    fn drop(&mut self) {
        // Without a sender the threads end once nothing waits any more.
        self.jobs = None;
        let threads = std::mem::take(self.threads.get_mut().unwrap_or_else(PoisonError::into_inner));
        for thread in threads {
            // A job may have held the last reference to the pool: its thread cannot wait for itself.
            if thread.thread().id() != thread::current().id() && thread.join().is_err() {
                tracing::error!("a worker's thread ended by a panic outside of a job");
            }
        }
    }
}
