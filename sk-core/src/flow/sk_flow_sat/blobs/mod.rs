//! Blob channels of a satellite: files on their way to the hub and from it.

mod carrying;
mod commands;
mod errands;
mod objects;
mod porter;

pub(super) use carrying::tell_told;
pub use objects::{BlobProgress, FlowBlob, FlowDownload};
pub(super) use porter::Porter;
