//! The state of simulated sockets: what each holds and whether it is ready.

use super::wire::{Medium, SocketId};
use super::{Endpoint, Token};
use sk_flat::Instant;
use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;

/// How many bytes of datagrams may wait to be received; later ones are lost. The default of Linux.
const DATAGRAM_BYTES_MAX: usize = 212_992;

/// How many connections may wait to be accepted; further ones are refused.
const WAITING_MAX: usize = 1024;

/// A simulated socket.
#[derive(Debug)]
pub(super) struct Socket {
    /// The number of the loop that has it.
    pub(super) share: usize,
    /// `None` for the server's end of a connection that has not been accepted.
    pub(super) token: Option<Token>,
    /// Whether it stands in its loop's list of changed sockets.
    pub(super) listed: bool,
    pub(super) kind: Kind,
}

#[derive(Debug)]
pub(super) enum Kind {
    Listener(Waiting),
    Stream(End),
    Datagrams(Mailbox),
    Signals,
    /// One end of a pipe: whether it was rung since the last look, and when the last ring arrives.
    Bell {
        rung: bool,
        last_due: Instant,
    },
}

/// A listener's side.
#[derive(Debug)]
pub(super) struct Waiting {
    pub(super) at: Endpoint,
    pub(super) ends: VecDeque<SocketId>,
}

impl Waiting {
    pub(super) fn has_room(&self) -> bool {
        self.ends.len() < WAITING_MAX
    }
}

/// A datagram socket's side.
#[derive(Debug)]
pub(super) struct Mailbox {
    pub(super) at: SocketAddr,
    datagrams: VecDeque<(SocketAddr, Vec<u8>)>,
    bytes: usize,
}

impl Mailbox {
    pub(super) fn new(at: SocketAddr) -> Mailbox {
        Mailbox { at, datagrams: VecDeque::new(), bytes: 0 }
    }

    pub(super) fn has_room(&self, bytes: usize) -> bool {
        self.bytes + bytes <= DATAGRAM_BYTES_MAX
    }

    pub(super) fn put(&mut self, from: SocketAddr, bytes: Vec<u8>) {
        self.bytes += bytes.len();
        self.datagrams.push_back((from, bytes));
    }

    pub(super) fn take(&mut self) -> Option<(SocketAddr, Vec<u8>)> {
        let next = self.datagrams.pop_front()?;
        self.bytes -= next.1.len();
        Some(next)
    }

    pub(super) fn is_readable(&self) -> bool {
        !self.datagrams.is_empty()
    }
}

/// How far a connection is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Connecting,
    Open,
    Refused,
}

/// How what comes in ends; a later one is the graver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Ending {
    /// The other end writes no more, and still reads.
    Finished,
    /// The other end is gone.
    Closed,
    /// The other end is gone and has left bytes unread.
    Reset,
}

/// One end of a stream.
#[derive(Debug)]
pub(super) struct End {
    pub(super) medium: Medium,
    pub(super) phase: Phase,
    /// The other end, known from the moment that the wish to connect arrives.
    pub(super) other: Option<SocketId>,
    pub(super) peer: Option<Endpoint>,
    pub(super) incoming: VecDeque<u8>,
    pub(super) ending: Option<Ending>,
    /// How many bytes may still be written before the other end has read some.
    pub(super) credit: usize,
    /// Whether a write found too little credit and waits to hear of more.
    pub(super) starved: bool,
    pub(super) write_shut: bool,
    /// When the last thing sent arrives: nothing sent later arrives before.
    pub(super) last_due: Instant,
    /// The port that was taken for it, to be given back.
    pub(super) port: Option<u16>,
}

impl End {
    pub(super) fn new(medium: Medium, phase: Phase, credit: usize) -> End {
        End {
            medium,
            phase,
            other: None,
            peer: None,
            incoming: VecDeque::new(),
            ending: None,
            credit,
            starved: false,
            write_shut: false,
            last_due: Instant::ZERO,
            port: None,
        }
    }

    /// Moves what has come into `into`; the end of the stream is `Ok(0)`.
    pub(super) fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if self.phase == Phase::Refused {
            return Err(io::ErrorKind::NotConnected.into());
        }
        let count = into.len().min(self.incoming.len());
        if count > 0 {
            for (place, byte) in into.iter_mut().zip(self.incoming.drain(..count)) {
                *place = byte;
            }
            return Ok(count);
        }
        match self.ending {
            _ if into.is_empty() => Ok(0),
            None => Err(io::ErrorKind::WouldBlock.into()),
            Some(Ending::Finished | Ending::Closed) => Ok(0),
            Some(Ending::Reset) => Err(io::ErrorKind::ConnectionReset.into()),
        }
    }

    /// How many of `wanted` bytes may be written now; they are taken from the credit.
    pub(super) fn admit(&mut self, wanted: usize) -> io::Result<usize> {
        match (self.phase, self.ending) {
            (Phase::Refused, _) => return Err(io::ErrorKind::NotConnected.into()),
            (_, Some(Ending::Reset)) => return Err(io::ErrorKind::ConnectionReset.into()),
            (_, Some(Ending::Closed)) => return Err(io::ErrorKind::BrokenPipe.into()),
            _ if self.write_shut => return Err(io::ErrorKind::BrokenPipe.into()),
            (Phase::Connecting, _) => return Err(io::ErrorKind::WouldBlock.into()),
            (Phase::Open, _) => {}
        }
        let count = wanted.min(self.credit);
        self.credit -= count;
        self.starved = count < wanted;
        if count == 0 && wanted > 0 { Err(io::ErrorKind::WouldBlock.into()) } else { Ok(count) }
    }

    fn is_readable(&self) -> bool {
        !self.incoming.is_empty() || self.ending.is_some() || self.phase == Phase::Refused
    }

    fn is_writable(&self) -> bool {
        let fails_at_once = self.write_shut || self.ending > Some(Ending::Finished);
        match self.phase {
            Phase::Connecting => false,
            Phase::Open => self.credit > 0 || fails_at_once,
            Phase::Refused => true,
        }
    }
}

impl Socket {
    /// Whether it can be read and written at present.
    pub(super) fn state(&self, signals_pending: bool) -> (bool, bool) {
        match &self.kind {
            Kind::Listener(waiting) => (!waiting.ends.is_empty(), false),
            Kind::Stream(end) => (end.is_readable(), end.is_writable()),
            Kind::Datagrams(mailbox) => (mailbox.is_readable(), true),
            Kind::Signals => (signals_pending, false),
            Kind::Bell { rung, .. } => (*rung, false),
        }
    }
}
