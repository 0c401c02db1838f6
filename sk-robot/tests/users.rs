//! Accounts of a real hub, as people make and use them.

mod program;

use nix::sys::signal::Signal;
use program::{Hub, new_folder, text};
use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn command(hub: &Hub, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sk"));
    command.arg("--state-dir").arg(&hub.folder).args(arguments);
    command.env_remove("SKROBOT_HUB").env_remove("SKROBOT_USER");
    command
}

/// Runs `sk` with these lines as its standard input.
fn sk_with(hub: &Hub, lines: &str, arguments: &[&str]) -> Output {
    let mut child = command(hub, arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // One that ends before it reads says why.
    let _ = child.stdin.take().unwrap().write_all(lines.as_bytes());
    child.wait_with_output().unwrap()
}

#[track_caller]
fn good(output: Output) -> String {
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

#[track_caller]
fn bad(output: Output) -> String {
    assert!(!output.status.success(), "{}", text(&output.stdout));
    text(&output.stderr)
}

/// As `ada`, over TCP.
fn as_ada(hub: &Hub, password: &str, arguments: &[&str]) -> Output {
    let address = format!("tcp:{}", hub.tcp());
    let mut all = vec!["--hub", &address, "--user", "ada"];
    all.extend(arguments);
    sk_with(hub, &format!("{password}\n"), &all)
}

#[test]
fn s89_s92_an_account_is_added_does_what_it_was_granted_and_no_more_and_is_removed() {
    let hub = Hub::start();
    let said = good(sk_with(&hub, "pencil\n", &["user", "add", "ada"]));
    assert!(said.contains("no rights yet"), "{said}");
    assert!(bad(sk_with(&hub, "x\n", &["user", "add", "ada"])).contains("sk user passwd ada"));
    assert_eq!(good(as_ada(&hub, "pencil", &["ls"])), "no channels\n");
    let refused = bad(as_ada(&hub, "pencils", &["ls"]));
    assert!(refused.contains("refused"), "{refused}");
    let nobody = format!("tcp:{}", hub.tcp());
    let unknown = bad(sk_with(&hub, "pencil\n", &["--hub", &nobody, "--user", "bob", "ls"]));
    assert_eq!(unknown, refused, "who there is shows nowhere");

    let said = good(hub.sk(&["user", "grant", "ada", "subscribe", "robot.host.u*"]));
    assert_eq!(said, "ada may subscribe: robot.host.u*\n");
    let listed = good(as_ada(&hub, "pencil", &["ls"]));
    assert!(listed.contains("robot.host.uptime") && !listed.contains("robot.host.cpu"), "{listed}");
    assert_eq!(
        good(as_ada(&hub, "pencil", &["echo", "-n", "1", "host.uptime"]))
            .lines()
            .count(),
        1
    );
    let listed = good(hub.sk(&["user", "rights", "ada"]));
    assert_eq!(listed, "subscribe       robot.host.u*\n");
    assert!(bad(as_ada(&hub, "pencil", &["user", "list"])).contains("no right"));
    let own = ["user", "grant", "ada", "administer", "*"];
    assert!(bad(as_ada(&hub, "pencil", &own)).contains("ada"), "not its own rights");

    good(as_ada(&hub, "pencil\neraser", &["user", "passwd", "ada"]));
    bad(as_ada(&hub, "pencil", &["ls"]));
    good(as_ada(&hub, "eraser", &["ls"]));
    assert_eq!(good(hub.sk(&["user", "revoke", "ada", "subscribe"])), "ada may subscribe nothing\n");
    assert_eq!(good(as_ada(&hub, "eraser", &["ls"])), "no channels\n");
    let listed = good(hub.sk(&["user", "list"]));
    assert_eq!(listed, "ACCOUNT  CONNECTIONS\nada      0\nrobot    2\n", "{listed}");
    good(hub.sk(&["user", "remove", "ada"]));
    bad(as_ada(&hub, "eraser", &["ls"]));
    assert!(bad(hub.sk(&["user", "remove", "ada"])).contains("no account"));
    let (ended_well, out, log) = hub.end();
    assert!(ended_well);
    for secret in ["pencil", "eraser"] {
        assert!(!out.contains(secret) && !log.contains(secret), "{log}");
    }
}

#[test]
fn a_killed_hub_forgets_no_account_and_no_right_that_it_acknowledged() {
    let mut hub = Hub::start();
    good(sk_with(&hub, "pencil\n", &["user", "add", "ada"]));
    good(hub.sk(&["user", "grant", "ada", "list", "robot.host.uptime"]));
    good(sk_with(&hub, "pencil\n", &["user", "add", "bob"]));
    good(hub.sk(&["user", "remove", "bob"]));
    hub.signal(Signal::SIGKILL);
    hub.process.wait().unwrap();
    let moved = std::mem::replace(&mut hub.folder, new_folder());
    drop(hub);
    let hub = Hub::start_in(moved, &["--tcp", "127.0.0.1:0"]);
    assert!(good(as_ada(&hub, "pencil", &["ls"])).contains("robot.host.uptime"));
    let listed = good(hub.sk(&["user", "list", "--json"]));
    assert_eq!(listed, "{\"connections\":0,\"name\":\"ada\"}\n{\"connections\":2,\"name\":\"robot\"}\n");
}

fn password_file(folder: &Path, mode: u32) -> PathBuf {
    let path = folder.join(format!("password-{mode:o}"));
    std::fs::write(&path, "pencil\n").unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
    path
}

#[test]
fn t19_a_password_file_is_read_if_nobody_else_can_read_it() {
    let hub = Hub::start();
    good(sk_with(&hub, "pencil\n", &["user", "add", "ada"]));
    for (mode, fits) in [(0o600, true), (0o400, true), (0o640, false), (0o604, false)] {
        let file = password_file(&hub.folder, mode);
        let arguments = ["--user", "ada", "--password-file", file.to_str().unwrap(), "ls"];
        let output = hub.sk(&arguments);
        assert_eq!(output.status.success(), fits, "{mode:o}: {}", text(&output.stderr));
        assert_eq!(text(&output.stderr).contains("chmod 600"), !fits);
    }
    // It says nothing without an account.
    let file = password_file(&hub.folder, 0o600);
    assert!(bad(hub.sk(&["--password-file", file.to_str().unwrap(), "ls"])).contains("--user"));
}

#[test]
fn a_typed_password_is_not_echoed() {
    let hub = Hub::start();
    let terminal = nix::pty::openpty(None, None).unwrap();
    let (mut ours, theirs) = (File::from(terminal.master), File::from(terminal.slave));
    let mut child = command(&hub, &["user", "add", "ada"])
        .stdin(theirs.try_clone().unwrap())
        .stdout(theirs.try_clone().unwrap())
        .stderr(theirs)
        .spawn()
        .unwrap();
    let mut shown = Vec::new();
    let mut read_to = |end: &str, ours: &mut File| {
        let mut byte = [0];
        let begin = shown.len();
        while !String::from_utf8_lossy(&shown[begin..]).contains(end) {
            assert_eq!(ours.read(&mut byte).unwrap(), 1, "{}", String::from_utf8_lossy(&shown));
            shown.push(byte[0]);
        }
    };
    for prompt in ["New password of ada: ", "Once more: "] {
        read_to(prompt, &mut ours);
        ours.write_all(b"pencil\n").unwrap();
    }
    read_to("no rights yet", &mut ours);
    assert!(child.wait().unwrap().success());
    assert!(!text(&shown).contains("pencil"), "{}", text(&shown));
    good(as_ada(&hub, "pencil", &["ls"]));
}

#[test]
fn s92_a_module_is_commanded_by_who_may_administer_it_and_by_nobody_else() {
    let hub = Hub::start();
    good(sk_with(&hub, "pencil\n", &["user", "add", "ada"]));
    let grant = |right: &str, pattern: &str| good(hub.sk(&["user", "grant", "ada", right, pattern]));
    let ask = |what: &str| {
        as_ada(
            &hub,
            "pencil",
            &["call", "robot.modules", &format!("{{\"do\":\"{what}\",\"module\":\"host\"}}")],
        )
    };
    grant("call", "robot.modules");
    for other in ["robot.modules", "robot.modules.other", "robot.host.*"] {
        grant("administer", other);
        for what in ["list", "info", "stop"] {
            let said = bad(ask(what));
            assert!(said.contains("the right to administer robot.modules."), "{other}: {said}");
        }
        good(hub.sk(&["user", "revoke", "ada", "administer"]));
    }
    grant("administer", "robot.modules.host");
    assert!(good(ask("list")).contains("\"name\":\"host\""));
    assert!(good(ask("stop")).contains("\"state\":\"stopped\""));
    assert!(good(ask("start")).contains("\"state\":\"running\""));
    assert!(bad(as_ada(&hub, "pencil", &["user", "list"])).contains("no right"), "of modules alone");
}
