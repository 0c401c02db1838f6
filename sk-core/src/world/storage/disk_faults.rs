//! What is wrong with a simulated disk, and what a power cut leaves of a write.

use super::sim_disk::{Change, Disk};
use crate::world::Rng;
use std::io;

/// What a disk writes as one: of a longer write a power cut may keep any of these.
pub(super) const SECTOR_BYTES: usize = 512;

/// How a simulated disk misbehaves. The default is a disk without fault.
///
/// ```
/// use sk_core::world::{DiskFaults, SimulatedRng, SimulatedStorage, Storage};
/// use std::{io::ErrorKind, path::Path};
///
/// let storage = SimulatedStorage::new();
/// let full = DiskFaults { bytes_max: Some(3), ..DiskFaults::default() };
/// storage.set_faults(full, SimulatedRng::new(1, 0));
/// let error = storage.replace(Path::new("/a"), b"four").expect_err("there is no room");
/// assert_eq!(error.kind(), ErrorKind::StorageFull);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DiskFaults {
    /// How many reads of 1024 fail.
    pub read_errors: u16,
    /// How many writes and changes of names of 1024 fail, with nothing done.
    pub write_errors: u16,
    /// How many synchronisations of 1024 fail. All later ones of that handle fail as well, as those of the
    /// real storage do.
    pub sync_errors: u16,
    /// How many bytes of files the disk has room for.
    pub bytes_max: Option<u64>,
}

/// What is about to be done.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Operation {
    Look,
    Read,
    Write { grows_by: u64 },
    Sync,
}

fn failed() -> io::Error {
    io::Error::from_raw_os_error(libc::EIO)
}

impl Disk {
    /// Whether a process of that life may do it; its errors are what the kernel would answer.
    pub(super) fn admit(&mut self, life: Option<u64>, what: Operation) -> io::Result<()> {
        if life.is_some_and(|life| life != self.life) {
            return Err(io::Error::other("the process that had this disk is no more"));
        }
        if let (Some(left), Some(_)) = (&mut self.operations_left, life)
            && what != Operation::Look
        {
            *left = left.checked_sub(1).ok_or_else(failed)?;
        }
        if self.faults == DiskFaults::default() {
            return Ok(());
        }
        let of_1024 = match what {
            Operation::Look => 0,
            Operation::Read => self.faults.read_errors,
            Operation::Write { .. } => self.faults.write_errors,
            Operation::Sync => self.faults.sync_errors,
        };
        if let Some(rng) = self.chances.as_mut()
            && of_1024 > 0
            && rng.next_u64() % 1024 < u64::from(of_1024)
        {
            return Err(failed());
        }
        if let (Operation::Write { grows_by }, Some(max)) = (what, self.faults.bytes_max)
            && grows_by > 0
            && self.bytes() + grows_by > max
        {
            return Err(io::ErrorKind::StorageFull.into());
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.files.values().map(|file| file.bytes.len() as u64).sum()
    }
}

impl Change {
    /// Applies what a power cut leaves of it: all, nothing, or some sectors, mostly the first ones.
    pub(super) fn apply_by_chance(self, to: &mut Vec<u8>, rng: &mut dyn Rng) {
        let fate = rng.next_u64() >> 62;
        let Change::Write { offset, bytes } = self else {
            if fate & 1 == 1 {
                self.apply(to);
            }
            return;
        };
        let sectors = (offset + bytes.len()).div_ceil(SECTOR_BYTES) - offset / SECTOR_BYTES;
        if fate < 2 || sectors < 2 {
            if fate & 1 == 1 {
                Change::Write { offset, bytes }.apply(to);
            }
            return;
        }
        let prefix = (rng.next_u64() % sectors as u64) as usize;
        let mut start = offset;
        for sector in 0..sectors {
            let end = ((start / SECTOR_BYTES + 1) * SECTOR_BYTES).min(offset + bytes.len());
            let kept = if fate == 2 { sector < prefix } else { rng.next_u64() >> 63 == 1 };
            if kept {
                let bytes = bytes[start - offset..end - offset].to_vec();
                Change::Write { offset: start, bytes }.apply(to);
            }
            start = end;
        }
    }
}
