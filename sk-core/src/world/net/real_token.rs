//! Tokens as mio wants them, and the two that are the net's own.

use super::Token;
use std::io;

pub(super) const WAKER: mio::Token = mio::Token(usize::MAX);
pub(super) const TIMER: mio::Token = mio::Token(usize::MAX - 1);

/// The token in mio's shape.
///
/// # Errors
/// `InvalidInput` for one that does not fit a machine word or is one of the two that are ours.
pub(super) fn poll_token(token: Token) -> io::Result<mio::Token> {
    match usize::try_from(token.0) {
        Ok(value) if value < TIMER.0 => Ok(mio::Token(value)),
        _ => {
            let why = format!("the token {} cannot be registered", token.0);
            Err(io::Error::new(io::ErrorKind::InvalidInput, why))
        }
    }
}
