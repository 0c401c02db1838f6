//! Rights by name: what an account may do, and with what.
//!
//! They are variables of the account's database: `right.publish` holds a list of patterns, and so for each right.
//! What is not there is not granted, nor is what cannot be read.

use super::Right;
use super::definition::Rights;
use super::limits::{PATTERNS_PER_RIGHT_MAX, TEXT_BYTES_MAX};
use sk_flat::SkVariant;
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// What the keys of rights begin with.
pub const RIGHT_PREFIX: &str = "right.";

impl Right {
    /// Its name, as it stands behind [`RIGHT_PREFIX`]; that of [`Nothing`](Right::Nothing) is no right's.
    pub const fn name(self) -> &'static str {
        match self {
            Right::Nothing => "nothing",
            Right::List => "list",
            Right::Publish => "publish",
            Right::Subscribe => "subscribe",
            Right::Serve => "serve",
            Right::Call => "call",
            Right::BlobRead => "blob_read",
            Right::BlobWrite => "blob_write",
            Right::DatabaseRead => "database_read",
            Right::DatabaseWrite => "database_write",
            Right::Administer => "administer",
        }
    }

    /// The right of a name.
    pub fn by_name(name: &str) -> Option<Right> {
        Right::ALL.into_iter().find(|right| right.name() == name)
    }
}

/// Which names a right is about: one name, or with a `*` at its end, all that begin so. `*` alone is every name.
///
/// ```
/// use sk_core::flow::rights::Pattern;
///
/// let pattern: Pattern = "robot.host.*".parse()?;
/// assert!(pattern.matches("robot.host.cpu") && !pattern.matches("robot.hosts"));
/// assert!("*.cpu".parse::<Pattern>().is_err(), "a star stands at the end");
/// # Ok::<(), sk_core::flow::rights::PatternError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pattern {
    begin: Box<str>,
    open: bool,
}

/// Why a text is no pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "a pattern is a name of a-z 0-9 _ . - : and may end with `*`; it has 1 to {TEXT_BYTES_MAX} characters"
)]
pub struct PatternError;

impl Pattern {
    /// Whether a name is meant.
    pub fn matches(&self, name: &str) -> bool {
        match self.open {
            true => name.starts_with(&*self.begin),
            false => name == &*self.begin,
        }
    }

    /// Whether every name is.
    pub fn is_everything(&self) -> bool {
        self.open && self.begin.is_empty()
    }
}

impl FromStr for Pattern {
    type Err = PatternError;
    fn from_str(text: &str) -> Result<Pattern, PatternError> {
        let (begin, open) = text.strip_suffix('*').map_or((text, false), |begin| (begin, true));
        let allowed = |c: char| matches!(c, 'a'..='z' | '0'..='9' | '_' | '.' | '-' | ':');
        if text.is_empty() || text.len() > TEXT_BYTES_MAX || !begin.chars().all(allowed) {
            return Err(PatternError);
        }
        Ok(Pattern { begin: begin.into(), open })
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.begin)?;
        f.write_str(if self.open { "*" } else { "" })
    }
}

/// What is wrong with the variable of a right. It grants nothing then.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RightError {
    /// There is no such right.
    #[error(
        "there is no such right; there are list, publish, subscribe, serve, call, blob_read, blob_write, database_read, database_write, administer"
    )]
    Unknown,
    /// The value is not a list of texts.
    #[error("it is not a list of patterns")]
    NoList,
    /// The list is longer than it may be.
    #[error("it has more than {PATTERNS_PER_RIGHT_MAX} patterns")]
    TooMany,
    /// One of the texts is no pattern.
    #[error("{0:?} is none: {PatternError}")]
    Pattern(String),
}

/// Reads the variable of a right: which right, and what it is about.
///
/// # Errors
/// If it is anything else than a list of patterns for a right that there is.
pub fn read_right(key: &str, value: &SkVariant) -> Result<(Right, Vec<Pattern>), RightError> {
    let right = key
        .strip_prefix(RIGHT_PREFIX)
        .and_then(Right::by_name)
        .ok_or(RightError::Unknown)?;
    let list = value.as_list().ok_or(RightError::NoList)?;
    if list.len() > PATTERNS_PER_RIGHT_MAX {
        return Err(RightError::TooMany);
    }
    let pattern = |item: &SkVariant| {
        let text = item.as_str().ok_or(RightError::NoList)?;
        text.parse().map_err(|_| RightError::Pattern(text.to_owned()))
    };
    Ok((right, list.iter().map(pattern).collect::<Result<_, _>>()?))
}

/// All rights of an account, ready to be asked.
///
/// ```
/// use sk_core::flow::{Right, rights::Grants};
/// use sk_flat::SkVariant;
///
/// let patterns = SkVariant::from(vec![SkVariant::from("ada.*")]);
/// let (grants, unreadable) = Grants::read([("right.publish", patterns), ("right.call", "*".into())]);
/// assert!(grants.has(Right::Publish, "ada.imu") && !grants.has(Right::Publish, "robot.imu"));
/// assert_eq!(unreadable.len(), 1, "a text is no list of patterns");
/// assert!(!grants.has(Right::Call, "robot.gripper"), "and grants nothing");
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Grants {
    /// By the number of the right.
    patterns: [Box<[Pattern]>; Right::ALL.len()],
}

impl Grants {
    /// Reads the variables of rights. Answers also which of them grant nothing because of what is in them.
    pub fn read<K: AsRef<str>>(
        variables: impl IntoIterator<Item = (K, SkVariant)>,
    ) -> (Grants, Vec<(String, RightError)>) {
        let (mut grants, mut unreadable) = (Grants::default(), Vec::new());
        for (key, value) in variables {
            match read_right(key.as_ref(), &value) {
                Ok((right, patterns)) => grants.grant(right, patterns),
                Err(error) => unreadable.push((key.as_ref().to_owned(), error)),
            }
        }
        (grants, unreadable)
    }

    fn grant(&mut self, right: Right, patterns: Vec<Pattern>) {
        if let Some(place) = place(right) {
            self.patterns[place] = patterns.into();
        }
    }

    /// What a right is about.
    pub fn patterns(&self, right: Right) -> &[Pattern] {
        place(right).map_or(&[], |place| &self.patterns[place])
    }

    /// Whether a right is granted for this name.
    pub fn has(&self, right: Right, name: &str) -> bool {
        right == Right::Nothing || self.patterns(right).iter().any(|pattern| pattern.matches(name))
    }

    /// Whether a right is granted for every name.
    pub fn has_everywhere(&self, right: Right) -> bool {
        right == Right::Nothing || self.patterns(right).iter().any(Pattern::is_everything)
    }

    /// The rights that are granted for any name at all.
    pub fn rights(&self) -> Rights {
        let granted = Right::ALL.into_iter().filter(|right| !self.patterns(*right).is_empty());
        granted.fold(Rights::NONE, Rights::with)
    }
}

/// Where a right stands in the table; `Nothing` is none.
fn place(right: Right) -> Option<usize> {
    (right as usize).checked_sub(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn list(patterns: &[&str]) -> SkVariant {
        patterns
            .iter()
            .map(|pattern| SkVariant::from(*pattern))
            .collect::<Vec<_>>()
            .into()
    }

    #[test]
    fn a_pattern_is_a_name_or_the_beginning_of_names() {
        for (pattern, good, bad) in [
            ("ada.*", "ada.imu", "adam.imu"),
            ("ada.imu", "ada.imu", "ada.imu.left"),
            ("*", "anything", ""),
            ("flow:ada.*", "flow:ada.arm", "chan:ada.arm"),
        ] {
            let pattern: Pattern = pattern.parse().expect("a pattern");
            assert!(pattern.matches(good), "{pattern} {good}");
            assert!(bad.is_empty() || !pattern.matches(bad), "{pattern} {bad}");
        }
        for bad in ["", "**", "a*b", "*a", "Ada", "a b", "ü", "a\n"] {
            assert_eq!(bad.parse::<Pattern>(), Err(PatternError), "{bad:?}");
        }
        assert!("a".repeat(255).parse::<Pattern>().is_ok() && "a".repeat(256).parse::<Pattern>().is_err());
    }

    #[test]
    fn what_cannot_be_read_grants_nothing_and_is_told() {
        let many = |count: usize| list(&vec!["a"; count]);
        let bad = [
            ("right.publish", SkVariant::from("*"), RightError::NoList),
            ("right.publish", SkVariant::from(vec![SkVariant::from(1)]), RightError::NoList),
            ("right.publish", list(&["ada.*", "A"]), RightError::Pattern("A".into())),
            ("right.publish", many(PATTERNS_PER_RIGHT_MAX + 1), RightError::TooMany),
            ("right.fly", list(&["*"]), RightError::Unknown),
            ("right.nothing", list(&["*"]), RightError::Unknown),
            ("right.", list(&["*"]), RightError::Unknown),
        ];
        for (key, value, why) in bad {
            let (grants, unreadable) = Grants::read([(key, value)]);
            assert_eq!(unreadable, [(key.to_owned(), why)]);
            assert_eq!(grants, Grants::default());
        }
        let (grants, unreadable) = Grants::read([("right.publish", many(PATTERNS_PER_RIGHT_MAX))]);
        assert!(unreadable.is_empty() && grants.has(Right::Publish, "a"));
    }

    #[test]
    fn no_right_stands_for_another() {
        for right in Right::ALL {
            let key = format!("{RIGHT_PREFIX}{}", right.name());
            let (grants, _) = Grants::read([(key, list(&["ada.*"]))]);
            for other in Right::ALL {
                assert_eq!(grants.has(other, "ada.x"), right == other, "{right:?} {other:?}");
                assert_eq!(grants.rights().has(other), right == other);
                assert!(!grants.has_everywhere(other) && !grants.has(other, "bob.x"));
            }
        }
    }

    proptest! {
        #[test]
        fn a_pattern_reads_back_and_matches_what_it_begins(begin in "[a-z0-9_.:-]{0,20}", rest in "[a-z0-9_.-]{0,20}") {
            let open: Pattern = format!("{begin}*").parse().expect("a pattern");
            let whole = format!("{begin}{rest}");
            prop_assert!(open.matches(&whole));
            prop_assert_eq!(open.to_string().parse::<Pattern>(), Ok(open));
            if let Ok(exact) = begin.parse::<Pattern>() {
                prop_assert_eq!(exact.matches(&whole), rest.is_empty());
            }
        }
    }
}
