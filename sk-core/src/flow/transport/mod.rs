//! How frames travel: sockets, layers over them, and pipes inside the process.

mod address;
mod dial;
mod link;
mod pipe;
mod stream_link;
pub mod tty;
#[cfg(feature = "websocket")]
mod websocket;

pub use address::{AddressError, FLOW_PATH, HubAddress};
pub(crate) use dial::{dial, unsupported};
pub(crate) use link::{Broken, Core, Link, TURN_BYTES_MAX, Turn};
pub(crate) use pipe::PipeEnd;
pub use pipe::PipeSeed;
pub(crate) use stream_link::StreamLink;
#[cfg(feature = "websocket")]
pub(crate) use websocket::{WebSocketStream, agree};
