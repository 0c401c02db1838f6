//! What can go wrong with variants and names: what was expected, what came, and where.

use crate::variant::kind::Kind;
use std::fmt;

/// Why a variant could not be converted, read or written.
///
/// An error found below the top carries its place as [`VariantError::At`], written like
/// `pose.x: expected f64, found string`. The common cases carry no allocation.
///
/// ```
/// use sk_flat::{FromVariant, SkVariant};
///
/// let error = Vec::<u16>::from_variant(&SkVariant::from([1, 70_000])).unwrap_err();
/// assert_eq!(error.to_string(), "[1]: 70000 does not fit u16");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VariantError {
    /// The value is of another kind.
    #[error("expected {expected}, found {found}")]
    Expected {
        /// The Rust type or the form that was asked for.
        expected: &'static str,
        /// The kind of the value that came.
        found: Kind,
    },
    /// The value is a number, but the wanted type cannot hold it without changing it.
    #[error("{value} does not fit {expected}")]
    OutOfRange {
        /// The Rust type that was asked for.
        expected: &'static str,
        /// The number that came, in decimal.
        value: Box<str>,
    },
    /// The list has the wrong number of items for an array, a tuple or a tuple struct.
    #[error("expected a list of {expected} items, found {found}")]
    Length {
        /// How many items were wanted.
        expected: usize,
        /// How many came.
        found: usize,
    },
    /// A map lacks a field that has no default.
    #[error("the field is missing")]
    Missing,
    /// A map holds a key that the struct does not know.
    #[error("no such field; the known ones are {}", Listed(.known))]
    UnknownField {
        /// The keys that the struct reads.
        known: &'static [&'static str],
    },
    /// No case of the enum has this name.
    #[error("no such case {found:?}; the known ones are {}", Listed(.known))]
    UnknownCase {
        /// The name that came.
        found: Box<str>,
        /// The names of the enum's cases.
        known: &'static [&'static str],
    },
    /// Something below the top: a path such as `pose.x` or `points[3].y`, and what is wrong there.
    #[error("{path}: {cause}")]
    At {
        /// Where, seen from the top.
        path: Box<str>,
        /// What is wrong there; never itself an `At`.
        cause: Box<VariantError>,
    },
    /// A limit is exceeded: nothing was allocated for what lies beyond it.
    #[error("{what} exceeds the limit of {max}")]
    Limit {
        /// What is limited, for example `nesting depth`.
        what: &'static str,
        /// The largest value allowed.
        max: usize,
    },
    /// The binary form ends early.
    #[error("the binary form ends too early: {needed} bytes are needed at byte {at}, {left} are left")]
    Truncated {
        /// Where the missing part begins.
        at: usize,
        /// How many bytes it needs at least.
        needed: usize,
        /// How many are there.
        left: usize,
    },
    /// The binary form is not one that the encoder writes.
    #[error("malformed binary form at byte {at}: {what}")]
    Malformed {
        /// Where.
        at: usize,
        /// The rule that is broken.
        what: &'static str,
    },
    /// The text is not JSON, or not JSON that stands for a variant.
    #[error("JSON, line {line}, column {column}: {message}")]
    Text {
        /// The line, counted from 1.
        line: usize,
        /// The column, counted from 1.
        column: usize,
        /// What the parser says.
        message: Box<str>,
    },
    /// What a type's own `Serialize` or `Deserialize` reported.
    #[error("{0}")]
    Custom(Box<str>),
}

impl VariantError {
    /// This error, one field further up: `x: …` becomes `pose.x: …`.
    #[must_use]
    pub fn in_field(self, name: &str) -> VariantError {
        self.below(name.to_owned())
    }

    /// This error, one list further up: `x: …` becomes `[3].x: …`.
    #[must_use]
    pub fn in_item(self, index: usize) -> VariantError {
        self.below(format!("[{index}]"))
    }

    /// What is wrong, without its place.
    pub fn cause(&self) -> &VariantError {
        match self {
            VariantError::At { cause, .. } => cause,
            other => other,
        }
    }

    fn below(self, mut head: String) -> VariantError {
        match self {
            VariantError::At { path, cause } => {
                if !path.starts_with('[') {
                    head.push('.');
                }
                head.push_str(&path);
                VariantError::At { path: head.into(), cause }
            }
            cause => VariantError::At { path: head.into(), cause: Box::new(cause) },
        }
    }
}

impl serde::ser::Error for VariantError {
    fn custom<T: fmt::Display>(message: T) -> VariantError {
        VariantError::Custom(message.to_string().into())
    }
}

impl serde::de::Error for VariantError {
    fn custom<T: fmt::Display>(message: T) -> VariantError {
        VariantError::Custom(message.to_string().into())
    }
}

/// Why a text is not a name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NameError {
    /// Nothing was given.
    #[error("a name has at least one character")]
    Empty,
    /// The name is longer than [`NAME_BYTES_MAX`](crate::NAME_BYTES_MAX).
    #[error("the name has {found} bytes, at most {max} are allowed: shorten it")]
    TooLong {
        /// How many bytes came.
        found: usize,
        /// How many are allowed.
        max: usize,
    },
    /// A character is not of the alphabet.
    #[error(
        "character {found:?} at byte {at} of the name: write it with lower-case letters a-z, digits, '_', '.' and '-'"
    )]
    Character {
        /// The offending character.
        found: char,
        /// Its place in bytes.
        at: usize,
    },
    /// The user part of a composed name has a dot, so the whole could be another user's name.
    #[error(
        "the user's name {user:?} has a dot at byte {at}: a user's name may not, because the dot ends it"
    )]
    DotInUser {
        /// The user's name.
        user: Box<str>,
        /// Where its first dot stands.
        at: usize,
    },
}

struct Listed<'a>(&'a [&'static str]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return f.write_str("none");
        }
        for (index, name) in self.0.iter().enumerate() {
            f.write_str(if index == 0 { "" } else { ", " })?;
            f.write_str(name)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_grows_from_the_inside_out() {
        let inner = VariantError::Expected { expected: "f64", found: Kind::String };
        let error = inner.clone().in_field("x").in_item(3).in_field("poses");
        assert_eq!(error.to_string(), "poses[3].x: expected f64, found string");
        assert_eq!(error.cause(), &inner);
    }

    #[test]
    fn an_error_stays_small() {
        assert!(size_of::<VariantError>() <= 40, "{} bytes", size_of::<VariantError>());
    }
}
