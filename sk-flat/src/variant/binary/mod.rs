//! The binary form. Its layout is normative for the wire:
//!
//! A value is one kind byte (the number of its [`Kind`](crate::Kind)) and a body. All numbers are little-endian,
//! floats are their IEEE 754 bits, and every length and count is a `u32`.
//!
//! | kind | body |
//! |---|---|
//! | 0 null | nothing |
//! | 1 bool | one byte, 0 or 1 |
//! | 2 i8, 3 i16, 4 i32, 5 i64 | 1, 2, 4, 8 bytes, two's complement |
//! | 6 u8, 7 u16, 8 u32, 9 u64 | 1, 2, 4, 8 bytes |
//! | 10 f32, 11 f64 | 4, 8 bytes |
//! | 12 string | length in bytes, then that many bytes of UTF-8 |
//! | 13 bytes | length, then that many bytes |
//! | 14 list | count of items, then each item as a value |
//! | 15 map | count of entries, then each entry: length of the key, the key in UTF-8, the value |
//!
//! The keys of a map stand in ascending order of their bytes, and none stands twice. Nothing
//! follows the value. So every value has exactly one form, and the decoder refuses all others.
//!
//! Lists and maps nest at most 64 deep; one value holds at most 262,144 values (itself, every item
//! and every entry) in at most 16 MiB. The encoder obeys the limits that the decoder checks, and
//! the decoder checks each announced length against the bytes that are there before it allocates.

mod decode;
mod encode;

#[cfg(test)]
mod tests;
