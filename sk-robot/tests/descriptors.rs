//! A hub that runs out of descriptors: the owner still comes in, nothing is lost, and it recovers by itself.

mod program;

use program::{Hub, new_folder, objects, success};
use std::io::{ErrorKind, Read};
use std::net::TcpStream;
use std::process::Command;

/// How many descriptors the hub may have.
const LIMIT: usize = 96;
/// What connections from the network leave free of it: a quarter, where it is so little.
const RESERVE: usize = 24;

/// A hub below that limit.
fn poor_hub() -> Hub {
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    // The shell sets the limit of the process that takes its place.
    let program = folder.join("poor-skrobot");
    let skrobot = env!("CARGO_BIN_EXE_skrobot");
    std::fs::write(&program, format!("#!/bin/sh\nulimit -n {LIMIT}\nexec {skrobot} \"$@\"\n")).unwrap();
    let mut shell = Command::new("/bin/sh");
    shell.env_remove("SKROBOT_CONFIG").env("XDG_CONFIG_HOME", folder.join("config"));
    shell.arg(&program).arg("--state-dir").arg(&folder);
    Hub::start_as(shell, folder, &["--tcp", "127.0.0.1:0", "--without", "host"])
}

/// Whether the hub took a connection in: then it says why it ends it.
fn was_taken_in(mut stream: TcpStream) -> bool {
    let mut said = Vec::new();
    match stream.read_to_end(&mut said) {
        Ok(_) => !said.is_empty(),
        Err(error) => {
            assert_eq!(error.kind(), ErrorKind::ConnectionReset, "{error}");
            false
        }
    }
}

#[test]
fn t4_who_runs_out_of_descriptors_lets_the_owner_in_and_recovers() {
    let hub = poor_hub();
    let at = hub.tcp();
    success(&hub.sk(&["db", "create", "kept", "--durable"]));
    let crowd: Vec<TcpStream> = (0..LIMIT + RESERVE).map(|_| TcpStream::connect(&at).unwrap()).collect();
    // The reserve is for the owner's programs, and for files.
    for number in 0..3 {
        success(&hub.sk(&["db", "set", "kept", "n", &number.to_string()]));
        let told = objects(&hub.sk(&["info", "--json"])).remove(0);
        assert!(told["connections"].as_u64() <= Some((LIMIT - RESERVE) as u64), "{told}");
    }
    let all = crowd.len();
    let taken_in = crowd.into_iter().map(was_taken_in).filter(|taken| *taken).count();
    assert!(0 < taken_in && taken_in < all, "{taken_in} of {all} came in");
    // All of them have gone or were turned away, and the network is open again.
    assert_eq!(success(&hub.sk(&["--hub", &format!("tcp:{at}"), "ls"])), "no channels\n");
    let (good, _, log) = hub.end();
    assert!(good);
    let told: Vec<&str> = log.lines().filter(|line| line.contains("cannot be taken in")).collect();
    assert_eq!(told.len(), 1, "{log}");
}
