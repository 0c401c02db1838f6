//! Where the files of a channel are, and what an error of the disk means to who asked for a path.

use super::super::super::error::RefusalCode;
use super::super::path::BlobPath;
use super::super::request::BlobFailure;
use sha2::{Digest, Sha256};
use sk_flat::Name;
use std::fmt::Write;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

const FILES: &str = "files";
const PARTS: &str = "parts";
/// How much of a path's hash names its upload.
const HASH_BYTES: usize = 16;

/// The folders that a channel needs, in the order in which they are to be made.
pub(super) fn folders(channel: &Name) -> [PathBuf; 3] {
    [PathBuf::from(channel.as_str()), files(channel.as_str()), parts(channel.as_str())]
}

pub(super) fn files(channel: &str) -> PathBuf {
    Path::new(channel).join(FILES)
}

pub(super) fn parts(channel: &str) -> PathBuf {
    Path::new(channel).join(PARTS)
}

/// Where a file stands that is whole.
pub(super) fn file(channel: &Name, path: &BlobPath) -> PathBuf {
    let files = files(channel.as_str());
    if path.is_root() { files } else { files.join(path.as_str()) }
}

/// The name in `parts` of the upload of a path; that of its log has the extension `log`.
pub(super) fn part_name(path: &BlobPath) -> String {
    let digest = Sha256::digest(path.as_str().as_bytes());
    digest.iter().take(HASH_BYTES).fold(String::new(), |mut text, byte| {
        // Writing to a text cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// What an error at a path of the user's means. Everything else is the disk's own.
pub(super) fn failure(error: io::Error) -> BlobFailure {
    BlobFailure::Refused(match error.kind() {
        ErrorKind::NotFound => RefusalCode::NoSuchPath,
        ErrorKind::NotADirectory
        | ErrorKind::IsADirectory
        | ErrorKind::AlreadyExists
        | ErrorKind::InvalidInput => RefusalCode::WrongPath,
        ErrorKind::DirectoryNotEmpty => RefusalCode::NotEmpty,
        ErrorKind::InvalidFilename => RefusalCode::BadPath,
        _ => return disk(error),
    })
}

/// An error where none of the user's doing is possible.
pub(super) fn disk(error: io::Error) -> BlobFailure {
    BlobFailure::Disk(error.to_string())
}
