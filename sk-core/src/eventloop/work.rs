//! Blocking work away from the loop.

use crate::Cx;
use crate::object::Here;
use crate::signal::{SlotFor, SlotRef, Target};

/// Why a job was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "too many jobs wait for a worker (the most is {max}), or too many results for the loop",
    max = crate::world::JOBS_WAITING_MAX
)]
pub struct WorkError;

impl Cx {
    /// Runs blocking work (disk, hashing, name look-up) on a worker and brings its result back as a call of a
    /// slot: `cx.work(move || std::fs::read(path).ok(), this.slots().on_read())`. If the object is gone by
    /// then the result is dropped and counted. If the job panics nobody is called; the panic is logged.
    ///
    /// # Errors
    /// If too many jobs wait, or as many results as the mailbox holds messages are outstanding.
    pub fn work<R, S>(
        &mut self,
        job: impl FnOnce() -> R + Send + 'static,
        answer: SlotRef<S, Here>,
    ) -> Result<(), WorkError>
    where
        R: Clone + Send + 'static,
        S: SlotFor<R>,
    {
        let Target::Local(id) = answer.target() else { return Err(WorkError) };
        let place = self.own_mailbox().promise().map_err(|_| WorkError)?;
        let job = move || {
            let result = job();
            place.keep(move |cx| cx.call_slot::<R>(id, S::META.uid, &result));
        };
        self.world.worker.run(Box::new(job)).map_err(|_| WorkError)
    }
}
