//! What a socket has still to write.

use crate::object::Access;
use crate::world::Stream;
use bytes::{Buf, Bytes};
use std::collections::VecDeque;
use std::io::{self, IoSlice};

/// How many parts one system call writes.
const PARTS_PER_WRITE_MAX: usize = 64;
/// How much one flush writes before other sockets have their turn.
const FLUSH_BYTES: usize = 256 * 1024;
/// How much may wait for a peer that does not read, until the owner says otherwise.
pub(super) const QUEUED_BYTES_MAX_DEFAULT: usize = 32 * 1024 * 1024;

/// Why nothing was queued.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WriteError {
    /// The peer reads too slowly: the queue has reached its bound.
    #[error("{queued} bytes wait to be written already, of at most {max}")]
    Full {
        /// What waits.
        queued: usize,
        /// The bound.
        max: usize,
    },
    /// The connection has failed or was closed here.
    #[error("the socket is closed for writing")]
    Closed,
    /// The object is buried.
    #[error(transparent)]
    Access(#[from] Access),
}

/// How far a flush got.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Flushed {
    /// Nothing is left.
    All,
    /// The system takes no more: it will report when it does.
    Blocked,
    /// The turn is used up.
    More,
}

/// The queue of parts, shared with whoever made them.
#[derive(Debug)]
pub(super) struct Outgoing {
    parts: VecDeque<Bytes>,
    bytes: usize,
    pub(super) max: usize,
}

impl Outgoing {
    pub(super) fn new() -> Outgoing {
        Outgoing { parts: VecDeque::new(), bytes: 0, max: QUEUED_BYTES_MAX_DEFAULT }
    }

    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    pub(super) fn is_empty(&self) -> bool {
        self.bytes == 0
    }

    /// Puts a part at the end, whole or not at all.
    pub(super) fn push(&mut self, part: Bytes) -> Result<(), WriteError> {
        if part.len() > self.max.saturating_sub(self.bytes) {
            return Err(WriteError::Full { queued: self.bytes, max: self.max });
        }
        if !part.is_empty() {
            self.bytes += part.len();
            self.parts.push_back(part);
        }
        Ok(())
    }

    pub(super) fn clear(&mut self) {
        self.parts = VecDeque::new();
        self.bytes = 0;
    }

    /// Writes what the system takes, up to 64 parts a call.
    pub(super) fn flush(&mut self, stream: &mut dyn Stream) -> io::Result<Flushed> {
        let mut written = 0;
        while !self.is_empty() {
            if written >= FLUSH_BYTES {
                return Ok(Flushed::More);
            }
            let (offered, count) = match self.write_once(stream) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(Flushed::Blocked),
                other => other?,
            };
            self.advance(count);
            written += count;
            // A stream that took less than it was offered has no room: it reports when it has.
            if count < offered {
                return Ok(Flushed::Blocked);
            }
        }
        // A burst must not hold its memory for ever.
        if self.parts.capacity() > PARTS_PER_WRITE_MAX {
            self.parts.shrink_to(PARTS_PER_WRITE_MAX);
        }
        Ok(Flushed::All)
    }

    fn write_once(&self, stream: &mut dyn Stream) -> io::Result<(usize, usize)> {
        let mut slices = [IoSlice::new(&[]); PARTS_PER_WRITE_MAX];
        let mut offered = 0;
        let mut used = 0;
        for (slice, part) in slices.iter_mut().zip(&self.parts) {
            *slice = IoSlice::new(part);
            offered += part.len();
            used += 1;
        }
        stream.write_vectored(&slices[..used]).map(|count| (offered, count))
    }

    fn advance(&mut self, mut count: usize) {
        self.bytes = self.bytes.saturating_sub(count);
        while let Some(first) = self.parts.front_mut() {
            if count < first.len() {
                first.advance(count);
                return;
            }
            count -= first.len();
            self.parts.pop_front();
        }
    }
}
