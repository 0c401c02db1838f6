//! What is derived from a password, on either side.

use super::super::Proof;
use super::{ROUNDS_MAX, ROUNDS_MIN};
use hmac::{Hmac, KeyInit, Mac};
use sha2::{Digest, Sha256};
use sk_flat::{IntoVariant, SkVariant};
use std::fmt;
use subtle::ConstantTimeEq;
use zeroize::Zeroizing;

/// The length of every key: that of SHA-256.
pub(super) const KEY_BYTES: usize = 32;
/// The length of a salt.
pub(super) const SALT_BYTES: usize = 16;

/// A key that is overwritten when it is dropped.
pub(super) type Key = Zeroizing<[u8; KEY_BYTES]>;

/// A password. It is overwritten when it is dropped and never printed.
///
/// ```
/// use sk_core::flow::scram::Password;
///
/// let password = Password::new("pencil");
/// assert_eq!(format!("{password:?}"), "Password(secret)");
/// ```
#[derive(Clone)]
pub struct Password(Zeroizing<String>);

impl Password {
    /// A password of this text.
    pub fn new(text: impl Into<String>) -> Password {
        Password(Zeroizing::new(text.into()))
    }

    /// `Hi(password, salt, rounds)`: the slow part.
    fn salted(&self, salt: &[u8; SALT_BYTES], rounds: u32) -> Key {
        let mut salted = Key::default();
        pbkdf2::pbkdf2_hmac::<Sha256>(self.0.as_bytes(), salt, rounds, &mut *salted);
        salted
    }
}

impl PartialEq for Password {
    fn eq(&self, other: &Password) -> bool {
        self.0.as_bytes().ct_eq(other.0.as_bytes()).into()
    }
}

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Password(secret)")
    }
}

pub(super) fn hmac(key: &[u8; KEY_BYTES], message: &[u8]) -> Key {
    // The key as HMAC pads it: filled up with zeros to one block. In this form the constructor cannot fail.
    let mut block = hmac::digest::Key::<Hmac<Sha256>>::default();
    block[..KEY_BYTES].copy_from_slice(key);
    let mut mac = Hmac::<Sha256>::new(&block);
    zeroize::Zeroize::zeroize(&mut block[..]);
    mac.update(message);
    Zeroizing::new(mac.finalize().into_bytes().into())
}

fn hash(key: &[u8; KEY_BYTES]) -> Key {
    Zeroizing::new(Sha256::digest(key).into())
}

fn xor(a: &[u8; KEY_BYTES], b: &[u8; KEY_BYTES]) -> Key {
    Zeroizing::new(std::array::from_fn(|index| a[index] ^ b[index]))
}

/// What a client derives from its password for one salt and number of rounds. Kept, it saves the work at the
/// next login; whoever has it can log in.
#[derive(Clone)]
pub struct ClientKeys {
    pub(super) salt: [u8; SALT_BYTES],
    pub(super) rounds: u32,
    client: Key,
    server: Key,
}

impl ClientKeys {
    /// Derives them: a matter of milliseconds, for a worker and not for a loop.
    pub fn derive(password: &Password, salt: [u8; SALT_BYTES], rounds: u32) -> ClientKeys {
        let salted = password.salted(&salt, rounds);
        let (client, server) = (hmac(&salted, b"Client Key"), hmac(&salted, b"Server Key"));
        ClientKeys { salt, rounds, client, server }
    }

    /// The client's proof over this login.
    pub(super) fn proof(&self, login: &[u8]) -> Proof {
        *xor(&self.client, &hmac(&hash(&self.client), login))
    }

    /// Whether the hub knows the account's verifier. Takes the same time for every wrong signature.
    pub(super) fn hub_is_true(&self, login: &[u8], signature: &Proof) -> bool {
        hmac(&self.server, login).ct_eq(signature).into()
    }

    /// What a hub keeps of the password.
    pub fn verifier(&self) -> Verifier {
        Verifier {
            salt: self.salt,
            rounds: self.rounds,
            stored_key: hash(&self.client),
            server_key: self.server.clone(),
        }
    }
}

impl fmt::Debug for ClientKeys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ClientKeys(secret)")
    }
}

/// What a hub keeps of an account's password. It is enough to check a login and to prove that it is known, and
/// not enough to log in; passwords can be guessed from it, so it is not shown.
///
/// ```
/// use sk_core::flow::scram::{ClientKeys, Password, ROUNDS_MIN};
///
/// let verifier = ClientKeys::derive(&Password::new("pencil"), [7; 16], ROUNDS_MIN).verifier();
/// assert_eq!(format!("{verifier:?}"), "Verifier(secret)");
/// ```
#[derive(Clone)]
pub struct Verifier {
    pub(super) salt: [u8; SALT_BYTES],
    pub(super) rounds: u32,
    stored_key: Key,
    server_key: Key,
}

impl Verifier {
    /// A verifier of the fields of `user_set`. None if there are fewer rounds than are safe, or more than any
    /// client would work for.
    pub fn new(
        rounds: u32,
        salt: [u8; SALT_BYTES],
        stored_key: [u8; KEY_BYTES],
        server_key: [u8; KEY_BYTES],
    ) -> Option<Verifier> {
        let (stored_key, server_key) = (Zeroizing::new(stored_key), Zeroizing::new(server_key));
        (ROUNDS_MIN..=ROUNDS_MAX).contains(&rounds).then_some(Verifier {
            salt,
            rounds,
            stored_key,
            server_key,
        })
    }

    /// One for an account that is not there: it looks like others, is always the same for a name, and nobody
    /// knows a password to it.
    pub(super) fn of_nobody(secret: &[u8; KEY_BYTES], user: &str) -> Verifier {
        let part = |label: &str| hmac(secret, format!("SpecialK flow 1 nobody's {label} {user}").as_bytes());
        let salt = part("salt");
        Verifier {
            salt: std::array::from_fn(|index| salt[index]),
            rounds: ROUNDS_MIN,
            stored_key: part("stored key"),
            server_key: part("server key"),
        }
    }

    /// Its rounds, salt, stored key and server key, as `user_set` carries them.
    pub fn parts(&self) -> (u32, [u8; SALT_BYTES], [u8; KEY_BYTES], [u8; KEY_BYTES]) {
        (self.rounds, self.salt, *self.stored_key, *self.server_key)
    }

    /// Whether this proof is that of somebody who knows the password. Takes the same time for every wrong one.
    pub(super) fn client_is_true(&self, login: &[u8], proof: &Proof) -> subtle::Choice {
        let client = xor(proof, &hmac(&self.stored_key, login));
        hash(&client).ct_eq(&*self.stored_key)
    }

    /// The hub's proof over this login.
    pub(super) fn signature(&self, login: &[u8]) -> Proof {
        *hmac(&self.server_key, login)
    }

    /// As it is kept.
    pub fn variant(&self) -> SkVariant {
        SkVariant::map([
            ("rounds", SkVariant::from(self.rounds)),
            ("salt", self.salt.to_vec().into_variant()),
            ("server_key", self.server_key.to_vec().into_variant()),
            ("stored_key", self.stored_key.to_vec().into_variant()),
        ])
    }

    /// The same, read back. None if it is anything else.
    pub fn from_variant(variant: &SkVariant) -> Option<Verifier> {
        let map = variant.as_map().filter(|map| map.len() == 4)?;
        let bytes = |key: &str| map.get(key)?.as_bytes().map(|bytes| &bytes[..]);
        let rounds = u32::try_from(map.get("rounds")?).ok()?;
        let salt = bytes("salt")?.try_into().ok()?;
        Verifier::new(
            rounds,
            salt,
            bytes("stored_key")?.try_into().ok()?,
            bytes("server_key")?.try_into().ok()?,
        )
    }
}

impl PartialEq for Verifier {
    fn eq(&self, other: &Verifier) -> bool {
        let keys = self.stored_key.ct_eq(&*other.stored_key) & self.server_key.ct_eq(&*other.server_key);
        (self.salt, self.rounds) == (other.salt, other.rounds) && bool::from(keys)
    }
}

impl fmt::Debug for Verifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Verifier(secret)")
    }
}
