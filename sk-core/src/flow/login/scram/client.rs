//! The client's half of a login by password.

use super::super::{Binding, Nonce, Proof};
use super::keys::{ClientKeys, Password, SALT_BYTES};
use super::message::{
    BOUND_HEADER, ClientFinal, ClientFirst, ServerFirst, auth_message, bound_input, nonce_text,
};
use super::{ROUNDS_MAX, ROUNDS_MIN, ScramError};
use std::fmt;

/// Says that no channel binding is used.
const UNBOUND: &str = "n,,";

/// A login under way.
///
/// ```
/// use sk_core::flow::scram::{ClientExchange, ClientKeys, Password, ROUNDS_MIN, ServerExchange};
///
/// let pencil = Password::new("pencil");
/// let verifier = ClientKeys::derive(&pencil, [7; 16], ROUNDS_MIN).verifier();
/// let accounts = |user: &str| (user == "ada").then(|| verifier.clone());
///
/// let mut client = ClientExchange::new("ada", &[1; 32]);
/// let hub = ServerExchange::begin(&client.first(), &[2; 32], &[3; 32], &accounts)?;
/// let derivation = client.challenged(hub.challenge(), pencil)?;
/// let last = client.last(&derivation.run())?;
/// assert!(client.hub_is_true(&hub.finish(&last)?), "and it has proved that it knows the account");
/// # Ok::<(), sk_core::flow::scram::ScramError>(())
/// ```
pub struct ClientExchange {
    bare: String,
    nonce: String,
    binding: Option<Binding>,
    server_first: String,
    /// What the hub's proof is over, and the keys to check it with.
    proven: Option<(Vec<u8>, ClientKeys)>,
}

impl fmt::Debug for ClientExchange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ClientExchange(secret)")
    }
}

/// Keys that are to be derived: a matter of milliseconds.
#[derive(Clone, Debug)]
pub struct Derivation {
    password: Password,
    salt: [u8; SALT_BYTES],
    rounds: u32,
}

impl Derivation {
    /// Does it, on a worker.
    pub fn run(&self) -> ClientKeys {
        ClientKeys::derive(&self.password, self.salt, self.rounds)
    }

    /// Whether these keys are its outcome, of an earlier login.
    pub fn is_done_by(&self, keys: &ClientKeys) -> bool {
        (keys.salt, keys.rounds) == (self.salt, self.rounds)
    }
}

impl ClientExchange {
    /// A login to this account; `random` is new for each.
    pub fn new(user: &str, random: &Nonce) -> ClientExchange {
        ClientExchange::with_nonce(user, nonce_text(random))
    }

    pub(super) fn with_nonce(user: &str, nonce: String) -> ClientExchange {
        let bare = ClientFirst::bare(user, &nonce);
        ClientExchange { bare, nonce, binding: None, server_first: String::new(), proven: None }
    }

    /// The same, bound to an encrypted connection.
    pub fn bound_to(mut self, binding: Option<Binding>) -> ClientExchange {
        self.binding = binding;
        self
    }

    fn header(&self) -> &'static str {
        if self.binding.is_some() { BOUND_HEADER } else { UNBOUND }
    }

    /// The first message.
    pub fn first(&self) -> String {
        format!("{}{}", self.header(), self.bare)
    }

    /// Takes the hub's challenge; answers what is to be derived for it.
    ///
    /// # Errors
    /// `Malformed`, `Nonce`, or `Rounds`.
    pub fn challenged(&mut self, server_first: &str, password: Password) -> Result<Derivation, ScramError> {
        let challenge = ServerFirst::read(server_first)?;
        if !(ROUNDS_MIN..=ROUNDS_MAX).contains(&challenge.rounds) {
            return Err(ScramError::Rounds(challenge.rounds));
        }
        server_first.clone_into(&mut self.server_first);
        Ok(Derivation { password, salt: challenge.salt, rounds: challenge.rounds })
    }

    #[cfg(test)]
    pub(super) fn challenged_with_any_rounds(&mut self, server_first: &str) {
        server_first.clone_into(&mut self.server_first);
    }

    /// The last message.
    ///
    /// # Errors
    /// `Malformed` before the challenge; `Nonce` if that is not an answer to this login.
    pub fn last(&mut self, keys: &ClientKeys) -> Result<String, ScramError> {
        let challenge = ServerFirst::read(&self.server_first)?;
        let added = challenge.nonce.strip_prefix(self.nonce.as_str()).unwrap_or_default();
        if added.is_empty() {
            return Err(ScramError::Nonce);
        }
        let bound = bound_input(self.header(), self.binding.as_ref());
        let without_proof = ClientFinal::without_proof(&bound, challenge.nonce);
        let login = auth_message(&self.bare, &self.server_first, &without_proof);
        let text = ClientFinal::text(&without_proof, &keys.proof(&login));
        self.proven = Some((login, keys.clone()));
        Ok(text)
    }

    /// Whether the hub has proved that it knows the account.
    pub fn hub_is_true(&self, signature: &Proof) -> bool {
        self.proven
            .as_ref()
            .is_some_and(|(login, keys)| keys.hub_is_true(login, signature))
    }
}
