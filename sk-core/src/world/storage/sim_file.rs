//! An open file of a simulated disk.

use super::StoredFile;
use super::disk_faults::Operation;
use super::sim_disk::{Change, Contents, Disk};
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// An open file of a simulated disk.
pub(super) struct SimulatedFile {
    disk: Arc<Mutex<Disk>>,
    id: u64,
    life: u64,
    /// As with the kernel, bytes of a failed synchronisation are lost though a later one would succeed.
    sync_failed: AtomicBool,
}

impl SimulatedFile {
    /// The disk counts the handle already.
    pub(super) fn new(disk: Arc<Mutex<Disk>>, id: u64, life: u64) -> SimulatedFile {
        SimulatedFile { disk, id, life, sync_failed: AtomicBool::new(false) }
    }

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
