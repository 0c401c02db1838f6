//! The Python client: its tests on Python 3 and on Python 2.7 against the hub of this tree, and what pip installs.

use super::Gate;
use crate::process::{self, Failure};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// The builders of the packages, each in the release that was last tried.
const BUILDERS: [&str; 2] = ["hatchling==1.27.0", "maturin==1.9.6"];
/// The tests of one interpreter take about twenty seconds; beyond this they hang.
const TESTS_LIMIT: Duration = Duration::from_secs(600);
/// Where Debian keeps a Python 2.7, and what of it is needed: the system stays as it is, the files are unpacked beside it.
const FETCH_PYTHON2: &str = r#"
set -e
mkdir -p lists/partial cache/archives/partial parts debs && : > status
mirror=$(grep -hE '^URIs:' /etc/apt/sources.list.d/*.sources 2>/dev/null | head -1 | sed 's/URIs: *//')
cat > parts/bullseye.sources <<END
Types: deb
URIs: ${mirror:-http://deb.debian.org/debian}
Suites: bullseye
Components: main
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg
END
cat > apt.conf <<END
Dir::Etc::sourcelist "/dev/null";
Dir::Etc::sourceparts "$PWD/parts";
Dir::State::lists "$PWD/lists";
Dir::State::status "$PWD/status";
Dir::Cache "$PWD/cache";
END
export APT_CONFIG=$PWD/apt.conf
apt-get update -q
cd debs
apt-get download -q python2.7-minimal libpython2.7-minimal python2.7 libpython2.7-stdlib libffi7 libssl1.1
for file in *.deb; do dpkg -x "$file" ../root; done
"#;

/// Runs the tests on both interpreters.
pub(super) fn on_both_interpreters(gate: &mut Gate<'_>) -> Result<String, Failure> {
    process::run(process::cargo().args(["build", "--quiet", "-p", "skrobot"]))?;
    let python2 = python2(&gate.workspace.target)?;
    let mut ran = Vec::new();
    for (name, python) in [("python3", Path::new("python3")), ("python2", &python2)] {
        let count = run_tests(gate, name, python, &python2)?;
        gate.passed += count;
        ran.push(format!("{count} on {name}"));
    }
    Ok(ran.join(", "))
}

fn run_tests(gate: &Gate<'_>, name: &str, python: &Path, python2: &Path) -> Result<usize, Failure> {
    let tests = gate.workspace.root.join("python/pysketch/tests");
    let log = gate.scratch.join(format!("tests-{name}.log"));
    let mut command = Command::new(python);
    command
        .args(["-m", "unittest", "discover", "-p", "test_*.py"])
        .current_dir(&tests)
        .env("PYTHONPATH", "../src")
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("PYTHON2", python2)
        .env("SKROBOT", gate.workspace.target.join("debug/skrobot"));
    process::run_logged(&mut command, &log, Some(TESTS_LIMIT))?;
    let said = std::fs::read_to_string(&log).map_err(|error| Failure::file(&log, error))?;
    count_of(&said)
        .ok_or_else(|| Failure::Other(format!("the tests on {name} did not say how many they are")))
}

/// How many tests `unittest` says it ran; none at all is no success.
fn count_of(said: &str) -> Option<usize> {
    let line = said.lines().rev().find(|line| line.starts_with("Ran "))?;
    line.split(' ').nth(1)?.parse().ok().filter(|count| *count > 0)
}

/// A Python 2.7 below the target folder, fetched when it is not there yet.
fn python2(target: &Path) -> Result<PathBuf, Failure> {
    let folder = target.join("python2.7");
    let program = folder.join("root/usr/bin/python2.7");
    if !process::answers(Command::new(&program).arg("--version")) {
        std::fs::create_dir_all(&folder).map_err(|error| Failure::file(&folder, error))?;
        process::run_logged(
            Command::new("sh").args(["-c", FETCH_PYTHON2]).current_dir(&folder),
            &folder.join("fetch.log"),
            None,
        )?;
    }
    Ok(program)
}

/// Builds the packages, installs them into a fresh environment and tries them there.
pub(super) fn packages(gate: &mut Gate<'_>) -> Result<String, Failure> {
    if gate.options.quick {
        return Ok("left out by --quick".into());
    }
    let (root, target) = (&gate.workspace.root, &gate.workspace.target);
    let builders = target.join("python-builders");
    let built = target.join("python-packages");
    let fresh = target.join("python-fresh");
    for folder in [&built, &fresh] {
        if folder.exists() {
            std::fs::remove_dir_all(folder).map_err(|error| Failure::file(folder, error))?;
        }
    }
    if !process::answers(Command::new(builders.join("bin/maturin")).arg("--version")) {
        environment(&builders)?;
        pip(&builders, &BUILDERS)?;
    }
    let bin = builders.join("bin");
    let sketch = root.join("python/pysketch");
    process::run(
        Command::new(bin.join("hatchling"))
            .args(["build", "-d"])
            .arg(&built)
            .current_dir(sketch),
    )?;
    let hub = root.join("python/hub");
    process::run(
        Command::new(bin.join("maturin"))
            .args(["build", "--quiet", "--release", "--target-dir"])
            .arg(target)
            .arg("--out")
            .arg(&built)
            .current_dir(hub),
    )?;
    environment(&fresh)?;
    let wheels = files_of(&built, ".whl")?;
    pip(&fresh, &wheels.iter().map(String::as_str).collect::<Vec<_>>())?;
    try_installed(gate, &fresh)?;
    let sources = files_of(&built, ".tar.gz")?.len();
    Ok(format!("{} wheels and {sources} source package, installed and tried", wheels.len()))
}

/// What a student has after `pip install`: a hub, its tool, and satellites.
fn try_installed(gate: &Gate<'_>, fresh: &Path) -> Result<(), Failure> {
    let tests = gate.workspace.root.join("python/pysketch/tests");
    let log = gate.scratch.join("tests-installed.log");
    let mut command = Command::new(fresh.join("bin/python"));
    command
        .args(["-m", "unittest", "test_program"])
        .current_dir(tests)
        .env_remove("PYTHONPATH")
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("PYSKETCH_INSTALLED", "1")
        .env("SKROBOT", fresh.join("bin/skrobot"));
    process::run_logged(&mut command, &log, Some(TESTS_LIMIT))?;
    process::run(Command::new(fresh.join("bin/sk")).arg("--version"))
}

fn environment(folder: &Path) -> Result<(), Failure> {
    process::run(Command::new("python3").args(["-m", "venv"]).arg(folder))
}

fn pip(folder: &Path, what: &[&str]) -> Result<(), Failure> {
    let quiet = ["install", "--quiet", "--disable-pip-version-check"];
    process::run(Command::new(folder.join("bin/pip")).args(quiet).args(what))
}

fn files_of(folder: &Path, ending: &str) -> Result<Vec<String>, Failure> {
    let entries = std::fs::read_dir(folder).map_err(|error| Failure::file(folder, error))?;
    let names = entries.flatten().map(|entry| entry.path().display().to_string());
    Ok(names.filter(|name| name.ends_with(ending)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_that_did_not_run_are_no_success() {
        assert_eq!(count_of("..\n-----\nRan 22 tests in 0.4s\n\nOK\n"), Some(22));
        assert_eq!(count_of("Ran 0 tests in 0.000s\n\nOK\n"), None);
        assert_eq!(count_of("ImportError: no module\n"), None);
    }
}
