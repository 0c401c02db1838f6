//! Whatever comes to an HTTP port, a head is read as one request or none.
#![no_main]

#[path = "../properties/transports.rs"]
mod transports;

libfuzzer_sys::fuzz_target!(|data: &[u8]| transports::http_request(data));
