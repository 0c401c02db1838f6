//! Variants and serde, both ways: a variant is data that any serde format can carry, and a format
//! that any serde type can be written to and read from.

mod forms;
mod keys;
mod reader;
mod value;
mod writer;

pub use reader::from_variant_serde;
pub use writer::to_variant;

pub(super) use forms::unfold;
pub(super) use value::{Raw, RawReading, Shown, Style};

#[cfg(test)]
mod tests;
