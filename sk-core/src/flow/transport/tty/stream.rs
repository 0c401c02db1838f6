//! One of the byte streams of a line: what waits in either direction, and how much more may be sent.

use std::collections::VecDeque;

/// How much one side may send before the other has read some.
pub(super) const CREDIT_BYTES: usize = 8 * 1024;
/// How much waits here to be sent. Little, so that what waits longer stays where drop policies reach it.
const OUTGOING_BYTES_MAX: usize = 4 * 1024;

#[derive(Debug, Default)]
pub(super) struct Stream {
    /// Somebody here uses it.
    pub(super) in_use: bool,
    pub(super) incoming: VecDeque<u8>,
    outgoing: VecDeque<u8>,
    /// How much the peer has room for.
    credit: usize,
    /// Read here and not told to the peer.
    read: usize,
    open_due: bool,
    close_due: bool,
    closed_here: bool,
    pub(super) closed_there: bool,
    /// A write found no room.
    starved: bool,
}

/// What a stream has to send next.
pub(super) enum Due {
    Open,
    Close,
    Credit(u32),
    Data(Vec<u8>),
}

impl Stream {
    pub(super) fn begin(open_due: bool) -> Stream {
        Stream { in_use: true, open_due, credit: CREDIT_BYTES, ..Stream::default() }
    }

    /// Whether the number can be used anew.
    pub(super) fn is_free(&self) -> bool {
        !self.in_use
    }

    /// Takes what finds room.
    pub(super) fn write(&mut self, bytes: &[u8]) -> usize {
        let count = bytes.len().min(OUTGOING_BYTES_MAX.saturating_sub(self.outgoing.len()));
        self.outgoing.extend(&bytes[..count]);
        self.starved = count < bytes.len();
        count
    }

    /// Hands out what has come.
    pub(super) fn read(&mut self, into: &mut [u8]) -> usize {
        let count = into.len().min(self.incoming.len());
        for (place, byte) in into.iter_mut().zip(self.incoming.drain(..count)) {
            *place = byte;
        }
        self.read += count;
        if self.incoming.is_empty() {
            // An idle stream keeps no memory.
            self.incoming = VecDeque::new();
        }
        count
    }

    /// What came from the peer; `false` if that is more than it was allowed.
    pub(super) fn receive(&mut self, bytes: &[u8]) -> bool {
        if self.closed_here || self.close_due {
            return true;
        }
        // What was read and not told of is not the peer's to use yet.
        if self.incoming.len() + self.read + bytes.len() > CREDIT_BYTES {
            return false;
        }
        self.incoming.extend(bytes);
        true
    }

    pub(super) fn add_credit(&mut self, bytes: u32) {
        self.credit = self.credit.saturating_add(bytes as usize).min(CREDIT_BYTES);
    }

    /// Nobody here uses it any more.
    pub(super) fn close(&mut self) {
        self.close_due = true;
        self.incoming = VecDeque::new();
        if self.closed_there {
            self.outgoing = VecDeque::new();
        }
    }

    pub(super) fn close_there(&mut self) {
        self.closed_there = true;
        // Nobody will read it.
        self.outgoing = VecDeque::new();
        self.free_if_over();
    }

    fn free_if_over(&mut self) {
        if self.closed_here && self.closed_there {
            *self = Stream::default();
        }
    }

    /// Whether [`next`](Stream::next) would give something.
    pub(super) fn has_next(&self) -> bool {
        self.in_use
            && (self.open_due
                || self.is_credit_due()
                || (!self.outgoing.is_empty() && self.credit > 0)
                || self.is_close_due())
    }

    fn is_credit_due(&self) -> bool {
        self.read >= CREDIT_BYTES / 2 && !self.close_due && !self.closed_there
    }

    fn is_close_due(&self) -> bool {
        self.close_due && !self.closed_here && self.outgoing.is_empty()
    }

    /// What is to be sent next, at most `max` bytes of it.
    pub(super) fn next(&mut self, max: usize) -> Option<Due> {
        if !self.in_use {
            return None;
        }
        if std::mem::take(&mut self.open_due) {
            return Some(Due::Open);
        }
        if self.is_credit_due() {
            return Some(Due::Credit(std::mem::take(&mut self.read) as u32));
        }
        let count = max.min(self.outgoing.len()).min(self.credit);
        if count > 0 {
            self.credit -= count;
            let bytes = self.outgoing.drain(..count).collect();
            if self.outgoing.is_empty() {
                self.outgoing = VecDeque::new();
            }
            return Some(Due::Data(bytes));
        }
        if self.is_close_due() {
            self.closed_here = true;
            self.free_if_over();
            return Some(Due::Close);
        }
        None
    }

    /// Whether a write that found no room would find some now; true once.
    pub(super) fn has_new_room(&mut self) -> bool {
        let has = self.starved && self.outgoing.len() <= OUTGOING_BYTES_MAX / 2;
        self.starved &= !has;
        has
    }
}
