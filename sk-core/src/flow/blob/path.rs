//! Which paths there may be inside a blob channel.

use super::super::error::RefusalCode;
use super::super::limits::{PATH_BYTES_MAX, TEXT_BYTES_MAX};
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// How many parts a path may have.
pub const PATH_PARTS_MAX: usize = 16;

/// A path inside a blob channel: 1 to 16 names out of `A-Z`, `a-z`, `0-9`, `_`, `.` and `-`, with `/` between
/// them, none of them `.` or `..`. The channel's own folder is the path without any name. A clone shares the text.
///
/// ```
/// use sk_core::flow::RefusalCode;
/// use sk_core::flow::blob::BlobPath;
///
/// assert_eq!(BlobPath::parse("floor/2.png")?.as_str(), "floor/2.png");
/// assert_eq!(BlobPath::parse("../secrets"), Err(RefusalCode::BadPath));
/// assert_eq!(BlobPath::parse(""), Err(RefusalCode::BadPath));
/// assert!(BlobPath::parse_folder("")?.is_root());
/// # Ok::<(), RefusalCode>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BlobPath(Arc<str>);

impl BlobPath {
    /// Checks the path of a file or folder inside the channel.
    ///
    /// # Errors
    /// `BadPath`.
    pub fn parse(text: &str) -> Result<BlobPath, RefusalCode> {
        let parts = text.split('/');
        if text.len() > PATH_BYTES_MAX || parts.clone().count() > PATH_PARTS_MAX {
            return Err(RefusalCode::BadPath);
        }
        if parts.clone().all(is_name) { Ok(BlobPath(text.into())) } else { Err(RefusalCode::BadPath) }
    }

    /// Checks the path of a folder; the empty text is the channel's own.
    ///
    /// # Errors
    /// `BadPath`.
    pub fn parse_folder(text: &str) -> Result<BlobPath, RefusalCode> {
        if text.is_empty() { Ok(BlobPath(text.into())) } else { BlobPath::parse(text) }
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Whether it is the channel's own folder.
    pub fn is_root(&self) -> bool {
        self.0.is_empty()
    }

    /// How many names it has.
    pub fn parts(&self) -> usize {
        if self.is_root() { 0 } else { self.0.split('/').count() }
    }

    /// Whether `other` is this path or below it.
    pub fn holds(&self, other: &BlobPath) -> bool {
        Path::new(&*other.0).starts_with(&*self.0)
    }
}

/// Whether a text may be a name in a blob channel.
pub(super) fn is_name(text: &str) -> bool {
    let allowed = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'.' | b'-');
    !matches!(text, "" | "." | "..") && text.len() <= TEXT_BYTES_MAX && text.bytes().all(allowed)
}

impl fmt::Display for BlobPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::Component;

    #[test]
    fn only_relative_paths_of_safe_names_are_paths() {
        for good in ["a", "a/b", "A-Z_0.9", "...", ".hidden", "a..b", "-rf", &"x/".repeat(15).add("y")] {
            assert!(BlobPath::parse(good).is_ok(), "{good}");
        }
        let long = "x".repeat(256);
        for bad in [
            "",
            "/",
            "/etc/passwd",
            "a//b",
            "a/",
            "./a",
            "..",
            "a/../b",
            "a/..",
            "a b",
            "a\\b",
            "a\0",
            "ä",
            "a/\u{202e}b",
            "C:",
            "a*",
            &"x/".repeat(16).add("y"),
            &long,
        ] {
            assert_eq!(BlobPath::parse(bad), Err(RefusalCode::BadPath), "{bad:?}");
        }
    }

    #[test]
    fn length_and_parts_are_limited_exactly() {
        for (length, fits) in [(254, true), (255, true), (256, false)] {
            assert_eq!(BlobPath::parse(&"n".repeat(length)).is_ok(), fits, "a name of {length} bytes");
        }
        for (parts, fits) in [(15, true), (16, true), (17, false)] {
            assert_eq!(BlobPath::parse(&vec!["n"; parts].join("/")).is_ok(), fits, "{parts} parts");
        }
        let of = |length: usize| {
            format!("{}{}", format!("{}/", "n".repeat(127)).repeat(7), "m".repeat(length - 896))
        };
        for (length, fits) in [(1023, true), (1024, true), (1025, false)] {
            assert_eq!(of(length).len(), length);
            assert_eq!(BlobPath::parse(&of(length)).is_ok(), fits, "{length} bytes");
        }
    }

    trait Add {
        fn add(self, more: &str) -> String;
    }

    impl Add for String {
        fn add(mut self, more: &str) -> String {
            self.push_str(more);
            self
        }
    }

    proptest! {
        #[test]
        fn what_is_accepted_stays_below_its_folder(text in "[a-zA-Z0-9./_\\\\ä\0-]{0,40}") {
            if let Ok(path) = BlobPath::parse_folder(&text) {
                let mut depth = 0;
                for part in Path::new(path.as_str()).components() {
                    prop_assert!(matches!(part, Component::Normal(_)));
                    depth += 1;
                }
                prop_assert_eq!(depth, path.parts());
                prop_assert!(depth <= PATH_PARTS_MAX);
            }
        }

        #[test]
        fn any_text_is_accepted_or_refused_without_a_panic(text in "\\PC{0,80}") {
            let accepted = BlobPath::parse(&text).is_ok();
            prop_assert_eq!(accepted, text.split('/').all(is_name) && text.split('/').count() <= PATH_PARTS_MAX);
        }
    }
}
