//! The simulated disk as a storage: names, whole files, and what opens files and folders.

use super::disk_faults::Operation;
use super::sim_disk::Node;
use super::sim_file::SimulatedFile;
use super::sim_folder::SimulatedFolder;
use super::simulated::SimulatedStorage;
use super::{Storage, StoredFile, StoredFolder};
use crate::world::net::SIMULATED_UID;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const FILE_MODE: u32 = 0o600;
const FOLDER_MODE: u32 = 0o700;

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
        Ok(Arc::new(SimulatedFile::new(self.disk.clone(), id, disk.life)))
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
