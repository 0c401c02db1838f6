//! What a hub asks of its disk about blobs, and what the disk answers. No disk is touched here.

use super::super::error::RefusalCode;
use super::super::fragment::Pieces;
use super::path::BlobPath;
use crate::world::StoredFile;
use bytes::Bytes;
use sk_flat::Name;
use std::fmt;
use std::sync::Arc;

/// Something for the disk to do. The requests of one channel are done in the order of their numbers.
#[derive(Clone, Debug)]
pub struct BlobRequest {
    /// Repeated in the answer.
    pub number: u64,
    /// The channel's full name, `account.name`.
    pub channel: Name,
    /// What to do.
    pub work: BlobWork,
}

/// What to do.
#[derive(Clone, Debug)]
pub enum BlobWork {
    /// Begin or resume an upload.
    Begin {
        /// Where the file will be.
        path: BlobPath,
        /// How long it is.
        bytes: u64,
        /// CRC-32 of the whole.
        checksum: u32,
    },
    /// Add to an upload.
    Write {
        /// Of which file.
        path: BlobPath,
        /// Where this piece begins.
        offset: u64,
        /// Its bytes.
        pieces: Pieces,
    },
    /// Check an upload and put the file in its place.
    Commit {
        /// Of which file.
        path: BlobPath,
    },
    /// Forget an upload.
    Abort {
        /// Of which file.
        path: BlobPath,
    },
    /// Make a folder.
    MakeFolder {
        /// Which.
        path: BlobPath,
    },
    /// Move a file or a folder.
    Move {
        /// What.
        from: BlobPath,
        /// Where to.
        to: BlobPath,
    },
    /// Remove a file or an empty folder.
    Remove {
        /// What.
        path: BlobPath,
    },
    /// Some entries of a folder.
    List {
        /// Which.
        path: BlobPath,
        /// Those after this name.
        after: Option<String>,
    },
    /// What is there.
    Look {
        /// Where.
        path: BlobPath,
    },
    /// Some bytes of a file.
    Read {
        /// Which.
        path: BlobPath,
        /// The file as it was opened at the beginning of this download; none at the first read.
        file: Option<BlobFile>,
        /// Where they begin.
        offset: u64,
        /// How many.
        bytes: usize,
    },
    /// The channel has gone. Its files stay, and its uploads can be resumed when it returns.
    Close,
}

/// A file that is open for a download, which goes on with it though another one may take its place.
#[derive(Clone)]
pub struct BlobFile(pub(super) Arc<dyn StoredFile>);

impl fmt::Debug for BlobFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("BlobFile")
    }
}

/// The answer to a request. To `Close` there is none.
#[derive(Clone, Debug)]
pub struct BlobAnswer {
    /// Of the request.
    pub number: u64,
    /// What became of it.
    pub outcome: Result<BlobDone, BlobFailure>,
}

/// What the disk did.
#[derive(Clone, Debug)]
pub enum BlobDone {
    /// It is done, and need not be on the disk yet.
    Done,
    /// It is done, and on the disk.
    Saved,
    /// An upload may go on.
    Resume {
        /// From here.
        offset: u64,
    },
    /// Entries, sorted by name.
    Entries {
        /// Some of them.
        entries: Vec<BlobEntry>,
        /// There are none after these.
        end: bool,
    },
    /// What is there.
    Entry {
        /// Its kind and length; the name is empty.
        entry: BlobEntry,
        /// CRC-32 of a file.
        checksum: u32,
    },
    /// Bytes of a file; fewer than were asked for if it ends there.
    Data {
        /// The bytes.
        bytes: Bytes,
        /// To go on with.
        file: BlobFile,
    },
}

/// What stands in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlobEntry {
    /// Its name.
    pub name: String,
    /// Whether it is a folder.
    pub is_folder: bool,
    /// The length of a file.
    pub bytes: u64,
}

/// Why the disk did not do it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BlobFailure {
    /// It cannot be, and nothing was changed.
    #[error("{0}")]
    Refused(RefusalCode),
    /// The disk failed; the text says how.
    #[error("{0}")]
    Disk(String),
}

impl From<RefusalCode> for BlobFailure {
    fn from(code: RefusalCode) -> Self {
        BlobFailure::Refused(code)
    }
}
