//! How a hub ends, also with a module that does not: the example `stubborn` as a process.

mod program;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use program::new_folder;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};

struct Stubborn {
    process: Child,
    lines: BufReader<ChildStdout>,
    folder: PathBuf,
}

impl Stubborn {
    fn start(how: &str) -> Stubborn {
        let folder = new_folder();
        // Cargo builds the examples beside the tests of their package.
        let own = std::env::current_exe().unwrap();
        let program = own.parent().unwrap().parent().unwrap().join("examples/stubborn");
        let mut process = Command::new(program)
            .arg(how)
            .arg(&folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap());
        let mut stubborn = Stubborn { process, lines, folder };
        stubborn.until("stubborn runs");
        stubborn
    }

    fn until(&mut self, wanted: &str) -> Vec<String> {
        let mut seen = Vec::new();
        loop {
            let mut line = String::new();
            assert_ne!(self.lines.read_line(&mut line).unwrap(), 0, "it ended before {wanted:?}: {seen:?}");
            seen.push(line.trim().to_owned());
            if line.contains(wanted) {
                return seen;
            }
        }
    }

    fn tell(&self, signal: Signal) {
        kill(Pid::from_raw(self.process.id().cast_signed()), signal).unwrap();
    }
}

impl Drop for Stubborn {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn a_module_on_a_thread_that_does_not_stop_is_left_behind_and_the_others_stop_after_it() {
    let mut hub = Stubborn::start("thread");
    let mut log = hub.process.stderr.take().unwrap();
    hub.tell(Signal::SIGTERM);
    let seen = hub.until("the hub has ended");
    assert_eq!(seen, ["stubborn does not stop", "docile stops", "the hub has ended"]);
    assert!(hub.process.wait().unwrap().success());
    let mut said = String::new();
    log.read_to_string(&mut said).unwrap();
    assert!(said.contains("modules/stubborn does not stop"), "{said}");
}

#[test]
fn a_module_on_the_hubs_loop_that_does_not_stop_holds_the_end_up_until_a_second_signal() {
    let mut hub = Stubborn::start("inline");
    hub.tell(Signal::SIGINT);
    hub.until("stubborn does not stop");
    hub.tell(Signal::SIGTERM);
    assert_eq!(hub.process.wait().unwrap().signal(), Some(Signal::SIGTERM as i32));
}

#[test]
fn a_second_signal_forces_the_end_while_a_thread_is_waited_for() {
    let mut hub = Stubborn::start("thread");
    hub.tell(Signal::SIGTERM);
    hub.until("stubborn does not stop");
    hub.tell(Signal::SIGINT);
    assert_eq!(hub.process.wait().unwrap().signal(), Some(Signal::SIGINT as i32));
}
