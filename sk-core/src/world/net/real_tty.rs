//! A serial port as a byte stream.

use super::{Endpoint, Stream};
use crate::sys::tty;
use nix::fcntl::Flock;
use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::{AsRawFd, RawFd};
use std::path::Path;

/// An open serial port. It has no beginning and no end of its own: whoever is at the other end of the wires is
/// found out by what comes.
pub(super) struct RealTty {
    file: Flock<File>,
    endpoint: Endpoint,
}

impl RealTty {
    pub(super) fn open(path: &Path, baud: u32) -> io::Result<RealTty> {
        let endpoint = Endpoint::Tty { path: path.to_owned(), baud };
        Ok(RealTty { file: tty::open_raw(path, baud)?, endpoint })
    }

    pub(super) fn raw_fd(&self) -> RawFd {
        self.file.as_raw_fd()
    }
}

impl Stream for RealTty {
    fn connected(&mut self) -> io::Result<bool> {
        Ok(true)
    }

    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        (&*self.file).read(into)
    }

    fn write_vectored(&mut self, parts: &[io::IoSlice<'_>]) -> io::Result<usize> {
        (&*self.file).write_vectored(parts)
    }

    fn shutdown_write(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn peer(&self) -> Option<Endpoint> {
        Some(self.endpoint.clone())
    }

    fn peer_uid(&self) -> Option<u32> {
        None
    }
}
