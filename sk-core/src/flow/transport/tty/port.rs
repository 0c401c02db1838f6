//! A serial line as an object: it serves the port, keeps the line's deadlines and tells the streams' ends.

use super::STREAMS;
use super::end::{LineEnd, Shared};
use super::line::{Line, LineEvent, Role};
use crate::eventloop::Timer;
use crate::flow::transport::Link;
use crate::object::{Handle, ObjectId};
use crate::world::{Endpoint, Readiness, Token};
use crate::{Cx, attach};
use std::cell::RefCell;
use std::io::{self, ErrorKind};
use std::rc::Rc;
use std::time::Duration;

/// Bytes taken from the port in one turn.
const TURN_BYTES_MAX: usize = 16 * 1024;
/// How often a listener looks for a port that went away: an adapter that was pulled out comes back.
const REOPEN_EVERY: Duration = Duration::from_secs(1);

/// Takes the listener's end of a stream that a caller opened.
pub(crate) type TakeEnd = Rc<dyn Fn(&mut Cx, Opening)>;

/// A stream that a caller opened, on its way to whoever serves it.
pub(crate) struct Opening {
    shared: Rc<RefCell<Shared>>,
    number: u8,
}

impl Opening {
    /// Makes it a link whose news are reported with `token`; nothing if the stream has ended again.
    pub(crate) fn accept(self, token: Token) -> Option<Box<dyn Link>> {
        let id = self.shared.borrow().line.opened(self.number)?;
        Some(Box::new(LineEnd::opened(self.shared, id, token)))
    }
}

/// One side of a serial line.
pub(crate) struct SerialLine {
    shared: Rc<RefCell<Shared>>,
    endpoint: Endpoint,
    role: Role,
    take: Option<TakeEnd>,
    deadline: Handle<Timer>,
    room: Vec<u8>,
}

crate::object! { pub(crate) SerialLine { slots { on_deadline() } hooks { on_destroy } } }

/// The name under which satellites of one loop find the line that they share.
fn name_of(endpoint: &Endpoint) -> String {
    match endpoint {
        Endpoint::Tty { path, .. } => format!("line:{}", path.display().to_string().replace('/', ":")),
        _ => String::from("line"),
    }
}

impl SerialLine {
    /// The caller's side: the end of a new stream, over a line that satellites of this loop share. The line is
    /// closed with the last of them.
    ///
    /// # Errors
    /// The port cannot be opened.
    pub(crate) fn call(cx: &mut Cx, at: &Endpoint, token: Token) -> io::Result<Box<dyn Link>> {
        let name = name_of(at);
        let known = cx.find_as::<SerialLine>(&name).filter(|line| cx.is_alive(*line));
        let line = match known {
            Some(line) => line,
            None => {
                let seed = cx.world().rng.next_u64();
                cx.named(&name)
                    .try_spawn_with(|cx, this| SerialLine::open(cx, this, at, Role::Caller, seed, None))?
            }
        };
        let shared = cx.with(line, |line, _| line.shared.clone()).map_err(io::Error::other)?;
        let end = LineEnd::calling(shared.clone(), token);
        cx.offer_source(shared.borrow().token);
        cx.offer_source(token);
        Ok(Box::new(end))
    }

    /// The listener's side, below `parent`.
    ///
    /// # Errors
    /// The port cannot be opened.
    pub(crate) fn listen(
        cx: &mut Cx,
        parent: ObjectId,
        at: &Endpoint,
        take: TakeEnd,
    ) -> io::Result<ObjectId> {
        let seed = cx.world().rng.next_u64();
        let line = cx
            .under(parent)
            .try_spawn_with(|cx, this| SerialLine::open(cx, this, at, Role::Listener, seed, Some(take)))?;
        Ok(line.id())
    }

    fn open(
        cx: &mut Cx,
        this: Handle<SerialLine>,
        at: &Endpoint,
        role: Role,
        seed: u64,
        take: Option<TakeEnd>,
    ) -> io::Result<SerialLine> {
        let Endpoint::Tty { baud, .. } = at else { return Err(ErrorKind::InvalidInput.into()) };
        let token = cx.add_source(this.id(), serve);
        let port = cx.world().net.connect(at, token)?;
        let deadline = cx.under(this).spawn(Timer::default());
        attach!(cx, deadline.timeout => this.on_deadline);
        let shared = Shared {
            line: Line::new(role, seed, *baud, cx.now()),
            port: Some(port),
            token,
            ends: [None; STREAMS as usize],
            waiting: Vec::new(),
            count: 0,
            failed: false,
        };
        Ok(SerialLine {
            shared: Rc::new(RefCell::new(shared)),
            endpoint: at.clone(),
            role,
            take,
            deadline,
            room: vec![0; 4096],
        })
    }

    fn serve(&mut self, cx: &mut Cx) -> (bool, Vec<Opening>) {
        let now = cx.now();
        let mut shared = self.shared.borrow_mut();
        let more = shared.read(&mut self.room, now);
        shared.line.tick(now);
        shared.pump(now);
        if shared.failed && shared.port.take().is_some() {
            cx.remove_source(shared.token);
            shared.line.hang_up(now);
        }
        let mut opened = Vec::new();
        while let Some(event) = shared.line.next_event() {
            match event {
                LineEvent::Ready(number) => {
                    if let Some(token) = shared.ends[usize::from(number)] {
                        cx.offer_source(token);
                    }
                }
                LineEvent::Opened(number) => opened.push(Opening { shared: self.shared.clone(), number }),
                LineEvent::Up => {
                    tracing::debug!("the serial line {:?} is up", self.endpoint);
                    shared.waiting.drain(..).for_each(|token| cx.offer_source(token));
                }
                LineEvent::Down => tracing::debug!("the serial line {:?} is down", self.endpoint),
            }
        }
        drop(shared);
        self.plan(cx);
        (more, opened)
    }

    /// Sets the timer to what is due next.
    fn plan(&mut self, cx: &mut Cx) {
        let (due, has_port, is_alone) = {
            let shared = self.shared.borrow();
            (shared.line.next_deadline(), shared.port.is_some(), shared.count == 0)
        };
        if self.role == Role::Caller && (is_alone || !has_port) {
            // The port is free for others from now on. Ends that are left find their streams ended, and whoever
            // has them calls anew.
            self.shared.borrow_mut().port = None;
            let this = cx.this(self);
            return cx.destroy_later(this);
        }
        let wait = match (has_port, due) {
            (false, _) => Some(REOPEN_EVERY),
            (true, Some(due)) => Some(due.since(cx.now()).max(Duration::from_millis(1))),
            (true, None) => None,
        };
        // The timer is this object's child and lives as long as it.
        let _ = match wait {
            Some(wait) => self.deadline.start_once(cx, wait),
            None => self.deadline.stop(cx),
        };
    }

    fn on_deadline(&mut self, cx: &mut Cx) {
        let has_port = self.shared.borrow().port.is_some();
        if !has_port {
            self.reopen(cx);
        }
        let token = self.shared.borrow().token;
        cx.offer_source(token);
    }

    fn reopen(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        let token = cx.add_source(this.id(), serve);
        match cx.world().net.connect(&self.endpoint, token) {
            Ok(port) => {
                let mut shared = self.shared.borrow_mut();
                (shared.port, shared.token, shared.failed) = (Some(port), token, false);
            }
            Err(error) => {
                tracing::debug!("a serial port is still gone: {error}");
                cx.remove_source(token);
                self.plan(cx);
            }
        }
    }

    /// The line's ends are still told what the peer hears of it.
    fn on_destroy(&mut self, cx: &mut Cx) {
        let now = cx.now();
        let mut shared = self.shared.borrow_mut();
        shared.pump(now);
        shared.port = None;
        shared.line.hang_up(now);
        let tokens: Vec<Token> = shared.ends.iter().flatten().copied().collect();
        drop(shared);
        tokens.into_iter().for_each(|token| cx.offer_source(token));
    }
}

impl Shared {
    /// Takes what the port has; whether there may be more.
    fn read(&mut self, room: &mut [u8], now: sk_flat::Instant) -> bool {
        let mut taken = 0;
        while taken < TURN_BYTES_MAX {
            let Some(port) = &mut self.port else { return false };
            match port.read(room) {
                Ok(0) => self.failed = true,
                Ok(count) => {
                    taken += count;
                    self.line.receive(&room[..count], now);
                    continue;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => {
                    tracing::debug!("a serial port failed: {error}");
                    self.failed = true;
                }
            }
            return false;
        }
        true
    }
}

/// The port is ready, or an end has made something for it.
fn serve(cx: &mut Cx, line: ObjectId, _readiness: Readiness) -> bool {
    let line = Handle::<SerialLine>::new(line);
    let Ok((more, opened)) = cx.with(line, |line, cx| line.serve(cx)) else { return false };
    if !opened.is_empty()
        && let Ok(Some(take)) = cx.with(line, |line, _| line.take.clone())
    {
        opened.into_iter().for_each(|opening| take(cx, opening));
    }
    more
}
