//! The project's own commands, run as `cargo xtask COMMAND`.
//!
//! `test` is the whole gate, the same on a contributor's machine and in continuous integration; `tidy` is
//! the part of it that checks the rules of this tree which no compiler knows; `sim` runs seeds of the network in
//! a box. `bench-peers` prepares what the benches are compared with, `bench-report` runs them and writes the page
//! on performance. `wheels` builds what pip installs. `schema` writes the JSON Schema of the hub's configuration.
#![forbid(unsafe_code)]

mod peers;
mod process;
mod report;
mod schema;
mod sim;
mod test;
mod tidy;
mod wheels;
mod workspace;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "The project's own commands")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Runs everything a change must pass: format, rules, lints, docs, tests, examples, fuzz targets, size.
    Test(test::Options),
    /// Checks the rules of this tree that no compiler knows.
    Tidy,
    /// Writes the JSON Schema of the hub's configuration anew.
    Schema,
    /// Runs seeds of the network in a box.
    Sim(sim::Options),
    /// Builds what pip installs: the hub, and the Python client.
    Wheels,
    /// Installs and builds what the benches are compared with.
    BenchPeers,
    /// Runs every bench and writes the page on performance.
    BenchReport(report::Options),
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::Test(options) => test::run(&options),
        Command::Schema => schema::run(),
        Command::Sim(options) => sim::run(&options),
        Command::BenchPeers => peers::run(),
        Command::BenchReport(options) => report::run(&options),
        Command::Wheels => wheels::run(),
        Command::Tidy => tidy::run().map(|summary| println!("tidy: {summary}")),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::FAILURE
        }
    }
}
