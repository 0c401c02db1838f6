//! A connection over a byte stream: a socket, or a socket under layers.

use super::link::{Core, Link, TURN_BYTES_MAX, Turn};
use crate::Cx;
use crate::flow::login::Binding;
use crate::flow::wire::WRITE_PARTS_MAX;
use crate::world::{Readiness, Stream};
use std::io::{self, ErrorKind};

/// Vectored writes for one connection in one round; a peer that takes more waits for the next.
const WRITES_PER_ROUND_MAX: usize = 16;
/// What a read that gave nothing costs of the turn: pings of a layer below are work too.
const FRUITLESS_READ_COST: usize = 1024;

/// A byte stream as a link.
pub(crate) struct StreamLink {
    stream: Box<dyn Stream>,
    fault: Option<io::Error>,
}

impl StreamLink {
    pub(crate) fn new(stream: Box<dyn Stream>) -> StreamLink {
        StreamLink { stream, fault: None }
    }

    fn fill(&mut self, core: &mut dyn Core, room: &mut [u8]) -> Turn {
        let mut taken = 0;
        while taken < TURN_BYTES_MAX {
            if !core.wants_input() {
                return Turn::Held;
            }
            let most = room.len().min(TURN_BYTES_MAX - taken);
            match self.stream.read(&mut room[..most]) {
                Ok(0) => return Turn::Over,
                Ok(count) => {
                    taken += count;
                    if core.bytes(&room[..count]).is_err() {
                        return Turn::Over;
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Turn::Done,
                Err(error) if error.kind() == ErrorKind::Interrupted => taken += FRUITLESS_READ_COST,
                Err(error) => {
                    tracing::debug!("a connection broke: {error}");
                    return self.break_by(error);
                }
            }
        }
        Turn::More
    }

    /// What a layer said first is told: what comes after it is a consequence.
    fn break_by(&mut self, error: io::Error) -> Turn {
        self.fault.get_or_insert(error);
        Turn::Over
    }
}

impl Link for StreamLink {
    fn may_write(&self, readiness: Readiness) -> bool {
        readiness.writable
    }

    fn connected(&mut self) -> io::Result<bool> {
        self.stream.connected()
    }

    fn read(&mut self, _cx: &mut Cx, core: &mut dyn Core, room: &mut [u8]) -> Turn {
        let turn = self.fill(core, room);
        // What came may have made a layer answer by itself.
        match self.stream.flush() {
            Err(error) if would_wait(&error) == Some(Turn::Over) => self.break_by(error),
            _ => turn,
        }
    }

    fn write(&mut self, _cx: &mut Cx, core: &mut dyn Core) -> Turn {
        for _ in 0..WRITES_PER_ROUND_MAX {
            // What a layer holds back goes first.
            if let Err(error) = self.stream.flush() {
                match would_wait(&error) {
                    Some(Turn::Over) => return self.break_by(error),
                    Some(turn) => return turn,
                    None => continue,
                }
            }
            if !core.has_output() {
                return Turn::Done;
            }
            let slices = core.slices(WRITE_PARTS_MAX);
            if slices.is_empty() {
                return Turn::Done;
            }
            match self.stream.write_vectored(&slices) {
                Ok(count) => {
                    drop(slices);
                    core.wrote(count);
                }
                Err(error) => match would_wait(&error) {
                    Some(Turn::Over) => return self.break_by(error),
                    Some(turn) => return turn,
                    None => continue,
                },
            }
        }
        Turn::More
    }

    fn channel_binding(&self) -> Option<Binding> {
        self.stream.channel_binding()
    }

    fn fault(&mut self) -> Option<io::Error> {
        self.fault.take()
    }

    fn close(mut self: Box<Self>, _cx: &mut Cx) {
        // The peer may be gone already: closing cannot fail in a way that matters.
        drop(self.stream.shutdown_write());
    }
}

fn would_wait(error: &io::Error) -> Option<Turn> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::NotConnected => Some(Turn::Done),
        ErrorKind::Interrupted => None,
        _ => Some(Turn::Over),
    }
}
