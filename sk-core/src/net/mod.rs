//! Sockets as objects: their readiness is a signal, and they are commanded by methods on their handles.
//!
//! A [`Listener`] accepts [`Socket`]s, which are byte streams over TCP or a Unix socket; [`Datagrams`] is
//! UDP. None of them is leased while its slots run, so a slot may read, write, close and destroy the socket
//! that called it. Ready sockets are served in turn, each for a bounded turn, so that none starves another.

mod alarm;
mod door;
#[cfg(feature = "http")]
pub mod http;
mod listener;
mod outgoing;
mod stream;
mod stream_state;
mod turn;
mod udp;

pub(crate) use door::{Door, Shortage, Wrap};
pub use listener::Listener;
pub use outgoing::WriteError;
pub use stream::Socket;
pub use stream_state::CloseReason;
pub use udp::Datagrams;

use crate::object::Access;
use std::io;

/// What an operation on a socket answers whose object is buried.
fn gone(access: Access) -> io::Error {
    io::Error::new(io::ErrorKind::NotConnected, access)
}
