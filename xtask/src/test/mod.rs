//! `cargo xtask test`: the whole gate, step by step, ending at the first failure.

mod benches;
pub(crate) mod examples;
mod features;
mod fuzz;
mod python;
mod sim;
mod size;
mod suites;
mod tools;

use crate::process::{self, Failure};
use crate::tidy;
use crate::workspace::Workspace;
use std::path::PathBuf;
use std::time::Instant;

/// How the gate is run.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Leave out the slow parts: the fuzz targets, the counting of instructions and the look at what we build on.
    #[arg(long)]
    quick: bool,
    /// How long each fuzz target runs.
    #[arg(long, default_value_t = 10, value_name = "SECONDS")]
    fuzz_seconds: u64,
    /// How long seeds of the network in a box are run.
    #[arg(long, default_value_t = 20, value_name = "SECONDS")]
    sim_seconds: u64,
}

/// What the steps share.
struct Gate<'a> {
    options: &'a Options,
    workspace: Workspace,
    /// A folder of our own below cargo's target folder, for logs and working folders.
    scratch: PathBuf,
    /// Tests, doc tests, examples, benches and fuzz targets that ran and passed so far.
    passed: usize,
}

/// One step: its name as announced, and what it does. It returns what is worth saying about its success.
type Step = (&'static str, fn(&mut Gate<'_>) -> Result<String, Failure>);

const STEPS: &[Step] = &[
    ("tools: what the steps need is installed", tools::install_missing),
    ("format: cargo fmt --all --check", format),
    ("tidy: the rules of this tree", check_rules),
    ("supply: licences and sources of what we build on", supply),
    ("clippy: no warning on any target", clippy),
    ("features: none and each alone build", features::build_alone),
    ("docs: every page builds without a warning", docs),
    ("tests: unit and integration tests", suites::unit_and_integration),
    ("doc tests: every example in the documentation", suites::documentation),
    ("examples: each is built and run", examples::build_and_run),
    ("benches: each runs once with the least work", benches::smoke_runs),
    ("sim: seeds of the network in a box", sim::short_run),
    (
        "python: the Python client on Python 3, 2.7 and, where there is one, 3.6",
        python::on_all_interpreters,
    ),
    ("instructions: the hot paths take no more than their limits", benches::count_instructions),
    ("fuzz: a short run of each target", fuzz::short_runs),
    ("release: the program is built and small enough", size::build_and_weigh),
    (
        "python packages: wheels and a source package are built, installed and tried",
        python::packages,
    ),
];

/// Runs the gate.
pub(crate) fn run(options: &Options) -> Result<(), Failure> {
    let started = Instant::now();
    let workspace = Workspace::load()?;
    let scratch = workspace.target.join("xtask");
    std::fs::create_dir_all(&scratch).map_err(|error| Failure::file(&scratch, error))?;
    // Cargo and rustup take the folder they are started in for what is meant.
    std::env::set_current_dir(&workspace.root).map_err(|error| Failure::file(&workspace.root, error))?;
    let mut gate = Gate { options, workspace, scratch, passed: 0 };
    let count = STEPS.len();
    for (index, (name, work)) in STEPS.iter().enumerate() {
        let number = index + 1;
        println!("== {number}/{count} {name}");
        let step_started = Instant::now();
        let said = work(&mut gate).map_err(|failure| {
            let step = name.split(':').next().unwrap_or(name);
            Failure::Other(format!("step {number} of {count} ({step}) failed: {failure}"))
        })?;
        println!("   {said} ({:.1} s)", step_started.elapsed().as_secs_f64());
    }
    let seconds = started.elapsed().as_secs();
    println!("gate passed: {count} steps, {} tests, {seconds} s", gate.passed);
    Ok(())
}

fn format(gate: &mut Gate<'_>) -> Result<String, Failure> {
    let remedy =
        |failure| Failure::Other(format!("{failure}; the same line without `--check` puts it right"));
    process::run(process::cargo().args(["fmt", "--all", "--check"])).map_err(remedy)?;
    // The fuzz targets are no part of the workspace, because their linking is the fuzzer's own.
    if gate.workspace.root.join("fuzz/Cargo.toml").exists() {
        let arguments = ["fmt", "--manifest-path", "fuzz/Cargo.toml", "--check"];
        process::run(process::cargo().args(arguments)).map_err(remedy)?;
    }
    Ok("formatted".into())
}

fn check_rules(gate: &mut Gate<'_>) -> Result<String, Failure> {
    tidy::check(&gate.workspace)
}

fn supply(gate: &mut Gate<'_>) -> Result<String, Failure> {
    if gate.options.quick {
        return Ok("left out by --quick".into());
    }
    // The fourth check, advisories, needs a database from the network and is left to the release.
    let arguments = ["deny", "--log-level", "error", "check", "bans", "licenses", "sources"];
    process::run(process::cargo().args(arguments))?;
    Ok("as deny.toml wants them".into())
}

fn clippy(_: &mut Gate<'_>) -> Result<String, Failure> {
    let arguments = ["clippy", "--quiet", "--workspace", "--all-targets", "--", "-D", "warnings"];
    process::run(process::cargo().args(arguments))?;
    Ok("no warning".into())
}

fn docs(_: &mut Gate<'_>) -> Result<String, Failure> {
    let arguments = ["doc", "--quiet", "--workspace", "--no-deps"];
    process::run(process::cargo().args(arguments).env("RUSTDOCFLAGS", "-Dwarnings"))?;
    Ok("built".into())
}
