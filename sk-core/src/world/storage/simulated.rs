//! Files that live in memory and know what a power cut would leave of them.

use super::disk_faults::{DiskFaults, Operation};
use super::sim_disk::{Change, Contents, Disk, Node};
use super::sim_folder::SimulatedFolder;
use super::{Storage, StoredFile, StoredFolder};
use crate::world::net::SIMULATED_UID;
use crate::world::{Rng, SimulatedRng};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
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
    /// The process it was given to; `None` for whoever runs the simulation.
    life: Option<u64>,
}

impl SimulatedStorage {
    /// An empty tree.
    pub fn new() -> SimulatedStorage {
        SimulatedStorage::default()
    }

    /// The same disk for the process that runs now. It answers errors when that process is no more.
    pub fn for_process(&self) -> SimulatedStorage {
        SimulatedStorage { disk: self.disk.clone(), life: Some(self.disk().life) }
    }

    /// How the disk misbehaves from now on, by chances drawn from `rng`.
    pub fn set_faults(&self, faults: DiskFaults, rng: SimulatedRng) {
        let mut disk = self.disk();
        disk.faults = faults;
        disk.chances = Some(rng);
    }

    /// The power fails: everything that was not synchronised is lost, and handles that are open answer
    /// errors from now on.
    pub fn power_cut(&self) {
        self.cut(|_, _| ());
    }

    /// The power fails while the disk is at work: each change that was not synchronised is by chance kept, lost,
    /// or torn at the border of a sector, independently of the others, because a disk writes in the order it
    /// likes. A change within one sector is not torn.
    pub fn power_cut_by_chance(&self, rng: &mut dyn Rng) {
        self.cut(|change, durable| change.apply_by_chance(durable, rng));
    }

    fn cut(&self, mut survive: impl FnMut(Change, &mut Vec<u8>)) {
        let mut disk = self.disk();
        disk.begin_life();
        disk.files.retain(|_, file| !file.removed);
        for file in disk.files.values_mut() {
            for change in std::mem::take(&mut file.unsynced) {
                survive(change, &mut file.durable);
            }
            file.bytes.clone_from(&file.durable);
        }
    }

    /// The process ends and the machine goes on: what was written stays, and its handles answer errors.
    pub(crate) fn end_process(&self) {
        let mut disk = self.disk();
        disk.begin_life();
        disk.files.retain(|_, file| !file.removed);
    }

    /// Puts a symbolic link into the tree, as somebody else on the machine might.
    pub fn plant_link(&self, path: &Path) {
        self.disk().put(path, Node::Link);
    }

    /// The present process ends after that many further operations; what it does later fails.
    pub(crate) fn give_out_after(&self, operations: u64) {
        self.disk().operations_left = Some(operations);
    }

    /// The disk, for one operation.
    pub(super) fn admitted(&self, what: Operation) -> io::Result<MutexGuard<'_, Disk>> {
        let mut disk = self.disk();
        disk.admit(self.life, what)?;
        Ok(disk)
    }

    fn disk(&self) -> MutexGuard<'_, Disk> {
        self.disk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Storage for SimulatedStorage {
    fn open(&self, path: &Path, create: bool) -> io::Result<Arc<dyn StoredFile>> {
        let mut disk = self.admitted(Operation::Read)?;
        let id = match disk.file(path) {
            Err(error) if create && error.kind() == io::ErrorKind::NotFound => {
                disk.admit(self.life, Operation::Write { grows_by: 0 })?;
                disk.check_parent(path)?;
                disk.make_file(path, &[])
            }
            found => found?,
        };
        if let Some(file) = disk.files.get_mut(&id) {
            file.handles += 1;
        }
        let file = SimulatedFile {
            disk: self.disk.clone(),
            id,
            life: disk.life,
            sync_failed: AtomicBool::new(false),
        };
        Ok(Arc::new(file))
    }

    fn open_to_read(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        self.open(path, false)
    }

    fn read(&self, path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
        let disk = self.admitted(Operation::Read)?;
        let file = disk.file(path)?;
        let bytes = disk.files.get(&file).map_or(&[][..], |file| &file.bytes);
        if bytes.len() as u64 > bytes_max {
            return Err(super::too_long(path, bytes_max));
        }
        Ok(bytes.to_vec())
    }

    fn replace(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut disk = self.admitted(Operation::Write { grows_by: bytes.len() as u64 })?;
        disk.check_parent(path)?;
        if disk.node(path).is_ok_and(|node| node == Node::Folder) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        disk.make_file(path, bytes);
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut disk = self.admitted(Operation::Write { grows_by: 0 })?;
        let moved = disk.node(from)?;
        disk.check_parent(to)?;
        if from == to {
            return Ok(());
        }
        match (moved, disk.node(to).ok()) {
            (Node::File(_) | Node::Link, Some(Node::Folder)) => {
                return Err(io::ErrorKind::IsADirectory.into());
            }
            (Node::Folder, Some(Node::File(_) | Node::Link)) => {
                return Err(io::ErrorKind::NotADirectory.into());
            }
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
        let mut disk = self.admitted(Operation::Write { grows_by: 0 })?;
        match disk.node(path)? {
            Node::Folder => return Err(io::ErrorKind::IsADirectory.into()),
            Node::File(id) => disk.unlink(id),
            Node::Link => {}
        }
        disk.names.remove(path);
        Ok(())
    }

    fn create_dir(&self, path: &Path) -> io::Result<()> {
        let mut disk = self.admitted(Operation::Write { grows_by: 0 })?;
        let mut missing = Vec::new();
        for folder in path.ancestors() {
            match disk.node(folder) {
                Ok(Node::Folder) => break,
                Ok(_) if folder == path => return Err(io::ErrorKind::AlreadyExists.into()),
                Ok(_) => return Err(io::ErrorKind::NotADirectory.into()),
                Err(_) => missing.push(folder.to_owned()),
            }
        }
        missing.iter().for_each(|folder| disk.put(folder, Node::Folder));
        Ok(())
    }

    fn folder(&self, path: &Path) -> io::Result<Arc<dyn StoredFolder>> {
        let disk = self.admitted(Operation::Look)?;
        if disk.node(path)? != Node::Folder {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        // What whoever runs the simulation opens belongs to the process of this moment, as a file does.
        let opened = SimulatedStorage { disk: self.disk.clone(), life: Some(disk.life) };
        Ok(Arc::new(SimulatedFolder::new(opened, path)))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<PathBuf>> {
        let disk = self.admitted(Operation::Look)?;
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
        let mode = match self.admitted(Operation::Look)?.node(path)? {
            Node::Folder => FOLDER_MODE,
            Node::File(_) | Node::Link => FILE_MODE,
        };
        Ok((SIMULATED_UID, mode))
    }
}

/// An open file of a simulated disk.
struct SimulatedFile {
    disk: Arc<Mutex<Disk>>,
    id: u64,
    life: u64,
    /// As with the kernel, bytes of a failed synchronisation are lost though a later one would succeed.
    sync_failed: AtomicBool,
}

impl SimulatedFile {
    fn with<R>(&self, what: Operation, work: impl FnOnce(&mut Contents) -> io::Result<R>) -> io::Result<R> {
        let mut disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        disk.admit(Some(self.life), what)?;
        let file = disk.files.get_mut(&self.id).ok_or(io::ErrorKind::NotFound)?;
        work(file)
    }

    fn change(&self, change: Change) -> io::Result<()> {
        let length = self.with(Operation::Look, |file| Ok(file.bytes.len()))?;
        let grows_by = change.end().saturating_sub(length) as u64;
        self.with(Operation::Write { grows_by }, |file| {
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
        self.with(Operation::Look, |file| Ok(file.bytes.len() as u64))
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let start = place(offset, into.len())?;
        self.with(Operation::Read, |file| {
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
        if self.sync_failed.load(Ordering::Relaxed) {
            return Err(io::Error::other("an earlier synchronisation of this file failed"));
        }
        let synced = self.with(Operation::Sync, |file| {
            let Contents { durable, unsynced, .. } = file;
            unsynced.drain(..).for_each(|change| change.apply(durable));
            Ok(())
        });
        self.sync_failed.store(synced.is_err(), Ordering::Relaxed);
        synced
    }
}

impl Drop for SimulatedFile {
    fn drop(&mut self) {
        let mut disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        if disk.life != self.life {
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
