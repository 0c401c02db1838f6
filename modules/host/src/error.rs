//! Why a sense could not be read.

use std::io;
use std::path::PathBuf;

/// Why a sense could not be read this time.
///
/// A device that is missing is no error: the sense leaves it out. These errors are about the files without
/// which a sense has nothing to say. The next reading may succeed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SenseError {
    /// A file or folder could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// Which one.
        path: PathBuf,
        /// What the kernel answered.
        source: io::Error,
    },
    /// A file is longer than any kernel makes it.
    #[error("{} is longer than {bytes_max} bytes", path.display())]
    TooLong {
        /// Which one.
        path: PathBuf,
        /// How long it may be.
        bytes_max: usize,
    },
    /// A file holds something else than its sense can read.
    #[error("{} holds no {expected}", path.display())]
    Malformed {
        /// Which one.
        path: PathBuf,
        /// What was looked for and not found.
        expected: &'static str,
    },
}
