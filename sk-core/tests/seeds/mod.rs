//! The committed seeds of a fuzz target, run through its property: whole, cut short, and with bits turned.

use std::fs;
use std::path::Path;

/// How much is tried with each seed.
pub struct Trial {
    pub target: &'static str,
    /// A fuzzer needs somewhere to begin: fewer seeds than this are a mistake.
    pub seeds_min: usize,
    /// It is cut at every so many bytes of as many at its beginning.
    pub cut_step: usize,
    pub cut_bytes_max: usize,
    /// Each bit of so many bytes at its beginning is turned.
    pub turned_bytes_max: usize,
}

impl Trial {
    pub fn run(&self, property: fn(&[u8])) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(self.target);
        let listed = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        let mut paths: Vec<_> = listed.map(|entry| entry.expect("the folder can be listed").path()).collect();
        paths.sort();
        assert!(paths.len() >= self.seeds_min, "a fuzzer needs a seed for each kind");
        for path in paths {
            // The test's output is shown when the property fails, and then names the seed.
            println!("{}", path.display());
            let seed = fs::read(&path).expect("a seed can be read");
            property(&seed);
            for cut in (0..seed.len().min(self.cut_bytes_max)).step_by(self.cut_step) {
                property(&seed[..cut]);
            }
            for bit in 0..seed.len().min(self.turned_bytes_max) * 8 {
                let mut turned = seed.clone();
                turned[bit / 8] ^= 1 << (bit % 8);
                property(&turned);
            }
        }
    }
}
