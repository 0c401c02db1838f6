//! The state of a simulated disk: names, files, and what of their bytes would survive.

use super::disk_faults::DiskFaults;
use crate::world::SimulatedRng;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

#[derive(Debug, Default)]
pub(super) struct Disk {
    pub(super) names: BTreeMap<PathBuf, Node>,
    pub(super) files: BTreeMap<u64, Contents>,
    files_made: u64,
    /// Which process has it: a handle of an earlier one can do nothing any more.
    pub(super) life: u64,
    pub(super) faults: DiskFaults,
    pub(super) chances: Option<SimulatedRng>,
    /// How many operations the present process has left, while it is dying.
    pub(super) operations_left: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Node {
    Folder,
    File(u64),
    /// A symbolic link; nothing follows it.
    Link,
}

/// A file's bytes as programs see them, and what is needed to know what the disk has.
#[derive(Debug, Default)]
pub(super) struct Contents {
    pub(super) bytes: Vec<u8>,
    pub(super) durable: Vec<u8>,
    /// The changes since the last synchronisation, in order.
    pub(super) unsynced: Vec<Change>,
    /// Open handles: a removed file lives as long as it has one.
    pub(super) handles: usize,
    pub(super) removed: bool,
}

#[derive(Debug)]
pub(super) enum Change {
    Write { offset: usize, bytes: Vec<u8> },
    SetLen(usize),
}

impl Change {
    /// How long the file is at least afterwards.
    pub(super) fn end(&self) -> usize {
        match self {
            Change::Write { offset, bytes } => offset + bytes.len(),
            Change::SetLen(len) => *len,
        }
    }

    pub(super) fn apply(&self, to: &mut Vec<u8>) {
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

impl Disk {
    /// Whoever had it is no more.
    pub(super) fn begin_life(&mut self) {
        self.life += 1;
        self.operations_left = None;
        self.files.values_mut().for_each(|file| file.handles = 0);
    }

    pub(super) fn node(&self, path: &Path) -> io::Result<Node> {
        if path.as_os_str().is_empty() || path == Path::new("/") {
            return Ok(Node::Folder);
        }
        self.names.get(path).copied().ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    pub(super) fn file(&self, path: &Path) -> io::Result<u64> {
        match self.node(path)? {
            Node::File(id) => Ok(id),
            Node::Folder => Err(io::ErrorKind::IsADirectory.into()),
            Node::Link => Err(io::ErrorKind::InvalidInput.into()),
        }
    }

    /// Checks that a name can be made at `path`.
    pub(super) fn check_parent(&self, path: &Path) -> io::Result<()> {
        if path.file_name().is_none() {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        match self.node(path.parent().unwrap_or(Path::new("")))? {
            Node::Folder => Ok(()),
            Node::File(_) | Node::Link => Err(io::ErrorKind::NotADirectory.into()),
        }
    }

    pub(super) fn make_file(&mut self, path: &Path, bytes: &[u8]) -> u64 {
        self.files_made += 1;
        let contents = Contents { bytes: bytes.to_vec(), durable: bytes.to_vec(), ..Contents::default() };
        self.files.insert(self.files_made, contents);
        self.put(path, Node::File(self.files_made));
        self.files_made
    }

    /// Gives a name to a node; the file that had it before lives on only in its open handles.
    pub(super) fn put(&mut self, path: &Path, node: Node) {
        if let Some(Node::File(before)) = self.names.insert(path.to_owned(), node) {
            self.unlink(before);
        }
    }

    pub(super) fn unlink(&mut self, id: u64) {
        if let Some(file) = self.files.get_mut(&id) {
            file.removed = true;
            if file.handles == 0 {
                self.files.remove(&id);
            }
        }
    }

    pub(super) fn below(&self, folder: &Path) -> impl Iterator<Item = &PathBuf> {
        self.names.keys().filter(move |name| name.parent() == Some(folder))
    }
}
