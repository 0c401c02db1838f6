//! The server's way to its disk: what gathered while the disk was busy goes there together, on a worker, and the
//! answers come back to the loop.

use super::SkFlowServer;
use crate::Cx;
use crate::flow::database::{
    Contents, DatabaseName, DatabaseStore, Saved, StoreAnswer, StoreFailure, StoreRequest, StoreWork, Stored,
};
use crate::flow::server::AccountsError;
use crate::object::{Access, Handle};
use crate::thread::Remote;
use crate::world::Job;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

/// What loop and worker share. Neither holds a lock while the disk works, but for that of the store itself,
/// which only jobs take.
struct Shared {
    store: Mutex<Box<dyn DatabaseStore>>,
    requests: Mutex<Vec<StoreRequest>>,
    answers: Mutex<Vec<StoreAnswer>>,
}

pub(super) struct Keeper {
    shared: Arc<Shared>,
    /// A job is under way.
    busy: bool,
    /// The worker had no room for it.
    stalled: Option<Job>,
}

/// A panic elsewhere says nothing against a list of requests.
fn locked<T: ?Sized>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// On the worker: what has gathered by now goes to the disk together.
    fn work(&self) {
        let mut store = locked(&self.store);
        let requests = std::mem::take(&mut *locked(&self.requests));
        let numbers: Vec<u64> = requests.iter().map(|request| request.number).collect();
        let answers = catch_unwind(AssertUnwindSafe(|| store.perform(requests))).unwrap_or_else(|_| {
            let failed = || Err(StoreFailure("the store panicked".to_owned()));
            numbers
                .into_iter()
                .map(|number| StoreAnswer { number, outcome: failed() })
                .collect()
        });
        locked(&self.answers).extend(answers);
    }
}

impl SkFlowServer {
    /// Hands the core's requests over, unless the disk is busy: then they wait and go together.
    pub(super) fn store_requests(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        let remote = cx.remote(this);
        let Some(keeper) = &mut self.keeper else { return };
        if keeper.busy || !self.core.has_store_requests() {
            return;
        }
        locked(&keeper.shared.requests).extend(std::iter::from_fn(|| self.core.next_store_request()));
        keeper.busy = true;
        let job = job(keeper.shared.clone(), Some(remote));
        keeper.stalled = cx.world().worker.run(job).err();
    }

    /// What the disk has answered. Called when a job says that it has ended; and now and then, because a full
    /// mailbox may have swallowed that.
    pub(super) fn take_stored(&mut self, cx: &mut Cx) {
        let now = cx.now();
        if let Some(keeper) = &mut self.keeper {
            if let Some(job) = keeper.stalled.take() {
                keeper.stalled = cx.world().worker.run(job).err();
            }
            let answers = std::mem::take(&mut *locked(&keeper.shared.answers));
            if !answers.is_empty() {
                keeper.busy = false;
            }
            for answer in answers {
                self.core.stored(answer, now);
            }
        }
        self.after(cx);
    }

    /// The server ends: what it promised to write is handed to the worker, which does it before the process ends.
    pub(super) fn store_the_rest(&mut self, cx: &mut Cx) {
        let Some(keeper) = &mut self.keeper else { return };
        locked(&keeper.shared.requests).extend(self.core.last_store_requests());
        let job = keeper.stalled.take().unwrap_or_else(|| job(keeper.shared.clone(), None));
        if let Err(job) = cx.world().worker.run(job) {
            // It is the end, and nobody else will do it.
            job();
        }
    }
}

fn job(shared: Arc<Shared>, to: Option<Remote<SkFlowServer>>) -> Job {
    Box::new(move || {
        shared.work();
        if let Some(to) = to {
            // A server that is gone waits for nothing; one whose mailbox is full looks by itself.
            let _ = to.post(|server, cx| server.take_stored(cx));
        }
    })
}

/// Why a server does not keep databases.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KeepError {
    /// The server cannot be reached.
    #[error(transparent)]
    Access(#[from] Access),
    /// The disk does not give the accounts.
    #[error("the hub's accounts cannot be read: {0}")]
    Disk(#[from] StoreFailure),
    /// What the disk gives are no accounts.
    #[error(transparent)]
    Accounts(#[from] AccountsError),
}

/// Asks a store for the accounts, if it has any.
fn load_accounts(
    store: &mut impl DatabaseStore,
    saved: &[(DatabaseName, Saved)],
) -> Result<Option<Contents>, StoreFailure> {
    let database = DatabaseName::accounts();
    if !saved.iter().any(|(name, _)| *name == database) {
        return Ok(None);
    }
    let mut answers = store.perform(vec![StoreRequest { number: 0, database, work: StoreWork::Load }]);
    match answers.pop().map(|answer| answer.outcome) {
        Some(Ok(Stored::Contents(contents))) => Ok(contents),
        Some(Err(failure)) => Err(failure),
        Some(Ok(Stored::Written)) | None => Err(StoreFailure("the store gave no answer".to_owned())),
    }
}

impl Handle<SkFlowServer> {
    /// Keeps databases in this store from here on; `saved` lists what it holds. To be called before the first
    /// connection is let in, and after [`listen`](Handle#method.listen): whoever has the address has the files.
    ///
    /// The accounts of the store are read here and now.
    ///
    /// # Errors
    /// If the server is gone, one of its slots is running, or the accounts cannot be read: then it must not be run,
    /// since nobody knows who would be let in.
    pub fn keep_databases(
        self,
        cx: &mut Cx,
        mut store: impl DatabaseStore + 'static,
        saved: Vec<(DatabaseName, Saved)>,
    ) -> Result<(), KeepError> {
        let accounts = load_accounts(&mut store, &saved)?;
        cx.with(self, |server, _| {
            server.core.keep_databases(saved);
            if let Some(accounts) = accounts {
                server.core.keep_accounts(&accounts)?;
            }
            server.keeper = Some(Keeper {
                shared: Arc::new(Shared {
                    store: Mutex::new(Box::new(store)),
                    requests: Mutex::default(),
                    answers: Mutex::default(),
                }),
                busy: false,
                stalled: None,
            });
            Ok(())
        })?
    }
}
