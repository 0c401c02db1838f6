//! A folder of a simulated disk.

use super::disk_faults::Operation;
use super::sim_disk::Node;
use super::simulated::SimulatedStorage;
use super::{Found, Storage, StoredFile, StoredFolder};
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

pub(super) struct SimulatedFolder {
    storage: SimulatedStorage,
    root: PathBuf,
}

impl SimulatedFolder {
    pub(super) fn new(storage: SimulatedStorage, root: &Path) -> SimulatedFolder {
        SimulatedFolder { storage, root: root.to_owned() }
    }

    /// The path from the disk's root. What stands on the way must be folders.
    fn place(&self, path: &Path) -> io::Result<PathBuf> {
        let mut place = self.root.clone();
        for part in path.components() {
            let Component::Normal(name) = part else { return Err(io::ErrorKind::InvalidInput.into()) };
            if self.node(&place)? != Node::Folder {
                return Err(io::ErrorKind::NotADirectory.into());
            }
            place.push(name);
        }
        Ok(place)
    }

    fn node(&self, place: &Path) -> io::Result<Node> {
        self.storage.admitted(Operation::Look)?.node(place)
    }
}

impl StoredFolder for SimulatedFolder {
    fn look(&self, path: &Path) -> io::Result<Found> {
        let place = self.place(path)?;
        let disk = self.storage.admitted(Operation::Look)?;
        Ok(match disk.node(&place)? {
            Node::Folder => Found::Folder,
            Node::Link => Found::Other,
            Node::File(id) => {
                let length = disk.files.get(&id).map_or(0, |file| file.bytes.len());
                Found::File { bytes: length as u64 }
            }
        })
    }

    fn open(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        self.storage.open(&self.place(path)?, false)
    }

    fn create(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        let place = self.place(path)?;
        if self.node(&place).is_ok() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        self.storage.open(&place, true)
    }

    fn create_dir(&self, path: &Path) -> io::Result<()> {
        let place = self.place(path)?;
        let mut disk = self.storage.admitted(Operation::Write { grows_by: 0 })?;
        if disk.node(&place).is_ok() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        disk.check_parent(&place)?;
        disk.put(&place, Node::Folder);
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.storage.rename(&self.place(from)?, &self.place(to)?)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.storage.remove(&self.place(path)?)
    }

    fn remove_dir(&self, path: &Path) -> io::Result<()> {
        let place = self.place(path)?;
        let mut disk = self.storage.admitted(Operation::Write { grows_by: 0 })?;
        if disk.node(&place)? != Node::Folder {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        if disk.below(&place).next().is_some() {
            return Err(io::ErrorKind::DirectoryNotEmpty.into());
        }
        disk.names.remove(&place);
        Ok(())
    }

    fn list(&self, path: &Path) -> io::Result<Vec<String>> {
        let place = self.place(path)?;
        let disk = self.storage.admitted(Operation::Look)?;
        if disk.node(&place)? != Node::Folder {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        let mut names: Vec<String> = disk
            .below(&place)
            .filter_map(|name| name.file_name()?.to_str().map(str::to_owned))
            .collect();
        names.sort();
        Ok(names)
    }
}
