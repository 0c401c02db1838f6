//! The committed seeds of the fuzz targets for transports, run through the same properties as plain tests.
#![cfg(feature = "http")]

mod seeds;

#[path = "../../fuzz/properties/transports.rs"]
mod transports;

fn over_seeds(target: &'static str, seeds_min: usize, property: fn(&[u8])) {
    seeds::Trial { target, seeds_min, cut_step: 1, cut_bytes_max: 100, turned_bytes_max: 60 }.run(property);
}

#[test]
fn a_head_is_one_request_or_none_whatever_comes() {
    over_seeds("http_request", 8, transports::http_request);
}

#[test]
fn a_serial_line_stands_whatever_comes() {
    over_seeds("serial_line", 8, transports::serial_line);
    over_seeds("serial_line", 8, transports::envelope);
}

#[test]
fn nobody_publishes_by_datagram_without_the_key() {
    over_seeds("datagram", 4, transports::datagram);
}
