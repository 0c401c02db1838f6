//! Whatever comes over a serial line, both sides stand and find each other again.
#![no_main]

#[path = "../properties/transports.rs"]
mod transports;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    transports::envelope(data);
    transports::serial_line(data);
});
