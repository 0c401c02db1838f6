//! The tests proper. Their output is let through, because its closing lines are what people and machines read.

use super::Gate;
use crate::process::{self, Failure};
use std::io::{IsTerminal, stdout};

/// Runs unit and integration tests, with cargo-nextest if it is there.
pub(super) fn unit_and_integration(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let with_nextest = process::answers(process::cargo().args(["nextest", "--version"]));
    let arguments: &[&str] = if with_nextest {
        &["nextest", "run", "--workspace", "--cargo-quiet"]
    } else {
        // Built first and quietly, so that what follows is the tests' own output.
        process::run(process::cargo().args(["test", "--quiet", "--workspace", "--all-targets", "--no-run"]))?;
        &["test", "--workspace", "--lib", "--bins", "--tests", "--no-fail-fast"]
    };
    run(gate, arguments)
}

/// Runs the examples in the documentation. cargo-nextest does not know them.
pub(super) fn documentation(gate: &mut Gate<'_>) -> Result<String, Failure> {
    run(gate, &["test", "--workspace", "--doc", "--no-fail-fast"])
}

fn run(gate: &mut Gate<'_>, arguments: &[&str]) -> Result<String, Failure> {
    let mut command = process::cargo();
    command.args(arguments);
    if stdout().is_terminal() {
        // The child writes to a pipe and would otherwise leave its colours out.
        command.env("CARGO_TERM_COLOR", "always");
    }
    let lines = process::run_and_listen(&mut command)?;
    let passed = passed(&lines);
    gate.passed += passed;
    Ok(format!("{passed} passed"))
}

/// Adds up the tests that the closing lines call passed: `test result: ok. 12 passed; …` of cargo's own
/// runner, `Summary [ 0.1s] 45 tests run: 45 passed, …` of nextest.
fn passed(lines: &[String]) -> usize {
    lines.iter().map(|line| passed_in(&without_colours(line)).unwrap_or(0)).sum()
}

fn passed_in(line: &str) -> Option<usize> {
    let line = line.trim_start();
    if !line.starts_with("test result:") && !line.starts_with("Summary [") {
        return None;
    }
    let before = line.split(" passed").next()?;
    before.rsplit(' ').next()?.parse().ok()
}

fn without_colours(line: &str) -> String {
    let mut plain = String::with_capacity(line.len());
    let mut characters = line.chars();
    while let Some(character) = characters.next() {
        if character == '\u{1b}' {
            // A colour is ESC, `[`, numbers and a final letter.
            let _ = characters.find(char::is_ascii_alphabetic);
        } else {
            plain.push(character);
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closing_lines_of_both_runners_are_added_up() {
        let lines = [
            "test result: ok. 12 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out".to_owned(),
            "\u{1b}[32;1m     Summary\u{1b}[0m [   0.087s] \u{1b}[1m3\u{1b}[0m tests run: \u{1b}[1m3\u{1b}[0m \u{1b}[32;1mpassed\u{1b}[0m, 0 skipped".to_owned(),
            "test the_hub::has_passed ... ok".to_owned(),
        ];
        assert_eq!(passed(&lines), 15);
    }
}
