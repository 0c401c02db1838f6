//! `skrobot --supervise`: what is started again, and what is not.

mod program;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use program::{Hub, new_folder, skrobot, text};
use std::io::{BufRead, Read};
use std::os::unix::process::ExitStatusExt;

/// The hub below the supervisor: the process whose parent that is.
fn child_of(parent: u32) -> Pid {
    let processes = std::fs::read_dir("/proc").unwrap().filter_map(Result::ok);
    let mut pids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    let is_child = |pid: &i32| {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        // The name in parentheses may hold anything; the state and the parent follow it.
        let parent_field = stat
            .rsplit_once(')')
            .and_then(|(_, rest)| rest.split_whitespace().nth(1).map(str::to_owned));
        parent_field == Some(parent.to_string())
    };
    Pid::from_raw(pids.find(is_child).expect("the supervisor has a child"))
}

fn supervised() -> Hub {
    Hub::start_in(new_folder(), &["--tcp", "off", "--supervise"])
}

#[test]
fn a_hub_that_aborts_is_started_again_and_serves() {
    let mut hub = supervised();
    for times in 1..=2 {
        let first = child_of(hub.process.id());
        kill(first, Signal::SIGABRT).unwrap();
        let greeting = hub.greeted_again();
        assert_ne!(child_of(hub.process.id()), first);
        assert!(hub.sk(&["ls"]).status.success(), "it answers again");
        let log = hub.logged("has crashed");
        assert!(log.contains(&format!("start {times} ")), "{log} {greeting:?}");
    }
    let (success, out, _) = hub.end();
    assert!(
        success && out.contains("restarted   2 times") && out.contains("skrobot has ended"),
        "{out}"
    );
}

#[test]
fn a_hub_that_was_told_to_end_is_not_started_again_and_both_end_well() {
    let mut hub = supervised();
    hub.signal(Signal::SIGTERM);
    assert_eq!(hub.process.wait().unwrap().code(), Some(0));
    let mut rest = String::new();
    hub.lines.read_to_string(&mut rest).unwrap();
    assert_eq!(rest.matches("has ended").count(), 1, "{rest}");
    assert!(!rest.contains("is pulsing"));
}

#[test]
fn a_hub_that_ends_by_a_signal_of_its_own_ends_its_supervisor_with_its_code() {
    let mut hub = supervised();
    kill(child_of(hub.process.id()), Signal::SIGTERM).unwrap();
    assert_eq!(hub.process.wait().unwrap().code(), Some(0), "it ended cleanly");
}

#[test]
fn a_mistake_in_the_configuration_or_a_port_that_is_taken_is_no_crash() {
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("own.json");
    std::fs::write(&file, r#"{"acount": "x"}"#).unwrap();
    let mistold = skrobot(&folder).arg("--supervise").arg("--config").arg(&file).output().unwrap();
    assert_eq!(mistold.status.code(), Some(2));
    assert_eq!(text(&mistold.stderr).matches("did you mean").count(), 1, "it was tried once");
    let other = Hub::start();
    let refused = skrobot(&folder).args(["--supervise", "--tcp", &other.tcp()]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert_eq!(text(&refused.stderr).matches("is in use").count(), 1, "{}", text(&refused.stderr));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_configuration_is_read_again_below_a_supervisor_too() {
    let mut hub = supervised();
    hub.signal(Signal::SIGHUP);
    hub.logged("the configuration is taken over");
    assert!(hub.end().0);
}

#[test]
fn no_hub_is_left_behind_when_its_supervisor_is_killed() {
    let mut hub = supervised();
    hub.process.kill().unwrap();
    assert_eq!(hub.process.wait().unwrap().signal(), Some(Signal::SIGKILL as i32));
    // The hub has the other end of the pipe: it says its farewell and closes it.
    let mut rest = String::new();
    hub.lines.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("skrobot has ended"), "{rest}");
    assert_eq!(hub.lines.read_line(&mut rest).unwrap(), 0);
}
