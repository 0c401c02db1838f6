//! Any bytes are refused, or read as a variant that is written as the very same bytes.
#![no_main]

#[path = "../properties/variant.rs"]
mod variant;

libfuzzer_sys::fuzz_target!(|data: &[u8]| variant::binary(data));
