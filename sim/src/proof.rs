//! Proof that the simulation finds what is wrong: bugs that were planted are switched on, one at a time.

use sk_core::testing::{Bug, plant};
use sk_sim::run::run;
use sk_sim::{generate, shrink::shrink};
use std::process::ExitCode;

/// Runs that a shrinker may make.
const SHRINK_RUNS_MAX: usize = 2000;

/// Looks for the bug of that name, or for each: which seed finds it, and how short its script becomes.
pub(crate) fn find(name: &str, from: u64, seeds: u64) -> ExitCode {
    let bugs: Vec<_> = Bug::ALL
        .into_iter()
        .filter(|(_, known)| name == "all" || name == *known)
        .collect();
    if bugs.is_empty() {
        let names: Vec<&str> = Bug::ALL.iter().map(|(_, name)| *name).collect();
        eprintln!("no bug `{name}` is planted; there are: {}", names.join(", "));
        return ExitCode::FAILURE;
    }
    println!("{:<24} {:>5} {:>6} {:>6} {:>6}  complaint", "bug", "seed", "steps", "left", "nodes");
    let mut found = 0;
    for &(bug, name) in &bugs {
        plant(Some(bug));
        let seed = (from..from + seeds).find(|seed| run(&generate::script(*seed)).complaint.is_some());
        match seed {
            None => println!("{name:<24} not found within {seeds} seeds"),
            Some(seed) => {
                found += 1;
                say(name, seed, bugs.len() == 1);
            }
        }
        plant(None);
    }
    if found == bugs.len() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn say(name: &str, seed: u64, whole: bool) {
    let script = generate::script(seed);
    let Some(shrunk) = shrink(&script, SHRINK_RUNS_MAX) else { return };
    let (before, after, nodes) = (script.steps.len(), shrunk.script.steps.len(), shrunk.script.nodes.len());
    let complaint = shrunk
        .outcome
        .complaint
        .map(|complaint| complaint.to_string())
        .unwrap_or_default();
    println!("{name:<24} {seed:>5} {before:>6} {after:>6} {nodes:>6}  {complaint}");
    if whole {
        print!("{}", shrunk.script);
    }
}
