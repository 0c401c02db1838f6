//! `sk module new`: what it writes is built, tested, and run in both ways.

mod program;

use program::{Hub, new_folder, sk, text};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A process that is ended with its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The workspace's own folder for what cargo builds: everything from elsewhere is there already.
fn target() -> PathBuf {
    let own = std::env::current_exe().unwrap();
    own.ancestors().nth(3).unwrap().to_owned()
}

fn cargo(folder: &Path, arguments: &[&str]) {
    let output = Command::new(env!("CARGO"))
        .current_dir(folder)
        .args(arguments)
        .args(["--offline", "--quiet"])
        .env("CARGO_TARGET_DIR", target())
        // As in the workspace, so that nothing is built twice.
        .env("CARGO_PROFILE_DEV_DEBUG", "line-tables-only")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}\n{}", text(&output.stdout), text(&output.stderr));
}

/// Removes what was built under a name that nothing else has. `cargo clean --package` would not do: it removes by
/// the names of targets too, and the skeleton has a test that is called as one of ours.
fn forget(name: &str) {
    let names = [name.to_owned(), name.replace('-', "_")];
    for below in ["debug", "debug/deps", "debug/incremental", "debug/.fingerprint"] {
        for entry in std::fs::read_dir(target().join(below)).into_iter().flatten().flatten() {
            let found = entry.file_name().to_string_lossy().trim_start_matches("lib").to_owned();
            if names.iter().any(|name| found.starts_with(name)) {
                // What cannot be removed only takes room.
                let _ = match entry.path().is_dir() {
                    true => std::fs::remove_dir_all(entry.path()),
                    false => std::fs::remove_file(entry.path()),
                };
            }
        }
    }
}

#[test]
fn the_skeleton_is_built_tested_and_run_in_a_hub_and_as_a_satellite() {
    let folder = new_folder();
    let name = format!("skeleton-{}", std::process::id());
    let made = sk(&folder, &["module", "new", &name, "--path", folder.to_str().unwrap()]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    // The versions that are here: a lock file of the same.
    let lock = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.lock");
    std::fs::copy(lock, folder.join("Cargo.lock")).unwrap();
    cargo(&folder, &["test"]);
    cargo(&folder, &["build"]);
    let program = target().join("debug").join(&name);
    let channel = format!("{name}.count");

    // A hub of its own.
    let state = folder.join("state");
    let own = Command::new(&program)
        .env("SKROBOT_STATE_DIR", &state)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut own = Running(own);
    // It says where it listens.
    let mut log = std::io::BufReader::new(own.0.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("listens on") {
        line.clear();
        assert_ne!(std::io::BufRead::read_line(&mut log, &mut line).unwrap(), 0, "the hub ended");
    }
    let echoed = sk(&state, &["echo", &channel, "-n", "2", "--wait"]);
    assert_eq!(text(&echoed.stdout).lines().count(), 2, "{}", text(&echoed.stderr));
    drop(own);

    // A satellite of another.
    let hub = Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host"]);
    let address = format!("unix:{}", hub.folder.join("hub.sock").display());
    let satellite = Running(Command::new(&program).arg(address).spawn().unwrap());
    let echoed = hub.sk(&["echo", &channel, "-n", "2", "--wait"]);
    assert_eq!(text(&echoed.stdout).lines().count(), 2, "{}", text(&echoed.stderr));
    drop(satellite);
    // Nothing of it stays in the shared folder.
    forget(&name);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_folder_that_is_not_empty_or_a_name_that_cannot_be_is_refused() {
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("mine"), "precious").unwrap();
    let path = folder.to_str().unwrap();
    let refused = sk(&folder, &["module", "new", "wheel", "--path", path]);
    assert!(!refused.status.success());
    assert!(text(&refused.stderr).contains("is not empty"), "{}", text(&refused.stderr));
    let refused = sk(&folder, &["module", "new", "Wheel", "--path", path]);
    assert!(text(&refused.stderr).contains("lower-case letters"), "{}", text(&refused.stderr));
    let refused = sk(&folder, &["module", "new", "wheel", "--path", "new", "--tree", path]);
    assert!(text(&refused.stderr).contains("sk-core"), "{}", text(&refused.stderr));
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "nothing was written");
    std::fs::remove_dir_all(&folder).unwrap();
}
