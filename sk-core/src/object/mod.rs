//! Objects: plain structs owned by their loop's table, named by handles, standing in trees.

mod handle;
mod macros;
mod meta;
mod node;
mod table;

pub use handle::{Access, Handle, Here, ObjectId, Place};
pub use macros::{assert_distinct, has_hooks, member_uid};
pub use meta::{Address, Class, Extends, Itself, MetaError, Project, SkObject, Through};
pub use node::Node;
pub(crate) use node::{AnyNode, DEFERRED, DRAINING, Header, MARKED, TO_SWEEP, WAITING};
pub use table::NameError;
pub(crate) use table::{Placement, Table};
