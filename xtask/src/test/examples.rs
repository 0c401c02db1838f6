//! The programs in `examples/`: each is built, and run to its end within a time limit.
//!
//! An example that cannot run alone, for instance because it talks to a hub, says in its leading comment
//! which test runs it instead:
//!
//! ```text
//! //! xtask: run by `a_satellite_publishes_and_another_subscribes`
//! ```
//!
//! It is then only built here; `cargo xtask tidy` checks that a test of that name exists.

use super::Gate;
use crate::process::{self, Failure};
use std::fs;
use std::process::Command;
use std::time::Duration;

/// The package that holds the examples.
const PACKAGE: &str = "sk-examples";
/// How long an example may run.
const LIMIT_S: u64 = 30;
/// What begins the line that names the test.
const MARK: &str = "//! xtask: run by `";

/// The test that runs this example, if its leading comment names one.
pub(crate) fn run_by(source: &str) -> Option<&str> {
    let head = source.lines().take_while(|line| line.starts_with("//!"));
    head.filter_map(|line| line.strip_prefix(MARK))
        .find_map(|rest| rest.split('`').next())
}

/// Builds all examples and runs those that run alone.
pub(super) fn build_and_run(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let Some(package) = gate.workspace.member(PACKAGE) else {
        return Err(Failure::Other(format!("the workspace has no package {PACKAGE}")));
    };
    process::run(process::cargo().args(["build", "--quiet", "--package", PACKAGE, "--examples"]))?;
    let (mut run, mut left) = (0, 0);
    for example in package.targets.iter().filter(|target| target.kind == "example") {
        let file = gate.workspace.root.join(&example.file);
        let source = fs::read_to_string(&file).map_err(|error| Failure::file(&file, error))?;
        if let Some(test) = run_by(&source) {
            println!("   {}: built; the test {test} runs it", example.name);
            left += 1;
            continue;
        }
        // A folder of its own, so that an example that writes a file leaves nothing in the repository.
        let folder = gate.scratch.join("examples").join(&example.name);
        fs::create_dir_all(&folder).map_err(|error| Failure::file(&folder, error))?;
        let mut program = Command::new(gate.workspace.target.join("debug/examples").join(&example.name));
        let log = folder.join("output.log");
        let limit = Duration::from_secs(LIMIT_S);
        process::run_logged(program.current_dir(&folder), &log, Some(limit))?;
        println!("   {}: ran", example.name);
        run += 1;
    }
    gate.passed += run;
    Ok(format!("{run} ran, {left} built for a test that runs them"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_leading_comment_may_name_the_test_that_runs_the_example() {
        let marked = "//! Publishes.\n//! xtask: run by `satellites_talk`\nfn main() {}\n";
        assert_eq!(run_by(marked), Some("satellites_talk"));
        assert_eq!(run_by("//! Publishes.\nfn main() {}\n"), None);
        let too_late = "//! Publishes.\nfn main() {}\n//! xtask: run by `satellites_talk`\n";
        assert_eq!(run_by(too_late), None);
    }
}
