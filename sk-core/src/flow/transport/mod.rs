//! How frames travel: sockets, and pipes inside the process.

mod address;
mod link;
mod pipe;

pub use address::{AddressError, HubAddress};
pub(crate) use link::{Broken, Core, Link, TURN_BYTES_MAX, Turn};
pub(crate) use pipe::PipeEnd;
pub use pipe::PipeSeed;
