//! Nobody without the key publishes by datagram.
#![no_main]

#[path = "../properties/transports.rs"]
mod transports;

libfuzzer_sys::fuzz_target!(|data: &[u8]| transports::datagram(data));
