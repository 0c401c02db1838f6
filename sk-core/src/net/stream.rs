//! A connected byte stream as an object.

use super::alarm::Alarm;
use super::gone;
use super::outgoing::{Flushed, WriteError};
use super::stream_state::{CloseReason, Connection, TurnEnd};
use crate::Cx;
use crate::eventloop::Spawner;
use crate::object::{Access, Handle, ObjectId};
use crate::signal::Signal;
use crate::world::{Endpoint, Readiness, Stream, Token};
use bytes::{Bytes, BytesMut};
use std::io;
use std::time::Duration;

/// How long a socket that was closed here waits for its peer to take what is queued and to close too.
const LINGER: Duration = Duration::from_secs(5);

/// A byte stream to one peer, over TCP or a Unix socket: made by [`Socket::connect`] or by
/// [`accept`](Handle::accept). It is commanded by methods on its handle, also in the slots it calls.
///
/// **Reading.** `readable` tells that there may be something; the slot reads until `WouldBlock`, or less:
/// then it is called again in its next turn. A turn ends after 64 KiB, also with `WouldBlock`, so that other
/// sockets are served. A slot that reads nothing is not called again before something new comes or somebody
/// calls [`resume`](Handle::resume): that is how to let a peer wait.
///
/// **Writing.** [`write`](Handle::write) queues; the parts queued in a round go out at its end in one system
/// call per 64 of them. What the system does not take waits until it does, up to a bound.
///
/// **The end.** `closed` is emitted once, after all that could be read was offered. After
/// [`CloseReason::Ended`] the socket still writes and lives until it is closed or destroyed here. After the
/// other reasons the descriptor is closed and the object is destroyed at the end of the round.
/// [`close`](Handle::close) ends politely. `destroy_later` ends at once: what was queued before it gets the
/// one write at the end of the round, the rest is lost, and `closed` is not emitted; the descriptor is
/// closed at the burial.
///
/// ```
/// use sk_core::prelude::*;
///
/// struct Echo { listener: Handle<Listener> }
/// impl Echo {
///     fn greet(&mut self, cx: &mut Cx) -> std::io::Result<()> {
///         let this = cx.this(self);
///         while let Some(socket) = self.listener.accept_under(cx, this)? {
///             let answer = cx.under(socket).spawn(Answer { socket });
///             attach!(cx, socket.readable => answer.answer);
///             attach!(cx, socket.closed => answer.leave());
///         }
///         Ok(())
///     }
/// }
/// object! { Echo { slots { greet() } } }
///
/// struct Answer { socket: Handle<Socket> }
/// impl Answer {
///     fn answer(&mut self, cx: &mut Cx) -> Result<(), Box<dyn std::error::Error>> {
///         let mut text = bytes::BytesMut::new();
///         self.socket.read_into(cx, &mut text)?;
///         Ok(self.socket.write(cx, text)?)
///     }
///     fn leave(&mut self, cx: &mut Cx) { let _ = self.socket.close(cx); }
/// }
/// object! { Answer { slots { answer() leave() } } }
///
/// struct Client { socket: Handle<Socket>, heard: Vec<u8> }
/// impl Client {
///     fn hear(&mut self, cx: &mut Cx) {
///         let mut room = [0; 64];
///         while let Ok(count @ 1..) = self.socket.read(cx, &mut room) {
///             self.heard.extend_from_slice(&room[..count]);
///         }
///         if self.heard == b"hello" { cx.quit() }
///     }
/// }
/// object! { Client { slots { hear() } } }
///
/// let mut app = SkApp::new();
/// let cx = app.cx();
/// let listener = Listener::on(cx, &Endpoint::Ip("127.0.0.1:0".parse()?))?;
/// let echo = cx.spawn(Echo { listener });
/// attach!(cx, listener.incoming => echo.greet);
///
/// let at = listener.local(cx)?;
/// let socket = Socket::connect(cx, &at)?;
/// let client = cx.spawn(Client { socket, heard: Vec::new() });
/// attach!(cx, socket.readable => client.hear);
/// socket.write(cx, "hello")?;
/// app.run();
/// assert_eq!(app.cx().with(client, |c, _| c.heard.clone())?, b"hello");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Socket {
    /// The connection begun by [`Socket::connect`] is made. Accepted ones do not emit it.
    pub connected: Signal<()>,
    /// There may be something to read.
    pub readable: Signal<()>,
    /// All that was queued has been taken by the system.
    pub drained: Signal<()>,
    /// The connection is over.
    pub closed: Signal<CloseReason>,
    connection: Connection,
}

crate::object! { pub Socket { signals { connected() readable() drained() closed(CloseReason) } } }

impl Socket {
    /// Begins to connect: `connected` or `closed` tells the outcome.
    ///
    /// # Errors
    /// What is known at once, as [`Net::connect`](crate::world::Net::connect).
    pub fn connect(cx: &mut Cx, to: &Endpoint) -> io::Result<Handle<Socket>> {
        cx.try_spawn_with(|cx, this| Socket::begin(cx, this, to))
    }

    /// As [`connect`](Socket::connect), with a place: `Socket::connect_placed(cx.under(owner), &to)`.
    ///
    /// # Errors
    /// As [`connect`](Socket::connect).
    pub fn connect_placed(place: Spawner<'_>, to: &Endpoint) -> io::Result<Handle<Socket>> {
        place.try_spawn_with(|cx, this| Socket::begin(cx, this, to))
    }

    fn begin(cx: &mut Cx, this: Handle<Socket>, to: &Endpoint) -> io::Result<Socket> {
        let token = cx.add_source(this.id(), serve);
        match cx.world.net.connect(to, token) {
            Ok(stream) => Ok(Socket::over(Connection::new(stream, token, false))),
            Err(error) => {
                cx.remove_source(token);
                Err(error)
            }
        }
    }

    /// Makes the object of a stream that was accepted.
    pub(super) fn accepted(
        cx: &mut Cx,
        parent: Option<ObjectId>,
        stream: Box<dyn Stream>,
        token: Token,
    ) -> Handle<Socket> {
        let socket = Socket::over(Connection::new(stream, token, true));
        let socket = match parent {
            Some(parent) => cx.under(parent).spawn(socket),
            None => cx.spawn(socket),
        };
        cx.give_source(token, socket.id());
        socket
    }

    fn over(connection: Connection) -> Socket {
        Socket {
            connected: Signal::new(),
            readable: Signal::new(),
            drained: Signal::new(),
            closed: Signal::new(),
            connection,
        }
    }

    /// What a stream that is about to be accepted is served by.
    pub(super) const SERVE: crate::eventloop::Dispatch = serve;
}

impl Handle<Socket> {
    /// Reads into `into`. `Ok(0)` is the end of the stream, or the socket was closed here.
    ///
    /// # Errors
    /// `WouldBlock` when nothing is there for now or the turn is used up; other errors end the connection
    /// and come with `closed` too. `NotConnected` if the object is gone.
    pub fn read(self, cx: &mut Cx, into: &mut [u8]) -> io::Result<usize> {
        self.reading(cx, |connection, round| connection.read(round, into))
    }

    /// Adds to `into` whatever can be read in this turn, and answers how many bytes. The end of the stream
    /// is told by `closed` alone.
    ///
    /// # Errors
    /// As [`read`](Handle::read), but without `WouldBlock`, and only if nothing was read before.
    pub fn read_into(self, cx: &mut Cx, into: &mut BytesMut) -> io::Result<usize> {
        self.reading(cx, |connection, round| connection.read_into(round, into))
    }

    fn reading(
        self,
        cx: &mut Cx,
        read: impl FnOnce(&mut Connection, u64) -> io::Result<usize>,
    ) -> io::Result<usize> {
        let round = cx.pulse().round;
        let (outcome, offer) = self
            .inside(cx, |connection| {
                let outcome = read(connection, round);
                (outcome, connection.wants_offer(round).then_some(connection.token))
            })
            .map_err(gone)?;
        if let Some(token) = offer {
            cx.offer_source(token);
        }
        outcome
    }

    /// Asks for `readable` once more, for data that was left unread.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn resume(self, cx: &mut Cx) -> Result<(), Access> {
        let token = self.inside(cx, |connection| connection.token)?;
        cx.offer_source(token);
        Ok(())
    }

    /// Queues `part`, whole or not at all. It is not copied. Before the connection is made it waits for it.
    ///
    /// # Errors
    /// [`WriteError`]; nothing was queued then.
    pub fn write(self, cx: &mut Cx, part: impl Into<Bytes>) -> Result<(), WriteError> {
        let part = part.into();
        if self.inside(cx, |connection| connection.write(part))?? {
            cx.write_later(self.id(), flush);
        }
        Ok(())
    }

    /// How many bytes wait to be taken by the system.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn queued_bytes(self, cx: &mut Cx) -> Result<usize, Access> {
        self.inside(cx, |connection| connection.outgoing.bytes())
    }

    /// Bounds how many bytes may wait: 32 MiB unless told otherwise. What waits already stays.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn set_queued_bytes_max(self, cx: &mut Cx, max: usize) -> Result<(), Access> {
        self.inside(cx, |connection| connection.outgoing.max = max)
    }

    /// Closes politely: takes no more writes, sends what is queued, tells the peer the end, throws away what
    /// still comes until the peer closes too, then emits `closed` and destroys the socket. After five
    /// seconds it does so in any case. Safe to call twice.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn close(self, cx: &mut Cx) -> Result<(), Access> {
        let began = self.inside(cx, |connection| {
            let first = !connection.closing && connection.stream.is_some();
            if first {
                connection.begin_close();
            }
            first.then_some(connection.token)
        })?;
        if let Some(token) = began {
            Alarm::set(cx, self.id(), LINGER, |cx, id| {
                Handle::<Socket>::new(id).conclude(cx, CloseReason::Local);
            });
            cx.offer_source(token);
        }
        Ok(())
    }

    /// The other end, where it has a name.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn peer(self, cx: &mut Cx) -> Result<Option<Endpoint>, Access> {
        self.inside(cx, |connection| connection.peer.clone())
    }

    /// The user id of the process at the other end of a Unix socket; `None` for TCP.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn peer_uid(self, cx: &mut Cx) -> Result<Option<u32>, Access> {
        self.inside(cx, |connection| connection.stream.as_ref().and_then(|stream| stream.peer_uid()))
    }

    fn inside<R>(self, cx: &mut Cx, f: impl FnOnce(&mut Connection) -> R) -> Result<R, Access> {
        cx.with(self, |socket, _| f(&mut socket.connection))
    }

    // ---- what the loop calls ----

    /// Whether the connection is made; tells so, or that it failed, when it becomes known.
    fn is_made(self, cx: &mut Cx) -> Result<bool, Access> {
        let outcome = self.inside(cx, |connection| {
            if connection.made {
                return None;
            }
            let connected = connection.stream.as_mut().map(|stream| stream.connected())?;
            connection.made = matches!(connected, Ok(true));
            Some((connected, connection.closing))
        })?;
        match outcome {
            None => return Ok(true),
            Some((Ok(false), _)) => return Ok(false),
            Some((Err(error), closing)) => {
                let failed = CloseReason::Failed(error.to_string());
                self.conclude(cx, if closing { CloseReason::Local } else { failed });
                return Ok(false);
            }
            Some((Ok(true), false)) => cx.emit_own(self, |socket| &socket.connected, &()),
            Some((Ok(true), true)) => {}
        }
        if self.inside(cx, Connection::ask_for_flush)? {
            cx.write_later(self.id(), flush);
        }
        Ok(true)
    }

    /// Serves one turn; whether the socket is ready still.
    fn serve(self, cx: &mut Cx, ready: Readiness) -> Result<bool, Access> {
        if !self.is_made(cx)? {
            return self.close_up(cx);
        }
        if ready.writable && self.inside(cx, Connection::unblock)? {
            cx.write_later(self.id(), flush);
        }
        if !cx.is_alive(self) || !ready.readable {
            return Ok(false);
        }
        if self.inside(cx, |connection| connection.closing)? {
            return self.close_up(cx);
        }
        let round = cx.pulse().round;
        self.inside(cx, |connection| connection.turn.begin(round))?;
        if !self.inside(cx, |connection| connection.told)? {
            cx.emit_own(self, |socket| &socket.readable, &());
        }
        match self
            .inside(cx, |connection| if connection.closing { TurnEnd::Rest } else { connection.end_turn() })?
        {
            TurnEnd::More => return Ok(true),
            TurnEnd::Rest => {}
            TurnEnd::Over(reason) if cx.is_alive(self) => self.conclude(cx, reason),
            TurnEnd::Over(_) => {}
        }
        Ok(false)
    }

    /// One turn of a socket that is being closed from here.
    fn close_up(self, cx: &mut Cx) -> Result<bool, Access> {
        let round = cx.pulse().round;
        let (more, over) = self.inside(cx, |connection| {
            let more = connection.closing && connection.made && connection.discard(round);
            (more, connection.closing && connection.is_closed_up())
        })?;
        if over {
            self.conclude(cx, CloseReason::Local);
        }
        Ok(more && !over)
    }

    /// Tells the end, once. Unless only the peer has ended, the descriptor is closed first.
    fn conclude(self, cx: &mut Cx, reason: CloseReason) {
        let stays = reason == CloseReason::Ended;
        // The end of a socket that lives on waits for somebody to hear it.
        if stays && cx.with(self, |socket, _| socket.closed.listeners()) == Ok(0) {
            return;
        }
        let before = self.inside(cx, |connection| {
            if !stays {
                connection.release();
            }
            (std::mem::replace(&mut connection.told, true), connection.token)
        });
        let Ok((told, token)) = before else { return };
        if !stays {
            cx.remove_source(token);
        }
        if !told {
            cx.emit_own(self, |socket| &socket.closed, &reason);
        }
        if !stays {
            cx.destroy_later(self);
        }
    }

    fn flush(self, cx: &mut Cx) -> Result<(), Access> {
        let (flushed, closing, token) =
            self.inside(cx, |connection| (connection.flush(), connection.closing, connection.token))?;
        match flushed {
            Some(Flushed::Blocked) => {}
            Some(Flushed::More) => {
                if self.inside(cx, Connection::ask_for_flush)? {
                    cx.write_later(self.id(), flush);
                }
            }
            // What came before the connection broke can still be read; and a closing socket may be done.
            None => cx.offer_source(token),
            Some(Flushed::All) if closing => cx.offer_source(token),
            Some(Flushed::All) if cx.is_alive(self) => cx.emit_own(self, |socket| &socket.drained, &()),
            Some(Flushed::All) => {}
        }
        Ok(())
    }
}

fn serve(cx: &mut Cx, owner: ObjectId, ready: Readiness) -> bool {
    Handle::<Socket>::new(owner).serve(cx, ready).unwrap_or(false)
}

fn flush(cx: &mut Cx, owner: ObjectId) {
    // Buried meanwhile: there is nothing left to write.
    let _ = Handle::<Socket>::new(owner).flush(cx);
}
