//! The committed seeds of the fuzz targets, run through the same properties as plain tests.

use std::fs;
use std::path::Path;

#[path = "../../fuzz/properties/variant.rs"]
mod variant;

fn seeds(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target);
    let listed = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let paths = listed.map(|entry| entry.expect("the folder can be listed").path());
    let mut seeds: Vec<_> = paths
        .map(|path| (path.display().to_string(), fs::read(&path).expect("a seed can be read")))
        .collect();
    seeds.sort();
    seeds
}

/// Runs the property over the seeds, each whole, cut short and with one bit turned at a time.
fn run(target: &str, property: fn(&[u8]), is_read: fn(&[u8]) -> bool) {
    let seeds = seeds(target);
    let read = seeds.iter().filter(|(_, seed)| is_read(seed)).count();
    assert!(read >= 8, "{target} has {read} seeds that are read; a fuzzer needs some to begin with");
    for (name, seed) in seeds {
        // The test's output is shown when a property fails, and then names the seed.
        println!("{name}");
        property(&seed);
        for cut in 0..seed.len() {
            property(&seed[..cut]);
        }
        for bit in 0..seed.len().min(512) * 8 {
            let mut turned = seed.clone();
            turned[bit / 8] ^= 1 << (bit % 8);
            property(&turned);
        }
    }
}

#[test]
fn the_seeds_of_variant_text_hold() {
    let is_read =
        |seed: &[u8]| std::str::from_utf8(seed).is_ok_and(|text| sk_flat::SkVariant::from_json(text).is_ok());
    run("variant_text", variant::text, is_read);
}

#[test]
fn the_seeds_of_variant_binary_hold() {
    run("variant_binary", variant::binary, |seed| sk_flat::SkVariant::decode(seed).is_ok());
}
