//! Durable files.

mod disk_chances;
mod disk_faults;
mod folder;
mod real;
mod real_file;
mod real_folder;
mod sim_disk;
mod sim_file;
mod sim_folder;
mod sim_storage;
mod simulated;

pub use disk_faults::DiskFaults;
pub use folder::{Found, StoredFolder};
pub use real::RealStorage;
pub use simulated::SimulatedStorage;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file system. Every call may block: use it on a worker, or before the loop runs.
pub trait Storage: Send + Sync {
    /// Opens a file for reading and writing; `create` makes it, with mode 0600, where it is missing, and
    /// then synchronises the folder, so that the (empty) file survives a power cut.
    fn open(&self, path: &Path, create: bool) -> io::Result<Arc<dyn StoredFile>>;

    /// Opens a file that is there for reading alone.
    fn open_to_read(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>>;

    /// The whole of a file, or an error of kind `InvalidData` if it is longer than `bytes_max`.
    fn read(&self, path: &Path, bytes_max: u64) -> io::Result<Vec<u8>>;

    /// Replaces a file by `bytes`: a new file with mode 0600 beside it, synchronised, renamed over it,
    /// and the folder synchronised. After `Ok` the bytes survive a power cut; before it the old file stands.
    fn replace(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Renames within the file system, over what is there, and synchronises both folders.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes a file and synchronises its folder.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Makes a folder and its parents, with mode 0700, and synchronises what they are in; it may exist.
    fn create_dir(&self, path: &Path) -> io::Result<()>;

    /// Opens a folder, for what is below it. Its own name must not be a symbolic link.
    fn folder(&self, path: &Path) -> io::Result<Arc<dyn StoredFolder>>;

    /// The names in a folder, sorted.
    fn list(&self, path: &Path) -> io::Result<Vec<PathBuf>>;

    /// The permission bits and the owner's user id, where the file system has them.
    fn owner_and_mode(&self, path: &Path) -> io::Result<(u32, u32)>;
}

/// An open file, in the shape a database wants it.
pub trait StoredFile: Send + Sync {
    /// Its length in bytes.
    fn len(&self) -> io::Result<u64>;

    /// Whether it has no bytes.
    fn is_empty(&self) -> io::Result<bool> {
        Ok(self.len()? == 0)
    }

    /// Fills `into` from `offset`; an error of kind `UnexpectedEof` if the file ends before.
    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()>;

    /// Writes all of `bytes` at `offset`. Durable only after [`sync`](StoredFile::sync).
    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()>;

    /// Cuts or extends (with zeros) the file.
    fn set_len(&self, len: u64) -> io::Result<()>;

    /// Returns when all that was written is on the disk.
    fn sync(&self) -> io::Result<()>;
}

fn too_long(path: &Path, bytes_max: u64) -> io::Error {
    let why = format!("{} is longer than {bytes_max} bytes", path.display());
    io::Error::new(io::ErrorKind::InvalidData, why)
}
