//! SIGINT, SIGTERM and SIGHUP as something to read instead of something that interrupts.

use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use std::io;
use std::os::fd::{AsFd, AsRawFd, RawFd};

/// The signals that end an application, or tell it something, unless it hears them itself.
fn heard() -> SigSet {
    let mut set = SigSet::empty();
    set.add(Signal::SIGINT);
    set.add(Signal::SIGTERM);
    set.add(Signal::SIGHUP);
    set
}

/// Blocks SIGINT, SIGTERM and SIGHUP for the calling thread and for those it starts from now on. Needs no
/// privilege.
pub(crate) fn block_ending() -> io::Result<()> {
    Ok(heard().thread_block()?)
}

/// Undoes [`block_ending`] for the calling thread: a signal ends the process again.
pub(crate) fn release_ending() -> io::Result<()> {
    Ok(heard().thread_unblock()?)
}

/// The blocked signals that have arrived.
#[derive(Debug)]
pub(crate) struct EndingSignals {
    arrived: SignalFd,
}

impl EndingSignals {
    pub(crate) fn new() -> io::Result<EndingSignals> {
        let flags = SfdFlags::SFD_CLOEXEC | SfdFlags::SFD_NONBLOCK;
        Ok(EndingSignals { arrived: SignalFd::with_flags(&heard(), flags)? })
    }

    /// The number of the next one, `None` when there is none.
    pub(crate) fn take(&self) -> io::Result<Option<libc::c_int>> {
        loop {
            match self.arrived.read_signal() {
                Ok(info) => return Ok(info.and_then(|info| libc::c_int::try_from(info.ssi_signo).ok())),
                Err(Errno::EINTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// For the registration with a poll only.
    pub(crate) fn raw_fd(&self) -> RawFd {
        self.arrived.as_fd().as_raw_fd()
    }
}
