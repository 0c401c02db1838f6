//! Proof that the simulation finds what is wrong: every planted bug, switched on alone.
#![cfg(feature = "planted-bugs")]

use sk_core::testing::{Bug, plant};
use sk_sim::{generate, run::run};

/// Seeds that are enough for every one of them.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=1500;

#[test]
fn every_planted_bug_is_found() {
    for (bug, name) in Bug::ALL {
        plant(Some(bug));
        let found = SEEDS.into_iter().find(|seed| run(&generate::script(*seed)).complaint.is_some());
        plant(None);
        assert!(found.is_some(), "{name} is not found");
    }
}
