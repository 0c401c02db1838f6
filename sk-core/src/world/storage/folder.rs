//! A folder that is open, and what is below it.

use super::StoredFile;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// What stands at a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// A folder.
    Folder,
    /// A regular file.
    File {
        /// Its length.
        bytes: u64,
    },
    /// Something else: a symbolic link, a device, a socket. It is never opened or followed.
    Other,
}

/// A folder that is open. Paths are relative to it and consist of names only; symbolic links are not followed,
/// so that nothing outside is ever reached, whoever planted what in it. The empty path is the folder itself.
///
/// Changes of names are durable when a call returns. Every call may block: use it on a worker.
pub trait StoredFolder: Send + Sync {
    /// What stands at a path. A link on the way there is an error of kind `NotADirectory`, as a file would be.
    fn look(&self, path: &Path) -> io::Result<Found>;

    /// Opens a regular file; an error of kind `IsADirectory` or `InvalidInput` for anything else.
    fn open(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>>;

    /// Makes a file that was not there, with mode 0600.
    fn create(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>>;

    /// Makes a folder that was not there, with mode 0700; the one above must be.
    fn create_dir(&self, path: &Path) -> io::Result<()>;

    /// Renames below this folder, over a file that is there.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes what is no folder.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Removes an empty folder.
    fn remove_dir(&self, path: &Path) -> io::Result<()>;

    /// The names in a folder, sorted; those that are not UTF-8 are left out.
    fn list(&self, path: &Path) -> io::Result<Vec<String>>;
}
