//! The programs the steps need. What is missing is installed by root; anybody else is told the line to run.

use super::{Gate, fuzz};
use crate::process::{self, Failure};
use std::process::Command;

/// The release of cargo-fuzz the targets were last run with.
const CARGO_FUZZ_VERSION: &str = "0.13.2";
/// The release of cargo-deny that reads our `deny.toml`. Compiling it takes 3 minutes on two cores.
const CARGO_DENY_VERSION: &str = "0.20.2";

/// The program that counts instructions for the bench of that name; it must be of the same release as the library
/// `gungraun` in the lock file.
const GUNGRAUN_RUNNER_VERSION: &str = "0.20.0";
const GUNGRAUN_RUNNER_PROBE: &[&str] =
    &["sh", "-c", "gungraun-runner --version | grep -qxF 'gungraun-runner 0.20.0'"];

/// A program the gate cannot do without.
struct Tool {
    name: &'static str,
    /// A command that succeeds when the program is there.
    probe: &'static [&'static str],
    /// The commands that install it, as a shell reads them.
    install: String,
}

impl Tool {
    fn new(name: &'static str, probe: &'static [&'static str], install: impl Into<String>) -> Self {
        Self { name, probe, install: install.into() }
    }

    fn is_there(&self) -> bool {
        let (program, arguments) = self.probe.split_first().expect("every tool has a probe");
        process::answers(Command::new(program).args(arguments))
    }
}

/// Installs what is missing and says so.
pub(super) fn install_missing(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let fuzzing = !fuzz::targets(&gate.workspace.root)?.is_empty();
    let tools = needed(gate.options.quick, fuzzing);
    let missing: Vec<&Tool> = tools.iter().filter(|tool| !tool.is_there()).collect();
    if !missing.is_empty() && !process::read(Command::new("id").arg("-u"))?.trim().eq("0") {
        return Err(Failure::Other(ask_for(&missing)));
    }
    for tool in &missing {
        println!("   {} is missing, installing it: {}", tool.name, tool.install);
        process::run(Command::new("sh").args(["-c", &tool.install]))?;
        if !tool.is_there() {
            let probe = tool.probe.join(" ");
            let sentence = format!("{} was installed, but `{probe}` still fails", tool.name);
            return Err(Failure::Other(sentence));
        }
    }
    let rustc = process::read(Command::new("rustc").arg("--version"))?;
    Ok(format!("{} there, {} of them new; {}", tools.len(), missing.len(), rustc.trim()))
}

fn needed(quick: bool, fuzzing: bool) -> Vec<Tool> {
    let apt = |packages| {
        format!("apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy {packages}")
    };
    let mut tools = vec![
        Tool::new("a C compiler", &["cc", "--version"], apt("gcc libc6-dev")),
        Tool::new("Python 3", &["python3", "--version"], apt("python3")),
        Tool::new("rustfmt", &["cargo", "fmt", "--version"], "rustup component add rustfmt"),
        Tool::new("clippy", &["cargo", "clippy", "--version"], "rustup component add clippy"),
    ];
    if !quick {
        let install = format!("cargo install --locked cargo-deny --version {CARGO_DENY_VERSION}");
        tools.push(Tool::new("cargo-deny", &["cargo", "deny", "--version"], install));
        tools.push(Tool::new("valgrind", &["valgrind", "--version"], apt("valgrind")));
        let install = format!("cargo install --locked gungraun-runner --version {GUNGRAUN_RUNNER_VERSION}");
        tools.push(Tool::new("gungraun-runner", GUNGRAUN_RUNNER_PROBE, install));
    }
    if fuzzing && !quick {
        let install = format!("cargo install --locked cargo-fuzz --version {CARGO_FUZZ_VERSION}");
        // libFuzzer itself is C++ and is compiled into every target.
        tools.push(Tool::new("a C++ compiler", &["c++", "--version"], apt("g++")));
        tools.push(Tool::new("cargo-fuzz", &["cargo", "fuzz", "--version"], install));
    }
    tools
}

fn ask_for(missing: &[&Tool]) -> String {
    let names: Vec<_> = missing.iter().map(|tool| tool.name).collect();
    let lines: Vec<_> = missing.iter().map(|tool| format!("    {}", tool.install)).collect();
    let (names, lines) = (names.join(", "), lines.join("\n"));
    format!("missing: {names}. Only root installs by itself; please run\n{lines}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_tool_is_asked_for_with_the_line_to_run() {
        let tool = Tool::new("a lathe", &["no-such-program-anywhere"], "apt-get install lathe");
        assert!(!tool.is_there());
        let sentence = ask_for(&[&tool]);
        assert!(sentence.starts_with("missing: a lathe."), "{sentence}");
        assert!(sentence.ends_with("    apt-get install lathe"), "{sentence}");
    }

    #[test]
    fn what_is_slow_to_install_is_needed_only_for_the_steps_that_use_it() {
        let names = |quick, fuzzing| needed(quick, fuzzing).iter().map(|tool| tool.name).collect::<Vec<_>>();
        let all = names(false, true);
        assert!(all.contains(&"cargo-fuzz") && all.contains(&"cargo-deny"), "{all:?}");
        assert!(all.contains(&"valgrind") && all.contains(&"gungraun-runner"), "{all:?}");
        assert!(!names(false, false).contains(&"cargo-fuzz"));
        let quick = names(true, true);
        assert!(!quick.contains(&"cargo-fuzz") && !quick.contains(&"cargo-deny"), "{quick:?}");
        assert!(!quick.contains(&"valgrind"), "{quick:?}");
    }

    #[test]
    fn the_probe_asks_for_the_release_that_is_installed() {
        assert!(GUNGRAUN_RUNNER_PROBE[2].contains(&format!(" {GUNGRAUN_RUNNER_VERSION}'")));
    }

    #[test]
    fn a_tool_that_answers_is_there() {
        assert!(Tool::new("cargo", &["cargo", "--version"], "").is_there());
    }
}
