//! Blocking work away from the loop.

use crate::Cx;
use crate::object::Here;
use crate::signal::{SlotFor, SlotRef, Target};
use crate::thread::Message;

/// Why a job was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("too many jobs wait for a worker ({max})", max = crate::world::JOBS_WAITING_MAX)]
pub struct WorkError;

impl Cx {
    /// Runs blocking work (disk, hashing, name look-up) on a worker and brings its result back as a call of a
    /// slot: `cx.work(move || std::fs::read(path).ok(), this.slots().on_read())`. If the object is gone by
    /// then the result is dropped and counted. If the job panics nobody is called; the panic is logged.
    ///
    /// # Errors
    /// If too many jobs wait.
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
        let back = self.here(id);
        let job = move || {
            let result = job();
            // The loop may have ended meanwhile: then nobody waits for the result.
            let _ = back.mailbox.post_anyway(Message::Run(Box::new(move |cx| {
                cx.call_slot::<R>(back.id, S::META.uid, &result);
            })));
        };
        self.world.worker.run(Box::new(job)).map_err(|_| WorkError)
    }
}
