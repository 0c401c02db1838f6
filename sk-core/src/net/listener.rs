//! A listening socket as an object.

use super::alarm::Alarm;
use super::turn::Turn;
use super::{Socket, gone};
use crate::Cx;
use crate::eventloop::Spawner;
use crate::object::{Access, Handle, ObjectId};
use crate::signal::Signal;
use crate::world::{self, Endpoint, Readiness, Token};
use std::io::{self, ErrorKind};
use std::time::Duration;

/// How many connections are accepted before other sockets have their turn.
const ACCEPTS_PER_TURN: usize = 64;
/// When accepting is tried again after the process ran out of descriptors.
const RETRY_AFTER: Duration = Duration::from_millis(100);

/// Listens for streams on a TCP port or a Unix socket. `incoming` tells that some may wait; the slot
/// [`accept`](Handle::accept)s until it gets `None`. [`Socket`] shows it at work.
pub struct Listener {
    /// Connections may wait to be accepted.
    pub incoming: Signal<()>,
    socket: Box<dyn world::Listener>,
    token: Token,
    turn: Turn,
    retrying: bool,
}

crate::object! { pub Listener { signals { incoming() } } }

/// What one attempt to accept came to.
enum Accepted {
    Stream(Box<dyn world::Stream>),
    /// Nothing more now; the turn may be used up, and then the listener has to be offered again.
    None {
        offer: bool,
    },
    Failed {
        error: io::Error,
        retry: bool,
    },
}

impl Listener {
    /// Listens at `at`.
    ///
    /// # Errors
    /// The address is taken or not allowed, or no descriptor is left.
    pub fn on(cx: &mut Cx, at: &Endpoint) -> io::Result<Handle<Listener>> {
        cx.try_spawn_with(|cx, this| Listener::open(cx, this, at))
    }

    /// As [`on`](Listener::on), with a place: `Listener::placed(cx.under(hub).named("tcp"), &at)`.
    ///
    /// # Errors
    /// As [`on`](Listener::on).
    pub fn placed(place: Spawner<'_>, at: &Endpoint) -> io::Result<Handle<Listener>> {
        place.try_spawn_with(|cx, this| Listener::open(cx, this, at))
    }

    fn open(cx: &mut Cx, this: Handle<Listener>, at: &Endpoint) -> io::Result<Listener> {
        let token = cx.add_source(this.id(), serve);
        match cx.world.net.listen(at, token) {
            Ok(socket) => Ok(Listener {
                incoming: Signal::new(),
                socket,
                token,
                turn: Turn::of(ACCEPTS_PER_TURN),
                retrying: false,
            }),
            Err(error) => {
                cx.remove_source(token);
                Err(error)
            }
        }
    }

    fn accept_one(&mut self, round: u64, token: Token) -> Accepted {
        if self.turn.left(round) == 0 {
            return Accepted::None { offer: !self.turn.is_served() };
        }
        match self.socket.accept(token) {
            Ok(stream) => {
                self.turn.took(1);
                Accepted::Stream(stream)
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                self.turn.ran_dry();
                Accepted::None { offer: false }
            }
            Err(error) => {
                // The system does not report the waiting connection again, and trying at once would spin.
                self.turn.ran_dry();
                Accepted::Failed { error, retry: !std::mem::replace(&mut self.retrying, true) }
            }
        }
    }
}

impl Handle<Listener> {
    /// The next connection, as an object without a parent; `None` when none waits or when this turn's
    /// share is used up, and then `incoming` comes again by itself.
    ///
    /// # Errors
    /// No descriptor is left (`EMFILE`, `ENFILE`) or no memory: the connection goes on waiting and
    /// `incoming` comes again after 100 ms. `NotConnected` if the listener is gone.
    pub fn accept(self, cx: &mut Cx) -> io::Result<Option<Handle<Socket>>> {
        self.accept_to(cx, None)
    }

    /// As [`accept`](Handle::accept); the socket becomes a child of `parent`.
    ///
    /// # Errors
    /// As [`accept`](Handle::accept).
    pub fn accept_under(
        self,
        cx: &mut Cx,
        parent: impl Into<ObjectId>,
    ) -> io::Result<Option<Handle<Socket>>> {
        self.accept_to(cx, Some(parent.into()))
    }

    fn accept_to(self, cx: &mut Cx, parent: Option<ObjectId>) -> io::Result<Option<Handle<Socket>>> {
        let round = cx.pulse().round;
        // Its owner is known only when there is a stream.
        let token = cx.add_source(ObjectId::NOBODY, Socket::SERVE);
        let outcome = cx.with(self, |listener, _| (listener.accept_one(round, token), listener.token));
        if !matches!(outcome, Ok((Accepted::Stream(_), _))) {
            cx.remove_source(token);
        }
        match outcome.map_err(gone)? {
            (Accepted::Stream(stream), _) => Ok(Some(Socket::accepted(cx, parent, stream, token))),
            (Accepted::None { offer }, own) => {
                if offer {
                    cx.offer_source(own);
                }
                Ok(None)
            }
            (Accepted::Failed { error, retry }, _) => {
                if retry {
                    Alarm::set(cx, self.id(), RETRY_AFTER, |cx, id| Handle::<Listener>::new(id).retry(cx));
                }
                Err(error)
            }
        }
    }

    /// Where it listens, with the port that was chosen.
    ///
    /// # Errors
    /// [`Access::Gone`] if the listener was buried.
    pub fn local(self, cx: &mut Cx) -> Result<Endpoint, Access> {
        cx.with(self, |listener, _| listener.socket.local())
    }

    fn retry(self, cx: &mut Cx) {
        let token = cx.with(self, |listener, _| {
            listener.retrying = false;
            listener.token
        });
        if let Ok(token) = token {
            cx.offer_source(token);
        }
    }
}

fn serve(cx: &mut Cx, owner: ObjectId, _ready: Readiness) -> bool {
    let this = Handle::<Listener>::new(owner);
    let round = cx.pulse().round;
    if cx.with(this, |listener, _| listener.turn.begin(round)).is_err() {
        return false;
    }
    cx.emit_own(this, |listener| &listener.incoming, &());
    cx.with(this, |listener, _| listener.turn.end()).unwrap_or(false)
}
