//! A datagram socket as an object.

use super::gone;
use super::turn::Turn;
use crate::Cx;
use crate::eventloop::Spawner;
use crate::object::{Access, Handle, ObjectId};
use crate::signal::Signal;
use crate::world::{Datagram, Readiness, Token};
use std::io::{self, ErrorKind};
use std::net::SocketAddr;

/// How many datagrams are received before other sockets have their turn.
const DATAGRAMS_PER_TURN: usize = 64;

/// A UDP socket. `readable` tells that datagrams may wait; the slot [`receive`](Handle::receive)s until
/// `WouldBlock`.
///
/// ```
/// use sk_core::prelude::*;
///
/// struct Ear { socket: Handle<Datagrams>, heard: Vec<u8> }
/// impl Ear {
///     fn hear(&mut self, cx: &mut Cx) {
///         let mut room = [0; 1500];
///         while let Ok((count, _from)) = self.socket.receive(cx, &mut room) {
///             self.heard.extend_from_slice(&room[..count]);
///             cx.quit();
///         }
///     }
/// }
/// object! { Ear { slots { hear() } } }
///
/// let mut app = SkApp::new();
/// let cx = app.cx();
/// let socket = Datagrams::bind(cx, "127.0.0.1:0".parse()?)?;
/// let ear = cx.spawn(Ear { socket, heard: Vec::new() });
/// attach!(cx, socket.readable => ear.hear);
/// let at = socket.local(cx)?;
/// socket.send(cx, at, b"to myself")?;
/// app.run();
/// assert_eq!(app.cx().with(ear, |ear, _| ear.heard.clone())?, b"to myself");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Datagrams {
    /// Datagrams may wait.
    pub readable: Signal<()>,
    socket: Box<dyn Datagram>,
    token: Token,
    turn: Turn,
}

crate::object! { pub Datagrams { signals { readable() } } }

impl Datagrams {
    /// Binds `at`.
    ///
    /// # Errors
    /// The address is taken or not allowed, or no descriptor is left.
    pub fn bind(cx: &mut Cx, at: SocketAddr) -> io::Result<Handle<Datagrams>> {
        cx.try_spawn_with(|cx, this| Datagrams::open(cx, this, at))
    }

    /// As [`bind`](Datagrams::bind), with a place: `Datagrams::placed(cx.under(hub), at)`.
    ///
    /// # Errors
    /// As [`bind`](Datagrams::bind).
    pub fn placed(place: Spawner<'_>, at: SocketAddr) -> io::Result<Handle<Datagrams>> {
        place.try_spawn_with(|cx, this| Datagrams::open(cx, this, at))
    }

    fn open(cx: &mut Cx, this: Handle<Datagrams>, at: SocketAddr) -> io::Result<Datagrams> {
        let token = cx.add_source(this.id(), serve);
        match cx.world.net.bind(at, token) {
            Ok(socket) => {
                Ok(Datagrams { readable: Signal::new(), socket, token, turn: Turn::of(DATAGRAMS_PER_TURN) })
            }
            Err(error) => {
                cx.remove_source(token);
                Err(error)
            }
        }
    }

    fn receive(&mut self, round: u64, into: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        if self.turn.left(round) == 0 {
            return Err(ErrorKind::WouldBlock.into());
        }
        let outcome = self.socket.receive(into);
        match &outcome {
            Err(error) if error.kind() == ErrorKind::WouldBlock => self.turn.ran_dry(),
            // An error is the report on something sent before; more may wait behind it.
            _ => self.turn.took(1),
        }
        outcome
    }
}

impl Handle<Datagrams> {
    /// The next datagram and its sender; what does not fit into `into` is lost.
    ///
    /// # Errors
    /// `WouldBlock` when none waits or this turn's share is used up, and then `readable` comes again by
    /// itself; what the system reports of datagrams sent before; `NotConnected` if the object is gone.
    pub fn receive(self, cx: &mut Cx, into: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        let round = cx.pulse().round;
        let (outcome, offer) = cx
            .with(self, |socket, _| {
                let outcome = socket.receive(round, into);
                let stopped = socket.turn.left(round) == 0 && !socket.turn.is_served();
                (outcome, stopped.then_some(socket.token))
            })
            .map_err(gone)?;
        if let Some(token) = offer {
            cx.offer_source(token);
        }
        outcome
    }

    /// Sends one datagram at once.
    ///
    /// # Errors
    /// `WouldBlock` when the system has no room: the datagram is not sent. Otherwise what the system says,
    /// for example that it is too long; `NotConnected` if the object is gone.
    pub fn send(self, cx: &mut Cx, to: SocketAddr, datagram: &[u8]) -> io::Result<()> {
        cx.with(self, |socket, _| socket.socket.send(to, datagram))
            .map_err(gone)?
            .map(drop)
    }

    /// Where it is bound, with the port that was chosen.
    ///
    /// # Errors
    /// [`Access::Gone`] if the socket was buried.
    pub fn local(self, cx: &mut Cx) -> Result<SocketAddr, Access> {
        cx.with(self, |socket, _| socket.socket.local())
    }
}

fn serve(cx: &mut Cx, owner: ObjectId, ready: Readiness) -> bool {
    let this = Handle::<Datagrams>::new(owner);
    let round = cx.pulse().round;
    if !ready.readable || cx.with(this, |socket, _| socket.turn.begin(round)).is_err() {
        return false;
    }
    cx.emit_own(this, |socket| &socket.readable, &());
    cx.with(this, |socket, _| socket.turn.end()).unwrap_or(false)
}
