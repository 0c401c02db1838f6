//! The committed seeds of the fuzz target `blob_commands`, run through the same property as plain tests.

use std::fs;
use std::path::Path;

#[path = "../../fuzz/properties/blobs.rs"]
mod blobs;

#[test]
fn t12_files_stay_where_and_whose_they_are_whatever_the_seeds_hold_cut_short_or_with_a_bit_turned() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds/blob_commands");
    let listed = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<_> = listed.map(|entry| entry.expect("the folder can be listed").path()).collect();
    paths.sort();
    assert!(paths.len() >= 20, "a fuzzer needs a seed for each kind");
    for path in paths {
        // The test's output is shown when the property fails, and then names the seed.
        println!("{}", path.display());
        let seed = fs::read(&path).expect("a seed can be read");
        blobs::commands(&seed);
        for cut in (0..seed.len()).step_by(3) {
            blobs::commands(&seed[..cut]);
        }
        for bit in 0..seed.len().min(60) * 8 {
            let mut turned = seed.clone();
            turned[bit / 8] ^= 1 << (bit % 8);
            blobs::commands(&turned);
        }
    }
}
