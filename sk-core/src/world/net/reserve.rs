//! Descriptors that connections leave to others.

use crate::sys::descriptors;
use std::fs::File;
use std::io;
use std::os::fd::RawFd;

/// What connections from the network leave free: for files, and for those who administer this program.
const FOR_FILES_AND_OWNER: u64 = 32;
/// What programs of the same user leave free of that: for files.
const FOR_FILES: u64 = 16;
/// Where few descriptors are allowed at all, no more than one in so many is left free.
const SHARE_MIN: u64 = 4;
/// The process has as many descriptors as it may, or the system has.
const EXHAUSTED: [i32; 2] = [24, 23];

/// Who may come in at a listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Guests {
    Network,
    SameUser,
}

/// A listener's part in leaving descriptors free. One is kept open for nothing: when there is no other, it makes
/// room to take in who waits, and to turn him away at once instead of leaving him to wait.
#[derive(Debug)]
pub(super) struct Reserve {
    guests: Guests,
    spare: Option<File>,
}

impl Reserve {
    pub(super) fn new(guests: Guests) -> Reserve {
        Reserve { guests, spare: spare() }
    }

    /// Whether a descriptor that was given out is one of those that are to be left free: the system gives out the
    /// lowest one.
    pub(super) fn is_touched_by(&self, descriptor: RawFd) -> bool {
        descriptors::limit().is_some_and(|limit| is_reserved(self.guests, descriptor, limit))
    }

    /// Turns away who waits, if `error` says that no descriptor is left.
    pub(super) fn turn_away<S>(&mut self, error: &io::Error, accept: impl FnOnce() -> io::Result<S>) {
        if error.raw_os_error().is_some_and(|number| EXHAUSTED.contains(&number)) {
            self.spare = None;
            // Another thread may have been quicker: then he waits.
            drop(accept());
            self.spare = spare();
        }
    }
}

/// What is told of a connection that is turned away.
pub(super) fn exhausted() -> io::Error {
    io::Error::from_raw_os_error(EXHAUSTED[0])
}

fn spare() -> Option<File> {
    File::open("/dev/null").ok()
}

fn is_reserved(guests: Guests, descriptor: RawFd, limit: u64) -> bool {
    let wanted = match guests {
        Guests::Network => FOR_FILES_AND_OWNER,
        Guests::SameUser => FOR_FILES,
    };
    let reserve = wanted.min(limit / SHARE_MIN);
    u64::try_from(descriptor).is_ok_and(|descriptor| descriptor >= limit - reserve)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_descriptors_are_left_free() {
        for (guests, limit, last) in [
            (Guests::Network, 1024, 991),
            (Guests::SameUser, 1024, 1007),
            (Guests::Network, 64, 47),
            (Guests::SameUser, 40, 29),
        ] {
            assert!(!is_reserved(guests, last, limit), "{guests:?} of {limit}");
            assert!(is_reserved(guests, last + 1, limit), "{guests:?} of {limit}");
        }
        assert!(!is_reserved(Guests::Network, -1, 1024));
    }
}
