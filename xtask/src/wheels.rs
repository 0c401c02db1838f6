//! What pip installs: the Python client and the hub as wheels, and the client's source package.

use crate::process::{self, Failure};
use crate::workspace::Workspace;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The builders of the packages, each in the release that was last tried.
const BUILDERS: [&str; 3] = ["hatchling==1.27.0", "maturin==1.9.6", "wheel==0.45.1"];

/// Builds the wheels for a user, below the target folder.
pub(crate) fn run() -> Result<(), Failure> {
    let workspace = Workspace::load()?;
    let folder = workspace.target.join("wheels");
    for wheel in build(&workspace, &folder)?.wheels {
        println!("{}", wheel.display());
    }
    Ok(())
}

/// What was built.
pub(crate) struct Built {
    pub(crate) wheels: Vec<PathBuf>,
    pub(crate) sources: Vec<PathBuf>,
}

/// Builds everything into a folder that is made anew.
pub(crate) fn build(workspace: &Workspace, folder: &Path) -> Result<Built, Failure> {
    let bin = builders(&workspace.target)?;
    make_anew(folder)?;
    client(workspace, &bin, folder)?;
    process::run(
        Command::new(bin.join("maturin"))
            // Pips of old Pythons know of no newer kind of platform than plain Linux.
            .args(["build", "--quiet", "--release", "--compatibility", "linux", "--target-dir"])
            .arg(&workspace.target)
            .arg("--out")
            .arg(folder)
            .current_dir(workspace.root.join("python/hub")),
    )?;
    // Programs need no Python: maturin says Python 3, and a pip of Python 2.7 would not have them.
    for wheel in files_of(folder, "-py3-none-")? {
        let tag = ["tags", "--remove", "--python-tag", "py2.py3"];
        process::read(Command::new(bin.join("wheel")).args(tag).arg(wheel))?;
    }
    Ok(Built { wheels: files_of(folder, ".whl")?, sources: files_of(folder, ".tar.gz")? })
}

/// The client's source package, and its wheel out of that: so what it takes is in there.
fn client(workspace: &Workspace, bin: &Path, folder: &Path) -> Result<(), Failure> {
    let hatchling = |target: &str| {
        let mut command = Command::new(bin.join("hatchling"));
        command.args(["build", "-t", target, "-d"]).arg(folder);
        command
    };
    process::run(hatchling("sdist").current_dir(workspace.root.join("python/pysketch")))?;
    let unpacked = workspace.target.join("python-source");
    make_anew(&unpacked)?;
    std::fs::create_dir_all(&unpacked).map_err(|error| Failure::file(&unpacked, error))?;
    for package in files_of(folder, ".tar.gz")? {
        let strip = ["--strip-components", "1", "-xzf"];
        process::run(Command::new("tar").args(strip).arg(package).current_dir(&unpacked))?;
    }
    process::run(hatchling("wheel").current_dir(&unpacked))
}

/// The programs that build, in an environment of their own.
fn builders(target: &Path) -> Result<PathBuf, Failure> {
    let folder = target.join("python-builders");
    let bin = folder.join("bin");
    let are_there = process::answers(Command::new(bin.join("maturin")).arg("--version"))
        && process::answers(Command::new(bin.join("wheel")).arg("version"));
    if !are_there {
        environment(&folder)?;
        pip(&folder, &BUILDERS.map(PathBuf::from))?;
    }
    Ok(bin)
}

/// A fresh Python environment.
pub(crate) fn environment(folder: &Path) -> Result<(), Failure> {
    make_anew(folder)?;
    process::run(Command::new("python3").args(["-m", "venv"]).arg(folder))
}

/// Installs packages into an environment.
pub(crate) fn pip(environment: &Path, what: &[PathBuf]) -> Result<(), Failure> {
    let quiet = ["install", "--quiet", "--disable-pip-version-check"];
    process::run(Command::new(environment.join("bin/pip")).args(quiet).args(what))
}

fn make_anew(folder: &Path) -> Result<(), Failure> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(|error| Failure::file(folder, error))?;
    }
    Ok(())
}

/// The files of a folder with these words in their names, in order.
fn files_of(folder: &Path, words: &str) -> Result<Vec<PathBuf>, Failure> {
    let entries = std::fs::read_dir(folder).map_err(|error| Failure::file(folder, error))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.file_name().is_some_and(|name| name.to_string_lossy().contains(words)));
    files.sort();
    Ok(files)
}
