//! Login by name and password: SCRAM-SHA-256 of RFC 5802 and RFC 7677.
//!
//! The password is never sent. The client derives keys from it, which takes time on purpose; the hub keeps a
//! [`Verifier`] of which nobody can log in, and computes three HMACs and a hash for a login. Each side proves to
//! the other what it knows, over random numbers of both.
//!
//! No preparation of text (SASLprep) is applied: the password is the bytes of its UTF-8, and a client in another
//! language must not change them either. On an encrypted
//! connection the login can be bound to it (`tls-exporter` of RFC 9266): who stands between two such connections
//! cannot pass it on.

mod client;
mod keys;
mod message;
mod server;
#[cfg(test)]
mod tests;

pub use client::{ClientExchange, Derivation};
pub use keys::{ClientKeys, Password, Verifier};
pub use server::{FindVerifier, ServerExchange};

use thiserror::Error;

/// The rounds of PBKDF2 for a new password, and the fewest that an account may have: what RFC 7677 asks for.
pub const ROUNDS_MIN: u32 = 15_000;
/// The most rounds that an account may have. A client does not work longer than that for a hub that it does not
/// know yet.
pub const ROUNDS_MAX: u32 = 1_000_000;

/// Why a login by password does not go on. What a hub finds is told to nobody: its client hears that the login
/// failed, and no more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ScramError {
    /// A message does not follow its grammar, or asks for what is not offered.
    #[error("a message of the login by password does not follow its grammar at `{0}`")]
    Malformed(&'static str),
    /// The other side does not repeat the random numbers of this login.
    #[error("the answer is for another login")]
    Nonce,
    /// The hub asks for fewer rounds than are safe, or for more than are bearable.
    #[error("the hub asks for {0} rounds; {ROUNDS_MIN} to {ROUNDS_MAX} are acceptable")]
    Rounds(u32),
    /// The login is bound to another connection, or is not bound to one that it could be bound to.
    #[error("the login is not bound to this connection as it should be")]
    Binding,
    /// The other side does not know the password.
    #[error("the proof is wrong")]
    Proof,
}
