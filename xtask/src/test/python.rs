//! The Python client: its tests on Python 3, 2.7 and, where there is one, 3.6 against the hub of this tree, and what pip
//! installs.

use super::Gate;
use crate::process::{self, Failure};
use crate::wheels;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// The tests of one interpreter take about half a minute; beyond this they hang.
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

/// Runs the tests on all interpreters.
pub(super) fn on_all_interpreters(gate: &mut Gate<'_>) -> Result<String, Failure> {
    process::run(process::cargo().args(["build", "--quiet", "-p", "skrobot"]))?;
    let python2 = python2(&gate.workspace.target)?;
    let oldest = oldest_python3();
    let mut ran = Vec::new();
    let both = [("python3", Path::new("python3")), ("python2.7", &python2)];
    for (name, python) in both.into_iter().chain(oldest.as_deref().map(|found| ("python3.6", found))) {
        let count = run_tests(gate, name, python, &python2)?;
        gate.passed += count;
        ran.push(format!("{count} on {name}"));
    }
    if oldest.is_none() {
        ran.push("there is no python3.6 here".to_owned());
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

/// The oldest Python 3 that the client supports, if this machine has one. No archive that is reached in the usual way
/// has it, so none is fetched.
fn oldest_python3() -> Option<PathBuf> {
    let root = std::env::var_os("PYENV_ROOT").map(PathBuf::from);
    let root = root.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".pyenv")));
    let versions = root.and_then(|root| std::fs::read_dir(root.join("versions")).ok());
    let versions = versions.into_iter().flatten().flatten();
    let built = versions.filter(|version| version.file_name().to_string_lossy().starts_with("3.6."));
    let built = built.map(|version| version.path().join("bin/python3.6"));
    std::iter::once(PathBuf::from("python3.6"))
        .chain(built)
        .find(|program| process::answers(Command::new(program).arg("--version")))
}

/// Builds the packages, installs them into a fresh environment and tries them there.
pub(super) fn packages(gate: &mut Gate<'_>) -> Result<String, Failure> {
    if gate.options.quick {
        return Ok("left out by --quick".into());
    }
    let target = &gate.workspace.target;
    let fresh = target.join("python-fresh");
    let built = wheels::build(&gate.workspace, &target.join("python-packages"))?;
    wheels::environment(&fresh)?;
    wheels::pip(&fresh, &built.wheels)?;
    try_installed(gate, &fresh)?;
    let (wheels, sources) = (built.wheels.len(), built.sources.len());
    Ok(format!("{wheels} wheels and {sources} source package, installed and tried"))
}

/// What a student has after `pip install`: a hub, its tool, and satellites.
fn try_installed(gate: &Gate<'_>, fresh: &Path) -> Result<(), Failure> {
    let tests = gate.workspace.root.join("python/pysketch/tests");
    let log = gate.scratch.join("tests-installed.log");
    let mut command = Command::new(fresh.join("bin/python"));
    command
        .args(["-m", "unittest", "test_program", "test_guide"])
        .current_dir(tests)
        .env_remove("PYTHONPATH")
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("PYSKETCH_INSTALLED", "1")
        .env("SKROBOT", fresh.join("bin/skrobot"));
    process::run_logged(&mut command, &log, Some(TESTS_LIMIT))?;
    process::run(Command::new(fresh.join("bin/sk")).arg("--version"))
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
