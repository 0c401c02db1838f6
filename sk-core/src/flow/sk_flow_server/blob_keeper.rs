//! The server's way to the files of its blob channels: requests go to a worker, which does a bounded piece of work at
//! a time, and the answers come back to the loop.

use super::SkFlowServer;
use crate::Cx;
use crate::flow::blob::{BlobAnswer, BlobRequest, BlobStore};
use crate::object::{Access, Handle};
use crate::thread::Remote;
use crate::world::Job;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How many steps one job does before the loop hears of what is done.
const STEPS_PER_JOB: usize = 16;

/// What loop and worker share. Neither holds a lock while the disk works, but for that of the store itself,
/// which only jobs take.
struct Shared {
    store: Mutex<BlobStore>,
    requests: Mutex<Vec<BlobRequest>>,
    answers: Mutex<Vec<BlobAnswer>>,
    /// The job has ended.
    ended: AtomicBool,
    /// It left something to do.
    more: AtomicBool,
}

pub(super) struct BlobKeeper {
    shared: Arc<Shared>,
    /// A job is under way.
    busy: bool,
    /// The worker had no room for it.
    stalled: Option<Job>,
}

/// A panic elsewhere says nothing against a list of requests.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// On the worker.
    fn work(&self, steps_max: usize) {
        let mut store = locked(&self.store);
        locked(&self.requests).drain(..).for_each(|request| store.take(request));
        for _ in 0..steps_max {
            let answer = match catch_unwind(AssertUnwindSafe(|| store.step_once())) {
                Ok(None) => break,
                Ok(Some(answer)) => answer,
                Err(_) => store.recover(),
            };
            locked(&self.answers).extend(answer);
        }
        self.more.store(!store.is_idle(), Ordering::Release);
        self.ended.store(true, Ordering::Release);
    }
}

impl SkFlowServer {
    /// Hands the core's requests to a job, unless there is one already: then they wait for the next.
    pub(super) fn file_requests(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        let Some(keeper) = &mut self.blob_keeper else { return };
        let has_more = keeper.shared.more.load(Ordering::Acquire);
        if keeper.busy || !(has_more || self.core.has_blob_requests()) {
            return;
        }
        locked(&keeper.shared.requests).extend(std::iter::from_fn(|| self.core.next_blob_request()));
        keeper.busy = true;
        let job = job(keeper.shared.clone(), STEPS_PER_JOB, Some(cx.remote(this)));
        keeper.stalled = cx.world().worker.run(job).err();
    }

    /// What the disk has answered. Called when a job says that it has ended; and now and then, because a full
    /// mailbox may have swallowed that.
    pub(super) fn take_filed(&mut self, cx: &mut Cx) {
        let now = cx.now();
        if let Some(keeper) = &mut self.blob_keeper {
            if let Some(job) = keeper.stalled.take() {
                keeper.stalled = cx.world().worker.run(job).err();
            }
            if keeper.shared.ended.swap(false, Ordering::AcqRel) {
                keeper.busy = false;
            }
            let answers = std::mem::take(&mut *locked(&keeper.shared.answers));
            for answer in answers {
                self.core.blob_done(answer, now);
            }
        }
        self.after(cx);
    }

    /// The server ends: what was asked of the disk is handed to the worker, which does it before the process ends.
    pub(super) fn file_the_rest(&mut self, cx: &mut Cx) {
        let Some(keeper) = &mut self.blob_keeper else { return };
        locked(&keeper.shared.requests).extend(std::iter::from_fn(|| self.core.next_blob_request()));
        let job = job(keeper.shared.clone(), usize::MAX, None);
        if let Err(job) = cx.world().worker.run(job) {
            // It is the end, and nobody else will do it.
            job();
        }
    }
}

fn job(shared: Arc<Shared>, steps_max: usize, to: Option<Remote<SkFlowServer>>) -> Job {
    Box::new(move || {
        shared.work(steps_max);
        if let Some(to) = to {
            // A server that is gone waits for nothing; one whose mailbox is full looks by itself.
            let _ = to.post(|server, cx| server.take_filed(cx));
        }
    })
}

impl Handle<SkFlowServer> {
    /// Offers blob channels from here on, with their files in this store. To be called before the first connection
    /// is let in, and after [`listen`](Handle#method.listen): whoever has the address has the files.
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    pub fn keep_blobs(self, cx: &mut Cx, store: BlobStore) -> Result<(), Access> {
        cx.with(self, |server, _| {
            server.core.keep_blobs();
            server.blob_keeper = Some(BlobKeeper {
                shared: Arc::new(Shared {
                    store: Mutex::new(store),
                    requests: Mutex::default(),
                    answers: Mutex::default(),
                    ended: AtomicBool::new(false),
                    more: AtomicBool::new(false),
                }),
                busy: false,
                stalled: None,
            });
        })
    }
}
