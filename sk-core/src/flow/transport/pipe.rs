//! A connection inside the process: whole frames through bounded queues, no payload byte copied.
//!
//! The hub and a module may share a loop or sit on two threads. Either way frames are taken in step 4 of a
//! round, like socket input, and never by a direct call.

use super::link::{Core, Link, Turn};
use crate::Cx;
use crate::flow::Encoded;
use crate::thread::{Mailbox, Message};
use crate::world::{Readiness, SimulatedBell, Token};
use crossbeam_channel::{Receiver, Sender, TryRecvError, TrySendError};
use sk_flat::Instant;
use std::cell::RefCell;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering, fence};
use std::sync::{Arc, OnceLock};

/// How many frames wait in each direction.
const FRAMES_WAITING_MAX: usize = 256;
/// Frames taken from a pipe in one turn.
const TURN_FRAMES_MAX: usize = 64;

/// How to make one end look at its queue.
struct Bell {
    place: OnceLock<Place>,
    rung: AtomicBool,
    /// The other end waits for room.
    wanted: AtomicBool,
}

/// The loop and source that serve an end.
struct Place {
    mailbox: Arc<Mailbox>,
    token: Token,
    /// In a simulated world the way takes time, and the simulated network tells the source.
    simulated: Option<SimulatedBell>,
}

/// A frame, and when it arrives: at once in the real world.
type Sent = (Instant, Encoded);

impl Bell {
    fn new() -> Arc<Bell> {
        Arc::new(Bell {
            place: OnceLock::new(),
            rung: AtomicBool::new(false),
            wanted: AtomicBool::new(false),
        })
    }

    /// Rung once until it is heard, however many frames go by.
    fn ring(&self, cx: &mut Cx) {
        // Ringing comes after what is to be found, hearing before looking for it. The fences make sure that a
        // bell that is not rung, because it was rung before, is heard after what this ring is about.
        fence(Ordering::SeqCst);
        let Some(Place { mailbox, token, simulated }) = self.place.get() else { return };
        if let Some(bell) = simulated.as_ref().filter(|bell| bell.takes_time(cx.is_my_mailbox(mailbox))) {
            bell.ring();
            return;
        }
        if self.rung.swap(true, Ordering::AcqRel) {
            return;
        }
        let token = *token;
        if cx.is_my_mailbox(mailbox) {
            cx.offer_source(token);
        } else {
            // A loop that has ended hears nothing any more; this end finds the queue closed.
            let _ = mailbox.post_anyway(Message::Settle(Box::new(move |cx| cx.offer_source(token))));
        }
    }

    /// When what is sent now arrives, if the way takes time.
    fn arrival(&self, cx: &Cx) -> Instant {
        let Some(Place { mailbox, simulated: Some(bell), .. }) = self.place.get() else {
            return Instant::ZERO;
        };
        if bell.takes_time(cx.is_my_mailbox(mailbox)) { bell.next_arrival() } else { Instant::ZERO }
    }
}

/// One end of a pipe.
pub(crate) struct PipeEnd {
    /// Both are `Some` until the end is dropped.
    sender: Option<Sender<Sent>>,
    receiver: Option<Receiver<Sent>>,
    /// A frame that is still under way.
    ahead: RefCell<Option<Sent>>,
    mine: Arc<Bell>,
    other: Arc<Bell>,
}

/// The satellite's end of a pipe on its way to its loop. `Send`.
pub struct PipeSeed(PipeEnd);

/// What [`PipeEnd::take`] found.
enum Taken {
    Frame(Encoded),
    Nothing,
    Closed,
}

impl PipeEnd {
    /// Two ends; the second is sent to the satellite's loop.
    pub(crate) fn pair() -> (PipeEnd, PipeSeed) {
        let (to_satellite, from_hub) = crossbeam_channel::bounded(FRAMES_WAITING_MAX);
        let (to_hub, from_satellite) = crossbeam_channel::bounded(FRAMES_WAITING_MAX);
        let (hub, satellite) = (Bell::new(), Bell::new());
        let near = PipeEnd {
            sender: Some(to_satellite),
            receiver: Some(from_satellite),
            ahead: RefCell::new(None),
            mine: hub.clone(),
            other: satellite.clone(),
        };
        let far = PipeEnd {
            sender: Some(to_hub),
            receiver: Some(from_hub),
            ahead: RefCell::new(None),
            mine: satellite,
            other: hub,
        };
        (near, PipeSeed(far))
    }

    /// From now on this end is served by that source.
    pub(crate) fn serve_by(&self, cx: &mut Cx, token: Token) {
        let simulated = cx.world.simulated_share().map(|share| share.bell(token));
        let place = Place { mailbox: cx.own_mailbox(), token, simulated };
        // An end is placed once, by whoever grows it.
        let _ = self.mine.place.set(place);
        // What came before is looked at now.
        cx.offer_source(token);
    }

    /// To be called when the source is served, before frames are taken.
    fn heard(&self) {
        self.mine.rung.store(false, Ordering::Relaxed);
        fence(Ordering::SeqCst);
    }

    /// Sends a frame, or gives it back if there is no room: the source is served again when there is.
    fn send(&self, cx: &mut Cx, frame: Encoded) -> Result<(), Option<Encoded>> {
        let Some(sender) = &self.sender else { return Err(None) };
        match sender.try_send((self.other.arrival(cx), frame)) {
            Ok(()) => {
                self.other.ring(cx);
                Ok(())
            }
            Err(TrySendError::Full((_, frame))) => {
                self.mine.wanted.store(true, Ordering::Release);
                self.other.ring(cx);
                Err(Some(frame))
            }
            Err(TrySendError::Disconnected(_)) => Err(None),
        }
    }

    fn take(&self, cx: &mut Cx) -> Taken {
        let Some(receiver) = &self.receiver else { return Taken::Closed };
        let taken = match self.ahead.take() {
            Some(sent) => Ok(sent),
            None => receiver.try_recv(),
        };
        // Looked at when nothing is there too: the sender may have found the queue full just before this end
        // emptied it, and said so just after.
        if self.other.wanted.swap(false, Ordering::AcqRel) {
            self.other.ring(cx);
        }
        match taken {
            // The bell rings again when it has come.
            Ok(sent) if sent.0 > Instant::ZERO && sent.0 > cx.clock_now() => {
                self.ahead.replace(Some(sent));
                Taken::Nothing
            }
            Ok((_, frame)) => Taken::Frame(frame),
            Err(TryRecvError::Empty) => Taken::Nothing,
            Err(TryRecvError::Disconnected) => Taken::Closed,
        }
    }
}

impl Link for PipeEnd {
    /// A pipe has one bell for both directions.
    fn may_write(&self, _readiness: Readiness) -> bool {
        true
    }

    fn connected(&mut self) -> io::Result<bool> {
        Ok(true)
    }

    fn read(&mut self, cx: &mut Cx, core: &mut dyn Core, _room: &mut [u8]) -> Turn {
        self.heard();
        for _ in 0..TURN_FRAMES_MAX {
            if !core.wants_input() {
                return Turn::Held;
            }
            match self.take(cx) {
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

    fn write(&mut self, cx: &mut Cx, core: &mut dyn Core) -> Turn {
        while let Some(frame) = core.put_back_first().or_else(|| core.take()) {
            match self.send(cx, frame) {
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

    fn close(self: Box<Self>, _cx: &mut Cx) {}
}

impl Drop for PipeEnd {
    /// However an end goes, the other one is told and finds the queue closed.
    fn drop(&mut self) {
        drop((self.sender.take(), self.receiver.take()));
        fence(Ordering::SeqCst);
        if let Some(Place { mailbox, token, simulated }) = self.other.place.get() {
            if let Some(bell) = simulated {
                bell.ring();
                return;
            }
            let token = *token;
            // A loop that has ended needs no telling.
            let _ = mailbox.post_anyway(Message::Settle(Box::new(move |cx| cx.offer_source(token))));
        }
    }
}

impl PipeSeed {
    pub(crate) fn grow(self) -> PipeEnd {
        self.0
    }
}
