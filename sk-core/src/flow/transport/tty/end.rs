//! One stream of a line as a link, and what the ends of a line share with its port.

use super::line::{Line, StreamError, StreamId};
use super::{PAYLOAD_BYTES_MAX, STREAMS};
use crate::Cx;
use crate::flow::transport::link::{Core, Link, TURN_BYTES_MAX, Turn};
use crate::flow::wire::WRITE_PARTS_MAX;
use crate::world::{Readiness, Stream, Token};
use sk_flat::Instant;
use std::cell::RefCell;
use std::io::{self, ErrorKind, IoSlice};
use std::rc::Rc;

/// A line, its port, and who is told when a stream has news. All of it lives on one loop.
pub(super) struct Shared {
    pub(super) line: Line,
    pub(super) port: Option<Box<dyn Stream>>,
    /// The source of the line itself.
    pub(super) token: Token,
    /// The sources of the streams in use.
    pub(super) ends: [Option<Token>; STREAMS as usize],
    /// Ends that wait for the line to come up.
    pub(super) waiting: Vec<Token>,
    /// How many ends there are, waiting ones included.
    pub(super) count: usize,
    /// Why the port cannot be used any more.
    pub(super) failed: bool,
}

impl Shared {
    /// Writes what the port takes.
    pub(super) fn pump(&mut self, now: Instant) {
        let Some(port) = &mut self.port else { return };
        loop {
            let ready = self.line.output(now);
            if ready.is_empty() {
                return;
            }
            match port.write_vectored(&[IoSlice::new(ready)]) {
                Ok(count) => self.line.wrote(count),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => {
                    tracing::debug!("a serial port failed: {error}");
                    self.failed = true;
                    return;
                }
            }
        }
    }
}

/// One end of one stream.
pub(crate) struct LineEnd {
    shared: Rc<RefCell<Shared>>,
    /// None while the line is not up.
    id: Option<StreamId>,
    token: Token,
}

impl LineEnd {
    /// An end that opens a stream as soon as the line is up.
    pub(super) fn calling(shared: Rc<RefCell<Shared>>, token: Token) -> LineEnd {
        shared.borrow_mut().count += 1;
        LineEnd { shared, id: None, token }
    }

    /// The listener's end of a stream that was opened.
    pub(super) fn opened(shared: Rc<RefCell<Shared>>, id: StreamId, token: Token) -> LineEnd {
        let mut lent = shared.borrow_mut();
        lent.count += 1;
        lent.ends[usize::from(id.number)] = Some(token);
        drop(lent);
        LineEnd { shared, id: Some(id), token }
    }

    /// The stream's name, opened now if that has become possible.
    fn id(&mut self) -> Option<StreamId> {
        if self.id.is_none() {
            let mut shared = self.shared.borrow_mut();
            match shared.line.open() {
                Some(id) => {
                    shared.ends[usize::from(id.number)] = Some(self.token);
                    self.id = Some(id);
                }
                None if !shared.waiting.contains(&self.token) => shared.waiting.push(self.token),
                None => {}
            }
        }
        self.id
    }

    /// What was done here may have made something for the port, and the line looks after its deadlines.
    fn move_on(&self, cx: &mut Cx) {
        let mut shared = self.shared.borrow_mut();
        shared.pump(cx.now());
        cx.offer_source(shared.token);
    }
}

impl Link for LineEnd {
    fn fragment_bytes_max(&self) -> Option<u32> {
        Some(PAYLOAD_BYTES_MAX as u32)
    }

    /// The line has one bell for both directions.
    fn may_write(&self, _readiness: Readiness) -> bool {
        true
    }

    fn connected(&mut self) -> io::Result<bool> {
        Ok(self.id().is_some())
    }

    fn read(&mut self, cx: &mut Cx, core: &mut dyn Core, room: &mut [u8]) -> Turn {
        let Some(id) = self.id() else { return Turn::Done };
        let mut taken = 0;
        let turn = loop {
            if taken >= TURN_BYTES_MAX {
                break Turn::More;
            }
            if !core.wants_input() {
                break Turn::Held;
            }
            let read = self.shared.borrow_mut().line.read(id, room);
            match read {
                Ok(count) => {
                    taken += count;
                    if core.bytes(&room[..count]).is_err() {
                        break Turn::Over;
                    }
                }
                Err(StreamError::NotNow) => break Turn::Done,
                Err(StreamError::Ended) => break Turn::Over,
            }
        };
        if taken > 0 {
            // The other side may be waiting to hear that there is room again.
            self.move_on(cx);
        }
        turn
    }

    fn write(&mut self, cx: &mut Cx, core: &mut dyn Core) -> Turn {
        let Some(id) = self.id() else { return Turn::Done };
        let mut written = 0;
        let turn = loop {
            if !core.has_output() {
                break Turn::Done;
            }
            let slices = core.slices(WRITE_PARTS_MAX);
            let Some(first) = slices.first() else { break Turn::Done };
            let wrote = self.shared.borrow_mut().line.write(id, first);
            drop(slices);
            match wrote {
                Ok(count) => {
                    written += count;
                    core.wrote(count);
                }
                Err(StreamError::NotNow) => break Turn::Done,
                Err(StreamError::Ended) => break Turn::Over,
            }
        };
        if written > 0 {
            self.move_on(cx);
        }
        turn
    }

    fn close(self: Box<Self>, cx: &mut Cx) {
        let shared = self.shared.clone();
        drop(self);
        let mut shared = shared.borrow_mut();
        shared.pump(cx.now());
        cx.offer_source(shared.token);
    }
}

impl Drop for LineEnd {
    /// However an end goes, its number becomes free and the other side is told with the line's next turn.
    fn drop(&mut self) {
        // Nobody drops an end while the line is lent out.
        let Ok(mut shared) = self.shared.try_borrow_mut() else { return };
        shared.count -= 1;
        let token = self.token;
        shared.waiting.retain(|waiting| *waiting != token);
        if let Some(id) = self.id {
            shared.line.close(id);
            let place = &mut shared.ends[usize::from(id.number)];
            if *place == Some(token) {
                *place = None;
            }
        }
    }
}
