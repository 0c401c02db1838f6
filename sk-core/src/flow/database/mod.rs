//! PairDatabases: variables under names, for flows, accounts, channels, and by themselves.
//!
//! Nothing here knows a connection, a clock or a disk. [`PairDatabase`] is one database, [`Databases`] all of a
//! hub; [`StoreRequest`] is what a hub asks of its disk. `disk`, a feature, is the disk's side.

mod name;
mod pairs;
#[cfg(test)]
mod pairs_tests;
mod registry;
mod store;

pub use name::{DatabaseKind, DatabaseName, check_key};
pub use pairs::{Change, Contents, PairDatabase, Room};
pub use registry::{AccountRoom, Databases, Entity, Line, Open, Reach, Saved, Usage, Watcher};
pub use store::{StoreAnswer, StoreFailure, StoreRequest, StoreWork, Stored};
