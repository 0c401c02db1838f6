//! One connection's way, whatever it is made of.

use super::PipeEnd;
use super::pipe::Taken;
use crate::Cx;
use crate::flow::Encoded;
use crate::flow::wire::{Slices, WRITE_PARTS_MAX};
use crate::world::{Readiness, Stream};
use std::io::{self, ErrorKind};

/// Bytes taken from one source in one turn.
pub(crate) const TURN_BYTES_MAX: usize = 64 * 1024;
/// Frames taken from a pipe in one turn.
const TURN_FRAMES_MAX: usize = 64;
/// Vectored writes for one connection in one round; a peer that takes more waits for the next.
const WRITES_PER_ROUND_MAX: usize = 16;

/// A socket or a pipe.
pub(crate) enum Link {
    Socket(Box<dyn Stream>),
    Pipe(PipeEnd),
}

/// The core of a connection, of either side, as a link sees it.
pub(crate) trait Core {
    fn wants_input(&self) -> bool;
    fn bytes(&mut self, bytes: &[u8]) -> Result<(), Broken>;
    fn frame(&mut self, frame: Encoded) -> Result<(), Broken>;
    fn has_output(&self) -> bool;
    fn slices(&mut self, parts_max: usize) -> Slices<'_>;
    fn wrote(&mut self, count: usize);
    fn take(&mut self) -> Option<Encoded>;
    /// A frame that found no room, to be the next one again.
    fn put_back(&mut self, frame: Encoded);
    fn put_back_first(&mut self) -> Option<Encoded>;
}

/// The connection is over on this side: the core has seen what no honest peer sends.
pub(crate) struct Broken;

/// What became of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Nothing more for now; readiness will tell.
    Done,
    /// Something may be left: come again.
    More,
    /// The core does not want more now; the link is still readable.
    Held,
    /// The link is over.
    Over,
}

impl Link {
    /// Whether what waits is to be written at this readiness. A pipe has one bell for both directions.
    pub(crate) fn may_write(&self, readiness: Readiness) -> bool {
        readiness.writable || matches!(self, Link::Pipe(_))
    }

    /// Reads what a turn allows.
    pub(crate) fn read(&mut self, cx: &mut Cx, core: &mut dyn Core, room: &mut [u8]) -> Turn {
        match self {
            Link::Socket(stream) => read_socket(&mut **stream, core, room),
            Link::Pipe(pipe) => read_pipe(pipe, cx, core),
        }
    }

    /// Writes what there is, a vectored write at a time. `More`: the peer would take more.
    pub(crate) fn write(&mut self, cx: &mut Cx, core: &mut dyn Core) -> Turn {
        match self {
            Link::Socket(stream) => write_socket(&mut **stream, core),
            Link::Pipe(pipe) => write_pipe(pipe, cx, core),
        }
    }

    /// The end: nothing more will be written.
    pub(crate) fn close(self) {
        match self {
            // The peer may be gone already: closing cannot fail in a way that matters.
            Link::Socket(mut stream) => drop(stream.shutdown_write()),
            Link::Pipe(pipe) => drop(pipe),
        }
    }
}

fn read_socket(stream: &mut dyn Stream, core: &mut dyn Core, room: &mut [u8]) -> Turn {
    let mut taken = 0;
    while taken < TURN_BYTES_MAX {
        if !core.wants_input() {
            return Turn::Held;
        }
        let most = room.len().min(TURN_BYTES_MAX - taken);
        match stream.read(&mut room[..most]) {
            Ok(0) => return Turn::Over,
            Ok(count) => {
                taken += count;
                if core.bytes(&room[..count]).is_err() {
                    return Turn::Over;
                }
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Turn::Done,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return Turn::Over,
        }
    }
    Turn::More
}

fn read_pipe(pipe: &PipeEnd, cx: &mut Cx, core: &mut dyn Core) -> Turn {
    pipe.heard();
    for _ in 0..TURN_FRAMES_MAX {
        if !core.wants_input() {
            return Turn::Held;
        }
        match pipe.take(cx) {
            Taken::Frame(frame) => {
                if core.frame(frame).is_err() {
                    return Turn::Over;
                }
            }
            Taken::Nothing => return Turn::Done,
            Taken::Closed => return Turn::Over,
        }
    }
    Turn::More
}

fn write_socket(stream: &mut dyn Stream, core: &mut dyn Core) -> Turn {
    for _ in 0..WRITES_PER_ROUND_MAX {
        if !core.has_output() {
            return Turn::Done;
        }
        let slices = core.slices(WRITE_PARTS_MAX);
        if slices.is_empty() {
            return Turn::Done;
        }
        match stream.write_vectored(&slices) {
            Ok(count) => {
                drop(slices);
                core.wrote(count);
            }
            Err(error) => match would_wait(&error) {
                Some(turn) => return turn,
                None => continue,
            },
        }
    }
    Turn::More
}

fn would_wait(error: &io::Error) -> Option<Turn> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::NotConnected => Some(Turn::Done),
        ErrorKind::Interrupted => None,
        _ => Some(Turn::Over),
    }
}

fn write_pipe(pipe: &PipeEnd, cx: &mut Cx, core: &mut dyn Core) -> Turn {
    while let Some(frame) = core.put_back_first().or_else(|| core.take()) {
        match pipe.send(cx, frame) {
            Ok(()) => {}
            Err(Some(frame)) => {
                core.put_back(frame);
                return Turn::Done;
            }
            Err(None) => return Turn::Over,
        }
    }
    Turn::Done
}
