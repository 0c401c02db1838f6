//! The hub's half of a login by password.

use super::super::{Binding, Nonce, Proof};
use super::ScramError;
use super::keys::{KEY_BYTES, Verifier};
use super::message::{
    BOUND_HEADER, ClientFinal, ClientFirst, ServerFirst, auth_message, bound_input, nonce_text,
};
use std::fmt;
use subtle::Choice;

/// Finds what is kept of an account's password.
pub type FindVerifier<'a> = &'a dyn Fn(&str) -> Option<Verifier>;

/// A login under way. Whether there is such an account shows neither in what is answered nor in how long it
/// takes: one that is not there has a verifier too, which no password fits.
pub struct ServerExchange {
    user: String,
    header: String,
    client_first_bare: String,
    nonce: String,
    server_first: String,
    verifier: Verifier,
    known: Choice,
}

impl fmt::Debug for ServerExchange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ServerExchange")
            .field("user", &self.user)
            .finish_non_exhaustive()
    }
}

impl ServerExchange {
    /// Takes the client's first message. `random` is new for each login; `secret` is the hub's own and stays the
    /// same, so that an account that is not there has the same salt tomorrow.
    ///
    /// # Errors
    /// `Malformed`.
    pub fn begin(
        client_first: &str,
        random: &Nonce,
        secret: &[u8; KEY_BYTES],
        find: FindVerifier<'_>,
    ) -> Result<ServerExchange, ScramError> {
        let first = ClientFirst::read(client_first)?;
        let nobody = Verifier::of_nobody(secret, first.user);
        let found = find(first.user);
        let known = Choice::from(u8::from(found.is_some()));
        let verifier = found.unwrap_or(nobody);
        let nonce = format!("{}{}", first.nonce, nonce_text(random));
        let answer = ServerFirst { nonce: &nonce, salt: verifier.salt, rounds: verifier.rounds };
        let server_first = answer.text();
        Ok(ServerExchange {
            user: first.user.to_owned(),
            header: first.header.to_owned(),
            client_first_bare: first.bare.to_owned(),
            nonce,
            server_first,
            verifier,
            known,
        })
    }

    /// The account, as the client calls it.
    pub fn user(&self) -> &str {
        &self.user
    }

    /// What to answer to the first message.
    pub fn challenge(&self) -> &str {
        &self.server_first
    }

    /// Whether the client binds the login to its connection.
    pub fn is_bound(&self) -> bool {
        self.header == BOUND_HEADER
    }

    /// Takes the client's last message; answers the hub's proof.
    ///
    /// # Errors
    /// `Malformed`, `Nonce`, `Binding` if the client binds the login to an encrypted connection, or `Proof` if it
    /// does not know the password or there is no such account.
    pub fn finish(self, client_final: &str) -> Result<Proof, ScramError> {
        self.finish_on(client_final, None)
    }

    /// The same on an encrypted connection. A client that binds the login must bind it to this one; one that could
    /// and takes the hub for one that cannot has been lied to by somebody between them.
    ///
    /// # Errors
    /// As [`finish`](ServerExchange::finish).
    pub fn finish_on(self, client_final: &str, binding: Option<&Binding>) -> Result<Proof, ScramError> {
        let last = ClientFinal::read(client_final)?;
        if !last.header.starts_with(self.header.as_bytes()) {
            return Err(ScramError::Malformed("c"));
        }
        let lied_to = binding.is_some() && self.header.starts_with('y');
        let bound = match (self.is_bound(), binding) {
            (true, None) => return Err(ScramError::Binding),
            (true, Some(binding)) => bound_input(&self.header, Some(binding)),
            (false, _) => bound_input(&self.header, None),
        };
        if lied_to || last.header != bound {
            return Err(ScramError::Binding);
        }
        if last.nonce != self.nonce {
            return Err(ScramError::Nonce);
        }
        let login = auth_message(&self.client_first_bare, &self.server_first, last.without_proof);
        let proven = self.verifier.client_is_true(&login, &last.proof);
        let signature = self.verifier.signature(&login);
        if bool::from(proven & self.known) { Ok(signature) } else { Err(ScramError::Proof) }
    }
}
