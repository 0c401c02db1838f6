//! The hub's binary.
#![forbid(unsafe_code)]
fn main() {}
