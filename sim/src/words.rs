//! The words of a script's line.

use std::fmt::{self, Write as _};
use std::str::FromStr;

/// The words of a line.
pub(crate) type Words<'a> = std::str::SplitAsciiWhitespace<'a>;

/// The next word as a number.
pub(crate) fn number<N: FromStr>(words: &mut Words<'_>) -> Option<N> {
    words.next()?.parse().ok()
}

/// Writes a name and its numbers.
pub(crate) fn words(f: &mut fmt::Formatter<'_>, name: &str, numbers: &[u64]) -> fmt::Result {
    f.write_str(name)?;
    for number in numbers {
        f.write_char(' ')?;
        write!(f, "{number}")?;
    }
    Ok(())
}

/// The name of a value in a list of names.
pub(crate) fn name_of<T: PartialEq>(names: &[(T, &'static str)], value: &T) -> &'static str {
    names.iter().find(|(known, _)| known == value).map_or("?", |(_, name)| name)
}

/// The value that the next word names.
pub(crate) fn named<T: Copy>(names: &[(T, &'static str)], words: &mut Words<'_>) -> Option<T> {
    let word = words.next()?;
    names.iter().find(|(_, name)| *name == word).map(|(value, _)| *value)
}
