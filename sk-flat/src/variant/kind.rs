//! The kinds of a variant and their numbers.

use std::fmt;

/// The kind of a variant. Its number is the kind byte of the binary form.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Kind {
    /// Nothing.
    Null = 0,
    /// A truth.
    Bool = 1,
    /// A signed integer of 8 bits.
    I8 = 2,
    /// A signed integer of 16 bits.
    I16 = 3,
    /// A signed integer of 32 bits.
    I32 = 4,
    /// A signed integer of 64 bits.
    I64 = 5,
    /// An unsigned integer of 8 bits.
    U8 = 6,
    /// An unsigned integer of 16 bits.
    U16 = 7,
    /// An unsigned integer of 32 bits.
    U32 = 8,
    /// An unsigned integer of 64 bits.
    U64 = 9,
    /// A float of 32 bits.
    F32 = 10,
    /// A float of 64 bits.
    F64 = 11,
    /// A text.
    String = 12,
    /// Bytes.
    Bytes = 13,
    /// Values in order.
    List = 14,
    /// Values by key.
    Map = 15,
}

impl Kind {
    /// All kinds, in the order of their numbers.
    pub const ALL: [Kind; 16] = [
        Kind::Null,
        Kind::Bool,
        Kind::I8,
        Kind::I16,
        Kind::I32,
        Kind::I64,
        Kind::U8,
        Kind::U16,
        Kind::U32,
        Kind::U64,
        Kind::F32,
        Kind::F64,
        Kind::String,
        Kind::Bytes,
        Kind::List,
        Kind::Map,
    ];

    /// The kind's name, as the error messages print it: the Rust name for numbers.
    pub const fn name(self) -> &'static str {
        match self {
            Kind::Null => "null",
            Kind::Bool => "bool",
            Kind::I8 => "i8",
            Kind::I16 => "i16",
            Kind::I32 => "i32",
            Kind::I64 => "i64",
            Kind::U8 => "u8",
            Kind::U16 => "u16",
            Kind::U32 => "u32",
            Kind::U64 => "u64",
            Kind::F32 => "f32",
            Kind::F64 => "f64",
            Kind::String => "string",
            Kind::Bytes => "bytes",
            Kind::List => "list",
            Kind::Map => "map",
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
