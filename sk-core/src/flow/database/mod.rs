//! PairDatabases: variables under names, for flows, accounts, channels, and by themselves.
//!
//! Nothing here knows a connection, a clock or a disk. [`PairDatabase`] is one database, [`Databases`] all of a
//! hub; [`StoreRequest`] is what a hub asks of its disk. `disk` (feature `store`) is the disk's side.

#[cfg(feature = "store")]
pub mod disk;
mod name;
mod pairs;
#[cfg(test)]
mod pairs_tests;
mod registry;
#[cfg(test)]
mod registry_tests;
mod store;

pub use name::{DatabaseKind, DatabaseName, check_key};
pub use pairs::{Change, Contents, PairDatabase, Room};
pub use registry::{AccountRoom, Databases, Entity, Line, Open, Reach, Saved, Usage, Watcher};
pub use store::{DatabaseStore, StoreAnswer, StoreFailure, StoreRequest, StoreWork, Stored};
