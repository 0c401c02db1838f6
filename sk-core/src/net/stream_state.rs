//! What a socket knows of its connection, without the loop.

use super::outgoing::{Flushed, Outgoing, WriteError};
use super::turn::Turn;
use crate::world::{Endpoint, Stream, Token};
use bytes::{Bytes, BytesMut};
use std::fmt;
use std::io::{self, ErrorKind};

/// How much a socket reads before the next ready one has its turn.
pub(super) const TURN_BYTES: usize = 64 * 1024;
/// How much room a read into a growing buffer asks for at first.
const READ_BYTES_FIRST: usize = 4 * 1024;

/// Why a connection is over.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum CloseReason {
    /// The peer writes no more. It may still read: what is queued goes out, and more can be written until
    /// the socket is closed here.
    Ended,
    /// It broke, or was never made.
    Failed(String),
    /// It was closed here.
    Local,
}

impl fmt::Display for CloseReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CloseReason::Ended => f.write_str("the peer ended it"),
            CloseReason::Failed(error) => write!(f, "it failed: {error}"),
            CloseReason::Local => f.write_str("it was closed here"),
        }
    }
}

/// What a turn of reading leaves behind.
pub(super) enum TurnEnd {
    /// There may be more to read.
    More,
    /// Nothing for now.
    Rest,
    /// The connection is over and all that could be read was offered.
    Over(CloseReason),
}

/// One end of a connection.
pub(super) struct Connection {
    /// `None` once the descriptor is closed.
    pub(super) stream: Option<Box<dyn Stream>>,
    pub(super) token: Token,
    pub(super) peer: Option<Endpoint>,
    pub(super) outgoing: Outgoing,
    pub(super) turn: Turn,
    /// The connection is made.
    pub(super) made: bool,
    /// It is being closed from here.
    pub(super) closing: bool,
    /// `closed` was emitted.
    pub(super) told: bool,
    /// A flush is asked for.
    flush_due: bool,
    /// The system takes no more at present.
    blocked: bool,
    /// The end of what the peer sends was reached, or an error.
    read_over: bool,
    failed: Option<String>,
    /// Read to learn whether the peer is there, while nobody reads.
    ahead: Option<u8>,
}

impl Connection {
    pub(super) fn new(stream: Box<dyn Stream>, token: Token, made: bool) -> Connection {
        Connection {
            peer: stream.peer(),
            stream: Some(stream),
            token,
            outgoing: Outgoing::new(),
            turn: Turn::of(TURN_BYTES),
            made,
            closing: false,
            told: false,
            flush_due: false,
            blocked: false,
            read_over: false,
            failed: None,
            ahead: None,
        }
    }

    // ---- reading ----

    /// One read for the owner. The end and errors are kept for the end of the turn.
    pub(super) fn read(&mut self, round: u64, into: &mut [u8]) -> io::Result<usize> {
        let room = self.turn.left(round).min(into.len());
        if self.closing || self.read_over || into.is_empty() {
            return Ok(0);
        }
        if room == 0 || !self.made {
            return Err(ErrorKind::WouldBlock.into());
        }
        if let Some(ahead) = self.ahead.take() {
            into[0] = ahead;
            self.turn.took(1);
            return Ok(1);
        }
        let count = self.read_stream(&mut into[..room])?;
        if count > 0 {
            self.turn.took(count);
        }
        Ok(count)
    }

    /// Reads until nothing is there or the turn is over; answers how much was added.
    pub(super) fn read_into(&mut self, round: u64, into: &mut BytesMut) -> io::Result<usize> {
        let before = into.len();
        let mut step = READ_BYTES_FIRST;
        loop {
            let filled = into.len();
            into.resize(filled + step, 0);
            let outcome = self.read(round, &mut into[filled..]);
            into.truncate(filled + *outcome.as_ref().unwrap_or(&0));
            match outcome {
                Ok(0) => break,
                // What fills its room is likely to be long.
                Ok(count) if count == step => step = (step * 4).min(TURN_BYTES),
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if into.len() == before => return Err(error),
                Err(_) => break,
            }
        }
        Ok(into.len() - before)
    }

    /// Whether somebody who reads by himself has met something that only the loop can carry on.
    pub(super) fn wants_offer(&mut self, round: u64) -> bool {
        let stopped = self.turn.left(round) == 0;
        !self.turn.is_served() && !self.told && self.stream.is_some() && (stopped || self.read_over)
    }

    fn read_stream(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let Some(stream) = &mut self.stream else { return Ok(0) };
        loop {
            match stream.read(into) {
                Ok(0) => {
                    self.read_over = true;
                    return Ok(0);
                }
                Ok(count) => return Ok(count),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.turn.ran_dry();
                    return Err(error);
                }
                Err(error) => {
                    self.read_over = true;
                    self.failed.get_or_insert_with(|| error.to_string());
                    return Err(error);
                }
            }
        }
    }

    /// The owner's slots have run: what now?
    pub(super) fn end_turn(&mut self) -> TurnEnd {
        let more = self.turn.end();
        if !self.turn.was_used() && !self.turn.is_dry() && !self.read_over && self.ahead.is_none() {
            self.look_ahead();
        }
        let waits = more && !self.read_over;
        match self.failed.take() {
            Some(error) if waits => {
                self.failed = Some(error);
                TurnEnd::More
            }
            Some(error) => TurnEnd::Over(CloseReason::Failed(error)),
            None if self.told => TurnEnd::Rest,
            None if self.read_over => TurnEnd::Over(CloseReason::Ended),
            None if waits => TurnEnd::More,
            None => TurnEnd::Rest,
        }
    }

    /// Nobody reads: then the end of the stream is found only by looking.
    fn look_ahead(&mut self) {
        let mut byte = [0];
        if let Ok(1) = self.read_stream(&mut byte) {
            self.ahead = Some(byte[0]);
        }
    }

    /// While closing: throws away what still comes, one turn of it. Whether there may be more.
    pub(super) fn discard(&mut self, round: u64) -> bool {
        self.turn.begin(round);
        let mut waste = [0; 8 * 1024];
        while !self.read_over && self.turn.left(round) > 0 {
            match self.read_stream(&mut waste) {
                Ok(count) => self.turn.took(count),
                Err(_) => break,
            }
        }
        self.turn.end() && !self.read_over
    }

    // ---- writing ----

    /// Queues a part; answers whether a flush has to be asked for.
    pub(super) fn write(&mut self, part: Bytes) -> Result<bool, WriteError> {
        if self.closing || self.failed.is_some() || self.stream.is_none() {
            return Err(WriteError::Closed);
        }
        self.outgoing.push(part)?;
        Ok(self.ask_for_flush())
    }

    /// Whether a flush is to be asked for now: not while one is, and not before the system has room.
    pub(super) fn ask_for_flush(&mut self) -> bool {
        let ask = self.made && !self.flush_due && !self.blocked && !self.outgoing.is_empty();
        self.flush_due |= ask;
        ask
    }

    /// The system has room again.
    pub(super) fn unblock(&mut self) -> bool {
        self.blocked = false;
        self.ask_for_flush()
    }

    /// Step 7. `None`: it failed, and the end has to be told.
    pub(super) fn flush(&mut self) -> Option<Flushed> {
        self.flush_due = false;
        let stream = self.stream.as_mut()?;
        match self.outgoing.flush(&mut **stream) {
            Ok(flushed) => {
                self.blocked = flushed == Flushed::Blocked;
                if self.closing && flushed == Flushed::All {
                    self.shut();
                }
                Some(flushed)
            }
            Err(error) => {
                self.outgoing.clear();
                self.failed.get_or_insert_with(|| error.to_string());
                None
            }
        }
    }

    // ---- the end ----

    /// Begins to close from here.
    pub(super) fn begin_close(&mut self) {
        self.closing = true;
        if self.made && self.outgoing.is_empty() {
            self.shut();
        }
    }

    fn shut(&mut self) {
        // A connection that is broken cannot be shut; reading from it tells so.
        if let Some(stream) = &mut self.stream {
            let _ = stream.shutdown_write();
        }
    }

    /// While closing: whether nothing is left to wait for.
    pub(super) fn is_closed_up(&self) -> bool {
        let nothing_queued = self.outgoing.is_empty();
        self.failed.is_some() || (nothing_queued && (self.read_over || !self.made))
    }

    /// Closes the descriptor.
    pub(super) fn release(&mut self) {
        self.stream = None;
        self.outgoing.clear();
        self.ahead = None;
    }
}
