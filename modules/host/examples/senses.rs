//! Prints what this machine's senses say, twice a second apart, and what a reading costs.
//!
//! `cargo run -p specialk-module-host --example senses`

use sk_flat::Instant;
use sk_host::{Kernel, senses};
use std::time::{self, Duration};

/// How many readings the cost is averaged over.
const READINGS: u32 = 200;

fn main() {
    let (kernel, start) = (Kernel::default(), time::Instant::now());
    let now = || Instant::ZERO + start.elapsed();
    let mut all = senses();
    all.retain(|sense| sense.is_present(&kernel));
    for _ in 0..2 {
        for sense in &mut all {
            match sense.read_variant(&kernel, now()) {
                Ok(Some(reading)) => println!("{:12} {reading}", sense.about().name),
                Ok(None) => {}
                Err(error) => println!("{:12} {error}", sense.about().name),
            }
        }
        std::thread::sleep(Duration::from_secs(1));
    }
    for sense in &mut all {
        let begin = time::Instant::now();
        for _ in 0..READINGS {
            let _ = sense.read_variant(&kernel, now());
        }
        println!("{:12} {:?} a reading", sense.about().name, begin.elapsed() / READINGS);
    }
}
