//! How long a program takes to build: 100 objects, 300 links between them, in release.
//!
//! `cargo bench -p sk-benches --bench build_time -- [--json] [--runs N] [--smoke]`
//!
//! What is measured is the program itself, as after a change in it: the framework and everything below it
//! were built before and are not built again.
#![forbid(unsafe_code)]

mod program;

use clap::Parser;
use sk_benches::{Bench, BenchError, Options, Sheet, Side};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// How many classes of objects the program has, and how many links are made.
const OBJECTS: usize = 100;
const LINKS: usize = 300;

/// The build of a generated program.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    shared: Options,
}

fn main() -> Result<(), BenchError> {
    let arguments = Arguments::parse();
    let smoke = arguments.shared.smoke;
    Bench::new("build_time", &arguments.shared)
        // The first time every dependency is built too.
        .expected(Duration::from_secs(200))
        .side(Side::ours(move |sheet| if smoke { only_generate(sheet) } else { measure(sheet) }))
        .run()?;
    Ok(())
}

/// Where the program is written and built, below cargo's target folder.
fn folder() -> Result<PathBuf, BenchError> {
    let peers = sk_benches::peers_folder();
    let target = peers.as_deref().and_then(Path::parent);
    let nowhere = || BenchError::Ours("this program does not lie in cargo's target folder".into());
    Ok(target.ok_or_else(nowhere)?.join("bench-build-time"))
}

/// For a smoke run: two objects, written and read by the compiler's parser alone, which takes milliseconds.
fn only_generate(sheet: &mut Sheet) -> Result<(), BenchError> {
    let folder = folder()?.join("smoke");
    program::write(&folder, 2, 3)?;
    let began = Instant::now();
    let mut format = Command::new("rustfmt");
    run(format
        .args(["--check", "--edition", "2024", "--config", "disable_all_formatting=true"])
        .arg(folder.join("src/main.rs")))?;
    sheet.figure("build/2x3", "seconds", "s", began.elapsed().as_secs_f64());
    Ok(())
}

fn measure(sheet: &mut Sheet) -> Result<(), BenchError> {
    let folder = folder()?;
    program::write(&folder, OBJECTS, LINKS)?;
    // The dependencies, and once the program.
    run(&mut build(&folder))?;
    program::touch(&folder)?;
    let began = Instant::now();
    run(&mut build(&folder))?;
    sheet.figure(&format!("build/{OBJECTS}x{LINKS}"), "seconds", "s", began.elapsed().as_secs_f64());
    Ok(())
}

fn build(folder: &Path) -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .args(["build", "--quiet", "--release", "--manifest-path"])
        .arg(folder.join("Cargo.toml"));
    cargo.arg("--target-dir").arg(folder.join("target"));
    cargo
}

fn run(command: &mut Command) -> Result<(), BenchError> {
    let status = command.stdout(std::process::Stdio::null()).status()?;
    if status.success() {
        return Ok(());
    }
    Err(BenchError::Ours(format!(
        "{} ended with {status}",
        command.get_program().to_string_lossy()
    )))
}
