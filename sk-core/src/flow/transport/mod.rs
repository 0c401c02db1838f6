//! How frames travel: sockets, layers over them, and pipes inside the process.

mod address;
pub mod datagram;
mod dial;
mod link;
mod pipe;
mod stream_link;
#[cfg(feature = "tls")]
mod tls;
pub mod tty;
#[cfg(feature = "websocket")]
mod websocket;

pub use address::{AddressError, FLOW_PATH, HubAddress};
#[cfg(not(all(feature = "tls", feature = "websocket")))]
pub(crate) use dial::unsupported;
pub(crate) use dial::{Destination, dial};
pub(crate) use link::{Broken, Core, Link, TURN_BYTES_MAX, Turn};
pub(crate) use pipe::PipeEnd;
pub use pipe::PipeSeed;
pub(crate) use stream_link::StreamLink;
#[cfg(feature = "tls")]
pub(crate) use tls::TlsStream;
#[cfg(feature = "tls")]
pub use tls::{TlsError, TlsIdentity, TlsTrust};
#[cfg(feature = "websocket")]
pub(crate) use websocket::{WebSocketStream, agree};
