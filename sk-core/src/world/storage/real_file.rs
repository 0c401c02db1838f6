//! An open file of the machine's file system.

use super::StoredFile;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicBool, Ordering};

/// A file that is open for reading and writing.
pub(super) struct RealFile {
    file: File,
    /// After a failed synchronisation the kernel forgets what it could not write and reports the next one
    /// as good; the bytes are lost all the same, so every later one has to fail too.
    sync_failed: AtomicBool,
}

impl RealFile {
    pub(super) fn new(file: File) -> RealFile {
        RealFile { file, sync_failed: AtomicBool::new(false) }
    }
}

impl StoredFile for RealFile {
    fn len(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        self.file.read_exact_at(into, offset)
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all_at(bytes, offset)
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.file.set_len(len)
    }

    fn sync(&self) -> io::Result<()> {
        if self.sync_failed.load(Ordering::Acquire) {
            return Err(io::Error::other("an earlier synchronisation of this file failed"));
        }
        let synced = self.file.sync_data();
        if synced.is_err() {
            self.sync_failed.store(true, Ordering::Release);
        }
        synced
    }
}
