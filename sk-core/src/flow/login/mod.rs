//! Login by the owner's token: both sides prove that they know it, nobody sends it.
//!
//! The proofs are HMAC-SHA-256 keyed by the token over a label, the prover's nonce and the other's. The
//! labels differ, so the proof of one side is never a proof of the other; the nonces are new for each
//! connection, so a proof that was overheard is worth nothing. On an encrypted connection the proofs are keyed by a
//! token that was bound to it, so that one which was passed on from another connection is worth nothing either.

pub mod scram;

use crate::testing::{Bug, is_planted};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::fmt;
use std::fmt::Write as _;
use subtle::ConstantTimeEq;
use thiserror::Error;

/// Random bytes, new for each side of each connection.
pub type Nonce = [u8; 32];
/// The proof of one side.
pub type Proof = [u8; 32];

/// What both ends of an encrypted connection know and nobody between them: a proof over it is worth nothing on
/// another connection.
pub type Binding = [u8; 32];

/// What begins the input of the client's proof.
pub const CLIENT_LABEL: &[u8] = b"SpecialK flow 1 client";
/// What begins the input of the hub's proof.
pub const HUB_LABEL: &[u8] = b"SpecialK flow 1 hub";

/// The proof of a login without a token.
pub const NO_PROOF: Proof = [0; 32];

/// The secret of the hub's owner: 32 random bytes, kept in a file that only the owner can read.
///
/// ```
/// use sk_core::flow::login::OwnerToken;
///
/// let token = OwnerToken::new([7; 32]);
/// let (client, hub) = ([1; 32], [2; 32]);
/// let proof = token.client_proof(&client, &hub);
/// assert!(token.client_is_true(&client, &hub, &proof));
/// assert!(!token.hub_is_true(&client, &hub, &proof), "a reflected proof is worth nothing");
/// assert_eq!(format!("{token:?}"), "OwnerToken(secret)");
/// ```
#[derive(Clone)]
pub struct OwnerToken([u8; 32]);

impl OwnerToken {
    /// A token of these bytes, which come from the world's `Rng`.
    pub const fn new(secret: [u8; 32]) -> OwnerToken {
        OwnerToken(secret)
    }

    /// Reads the text of a token file: 64 hexadecimal digits and at most one line end.
    ///
    /// # Errors
    /// If it is anything else. The text is not repeated in the error.
    pub fn parse(text: &str) -> Result<OwnerToken, TokenError> {
        let digits = text.strip_suffix('\n').unwrap_or(text);
        let digits = digits.strip_suffix('\r').unwrap_or(digits).as_bytes();
        if digits.len() != 64 {
            return Err(TokenError::Length(digits.len()));
        }
        let mut secret = [0; 32];
        for (index, pair) in digits.chunks_exact(2).enumerate() {
            let high = (pair[0] as char).to_digit(16);
            let low = (pair[1] as char).to_digit(16);
            let (Some(high), Some(low)) = (high, low) else { return Err(TokenError::Digit(index * 2)) };
            secret[index] = (high << 4 | low) as u8;
        }
        Ok(OwnerToken(secret))
    }

    /// The text of a token file.
    pub fn to_file_text(&self) -> String {
        let mut text = String::with_capacity(65);
        for byte in self.0 {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        text.push('\n');
        text
    }

    /// The token that proofs are keyed by on this very connection, if it is encrypted.
    pub fn bound_to(&self, binding: &Binding) -> OwnerToken {
        OwnerToken(self.prove(b"SpecialK flow 1 bound", binding, &[0; 32]))
    }

    /// What a client sends to show that it knows the token.
    pub fn client_proof(&self, client: &Nonce, hub: &Nonce) -> Proof {
        self.prove(CLIENT_LABEL, client, hub)
    }

    /// What a hub sends to show that it knows the token.
    pub fn hub_proof(&self, client: &Nonce, hub: &Nonce) -> Proof {
        self.prove(HUB_LABEL, hub, client)
    }

    /// Whether a client knows the token. Takes the same time for every wrong proof.
    pub fn client_is_true(&self, client: &Nonce, hub: &Nonce, proof: &Proof) -> bool {
        bool::from(self.client_proof(client, hub).ct_eq(proof)) || is_planted(Bug::TokenUnchecked)
    }

    /// Whether a hub knows the token. Takes the same time for every wrong proof.
    pub fn hub_is_true(&self, client: &Nonce, hub: &Nonce, proof: &Proof) -> bool {
        bool::from(self.hub_proof(client, hub).ct_eq(proof)) || is_planted(Bug::TokenUnchecked)
    }

    /// What the challenges for accounts that are not there are made from: always the same for this hub.
    pub(super) fn secret_of_nobody(&self) -> [u8; 32] {
        self.prove(b"SpecialK flow 1 nobody", &[0; 32], &[0; 32])
    }

    fn prove(&self, label: &[u8], own: &Nonce, other: &Nonce) -> Proof {
        let mut mac = Hmac::<Sha256>::new(&block_of(&self.0));
        mac.update(label);
        mac.update(own);
        mac.update(other);
        mac.finalize().into_bytes().into()
    }
}

/// The key as HMAC pads it: filled up with zeros to one block of SHA-256. In this form the constructor
/// cannot fail.
fn block_of(secret: &[u8; 32]) -> hmac::digest::Key<Hmac<Sha256>> {
    let mut block = hmac::digest::Key::<Hmac<Sha256>>::default();
    block[..32].copy_from_slice(secret);
    block
}

impl Drop for OwnerToken {
    /// Overwrites the secret. The black box keeps the compiler from leaving the writes out.
    fn drop(&mut self) {
        self.0 = [0; 32];
        std::hint::black_box(&mut self.0);
    }
}

impl fmt::Debug for OwnerToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("OwnerToken(secret)")
    }
}

/// Why a token file is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum TokenError {
    /// It does not have 64 digits.
    #[error("expected 64 hexadecimal digits, found {0} bytes")]
    Length(usize),
    /// It has another character there.
    #[error("no hexadecimal digit at byte {0} or after it")]
    Digit(usize),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proofs_are_as_another_implementation_computes_them() {
        // Python: hmac.new(bytes(range(32)), label + b"\x01"*32 + b"\x02"*32, "sha256").hexdigest()
        let token = OwnerToken::new(std::array::from_fn(|index| index as u8));
        let hex = |proof: Proof| proof.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        assert_eq!(
            hex(token.client_proof(&[1; 32], &[2; 32])),
            "be7ae0289b3932acb1060f7f88cfa1829a052bd50d44ff3a8ab748749293c3f7"
        );
        assert_eq!(
            hex(token.hub_proof(&[2; 32], &[1; 32])),
            "3484161a754a997f621cae71aa94774d8961e5e2b71e122e72a0e9fe0a18e5bd"
        );
    }

    #[test]
    fn a_proof_is_void_for_other_nonces_tokens_and_the_other_side() {
        let token = OwnerToken::new([7; 32]);
        let proof = token.client_proof(&[1; 32], &[2; 32]);
        assert!(token.client_is_true(&[1; 32], &[2; 32], &proof));
        assert!(!token.client_is_true(&[2; 32], &[1; 32], &proof));
        assert!(!token.client_is_true(&[1; 32], &[3; 32], &proof));
        assert!(!OwnerToken::new([8; 32]).client_is_true(&[1; 32], &[2; 32], &proof));
        assert!(!token.hub_is_true(&[2; 32], &[1; 32], &proof));
    }

    #[test]
    fn a_token_file_reads_back_and_anything_else_is_refused() {
        let token = OwnerToken::new(std::array::from_fn(|index| (index * 8) as u8));
        let text = token.to_file_text();
        let back = OwnerToken::parse(&text).expect("its own text");
        assert_eq!(back.0, token.0);
        assert_eq!(OwnerToken::parse(&text[..63]).err(), Some(TokenError::Length(63)));
        assert_eq!(OwnerToken::parse(&format!("{text}\n")).err(), Some(TokenError::Length(65)));
        assert_eq!(OwnerToken::parse(&text.replace("08", "0x")).err(), Some(TokenError::Digit(2)));
        assert_eq!(OwnerToken::parse("").err(), Some(TokenError::Length(0)));
    }
}
