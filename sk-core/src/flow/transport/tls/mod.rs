//! TLS as a layer over a byte stream: what a server shows, what a client trusts, and the stream itself.
//!
//! The cryptography is ring's, with its own randomness, and the validity of certificates is judged by the
//! machine's calendar: neither comes from the world, so a simulated network carries no TLS.

mod pin;
mod settings;
mod stream;

pub use settings::{TlsError, TlsIdentity, TlsTrust};
pub(crate) use stream::TlsStream;
