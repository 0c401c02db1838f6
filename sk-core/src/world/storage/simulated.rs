//! Files that live in memory and know what a power cut would leave of them.

use super::disk_faults::{DiskFaults, Operation};
use super::sim_disk::{Change, Disk, Node};
use crate::world::{Rng, SimulatedRng};
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A file tree in memory. Changes of names are durable when the call returns, as the contract of
/// [`Storage`](super::Storage) has it; bytes written to an open file are only after its `sync`.
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
    pub(super) disk: Arc<Mutex<Disk>>,
    /// The process it was given to; `None` for whoever runs the simulation.
    pub(super) life: Option<u64>,
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
