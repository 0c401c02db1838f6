//! The hub under a service manager: what it tells, and the unit files that go with it.

mod program;

use nix::sys::signal::Signal;
use program::{Hub, new_folder, skrobot, text};
use std::ffi::OsString;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::Path;
use std::time::Duration;

/// A manager that does not hear anything for so long fails the test instead of hanging.
const PATIENCE: Duration = Duration::from_secs(30);

fn manager_at(path: &Path) -> UnixDatagram {
    let manager = UnixDatagram::bind(path).unwrap();
    manager.set_read_timeout(Some(PATIENCE)).unwrap();
    manager
}

fn heard(manager: &UnixDatagram) -> String {
    let mut line = [0; 256];
    let length = manager.recv(&mut line).unwrap();
    text(&line[..length])
}

fn hub_below(address: OsString, options: &[&str], watchdog_us: Option<&str>) -> Hub {
    let mut all = vec!["--tcp", "off"];
    all.extend(options);
    Hub::start_with(new_folder(), &all, |command| {
        command
            .env("NOTIFY_SOCKET", address)
            .env_remove("WATCHDOG_PID")
            .env_remove("WATCHDOG_USEC");
        if let Some(us) = watchdog_us {
            command.env("WATCHDOG_USEC", us);
        }
    })
}

#[test]
fn the_manager_hears_that_the_hub_serves_lives_and_ends() {
    let path = new_folder().with_extension("notify");
    let manager = manager_at(&path);
    for options in [&[][..], &["--supervise"]] {
        let hub = hub_below(path.clone().into(), options, Some("20000"));
        assert!(heard(&manager).starts_with("READY=1\n"));
        assert!(hub.sk(&["ls"]).status.success(), "who is ready answers");
        assert_eq!(heard(&manager), "WATCHDOG=1");
        assert_eq!(heard(&manager), "WATCHDOG=1");
        hub.signal(Signal::SIGTERM);
        while !heard(&manager).starts_with("STOPPING=1\n") {}
        assert!(hub.end_by_itself());
        // Signs of life that crossed with the end.
        manager.set_nonblocking(true).unwrap();
        while manager.recv(&mut [0; 256]).is_ok() {}
        manager.set_nonblocking(false).unwrap();
    }
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn no_signs_of_life_come_unasked_and_the_address_may_have_no_file() {
    let name = format!("skrobot-service-test-{}", std::process::id());
    let address = SocketAddr::from_abstract_name(&name).unwrap();
    let manager = UnixDatagram::bind_addr(&address).unwrap();
    manager.set_read_timeout(Some(PATIENCE)).unwrap();
    let hub = hub_below(format!("@{name}").into(), &[], None);
    assert!(heard(&manager).starts_with("READY=1\n"));
    hub.signal(Signal::SIGTERM);
    assert!(heard(&manager).starts_with("STOPPING=1\n"), "nothing came between");
    assert!(hub.end_by_itself());
}

#[test]
fn a_manager_that_is_gone_does_not_keep_the_hub_from_serving() {
    let mut hub = hub_below("/nowhere/notify".into(), &[], None);
    hub.logged("the service manager was not told");
    assert!(hub.sk(&["ls"]).status.success());
}

/// `key=value` lines of a unit file.
fn unit(name: &str) -> Vec<(String, String)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../packaging").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .filter_map(|line| line.split_once('='))
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .collect()
}

#[test]
fn the_unit_files_say_what_the_program_does() {
    for name in ["skrobot.service", "skrobot-user.service"] {
        let unit = unit(name);
        let values = |key: &str| -> Vec<&str> {
            unit.iter()
                .filter(|(name, _)| name == key)
                .map(|(_, value)| value.as_str())
                .collect()
        };
        assert_eq!(values("Type"), ["notify"], "{name}");
        assert_eq!(values("Restart"), ["on-failure"], "{name}");
        assert_eq!(values("WatchdogSec").len(), 1, "{name}: the hub sends signs of life");
        assert_eq!(values("ExecReload"), ["/bin/kill -HUP $MAINPID"], "{name}");
        // What a new start does not help is not started again.
        let codes = [sk_robot::supervise::EXIT_REFUSED, sk_robot::supervise::EXIT_MISTOLD];
        assert_eq!(values("RestartPreventExitStatus"), [format!("{} {}", codes[0], codes[1])], "{name}");
        // The command line and the environment are ones the program takes.
        let start = values("ExecStart")[0];
        let mut words = start.split_whitespace();
        assert!(words.next().unwrap().ends_with("/skrobot"), "{name}: {start}");
        let folder = new_folder();
        let mut command = skrobot(&folder);
        for variable in values("Environment") {
            let (variable, value) = variable.split_once('=').unwrap();
            command.env(variable, value.replace("%S", folder.to_str().unwrap()).replace("%E", "/nowhere"));
        }
        let printed = command.args(words).arg("--print-config").output().unwrap();
        assert!(printed.status.success(), "{name}: {}", text(&printed.stderr));
    }
}
