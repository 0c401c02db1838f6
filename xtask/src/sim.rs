//! `cargo xtask sim`: seeds of the network in a box, on all cores.

use crate::process::{self, Failure};
use crate::workspace::Workspace;
use std::path::PathBuf;
use std::process::Command;
use std::thread;

/// The package and program of the simulation.
const PACKAGE: &str = "sk-sim";
/// The feature by which planted bugs come into being.
const PLANTED: &str = "planted-bugs";

/// What to run.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// How many seeds to run.
    #[arg(long, default_value_t = 1000)]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    from: u64,
    /// Run seeds until one fails.
    #[arg(long)]
    forever: bool,
    /// Run each seed twice and compare what happened.
    #[arg(long)]
    twice: bool,
    /// Go on after a failure.
    #[arg(long)]
    keep_going: bool,
    /// Print the script of this seed and run it with its log.
    #[arg(long, value_name = "NUMBER", conflicts_with = "replay")]
    seed: Option<u64>,
    /// Run the script in this file with its log.
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Look for this planted bug, or for `all` of them, and say which seed finds it.
    #[arg(long, value_name = "NAME")]
    planted: Option<String>,
    /// How many processes run side by side; one for each core unless given.
    #[arg(long)]
    jobs: Option<usize>,
}

/// Builds the program and runs what was asked for.
pub(crate) fn run(options: &Options) -> Result<(), Failure> {
    let workspace = Workspace::load()?;
    let mut command = program(&workspace, options.planted.is_some())?;
    let number = |name: &str, number: u64| [name.to_owned(), number.to_string()];
    if let Some(seed) = options.seed {
        command.arg("--show").args(number("--from", seed));
        return process::run(&mut command);
    }
    if let Some(file) = &options.replay {
        command.arg("--replay").arg(file);
        return process::run(&mut command);
    }
    command
        .args(number("--from", options.from))
        .args(number("--seeds", options.seeds));
    if let Some(name) = &options.planted {
        return process::run(command.arg("--planted").arg(name));
    }
    let switches =
        [("--forever", options.forever), ("--twice", options.twice), ("--keep-going", options.keep_going)];
    command.args(switches.iter().filter(|(_, on)| *on).map(|(name, _)| name));
    process::run(command.args(number("--jobs", options.jobs.unwrap_or_else(cores) as u64)))
}

/// How many processes can run side by side.
pub(crate) fn cores() -> usize {
    thread::available_parallelism().map_or(1, Into::into)
}

/// The program, built as it runs fastest; with planted bugs it stands in a folder of its own, so that the two do not
/// build each other anew.
pub(crate) fn program(workspace: &Workspace, planted: bool) -> Result<Command, Failure> {
    let target = if planted { workspace.target.join(PLANTED) } else { workspace.target.clone() };
    let mut build = process::cargo();
    build.args(["build", "--quiet", "--release", "--package", PACKAGE]);
    build.arg("--target-dir").arg(&target);
    if planted {
        build.args(["--features", PLANTED]);
    }
    process::run(build.current_dir(&workspace.root))?;
    Ok(Command::new(target.join("release").join(PACKAGE)))
}
