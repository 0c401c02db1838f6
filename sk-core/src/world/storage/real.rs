//! The machine's file system.

use super::real_file::RealFile;
use super::real_folder::RealFolder;
use super::{Storage, StoredFile, StoredFolder};
use std::ffi::OsString;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Owner only: files and folders of a robot hold credentials.
const FILE_MODE: u32 = 0o600;
const FOLDER_MODE: u32 = 0o700;

/// The machine's file system.
///
/// ```
/// use sk_core::world::{RealStorage, Storage};
///
/// let file = std::env::temp_dir().join(format!("sk-storage-example-{}", std::process::id()));
/// let storage = RealStorage::new();
/// storage.replace(&file, b"kept")?;
/// assert_eq!(storage.read(&file, 100)?, b"kept");
/// storage.remove(&file)?;
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug, Default)]
pub struct RealStorage {
    /// Makes the names of files under way different from each other within this process.
    replacements: AtomicU64,
}

impl RealStorage {
    /// Access to the machine's file system.
    pub fn new() -> RealStorage {
        RealStorage::default()
    }

    /// A name beside `path` that nobody else uses.
    fn beside(&self, path: &Path) -> io::Result<PathBuf> {
        let Some(name) = path.file_name() else {
            let why = format!("{} does not name a file", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
        };
        let number = self.replacements.fetch_add(1, Ordering::Relaxed);
        let mut new = OsString::from(".");
        new.push(name);
        new.push(format!(".{}.{number}.new", process::id()));
        Ok(path.with_file_name(new))
    }
}

impl Storage for RealStorage {
    fn open(&self, path: &Path, create: bool) -> io::Result<Arc<dyn StoredFile>> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).mode(FILE_MODE);
        if create {
            match options.clone().create_new(true).open(path) {
                Ok(file) => {
                    sync_folder_of(path)?;
                    return Ok(Arc::new(RealFile::new(file)));
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Arc::new(RealFile::new(options.open(path)?)))
    }

    fn open_to_read(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        Ok(Arc::new(RealFile::new(File::open(path)?)))
    }

    fn read(&self, path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        // One more than allowed is asked for, because the length in the metadata may be out of date.
        File::open(path)?.take(bytes_max.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > bytes_max {
            return Err(super::too_long(path, bytes_max));
        }
        Ok(bytes)
    }

    fn replace(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let new = self.beside(path)?;
        let written = write_whole(&new, bytes).and_then(|()| fs::rename(&new, path));
        if let Err(error) = written {
            // The old file stands; what was half written is of no use to anybody.
            let _ = fs::remove_file(&new);
            return Err(error);
        }
        sync_folder_of(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)?;
        sync_folder_of(to)?;
        if from.parent() == to.parent() { Ok(()) } else { sync_folder_of(from) }
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)?;
        sync_folder_of(path)
    }

    fn create_dir(&self, path: &Path) -> io::Result<()> {
        let missing: Vec<&Path> = path.ancestors().take_while(|folder| !is_folder(folder)).collect();
        DirBuilder::new().recursive(true).mode(FOLDER_MODE).create(path)?;
        missing.into_iter().rev().try_for_each(sync_folder_of)
    }

    fn folder(&self, path: &Path) -> io::Result<Arc<dyn StoredFolder>> {
        Ok(Arc::new(RealFolder::open(path)?))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<PathBuf>> {
        let names = fs::read_dir(path)?.map(|entry| Ok(PathBuf::from(entry?.file_name())));
        let mut names = names.collect::<io::Result<Vec<PathBuf>>>()?;
        names.sort();
        Ok(names)
    }

    fn owner_and_mode(&self, path: &Path) -> io::Result<(u32, u32)> {
        let metadata = fs::metadata(path)?;
        Ok((metadata.uid(), metadata.mode() & 0o7777))
    }
}

fn is_folder(path: &Path) -> bool {
    // The last ancestor of a relative path is empty and means the working folder.
    path.as_os_str().is_empty() || path.is_dir()
}

fn write_whole(new: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).create_new(true).mode(FILE_MODE).open(new)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Makes the names in the folder of `path` durable.
fn sync_folder_of(path: &Path) -> io::Result<()> {
    let folder = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}
