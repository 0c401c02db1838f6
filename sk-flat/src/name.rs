//! Names of users, channels and databases, and the numbers that stand for names.

use crate::error::NameError;
use sha2::{Digest, Sha256};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

/// How many bytes a name may have, a composed one included.
pub const NAME_BYTES_MAX: usize = 255;

/// A name: 1 to 255 characters out of `a-z`, `0-9`, `_`, `.` and `-`. A clone shares the text.
///
/// ```
/// use sk_flat::Name;
///
/// let user: Name = "nao".parse()?;
/// let channel: Name = "imu.left".parse()?;
/// assert_eq!(Name::compose(&user, &channel)?.as_str(), "nao.imu.left");
/// assert!("Übung".parse::<Name>().is_err());
/// # Ok::<(), sk_flat::NameError>(())
/// ```
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name(Arc<str>);

impl Name {
    /// Checks a text and makes it a name.
    ///
    /// # Errors
    /// The text is empty, too long, or has a character outside the alphabet.
    pub fn new(text: &str) -> Result<Name, NameError> {
        check(text)?;
        Ok(Name(text.into()))
    }

    /// `user.name`: the name under which a hub keeps what `user` calls `name`.
    ///
    /// # Errors
    /// The whole is too long, or the user's name has a dot: `a.b` + `c` and `a` + `b.c` would be
    /// the same name, and one user could take what is another's.
    pub fn compose(user: &Name, name: &Name) -> Result<Name, NameError> {
        if let Some(at) = user.0.find('.') {
            return Err(NameError::DotInUser { user: (*user.0).into(), at });
        }
        Name::new(&format!("{user}.{name}"))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The number that stands for this name on the network: [`channel_hash`].
    pub fn channel_hash(&self) -> u64 {
        channel_hash(&self.0)
    }
}

fn check(text: &str) -> Result<(), NameError> {
    if text.is_empty() {
        return Err(NameError::Empty);
    }
    if text.len() > NAME_BYTES_MAX {
        return Err(NameError::TooLong { found: text.len(), max: NAME_BYTES_MAX });
    }
    let allowed = |c: char| matches!(c, 'a'..='z' | '0'..='9' | '_' | '.' | '-');
    match text.char_indices().find(|&(_, c)| !allowed(c)) {
        Some((at, found)) => Err(NameError::Character { found, at }),
        None => Ok(()),
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&*self.0, f)
    }
}

impl FromStr for Name {
    type Err = NameError;
    fn from_str(text: &str) -> Result<Name, NameError> {
        Name::new(text)
    }
}

impl TryFrom<&str> for Name {
    type Error = NameError;
    fn try_from(text: &str) -> Result<Name, NameError> {
        Name::new(text)
    }
}

impl TryFrom<String> for Name {
    type Error = NameError;
    fn try_from(text: String) -> Result<Name, NameError> {
        Name::new(&text)
    }
}

impl AsRef<str> for Name {
    fn as_ref(&self) -> &str {
        &self.0
    }
}

impl std::borrow::Borrow<str> for Name {
    fn borrow(&self) -> &str {
        &self.0
    }
}

/// FNV-1a with 64 bits: the number of a slot's or signal's name inside one program. It is computed
/// at compile time. It resists no attacker, so names from the network are not hashed with it.
///
/// ```
/// const PULSE: u64 = sk_flat::name_hash("pulse");
/// assert_eq!(PULSE, sk_flat::name_hash("pulse"));
/// ```
pub const fn name_hash(name: &str) -> u64 {
    const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let bytes = name.as_bytes();
    let mut hash = OFFSET_BASIS;
    let mut at = 0;
    // A `for` loop is not allowed in a constant.
    while at < bytes.len() {
        hash = (hash ^ bytes[at] as u64).wrapping_mul(PRIME);
        at += 1;
    }
    hash
}

/// The first 8 bytes of the SHA-256 of the name, as a little-endian number: what the network uses
/// beside the full name `user.name` of a channel.
///
/// ```
/// assert_eq!(sk_flat::channel_hash("abc"), 0xeacf_018f_bf16_78ba);
/// ```
pub fn channel_hash(name: &str) -> u64 {
    let digest = Sha256::digest(name.as_bytes());
    let mut first = [0; 8];
    first.copy_from_slice(&digest[..8]);
    u64::from_le_bytes(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_alphabet_is_enforced_and_the_error_points_at_the_character() {
        assert_eq!(Name::new("a_b-c.9").map(|name| name.to_string()), Ok("a_b-c.9".to_owned()));
        assert_eq!(Name::new(""), Err(NameError::Empty));
        assert_eq!(Name::new("äb"), Err(NameError::Character { found: 'ä', at: 0 }));
        assert_eq!(Name::new("a/b"), Err(NameError::Character { found: '/', at: 1 }));
        assert_eq!(Name::new("a\0"), Err(NameError::Character { found: '\0', at: 1 }));
        assert!(Name::new("A").is_err());
    }

    #[test]
    fn a_name_has_at_most_255_bytes() {
        assert!(Name::new(&"n".repeat(255)).is_ok());
        assert_eq!(Name::new(&"n".repeat(256)), Err(NameError::TooLong { found: 256, max: 255 }));
        let long = Name::new(&"n".repeat(200)).unwrap();
        assert_eq!(Name::compose(&long, &long), Err(NameError::TooLong { found: 401, max: 255 }));
    }

    #[test]
    fn a_user_cannot_compose_another_users_name() {
        let [dotted, c] = ["a.b", "c"].map(|text| Name::new(text).unwrap());
        assert_eq!(Name::compose(&dotted, &c), Err(NameError::DotInUser { user: "a.b".into(), at: 1 }));
    }

    #[test]
    fn fnv_1a_matches_its_published_vectors() {
        assert_eq!(name_hash(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(name_hash("a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(name_hash("foobar"), 0x8594_4171_f739_67e8);
    }
}
