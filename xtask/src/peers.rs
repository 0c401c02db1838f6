//! `cargo xtask bench-peers`: installs what the benches are compared with and builds the small programs on it.
//!
//! The programs go to `bench-peers` below cargo's target folder, where the benches look for them. Each is
//! tried once after it was built. A peer that cannot be built is told, and the others are built all the same.

use crate::process::{self, Failure};
use crate::workspace::Workspace;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The packages of Debian with the libraries and programs of the peers.
const DEBIAN: [&str; 6] =
    ["g++", "pkg-config", "qt6-base-dev", "libboost-dev", "libsigc++-2.0-dev", "rt-tests"];
/// Programs that come ready made, and with which of their options they answer.
const READY_MADE: [&[&str]; 2] = [&["cyclictest", "--help"], &["chrt", "--version"]];
/// Where Qt's meta-object compiler may be: Debian keeps it off the path.
const MOC: [&str; 3] = ["moc6", "/usr/lib/qt6/libexec/moc", "moc"];

/// A program in C++.
struct Peer {
    /// Its source without the ending, and its name.
    name: &'static str,
    /// The library as pkg-config knows it, if it knows it.
    library: Option<&'static str>,
    /// Whether a header of the same name is for Qt's meta-object compiler.
    has_qt_objects: bool,
    /// Arguments with which it ends within milliseconds.
    trial: &'static [&'static str],
}

const PEERS: [Peer; 6] = [
    Peer { name: "signal_slot_boost", library: None, has_qt_objects: false, trial: &["smoke"] },
    Peer {
        name: "signal_slot_sigcxx",
        library: Some("sigc++-2.0"),
        has_qt_objects: false,
        trial: &["smoke"],
    },
    Peer { name: "signal_slot_qt6", library: Some("Qt6Core"), has_qt_objects: true, trial: &["smoke"] },
    Peer { name: "objects_qt6", library: Some("Qt6Core"), has_qt_objects: true, trial: &["smoke", "flat"] },
    Peer { name: "loop_scale_qt6", library: Some("Qt6Core"), has_qt_objects: false, trial: &["smoke"] },
    Peer { name: "tick_qt6", library: Some("Qt6Core"), has_qt_objects: false, trial: &["c", "1000", "0.01"] },
];

/// The package of the peer on tokio, and with what it is tried.
const TOKIO: &str = "tokio_peer";
const TOKIO_TRIAL: [&str; 2] = ["signal_slot", "smoke"];

/// Installs, builds, tries.
pub(crate) fn run() -> Result<(), Failure> {
    let workspace = Workspace::load()?;
    let folder = workspace.target.join("bench-peers");
    std::fs::create_dir_all(&folder).map_err(|error| Failure::file(&folder, error))?;
    install()?;
    let sources = workspace.root.join("benches/peers");
    let mut failed = Vec::new();
    for peer in &PEERS {
        let built =
            build(peer, &sources, &folder).and_then(|()| try_out(&folder.join(peer.name), peer.trial));
        failed.extend(told(peer.name, built));
    }
    let built = build_tokio(&sources, &folder).and_then(|()| try_out(&folder.join(TOKIO), &TOKIO_TRIAL));
    failed.extend(told(TOKIO, built));
    for probe in READY_MADE {
        let there = process::answers(Command::new(probe[0]).args(&probe[1..]));
        println!("   {}: {}", probe[0], if there { "there" } else { "missing" });
        failed.extend((!there).then(|| probe[0].to_owned()));
    }
    match failed.is_empty() {
        true => Ok(()),
        false => Err(Failure::Other(format!("not every peer is there; missing: {}", failed.join(", ")))),
    }
}

fn told(name: &str, outcome: Result<(), Failure>) -> Option<String> {
    match outcome {
        Ok(()) => {
            println!("   {name}: built");
            None
        }
        Err(failure) => {
            println!("   {name}: {failure}");
            Some(name.to_owned())
        }
    }
}

/// Asks apt for what dpkg does not know as installed.
fn install() -> Result<(), Failure> {
    let is_installed = |package: &&&str| {
        let mut ask = Command::new("dpkg-query");
        let state = process::read(ask.args(["--show", "--showformat=${db:Status-Status}", package]));
        state.is_ok_and(|state| state == "installed")
    };
    let missing: Vec<&str> = DEBIAN.iter().filter(|package| !is_installed(package)).copied().collect();
    if missing.is_empty() {
        return Ok(());
    }
    let line = format!("apt-get install -qy --no-install-recommends {}", missing.join(" "));
    if process::read(Command::new("id").arg("-u"))?.trim() != "0" {
        return Err(Failure::Other(format!("only root installs by itself; please run\n    {line}")));
    }
    let line = format!("apt-get update -q && DEBIAN_FRONTEND=noninteractive {line}");
    process::run(Command::new("sh").args(["-c", &line]))
}

fn build(peer: &Peer, sources: &Path, folder: &Path) -> Result<(), Failure> {
    let mut compile = Command::new("g++");
    compile.args(["-O2", "-std=c++17", "-fPIC", "-Wall", "-Wextra", "-DQT_NO_KEYWORDS", "-pthread"]);
    compile
        .arg("-I")
        .arg(sources)
        .arg(sources.join(peer.name).with_extension("cpp"));
    if peer.has_qt_objects {
        compile.arg(meta_object(peer, sources, folder)?);
    }
    compile.arg("-o").arg(folder.join(peer.name));
    if let Some(library) = peer.library {
        let flags = process::read(Command::new("pkg-config").args(["--cflags", "--libs", library]))?;
        compile.args(flags.split_whitespace());
    }
    process::run(&mut compile)
}

/// Lets Qt's compiler write what makes signals of the header's objects.
fn meta_object(peer: &Peer, sources: &Path, folder: &Path) -> Result<PathBuf, Failure> {
    let moc = MOC.iter().find(|moc| process::answers(Command::new(moc).arg("--version")));
    let moc = moc.ok_or_else(|| Failure::Other("Qt's meta-object compiler `moc` was not found".into()))?;
    let written = folder.join(format!("{}_moc.cpp", peer.name));
    let header = sources.join(peer.name).with_extension("hpp");
    process::run(Command::new(moc).arg(header).arg("-o").arg(&written))?;
    Ok(written)
}

fn build_tokio(sources: &Path, folder: &Path) -> Result<(), Failure> {
    let target = folder.join("cargo");
    let mut build = process::cargo();
    build.args(["build", "--quiet", "--release", "--locked", "--manifest-path"]);
    build.arg(sources.join("tokio/Cargo.toml")).arg("--target-dir").arg(&target);
    process::run(&mut build)?;
    let (from, to) = (target.join("release").join(TOKIO), folder.join(TOKIO));
    std::fs::copy(&from, &to).map(drop).map_err(|error| Failure::file(&from, error))
}

/// Runs the program with the least work, and wants at least one figure from it.
fn try_out(program: &Path, arguments: &[&str]) -> Result<(), Failure> {
    let said = process::read(Command::new(program).args(arguments))?;
    if said.lines().any(|line| line.starts_with("figure\t")) {
        return Ok(());
    }
    Err(Failure::Other(format!("{} ran and told no figure", program.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_peer_has_its_source() {
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../benches/peers");
        for peer in &PEERS {
            assert!(sources.join(peer.name).with_extension("cpp").is_file(), "{}", peer.name);
            let header = sources.join(peer.name).with_extension("hpp");
            assert_eq!(header.is_file(), peer.has_qt_objects, "{}", peer.name);
        }
    }

    #[test]
    fn a_program_that_tells_no_figure_is_not_taken_for_a_peer() {
        assert!(try_out(Path::new("echo"), &["figure\ta\tb\tns\t1"]).is_ok());
        assert!(try_out(Path::new("echo"), &["hello"]).is_err());
    }
}
