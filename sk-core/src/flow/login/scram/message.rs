//! The four messages as text. Each reader takes exactly what its grammar allows, in the order of RFC 5802; no
//! extensions, no authorisation identity, no other channel binding than `tls-exporter`.

use super::super::{Binding, Proof};
use super::ScramError;
use super::keys::SALT_BYTES;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// Says that the login is bound to a TLS connection, as RFC 9266 says.
pub(super) const BOUND_HEADER: &str = "p=tls-exporter,,";

/// What `c=` holds: the header of the first message, and what the login is bound to.
pub(super) fn bound_input(header: &str, binding: Option<&Binding>) -> Vec<u8> {
    [header.as_bytes(), binding.map_or(&[], |binding| binding)].concat()
}

/// `client-first-message`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ClientFirst<'a> {
    /// `n,,`, `y,,` or [`BOUND_HEADER`].
    pub(super) header: &'a str,
    /// The rest.
    pub(super) bare: &'a str,
    pub(super) user: &'a str,
    pub(super) nonce: &'a str,
}

/// `server-first-message`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ServerFirst<'a> {
    pub(super) nonce: &'a str,
    pub(super) salt: [u8; SALT_BYTES],
    pub(super) rounds: u32,
}

/// `client-final-message`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ClientFinal<'a> {
    /// All before `,p=`.
    pub(super) without_proof: &'a str,
    /// What `c=` holds, decoded.
    pub(super) header: Vec<u8>,
    pub(super) nonce: &'a str,
    pub(super) proof: Proof,
}

/// Takes one attribute off the text; the last one has no comma after it.
fn attribute<'a>(text: &mut Option<&'a str>, name: &'static str) -> Result<&'a str, ScramError> {
    let malformed = || ScramError::Malformed(name);
    let whole = text.take().ok_or_else(malformed)?;
    let (first, rest) = match whole.split_once(',') {
        Some((first, rest)) => (first, Some(rest)),
        None => (whole, None),
    };
    *text = rest;
    first
        .strip_prefix(name)
        .and_then(|value| value.strip_prefix('='))
        .ok_or_else(malformed)
}

fn nothing_more(text: Option<&str>) -> Result<(), ScramError> {
    text.map_or(Ok(()), |_| Err(ScramError::Malformed("end")))
}

/// `printable`: what a random number may consist of.
fn nonce(text: &str) -> Result<&str, ScramError> {
    let printable = !text.is_empty() && text.bytes().all(|byte| (0x21..=0x7e).contains(&byte));
    printable.then_some(text).ok_or(ScramError::Malformed("r"))
}

fn decoded<const LENGTH: usize>(text: &str, name: &'static str) -> Result<[u8; LENGTH], ScramError> {
    let bytes = STANDARD.decode(text).map_err(|_| ScramError::Malformed(name))?;
    bytes.try_into().map_err(|_| ScramError::Malformed(name))
}

impl<'a> ClientFirst<'a> {
    pub(super) fn read(text: &'a str) -> Result<ClientFirst<'a>, ScramError> {
        let header = ["n,,", "y,,", BOUND_HEADER].into_iter().find(|header| text.starts_with(header));
        let header = &text[..header.ok_or(ScramError::Malformed("gs2-header"))?.len()];
        let bare = &text[header.len()..];
        let mut rest = Some(bare);
        let user = attribute(&mut rest, "n")?;
        let nonce = nonce(attribute(&mut rest, "r")?)?;
        nothing_more(rest)?;
        Ok(ClientFirst { header, bare, user, nonce })
    }

    /// The text after the header.
    pub(super) fn bare(user: &str, nonce: &str) -> String {
        format!("n={user},r={nonce}")
    }
}

impl<'a> ServerFirst<'a> {
    pub(super) fn read(text: &'a str) -> Result<ServerFirst<'a>, ScramError> {
        let mut rest = Some(text);
        let nonce = nonce(attribute(&mut rest, "r")?)?;
        let salt = decoded(attribute(&mut rest, "s")?, "s")?;
        let digits = attribute(&mut rest, "i")?;
        nothing_more(rest)?;
        // The grammar has no sign and no leading zero.
        let is_number = digits.bytes().all(|byte| byte.is_ascii_digit()) && !digits.starts_with('0');
        let rounds = digits.parse().ok().filter(|_| is_number);
        Ok(ServerFirst { nonce, salt, rounds: rounds.ok_or(ScramError::Malformed("i"))? })
    }

    pub(super) fn text(&self) -> String {
        format!("r={},s={},i={}", self.nonce, STANDARD.encode(self.salt), self.rounds)
    }
}

impl<'a> ClientFinal<'a> {
    pub(super) fn read(text: &'a str) -> Result<ClientFinal<'a>, ScramError> {
        let mut rest = Some(text);
        let header = STANDARD
            .decode(attribute(&mut rest, "c")?)
            .map_err(|_| ScramError::Malformed("c"))?;
        let nonce = nonce(attribute(&mut rest, "r")?)?;
        let without_proof = rest.map_or(text, |rest| &text[..text.len() - rest.len() - 1]);
        let proof = decoded(attribute(&mut rest, "p")?, "p")?;
        nothing_more(rest)?;
        Ok(ClientFinal { without_proof, header, nonce, proof })
    }

    /// All before `,p=`.
    pub(super) fn without_proof(bound: &[u8], nonce: &str) -> String {
        format!("c={},r={nonce}", STANDARD.encode(bound))
    }

    pub(super) fn text(without_proof: &str, proof: &Proof) -> String {
        format!("{without_proof},p={}", STANDARD.encode(proof))
    }
}

/// A random number of ours as text.
pub(super) fn nonce_text(random: &[u8; 32]) -> String {
    STANDARD.encode(&random[..24])
}

/// What both sides prove over: `AuthMessage`.
pub(super) fn auth_message(client_first_bare: &str, server_first: &str, without_proof: &str) -> Vec<u8> {
    format!("{client_first_bare},{server_first},{without_proof}").into_bytes()
}
