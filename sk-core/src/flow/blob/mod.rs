//! Blob channels: files of an owner, held by the hub.
//!
//! [`BlobPath`] says which paths there may be, [`BlobRequest`] what a hub asks of its disk, and [`BlobStore`] is the
//! disk's side, to be run on a worker. Nothing here knows a connection or a clock.

mod path;
mod request;
mod store;

pub use path::{BlobPath, PATH_PARTS_MAX};
pub use request::{BlobAnswer, BlobDone, BlobEntry, BlobFailure, BlobFile, BlobRequest, BlobWork};
pub use store::{BlobStore, QUOTA_BYTES_DEFAULT};
