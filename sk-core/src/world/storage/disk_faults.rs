//! What is wrong with a simulated disk.

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
