//! What databases and variables are called.

use crate::flow::RefusalCode;
use crate::flow::limits::TEXT_BYTES_MAX;
use sk_flat::Name;
use std::fmt;
use std::sync::Arc;

/// What a database is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum DatabaseKind {
    /// `flow:user.name`: a flow. It lives as long as the flow.
    Flow,
    /// `user:name`: an account.
    User,
    /// `chan:user.name`: a channel of any kind. It lives as long as the channel.
    Channel,
    /// A plain name: created and removed by command.
    Named,
    /// `hub:accounts`: the hub's own. No command names it.
    Hub,
}

impl DatabaseKind {
    /// What stands before the name.
    pub const fn prefix(self) -> &'static str {
        match self {
            DatabaseKind::Flow => "flow:",
            DatabaseKind::User => "user:",
            DatabaseKind::Channel => "chan:",
            DatabaseKind::Named => "",
            DatabaseKind::Hub => "hub:",
        }
    }
}

const ACCOUNTS: &str = "hub:accounts";

/// The name of a database, checked. A clone shares the text.
///
/// ```
/// use sk_core::flow::database::{DatabaseKind, DatabaseName};
///
/// let name = DatabaseName::parse("chan:robot.imu").expect("well formed");
/// assert_eq!((name.kind(), name.entity()), (DatabaseKind::Channel, "robot.imu"));
/// assert!(DatabaseName::parse("disk:robot").is_err(), "there is no such kind");
/// ```
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DatabaseName(Arc<str>);

impl DatabaseName {
    /// Checks a text and makes it a name. The whole has at most 255 bytes.
    ///
    /// # Errors
    /// `BadName` if it has a prefix that is none, or the rest is no name of the network's alphabet.
    pub fn parse(text: &str) -> Result<DatabaseName, RefusalCode> {
        let rest = match text.split_once(':') {
            None => text,
            Some(("flow" | "user" | "chan", rest)) => rest,
            Some(_) => return Err(RefusalCode::BadName),
        };
        if text.len() > TEXT_BYTES_MAX {
            return Err(RefusalCode::BadName);
        }
        Name::new(rest).map_err(|_| RefusalCode::BadName)?;
        Ok(DatabaseName(text.into()))
    }

    /// The database in which a hub keeps its accounts. [`parse`](DatabaseName::parse) does not know it, so no
    /// command can be about it.
    pub fn accounts() -> DatabaseName {
        DatabaseName(ACCOUNTS.into())
    }

    /// A name as a disk has it: also that of the accounts.
    ///
    /// # Errors
    /// `BadName`.
    pub fn parse_stored(text: &str) -> Result<DatabaseName, RefusalCode> {
        if text == ACCOUNTS { Ok(DatabaseName::accounts()) } else { DatabaseName::parse(text) }
    }

    /// The database of an entity. None if its name is so long that no command could name the database.
    pub fn of(kind: DatabaseKind, entity: &Name) -> Option<DatabaseName> {
        let text = format!("{}{entity}", kind.prefix());
        (text.len() <= TEXT_BYTES_MAX).then(|| DatabaseName(text.into()))
    }

    /// The whole text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// What it is about.
    pub fn kind(&self) -> DatabaseKind {
        match self.0.split_once(':') {
            None => DatabaseKind::Named,
            Some(("flow", _)) => DatabaseKind::Flow,
            Some(("user", _)) => DatabaseKind::User,
            Some(("hub", _)) => DatabaseKind::Hub,
            Some(_) => DatabaseKind::Channel,
        }
    }

    /// The name without its prefix.
    pub fn entity(&self) -> &str {
        self.0.split_once(':').map_or(&self.0, |(_, entity)| entity)
    }

    /// The account that an entity's database belongs to; none for a plain name.
    pub fn account(&self) -> Option<&str> {
        match self.kind() {
            DatabaseKind::Named | DatabaseKind::Hub => None,
            DatabaseKind::User => Some(self.entity()),
            DatabaseKind::Flow | DatabaseKind::Channel => self.entity().split('.').next(),
        }
    }
}

impl std::borrow::Borrow<str> for DatabaseName {
    fn borrow(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for DatabaseName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl fmt::Debug for DatabaseName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&*self.0, f)
    }
}

/// Whether a variable can be called so: 1 to 255 bytes of UTF-8 without control characters.
///
/// # Errors
/// `BadKey`.
pub fn check_key(key: &str) -> Result<(), RefusalCode> {
    if key.is_empty() || key.len() > TEXT_BYTES_MAX || key.chars().any(char::is_control) {
        return Err(RefusalCode::BadKey);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_known_prefix_and_a_name_of_the_network() {
        for (text, kind, account) in [
            ("flow:robot.arm", DatabaseKind::Flow, Some("robot")),
            ("user:robot", DatabaseKind::User, Some("robot")),
            ("chan:robot.imu.left", DatabaseKind::Channel, Some("robot")),
            ("calibration", DatabaseKind::Named, None),
        ] {
            let name = DatabaseName::parse(text).expect("well formed");
            assert_eq!((name.kind(), name.account(), name.as_str()), (kind, account, text));
        }
        for bad in
            ["", ":", "hub:accounts", "flow:", "disk:x", "Arm", "flow:a:b", "a b", "../x", "flow:../x\0", "ü"]
        {
            assert_eq!(DatabaseName::parse(bad), Err(RefusalCode::BadName), "{bad:?}");
        }
    }

    #[test]
    fn names_and_keys_have_at_most_255_bytes() {
        for (length, fits) in [(254, true), (255, true), (256, false)] {
            assert_eq!(DatabaseName::parse(&"n".repeat(length)).is_ok(), fits, "a name of {length}");
            assert_eq!(check_key(&"k".repeat(length)).is_ok(), fits, "a key of {length}");
            let prefixed = format!("flow:{}", "n".repeat(length - 5));
            assert_eq!(DatabaseName::parse(&prefixed).is_ok(), fits, "a flow's of {length}");
        }
        let long: Name = "n".repeat(251).parse().expect("a name");
        assert_eq!(DatabaseName::of(DatabaseKind::Flow, &long), None);
    }

    #[test]
    fn a_key_is_text_without_control_characters() {
        for good in ["x", "gain.p", "Größe", "two words", "/a/b"] {
            assert_eq!(check_key(good), Ok(()), "{good:?}");
        }
        for bad in ["", "a\nb", "\0", "a\u{7f}", "\u{85}"] {
            assert_eq!(check_key(bad), Err(RefusalCode::BadKey), "{bad:?}");
        }
    }
}
