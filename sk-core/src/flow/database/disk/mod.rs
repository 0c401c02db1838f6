//! Databases on the disk: one file, written by transactions of the engine `redb`, checked when it is opened.

mod backend;
mod opening;
mod record;
#[cfg(test)]
mod tests;
mod transactions;

pub use opening::{Damage, Opened, StoreError};

use super::{DatabaseStore, StoreAnswer, StoreFailure, StoreRequest, StoreWork, Stored};
use crate::world::Storage;
use redb::{Database, TableDefinition};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

/// The format of what this build writes. A file of another one is left alone.
pub const STORE_FORMAT: u64 = 1;
/// What the engine keeps of the file in memory.
const CACHE_BYTES_MAX: usize = 8 * 1024 * 1024;

/// What the file says of itself.
const FILE: TableDefinition<'static, &str, u64> = TableDefinition::new("file");
/// What is to be known of each database.
const DATABASES: TableDefinition<'static, &str, &[u8]> = TableDefinition::new("databases");
/// Every variable, by its database and key.
const VARIABLES: TableDefinition<'static, (&str, &str), &[u8]> = TableDefinition::new("variables");

/// The file of a hub's databases.
///
/// What is written in one call of [`perform`](DatabaseStore::perform) goes to the disk in one transaction, with
/// two synchronisations: after the first the new state is there whole, and with the second it becomes the one
/// that counts. One would do against a power cut alone; but then a later fault of the disk in the newest state
/// could not be told from a power cut before it was whole, and the hub would go on with an older one without a
/// word.
///
/// ```
/// use sk_core::flow::Value;
/// use sk_core::flow::database::disk::Store;
/// use sk_core::flow::database::{DatabaseName, DatabaseStore, Saved, StoreRequest, StoreWork, Stored};
/// use sk_core::world::SimulatedStorage;
/// use std::sync::Arc;
///
/// let disk = Arc::new(SimulatedStorage::new());
/// let mut opened = Store::open(disk.clone(), "/databases.redb".into())?;
/// let database = DatabaseName::parse("arm").expect("a name");
/// let about = Saved { account: "robot".into(), durable: true, keys: 1, bytes: 15 };
/// let change = StoreWork::Change { about, key: "gain.p".into(), value: Some(Value::new(&1.5.into())?) };
/// let done = opened.store.perform(vec![StoreRequest { number: 1, database, work: change }]);
/// assert_eq!(done[0].outcome, Ok(Stored::Written));
///
/// disk.power_cut();
/// let again = Store::open(disk, "/databases.redb".into())?;
/// assert!(again.damage.is_none());
/// assert_eq!(again.saved.len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Store {
    storage: Arc<dyn Storage>,
    path: PathBuf,
    /// None after a failure: the engine gives up then, and the file has to be opened anew.
    engine: Option<Database>,
}

impl fmt::Debug for Store {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Store").field("path", &self.path).finish_non_exhaustive()
    }
}

impl DatabaseStore for Store {
    fn perform(&mut self, requests: Vec<StoreRequest>) -> Vec<StoreAnswer> {
        let mut answers = Vec::with_capacity(requests.len());
        let mut rest = &requests[..];
        while let Some(first) = rest.first() {
            // Writes that follow each other share a transaction; a reader sees those before it.
            let together = match first.work.writes() {
                true => rest.iter().take_while(|request| request.work.writes()).count(),
                false => 1,
            };
            let (now, later) = rest.split_at(together);
            rest = later;
            let outcome = self.attempt(now);
            answers.extend(
                now.iter()
                    .map(|request| StoreAnswer { number: request.number, outcome: outcome.clone() }),
            );
        }
        answers
    }
}

impl Store {
    /// Does these, all or none. After a failure the file is opened anew at the next attempt.
    fn attempt(&mut self, requests: &[StoreRequest]) -> Result<Stored, StoreFailure> {
        let outcome = contained(|| {
            let engine = match self.engine.take() {
                Some(engine) => engine,
                None => opening::open_engine(&self.storage, &self.path).map_err(failure)?,
            };
            let stored = match requests {
                [StoreRequest { work: StoreWork::Load, database, .. }] => {
                    transactions::load(&engine, database).map(Stored::Contents)
                }
                _ => transactions::write(&engine, requests).map(|()| Stored::Written),
            };
            self.engine = stored.is_ok().then_some(engine);
            stored.map_err(failure)
        });
        outcome.unwrap_or_else(|why| Err(StoreFailure(why)))
    }
}

fn failure(error: impl fmt::Display) -> StoreFailure {
    StoreFailure(error.to_string())
}

/// Runs something of the engine. It may panic over a damaged file; that is a failure of the disk like others.
fn contained<R>(work: impl FnOnce() -> R) -> Result<R, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| {
        let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
        format!("the engine gave up: {}", text.unwrap_or_else(|| "without words".to_owned()))
    })
}
