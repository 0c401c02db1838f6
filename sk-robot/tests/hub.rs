//! The hub and its tool as a user meets them: real processes, real sockets.

mod program;

use program::{Hub, new_folder, sk, text};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn the_hub_says_where_it_listens_what_pulses_and_what_to_type() {
    let hub = Hub::start();
    let greeting = hub.greeting.join("\n");
    assert!(greeting.contains("unix:") && greeting.contains("hub.sock"), "{greeting}");
    assert!(greeting.contains("tcp:127.0.0.1:"), "{greeting}");
    assert!(greeting.contains("robot.host.cpu") && greeting.contains("sk ls"), "{greeting}");
}

#[test]
fn sk_ls_lists_the_host_channels_with_units() {
    let hub = Hub::start();
    let listed = hub.sk(&["ls"]);
    assert!(listed.status.success(), "{}", text(&listed.stderr));
    let listed = text(&listed.stdout);
    let line = listed
        .lines()
        .find(|line| line.starts_with("robot.host.memory"))
        .expect(&listed);
    assert!(line.contains(" B "), "its unit is bytes: {line}");
    let json = text(&hub.sk(&["ls", "memory", "--json"]).stdout);
    let object: serde_json::Value = serde_json::from_str(json.trim()).unwrap();
    assert_eq!(object["name"], "robot.host.memory");
    assert_eq!(object["properties"]["units"]["total"], "B");
}

#[test]
fn sk_echo_shows_changing_values_over_both_transports() {
    let hub = Hub::start();
    let tcp = format!("tcp:{}", hub.tcp());
    for options in [&[][..], &["--hub", &tcp][..]] {
        let mut arguments = options.to_vec();
        arguments.extend(["echo", "host.uptime", "-n", "2"]);
        let echoed = hub.sk(&arguments);
        assert!(echoed.status.success(), "{}", text(&echoed.stderr));
        let values: Vec<f64> = text(&echoed.stdout)
            .lines()
            .map(|line| {
                serde_json::from_str::<serde_json::Value>(line).unwrap()["seconds"]
                    .as_f64()
                    .unwrap()
            })
            .collect();
        assert!(values.len() == 2 && values[0] < values[1], "{values:?}");
    }
}

#[test]
fn a_channel_that_does_not_exist_is_an_error_with_a_hint() {
    let hub = Hub::start();
    let echoed = hub.sk(&["echo", "host.cup"]);
    assert!(!echoed.status.success());
    assert!(text(&echoed.stderr).contains("did you mean robot.host.cpu?"), "{}", text(&echoed.stderr));
}

#[test]
fn without_a_hub_the_tool_says_what_to_do() {
    let folder = new_folder();
    let listed = sk(&folder, &["ls"]);
    assert!(!listed.status.success());
    assert!(text(&listed.stderr).contains("is skrobot running?"), "{}", text(&listed.stderr));
}

#[test]
fn garbage_is_cut_off_with_a_word_in_the_log_and_nobody_else_notices() {
    let hub = Hub::start();
    let echo = Command::new(env!("CARGO_BIN_EXE_sk"))
        .arg("--state-dir")
        .arg(&hub.folder)
        .args(["echo", "host.uptime", "-n", "3"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stranger = TcpStream::connect(hub.tcp()).unwrap();
    stranger.write_all(b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n").unwrap();
    // The hub greets nobody who does not greet it, so all that comes is the end.
    let mut answer = Vec::new();
    let ended = stranger.read_to_end(&mut answer);
    assert!(ended.is_err() || answer.is_empty(), "{answer:?}");
    assert_eq!(text(&echo.wait_with_output().unwrap().stdout).lines().count(), 3);
    let (_, _, log) = hub.end();
    assert!(log.contains("Killing spurious client"), "{log}");
}

#[test]
fn ctrl_c_ends_the_hub_cleanly_and_tells_its_satellites() {
    let hub = Hub::start();
    let mut echo = Command::new(env!("CARGO_BIN_EXE_sk"))
        .arg("--state-dir")
        .arg(&hub.folder)
        .args(["echo", "host.uptime"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = String::new();
    BufReader::new(echo.stdout.take().unwrap()).read_line(&mut first).unwrap();
    let socket = hub.folder.join("hub.sock");
    assert!(socket.exists());
    let (success, out, _) = hub.end();
    assert!(success && out.contains("skrobot has ended"), "{out}");
    assert!(!socket.exists(), "the socket's file is removed");
    let echo = echo.wait_with_output().unwrap();
    assert!(!echo.status.success());
    assert!(
        text(&echo.stderr).contains("the channel robot.host.uptime is gone"),
        "{}",
        text(&echo.stderr)
    );
}

#[test]
fn two_hubs_with_their_own_folders_run_side_by_side_and_one_folder_has_one_hub() {
    let (one, two) = (Hub::start(), Hub::start());
    assert!(one.sk(&["ls"]).status.success() && two.sk(&["ls"]).status.success());
    let third = Command::new(env!("CARGO_BIN_EXE_skrobot"))
        .arg("--state-dir")
        .arg(&one.folder)
        .args(["--tcp", "off"])
        .output()
        .unwrap();
    assert!(!third.status.success());
    let said = text(&third.stderr);
    assert!(said.contains("another hub runs there") && said.contains("--state-dir"), "{said}");
    assert!(one.sk(&["ls"]).status.success(), "the first hub goes on");
}

#[test]
fn the_owners_files_are_only_the_owners() {
    use std::os::unix::fs::PermissionsExt;
    let hub = Hub::start();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode(&hub.folder), 0o700);
    assert_eq!(mode(&hub.folder.join("owner.token")), 0o600);
    assert_eq!(mode(&hub.folder.join("hub.sock")), 0o600);
}

#[test]
fn a_token_that_others_could_read_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = new_folder();
    drop(Hub::start_in(folder.clone(), &["--tcp", "off"]));
    std::fs::create_dir_all(&folder).unwrap();
    let token = folder.join("owner.token");
    std::fs::write(&token, "00".repeat(32)).unwrap();
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o644)).unwrap();
    let refused = Command::new(env!("CARGO_BIN_EXE_skrobot"))
        .arg("--state-dir")
        .arg(&folder)
        .output()
        .unwrap();
    assert!(!refused.status.success());
    assert!(text(&refused.stderr).contains("644"), "{}", text(&refused.stderr));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_module_can_be_left_out_and_a_wrong_name_is_an_error() {
    let hub = Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host"]);
    assert_eq!(text(&hub.sk(&["ls"]).stdout).trim(), "no channels");
    let refused = Command::new(env!("CARGO_BIN_EXE_skrobot"))
        .args(["--without", "hots"])
        .output()
        .unwrap();
    assert!(text(&refused.stderr).contains("did you mean `host`?"), "{}", text(&refused.stderr));
}

#[test]
fn an_account_with_a_dot_is_refused() {
    let folder = new_folder();
    let refused = Command::new(env!("CARGO_BIN_EXE_skrobot"))
        .arg("--state-dir")
        .arg(&folder)
        .args(["--account", "a.b", "--tcp", "off"])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("a.b"), "{}", text(&refused.stderr));
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn a_hub_whose_output_nobody_reads_runs_on() {
    let folder = new_folder();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut process = Command::new(env!("CARGO_BIN_EXE_skrobot"))
        .arg("--state-dir")
        .arg(&folder)
        .args(["--tcp", "off"])
        .stdout(full)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It says so in its log, and serves.
    let mut log = BufReader::new(process.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("standard output") {
        line.clear();
        assert_ne!(log.read_line(&mut line).unwrap(), 0, "the hub ended");
    }
    assert!(sk(&folder, &["ls"]).status.success());
    process.kill().unwrap();
    process.wait().unwrap();
    let _ = std::fs::remove_dir_all(&folder);
}
