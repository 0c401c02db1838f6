//! Whatever a peer sends, both sides of the flow protocol stand, and nobody else is touched.
#![no_main]

#[path = "../properties/flow.rs"]
mod flow;

libfuzzer_sys::fuzz_target!(|data: &[u8]| flow::frames(data));
