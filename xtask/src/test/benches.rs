//! The benches: each is run once with the least work. That shows that they run, and nothing about time.

use super::Gate;
use crate::process::{self, Failure};
use crate::workspace::Target;
use std::time::Duration;

/// The package that holds the benches.
const PACKAGE: &str = "sk-benches";
/// How long a bench may run with the least work.
const LIMIT_S: u64 = 120;
/// The bench that counts instructions: it has a step and options of its own.
const INSTRUCTIONS: &str = "instructions";
/// How long the counting may take, with the building of its program.
const COUNTING_LIMIT_S: u64 = 900;

/// Builds all benches without optimisation and runs each.
pub(super) fn smoke_runs(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let Some(package) = gate.workspace.member(PACKAGE) else {
        return Err(Failure::Other(format!("the workspace has no package {PACKAGE}")));
    };
    process::run(process::cargo().args(["test", "--quiet", "--package", PACKAGE, "--benches", "--no-run"]))?;
    let timed = |target: &&Target| target.kind == "bench" && target.name != INSTRUCTIONS;
    let benches = package.targets.iter().filter(timed);
    let mut run = 0;
    for bench in benches {
        let log = gate.scratch.join(format!("bench-{}.log", bench.name));
        let mut command = process::cargo();
        command.args([
            "test",
            "--quiet",
            "--package",
            PACKAGE,
            "--bench",
            &bench.name,
            "--",
            "--smoke",
            "--json",
        ]);
        process::run_logged(&mut command, &log, Some(Duration::from_secs(LIMIT_S)))?;
        let said = std::fs::read_to_string(&log).map_err(|error| Failure::file(&log, error))?;
        let figures = figures(&said);
        if figures == 0 {
            return Err(Failure::Other(format!("the bench {} told no figure", bench.name)));
        }
        println!("   {}: {figures} figures", bench.name);
        run += 1;
    }
    gate.passed += run;
    Ok(format!("{run} ran"))
}

/// Counts the instructions of the hot paths; the bench fails where one takes more than its limit.
pub(super) fn count_instructions(gate: &mut Gate<'_>) -> Result<String, Failure> {
    if gate.options.quick {
        return Ok("left out by --quick".into());
    }
    let log = gate.scratch.join("bench-instructions.log");
    let mut command = process::cargo();
    command.args(["bench", "--quiet", "--package", PACKAGE, "--bench", INSTRUCTIONS]);
    process::run_logged(&mut command, &log, Some(Duration::from_secs(COUNTING_LIMIT_S)))?;
    let said = std::fs::read_to_string(&log).map_err(|error| Failure::file(&log, error))?;
    let paths = counts(&said);
    if paths == 0 {
        return Err(Failure::Other("no instruction was counted".into()));
    }
    gate.passed += paths;
    Ok(format!("{paths} within their limits"))
}

/// How many paths were counted.
fn counts(said: &str) -> usize {
    said.lines()
        .filter(|line| line.trim_start().starts_with("Instructions:"))
        .count()
}

/// How many lines are figures of our own, with every field that readers of the JSON rely on.
fn figures(said: &str) -> usize {
    let fields = ["bench", "case", "metric", "value", "unit", "peer"];
    let lines = said
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    lines
        .filter(|line| fields.iter().all(|field| line.get(field).is_some()))
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_counted_path_has_a_line_of_instructions() {
        let path = "instructions::hot_paths::direct_emits to_1:(linked(1))\n  Instructions:    43208|N/A\n";
        assert_eq!(counts(&format!("{path}  L1 Hits:    64874|N/A\n{path}")), 2);
    }

    #[test]
    fn only_whole_figures_count() {
        let whole = r#"{"bench":"b","case":"c","metric":"m","value":1.5,"unit":"ns","peer":null}"#;
        let partial = r#"{"bench":"b","case":"c"}"#;
        assert_eq!(figures(&format!("signal_slot\n{whole}\n{partial}\n{whole}\n")), 2);
    }
}
