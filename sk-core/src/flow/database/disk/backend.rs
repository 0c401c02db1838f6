//! A file of a world's storage as the engine wants it. So the simulated disk with its faults runs beneath it.

use crate::testing::{Bug, is_planted};
use crate::world::StoredFile;
use redb::StorageBackend;
use std::fmt;
use std::io;
use std::sync::Arc;

pub(super) struct Backend(pub(super) Arc<dyn StoredFile>);

impl fmt::Debug for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Backend")
    }
}

impl StorageBackend for Backend {
    fn len(&self) -> io::Result<u64> {
        self.0.len()
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.0.read_at(offset, out)
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        self.0.set_len(len)
    }

    fn sync_data(&self) -> io::Result<()> {
        if is_planted(Bug::AckBeforeSync) {
            return Ok(());
        }
        self.0.sync()
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.0.write_at(offset, data)
    }
}
