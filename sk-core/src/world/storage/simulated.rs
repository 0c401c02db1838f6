//! Files that live in memory and know what a power cut would leave of them.

use super::{Storage, StoredFile};
use crate::world::Rng;
use crate::world::net::SIMULATED_UID;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const FILE_MODE: u32 = 0o600;
const FOLDER_MODE: u32 = 0o700;

/// A file tree in memory. Changes of names are durable when the call returns, as the contract of
/// [`Storage`] has it; bytes written to an open file are only after its `sync`.
///
/// Only the root, the empty path and what was made with `create_dir` are folders.
///
/// ```
/// use sk_core::world::{SimulatedStorage, Storage};
/// use std::path::Path;
///
/// let storage = SimulatedStorage::new();
/// let file = storage.open(Path::new("/log"), true)?;
/// file.write_at(0, b"kept")?;
/// file.sync()?;
/// file.write_at(4, b", lost")?;
/// storage.power_cut();
/// assert_eq!(storage.read(Path::new("/log"), 100)?, b"kept");
/// assert!(file.len().is_err()); // the process that had it open is dead
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug, Default)]
pub struct SimulatedStorage {
    disk: Arc<Mutex<Disk>>,
}

#[derive(Debug, Default)]
struct Disk {
    names: BTreeMap<PathBuf, Node>,
    files: BTreeMap<u64, Contents>,
    files_made: u64,
    /// How often the power was cut: a handle from before has no process any more.
    power_cuts: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Node {
    Folder,
    File(u64),
}

/// A file's bytes as programs see them, and what is needed to know what the disk has.
#[derive(Debug, Default)]
struct Contents {
    bytes: Vec<u8>,
    durable: Vec<u8>,
    /// The changes since the last synchronisation, in order.
    unsynced: Vec<Change>,
    /// Open handles: a removed file lives as long as it has one.
    handles: usize,
    removed: bool,
}

#[derive(Debug)]
enum Change {
    Write { offset: usize, bytes: Vec<u8> },
    SetLen(usize),
}

impl Change {
    fn apply(&self, to: &mut Vec<u8>) {
        match self {
            Change::Write { offset, bytes } => {
                let end = offset + bytes.len();
                if to.len() < end {
                    to.resize(end, 0);
                }
                to[*offset..end].copy_from_slice(bytes);
            }
            Change::SetLen(len) => to.resize(*len, 0),
        }
    }
}

impl SimulatedStorage {
    /// An empty tree.
    pub fn new() -> SimulatedStorage {
        SimulatedStorage::default()
    }

    /// The power fails: everything that was not synchronised is lost, and handles that are open answer
    /// errors from now on.
    pub fn power_cut(&self) {
        self.cut(|| false);
    }

    /// The power fails while the disk is at work: each change that was not synchronised is by chance kept
    /// or lost, as a whole and independently of the others, because a disk writes in the order it likes.
    pub fn power_cut_by_chance(&self, rng: &mut dyn Rng) {
        self.cut(|| rng.next_u64() >> 63 == 1);
    }

    fn cut(&self, mut survives: impl FnMut() -> bool) {
        let mut disk = self.disk();
        disk.power_cuts += 1;
        disk.files.retain(|_, file| !file.removed);
        for file in disk.files.values_mut() {
            for change in std::mem::take(&mut file.unsynced) {
                if survives() {
                    change.apply(&mut file.durable);
                }
            }
            file.bytes.clone_from(&file.durable);
            file.handles = 0;
        }
    }

    fn disk(&self) -> MutexGuard<'_, Disk> {
        self.disk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Disk {
    fn node(&self, path: &Path) -> io::Result<Node> {
        if path.as_os_str().is_empty() || path == Path::new("/") {
            return Ok(Node::Folder);
        }
        self.names.get(path).copied().ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn file(&self, path: &Path) -> io::Result<u64> {
        match self.node(path)? {
            Node::File(id) => Ok(id),
            Node::Folder => Err(io::ErrorKind::IsADirectory.into()),
        }
    }

    /// Checks that a name can be made at `path`.
    fn check_parent(&self, path: &Path) -> io::Result<()> {
        if path.file_name().is_none() {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        match self.node(path.parent().unwrap_or(Path::new("")))? {
            Node::Folder => Ok(()),
            Node::File(_) => Err(io::ErrorKind::NotADirectory.into()),
        }
    }

    fn make_file(&mut self, path: &Path, bytes: &[u8]) -> u64 {
        self.files_made += 1;
        let contents = Contents { bytes: bytes.to_vec(), durable: bytes.to_vec(), ..Contents::default() };
        self.files.insert(self.files_made, contents);
        self.put(path, Node::File(self.files_made));
        self.files_made
    }

    /// Gives a name to a node; the file that had it before lives on only in its open handles.
    fn put(&mut self, path: &Path, node: Node) {
        if let Some(Node::File(before)) = self.names.insert(path.to_owned(), node) {
            self.unlink(before);
        }
    }

    fn unlink(&mut self, id: u64) {
        if let Some(file) = self.files.get_mut(&id) {
            file.removed = true;
            if file.handles == 0 {
                self.files.remove(&id);
            }
        }
    }

    fn below(&self, folder: &Path) -> impl Iterator<Item = &PathBuf> {
        self.names.keys().filter(move |name| name.parent() == Some(folder))
    }
}

impl Storage for SimulatedStorage {
    fn open(&self, path: &Path, create: bool) -> io::Result<Arc<dyn StoredFile>> {
        let mut disk = self.disk();
        let id = match disk.file(path) {
            Err(error) if create && error.kind() == io::ErrorKind::NotFound => {
                disk.check_parent(path)?;
                disk.make_file(path, &[])
            }
            found => found?,
        };
        if let Some(file) = disk.files.get_mut(&id) {
            file.handles += 1;
        }
        Ok(Arc::new(SimulatedFile { disk: self.disk.clone(), id, power_cuts: disk.power_cuts }))
    }

    fn read(&self, path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
        let disk = self.disk();
        let file = disk.file(path)?;
        let bytes = disk.files.get(&file).map_or(&[][..], |file| &file.bytes);
        if bytes.len() as u64 > bytes_max {
            return Err(super::too_long(path, bytes_max));
        }
        Ok(bytes.to_vec())
    }

    fn replace(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut disk = self.disk();
        disk.check_parent(path)?;
        if disk.node(path).is_ok_and(|node| node == Node::Folder) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        disk.make_file(path, bytes);
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut disk = self.disk();
        let moved = disk.node(from)?;
        disk.check_parent(to)?;
        if from == to {
            return Ok(());
        }
        match (moved, disk.node(to).ok()) {
            (Node::File(_), Some(Node::Folder)) => return Err(io::ErrorKind::IsADirectory.into()),
            (Node::Folder, Some(Node::File(_))) => return Err(io::ErrorKind::NotADirectory.into()),
            (Node::Folder, Some(Node::Folder)) if disk.below(to).next().is_some() => {
                return Err(io::ErrorKind::DirectoryNotEmpty.into());
            }
            (Node::Folder, _) if to.starts_with(from) => return Err(io::ErrorKind::InvalidInput.into()),
            _ => {}
        }
        let all: Vec<PathBuf> = disk.names.keys().filter(|name| name.starts_with(from)).cloned().collect();
        for name in all {
            if let (Some(node), Ok(rest)) = (disk.names.remove(&name), name.strip_prefix(from)) {
                let new = if rest.as_os_str().is_empty() { to.to_owned() } else { to.join(rest) };
                disk.put(&new, node);
            }
        }
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let mut disk = self.disk();
        let id = disk.file(path)?;
        disk.names.remove(path);
        disk.unlink(id);
        Ok(())
    }

    fn create_dir(&self, path: &Path) -> io::Result<()> {
        let mut disk = self.disk();
        let mut missing = Vec::new();
        for folder in path.ancestors() {
            match disk.node(folder) {
                Ok(Node::Folder) => break,
                Ok(Node::File(_)) if folder == path => return Err(io::ErrorKind::AlreadyExists.into()),
                Ok(Node::File(_)) => return Err(io::ErrorKind::NotADirectory.into()),
                Err(_) => missing.push(folder.to_owned()),
            }
        }
        missing.iter().for_each(|folder| disk.put(folder, Node::Folder));
        Ok(())
    }

    fn list(&self, path: &Path) -> io::Result<Vec<PathBuf>> {
        let disk = self.disk();
        if disk.node(path)? != Node::Folder {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        let mut names: Vec<PathBuf> = disk
            .below(path)
            .filter_map(|name| name.file_name())
            .map(PathBuf::from)
            .collect();
        names.sort();
        Ok(names)
    }

    fn owner_and_mode(&self, path: &Path) -> io::Result<(u32, u32)> {
        let mode = match self.disk().node(path)? {
            Node::Folder => FOLDER_MODE,
            Node::File(_) => FILE_MODE,
        };
        Ok((SIMULATED_UID, mode))
    }
}

/// An open file of a simulated disk.
struct SimulatedFile {
    disk: Arc<Mutex<Disk>>,
    id: u64,
    power_cuts: u64,
}

impl SimulatedFile {
    fn with<R>(&self, work: impl FnOnce(&mut Contents) -> io::Result<R>) -> io::Result<R> {
        let mut disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        if disk.power_cuts != self.power_cuts {
            return Err(io::Error::other("the power was cut since the file was opened"));
        }
        let file = disk.files.get_mut(&self.id).ok_or(io::ErrorKind::NotFound)?;
        work(file)
    }

    fn change(&self, change: Change) -> io::Result<()> {
        self.with(|file| {
            change.apply(&mut file.bytes);
            file.unsynced.push(change);
            Ok(())
        })
    }
}

/// An offset in memory.
///
/// # Errors
/// `FileTooLarge` beyond what can be addressed.
fn place(offset: u64, bytes: usize) -> io::Result<usize> {
    let start = usize::try_from(offset).ok();
    let fits = |&start: &usize| start.checked_add(bytes).is_some_and(|end| isize::try_from(end).is_ok());
    start.filter(fits).ok_or_else(|| io::ErrorKind::FileTooLarge.into())
}

impl StoredFile for SimulatedFile {
    fn len(&self) -> io::Result<u64> {
        self.with(|file| Ok(file.bytes.len() as u64))
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let start = place(offset, into.len())?;
        self.with(|file| {
            let bytes = file.bytes.get(start..start + into.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
            into.copy_from_slice(bytes);
            Ok(())
        })
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let offset = place(offset, bytes.len())?;
        self.change(Change::Write { offset, bytes: bytes.to_vec() })
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.change(Change::SetLen(place(len, 0)?))
    }

    fn sync(&self) -> io::Result<()> {
        self.with(|file| {
            let Contents { durable, unsynced, .. } = file;
            unsynced.drain(..).for_each(|change| change.apply(durable));
            Ok(())
        })
    }
}

impl Drop for SimulatedFile {
    fn drop(&mut self) {
        let mut disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        if disk.power_cuts != self.power_cuts {
            return;
        }
        if let Some(file) = disk.files.get_mut(&self.id) {
            file.handles -= 1;
            if file.removed && file.handles == 0 {
                disk.files.remove(&self.id);
            }
        }
    }
}
