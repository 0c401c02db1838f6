//! The committed seeds of the fuzz targets for transports, run through the same properties as plain tests.
#![cfg(feature = "http")]

use std::fs;
use std::path::Path;

#[path = "../../fuzz/properties/transports.rs"]
mod transports;

/// Each seed whole, cut short everywhere, and with each bit of its beginning turned.
fn over_seeds(target: &str, seeds_min: usize, property: fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target);
    let listed = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<_> = listed.map(|entry| entry.expect("the folder can be listed").path()).collect();
    paths.sort();
    assert!(paths.len() >= seeds_min, "a fuzzer needs somewhere to begin");
    for path in paths {
        // The test's output is shown when the property fails, and then names the seed.
        println!("{}", path.display());
        let seed = fs::read(&path).expect("a seed can be read");
        property(&seed);
        for cut in 0..seed.len().min(100) {
            property(&seed[..cut]);
        }
        for bit in 0..seed.len().min(60) * 8 {
            let mut turned = seed.clone();
            turned[bit / 8] ^= 1 << (bit % 8);
            property(&turned);
        }
    }
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
