//! Any text is refused, or read as a variant that is written and read back equal.
#![no_main]

#[path = "../properties/variant.rs"]
mod variant;

libfuzzer_sys::fuzz_target!(|data: &[u8]| variant::text(data));
