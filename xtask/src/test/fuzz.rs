//! A short run of every fuzz target, starting from its seeds.
//!
//! What the fuzzer finds interesting is written below cargo's target folder and never into the seeds, so
//! that a run of the gate leaves the repository as it was. The long runs are another matter.

use super::Gate;
use crate::process::{self, Failure};
use std::fs;
use std::path::Path;

/// How long the fuzzer may work on one input before that counts as a failure.
const INPUT_LIMIT_S: u64 = 10;

/// The names of the fuzz targets, in order.
pub(super) fn targets(root: &Path) -> Result<Vec<String>, Failure> {
    let folder = root.join("fuzz/fuzz_targets");
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(&folder).map_err(|error| Failure::file(&folder, error))?;
    let mut names = Vec::new();
    for entry in entries {
        let path = entry.map_err(|error| Failure::file(&folder, error))?.path();
        if path.extension().is_some_and(|extension| extension == "rs") {
            names.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    names.sort();
    Ok(names)
}

/// Runs each target for the time asked for.
pub(super) fn short_runs(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let seconds = gate.options.fuzz_seconds;
    if gate.options.quick {
        return Ok("left out by --quick".into());
    }
    let targets = targets(&gate.workspace.root)?;
    for target in &targets {
        let seeds = gate.workspace.root.join("fuzz/seeds").join(target);
        if fs::read_dir(&seeds).map_or(0, Iterator::count) == 0 {
            // From nothing the fuzzer takes hours to get past the first length field.
            let sentence =
                format!("the fuzz target {target} has no seeds; put valid inputs into fuzz/seeds/{target}/");
            return Err(Failure::Other(sentence));
        }
        let found = gate.scratch.join("fuzz").join(target);
        fs::create_dir_all(&found).map_err(|error| Failure::file(&found, error))?;
        let log = gate.scratch.join(format!("fuzz-{target}.log"));
        let mut command = process::cargo();
        command.current_dir(&gate.workspace.root).env("RUSTC_BOOTSTRAP", "1");
        // The trace of cargo-fuzz itself would push the input that failed out of sight.
        command.env("RUST_BACKTRACE", "0");
        command
            .args(["fuzz", "run", "-s", "none", target])
            .arg(&found)
            .arg(&seeds)
            .arg("--");
        command
            .arg(format!("-max_total_time={seconds}"))
            .arg(format!("-timeout={INPUT_LIMIT_S}"));
        let dictionary = gate.workspace.root.join(format!("fuzz/dictionaries/{target}.dict"));
        if dictionary.exists() {
            command.arg(format!("-dict={}", dictionary.display()));
        }
        process::run_logged(&mut command, &log, None)?;
        println!("   {target}: {}", last_word(&log));
    }
    gate.passed += targets.len();
    Ok(format!("{} targets, {seconds} s each", targets.len()))
}

/// The fuzzer's own closing line.
fn last_word(log: &Path) -> String {
    let text = fs::read(log).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    text.lines()
        .rfind(|line| line.starts_with("Done "))
        .unwrap_or("no count")
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_the_rust_files_of_the_folder() {
        let root = std::env::temp_dir().join(format!("xtask-fuzz-{}", std::process::id()));
        assert_eq!(targets(&root).unwrap(), Vec::<String>::new());
        fs::create_dir_all(root.join("fuzz/fuzz_targets")).unwrap();
        for name in ["variant_text.rs", "flow_frame.rs", "notes.md"] {
            fs::write(root.join("fuzz/fuzz_targets").join(name), "").unwrap();
        }
        assert_eq!(targets(&root).unwrap(), ["flow_frame", "variant_text"]);
        fs::remove_dir_all(root).unwrap();
    }
}
