//! Whatever is asked of a blob channel, the files stay where and whose they are.
#![no_main]

#[path = "../properties/blobs.rs"]
mod blobs;

libfuzzer_sys::fuzz_target!(|data: &[u8]| blobs::commands(data));
