//! How variants print. `Display` is compact and JSON-like, `Debug` also tells the kinds.

use super::{SkList, SkMap, SkVariant, VARIANT_DEPTH_MAX};
use std::fmt;

const BYTES_SHOWN_MAX: usize = 16;

/// Compact and JSON-like, for people and logs: control characters and marks that reorder text are
/// escaped as in Rust, of bytes the first 16 are shown, and below 64 levels stands `…`. What a
/// program is to read again is made by [`SkVariant::to_json`].
impl fmt::Display for SkVariant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(f, self, false, 0)
    }
}

/// Like `Display`, with the kind behind each number: `[1u8,2.5f32]`.
impl fmt::Debug for SkVariant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(f, self, true, 0)
    }
}

impl fmt::Debug for SkList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_list(f, self, true, 0)
    }
}

impl fmt::Debug for SkMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_map(f, self, true, 0)
    }
}

fn write(f: &mut fmt::Formatter<'_>, value: &SkVariant, kinds: bool, depth: usize) -> fmt::Result {
    match value {
        SkVariant::Null => f.write_str("null"),
        SkVariant::Bool(truth) => write!(f, "{truth}"),
        SkVariant::String(text) => write!(f, "{text:?}"),
        SkVariant::Bytes(bytes) => write_bytes(f, bytes),
        SkVariant::List(list) => write_list(f, list, kinds, depth),
        SkVariant::Map(map) => write_map(f, map, kinds, depth),
        number => {
            match number {
                // The Debug form of a float keeps the ".0" that tells it from an integer.
                SkVariant::F32(x) => write!(f, "{x:?}")?,
                SkVariant::F64(x) => write!(f, "{x:?}")?,
                integer => write!(f, "{}", integer.integer().unwrap_or_default())?,
            }
            if kinds { f.write_str(number.kind().name()) } else { Ok(()) }
        }
    }
}

fn write_bytes(f: &mut fmt::Formatter<'_>, bytes: &[u8]) -> fmt::Result {
    write!(f, "<{} bytes", bytes.len())?;
    for (index, byte) in bytes.iter().take(BYTES_SHOWN_MAX).enumerate() {
        write!(f, "{}{byte:02x}", if index == 0 { ": " } else { " " })?;
    }
    f.write_str(if bytes.len() > BYTES_SHOWN_MAX { " …>" } else { ">" })
}

fn write_list(f: &mut fmt::Formatter<'_>, list: &SkList, kinds: bool, depth: usize) -> fmt::Result {
    if depth >= VARIANT_DEPTH_MAX {
        return f.write_str("[…]");
    }
    f.write_str("[")?;
    for (index, item) in list.iter().enumerate() {
        f.write_str(if index == 0 { "" } else { "," })?;
        write(f, item, kinds, depth + 1)?;
    }
    f.write_str("]")
}

fn write_map(f: &mut fmt::Formatter<'_>, map: &SkMap, kinds: bool, depth: usize) -> fmt::Result {
    if depth >= VARIANT_DEPTH_MAX {
        return f.write_str("{…}");
    }
    f.write_str("{")?;
    for (index, (key, value)) in map.iter().enumerate() {
        write!(f, "{}{key:?}:", if index == 0 { "" } else { "," })?;
        write(f, value, kinds, depth + 1)?;
    }
    f.write_str("}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_is_for_people_and_debug_tells_the_kinds() {
        let value = SkVariant::map([
            ("a", SkVariant::U8(1)),
            ("b", SkVariant::list([1.0, f64::NAN])),
            ("c", SkVariant::from(bytes::Bytes::from_static(b"\x00\xff"))),
        ]);
        assert_eq!(value.to_string(), r#"{"a":1,"b":[1.0,NaN],"c":<2 bytes: 00 ff>}"#);
        assert_eq!(format!("{value:?}"), r#"{"a":1u8,"b":[1.0f64,NaNf64],"c":<2 bytes: 00 ff>}"#);
    }

    #[test]
    fn a_text_from_a_peer_cannot_steer_the_terminal() {
        let shown = SkVariant::from("\u{1b}[2J\n\u{202e}").to_string();
        assert!(shown.chars().all(|c| (' '..='~').contains(&c)), "{shown}");
    }

    #[test]
    fn a_deep_tree_prints_its_upper_levels() {
        let deep = (0..100_000).fold(SkVariant::Null, |below, _| SkVariant::list([below]));
        assert!(deep.to_string().contains("[…]"));
        assert!(format!("{deep:?}").len() < 1000);
    }
}
