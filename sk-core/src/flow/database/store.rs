//! What a hub asks of its disk, and what the disk answers. No disk is touched here.

use super::name::DatabaseName;
use super::pairs::Contents;
use super::registry::Saved;
use crate::flow::Value;
use std::sync::Arc;

/// Something for the disk to do. Requests are done in the order of their numbers; those that wait together go
/// to the disk together.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreRequest {
    /// Repeated in the answer.
    pub number: u64,
    /// The database.
    pub database: DatabaseName,
    /// What to do with it.
    pub work: StoreWork,
}

/// What to do.
#[derive(Clone, Debug, PartialEq)]
pub enum StoreWork {
    /// One variable has this value now, or none.
    Change {
        /// What is to be known of the database.
        about: Saved,
        /// The variable.
        key: Arc<str>,
        /// Its value.
        value: Option<Value>,
    },
    /// These are all its variables, in one transaction.
    Replace {
        /// What is to be known of the database.
        about: Saved,
        /// All variables.
        contents: Contents,
    },
    /// Its variables are wanted.
    Load,
    /// It is no more.
    Remove,
}

impl StoreWork {
    /// Whether the disk is to be changed.
    pub fn writes(&self) -> bool {
        !matches!(self, StoreWork::Load)
    }
}

/// The answer to a request.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreAnswer {
    /// Of the request.
    pub number: u64,
    /// What became of it. What was written is on the disk now, unless it failed: then it may be or not.
    pub outcome: Result<Stored, StoreFailure>,
}

/// A disk, as a hub sees it. It may block: a hub calls it on a worker.
pub trait DatabaseStore: Send {
    /// Does these requests in their order and answers each. What is written in one call may reach the disk in
    /// one transaction; when this returns with `Written` it is there.
    fn perform(&mut self, requests: Vec<StoreRequest>) -> Vec<StoreAnswer>;
}

/// What the disk did.
#[derive(Clone, Debug, PartialEq)]
pub enum Stored {
    /// It is written.
    Written,
    /// The variables; none if it has no database of this name.
    Contents(Option<Contents>),
}

/// The disk failed; the text says how.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct StoreFailure(pub String);
