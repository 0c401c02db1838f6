//! What chance does to a simulated disk: what it refuses, and what a power cut leaves of a write.

use super::disk_faults::{DiskFaults, Operation, SECTOR_BYTES};
use super::sim_disk::{Change, Disk};
use crate::world::Rng;
use std::io;

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
