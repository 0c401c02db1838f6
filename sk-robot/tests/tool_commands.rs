//! `sk` commands: databases and modules of a running hub, by every kind of address.

mod program;

use nix::pty::openpty;
use nix::unistd::ttyname;
use program::{Hub, Running, failure, lines, new_folder, objects, skrobot, success, text};
use std::fs::File;
use std::os::fd::OwnedFd;

fn hub() -> Hub {
    Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host"])
}

#[test]
fn databases_are_made_changed_read_and_removed() {
    let hub = hub();
    assert_eq!(success(&hub.sk(&["db", "create", "arm", "--durable"])), "");
    assert_eq!(failure(&hub.sk(&["db", "create", "arm"]), 1), "sk: there is a database arm already\n");
    success(&hub.sk(&["db", "set", "arm", "gain.p", "1.5"]));
    success(&hub.sk(&["db", "set", "arm", "gain.limits", "[-1,1]"]));
    success(&hub.sk(&["db", "set", "arm", "name", "\"left\""]));
    assert_eq!(success(&hub.sk(&["db", "get", "arm", "gain.p"])), "1.5\n");
    assert_eq!(lines(&hub.sk(&["db", "keys", "arm", "gain."])), ["gain.limits", "gain.p"]);
    let all = ["gain.limits  [-1,1]", "gain.p  1.5", "name  \"left\""];
    assert_eq!(lines(&hub.sk(&["db", "all", "arm"])), all);
    let object = &objects(&hub.sk(&["db", "all", "arm", "name", "--json"]))[0];
    assert_eq!((&object["key"], &object["value"]), (&"name".into(), &"left".into()));
    assert_eq!(lines(&hub.sk(&["db", "watch", "arm", "-n", "3"])), all);
    let listed = lines(&hub.sk(&["db", "ls", "a"]));
    assert_eq!(listed[0], "DATABASE  KEPT     VARIABLES  SIZE");
    assert!(listed[1].starts_with("arm       durable  3          "), "{listed:?}");
    assert_eq!(objects(&hub.sk(&["db", "ls", "arm", "--json"]))[0]["variables"], 3);

    success(&hub.sk(&["db", "delete", "arm", "name"]));
    let said = failure(&hub.sk(&["db", "get", "arm", "gain.o"]), 1);
    assert_eq!(said, "sk: no variable gain.o: did you mean gain.p?\n");
    let said = failure(&hub.sk(&["db", "get", "amr", "gain.p"]), 1);
    assert_eq!(said, "sk: no database amr: did you mean arm?\n");
    failure(&hub.sk(&["db", "set", "arm", "name", "left"]), 2);
    success(&hub.sk(&["db", "remove", "arm"]));
    assert_eq!(
        failure(&hub.sk(&["db", "keys", "arm"]), 1),
        "sk: no database arm: `sk db ls` lists them\n"
    );
}

#[test]
fn what_was_not_saved_is_undone_by_a_load() {
    let hub = hub();
    success(&hub.sk(&["db", "create", "map"]));
    success(&hub.sk(&["db", "set", "map", "door", "\"open\""]));
    success(&hub.sk(&["db", "save", "map"]));
    success(&hub.sk(&["db", "set", "map", "door", "\"shut\""]));
    success(&hub.sk(&["db", "load", "map"]));
    assert_eq!(success(&hub.sk(&["db", "get", "map", "door"])), "\"open\"\n");
}

#[test]
fn a_watch_tells_what_others_change() {
    let hub = hub();
    success(&hub.sk(&["db", "create", "arm"]));
    success(&hub.sk(&["db", "set", "arm", "gain.p", "1"]));
    let mut watch = Running::start(&hub, &["db", "watch", "arm", "gain.", "-n", "3"]);
    assert_eq!(watch.line(), "gain.p  1");
    success(&hub.sk(&["db", "set", "arm", "other", "0"]));
    success(&hub.sk(&["db", "set", "arm", "gain.p", "2"]));
    success(&hub.sk(&["db", "delete", "arm", "gain.p"]));
    assert_eq!(watch.all(), "gain.p  2\ngain.p  (deleted)\n");
}

#[test]
fn a_durable_database_survives_a_hub_that_is_killed() {
    let folder = new_folder();
    let mut hub = Hub::start_in(folder.clone(), &["--tcp", "off", "--without", "host"]);
    success(&hub.sk(&["db", "create", "arm", "--durable"]));
    success(&hub.sk(&["db", "set", "arm", "gain", "1.5"]));
    hub.process.kill().unwrap();
    hub.process.wait().unwrap();
    let again = Hub::start_in(folder, &["--tcp", "off", "--without", "host"]);
    assert_eq!(success(&again.sk(&["db", "get", "arm", "gain"])), "1.5\n");
    // The folder is that of both: the second one cleans it away.
    std::mem::forget(hub);
}

#[test]
fn modules_are_listed_told_stopped_and_started() {
    let hub = Hub::start_in(new_folder(), &["--tcp", "off"]);
    let expected = ["MODULE  STATE    RUNS ON", "host    running  the hub's loop"];
    assert_eq!(lines(&hub.sk(&["module", "ls"])), expected);
    assert_eq!(
        success(&hub.sk(&["module", "set", "host", "period_factor", "0.5", "pulse_period", "2.0"])),
        ""
    );
    let told = lines(&hub.sk(&["module", "info", "host"]));
    assert_eq!(told[..2], ["module    host", "state     running"]);
    let parameter = told.iter().find(|line| line.starts_with("period_factor")).unwrap();
    assert!(
        parameter.starts_with("period_factor  0.5  f64 in 0.1..=60.0    1.0      Every period"),
        "{parameter}"
    );
    let object = &objects(&hub.sk(&["module", "info", "host", "--json"]))[0];
    assert_eq!(object["parameters"]["pulse_period"], 2.0);
    assert_eq!(success(&hub.sk(&["module", "stop", "host"])), "host is stopped\n");
    assert_eq!(objects(&hub.sk(&["module", "ls", "--json"]))[0]["state"], "stopped");
    assert_eq!(success(&hub.sk(&["module", "start", "host"])), "host is running\n");
    assert_eq!(success(&hub.sk(&["module", "restart", "host"])), "host is running\n");

    let said = failure(&hub.sk(&["module", "set", "host", "period_factor", "99.0"]), 1);
    assert!(said.contains("takes f64 in 0.1..=60.0, found 99"), "{said}");
    let said = failure(&hub.sk(&["module", "set", "host", "period_factor"]), 2);
    assert!(said.contains("PARAMETER"), "{said}");
    let said = failure(&hub.sk(&["module", "control", "host", "\"dance\""]), 1);
    assert!(said.contains("dance"), "{said}");
    let said = failure(&hub.sk(&["module", "stop", "hots"]), 1);
    assert_eq!(said, "sk: there is no module \"hots\"; did you mean `host`?\n");
    let said = failure(&hub.sk(&["call", "modules", "{\"do\":\"lst\"}"]), 1);
    assert!(said.contains("did you mean `list`?"), "{said}");
}

/// A hub that shows a certificate of its own, and the file of that certificate.
fn secured() -> (Hub, String, String) {
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_owned()]).unwrap();
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (certificate, key) = (path("hub.pem"), path("hub.key"));
    std::fs::write(&certificate, made.cert.pem()).unwrap();
    std::fs::write(&key, made.signing_key.serialize_pem()).unwrap();
    let mut options = vec!["--tcp", "off", "--without", "host", "--tls", &certificate, &key];
    for address in ["ws:127.0.0.1:0", "tls:127.0.0.1:0", "wss:127.0.0.1:0/robot"] {
        options.extend(["--listen", address]);
    }
    let hub = Hub::start_in(folder.clone(), &options);
    let shown = hub
        .greeting
        .iter()
        .find_map(|line| line.split_once("with the fingerprint "))
        .unwrap();
    let fingerprint = shown.1.to_owned();
    (hub, certificate, fingerprint)
}

#[test]
fn a_hub_is_reached_at_every_kind_of_address_by_who_knows_its_certificate() {
    let (hub, certificate, fingerprint) = secured();
    let address = |kind: &str| {
        let line = hub
            .greeting
            .iter()
            .find(|line| line.starts_with(&format!("listens on  {kind}:")))
            .unwrap();
        line.split_whitespace().nth(2).unwrap().to_owned()
    };
    let plain = address("ws");
    assert_eq!(success(&hub.sk(&["--hub", &plain, "ls"])), "no channels\n");
    for kind in ["tls", "wss"] {
        let address = address(kind);
        for trust in [["--tls-pin", fingerprint.as_str()], ["--tls-ca", certificate.as_str()]] {
            let listed = hub.sk(&["--hub", &address, trust[0], trust[1], "ls"]);
            assert_eq!(success(&listed), "no channels\n", "{address} {trust:?}");
        }
        let other = "0f".repeat(32);
        let said = failure(&hub.sk(&["--hub", &address, "--tls-pin", &other, "ls"]), 1);
        let why = "cannot be used: its certificate has another fingerprint than the one that is trusted";
        assert_eq!(said, format!("sk: the hub at {address} {why}\n"));
        let said = failure(&hub.sk(&["--hub", &address, "ls"]), 1);
        assert!(said.contains("--tls-ca") && said.contains("--tls-pin"), "{said}");
    }
    assert!(address("wss").ends_with("/robot"));
    let elsewhere = plain.replace("/flow", "/elsewhere");
    let said = failure(&hub.sk(&["--hub", &elsewhere, "ls"]), 1);
    assert!(said.contains("cannot be used: ") && said.contains("404 Not Found"), "{said}");
}

/// A WebSocket address is reached by a name that the hub does not answer to.
#[test]
fn t13_a_hub_that_does_not_answer_to_a_name_says_so_to_who_uses_it() {
    let hub = Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host", "--listen", "ws:0.0.0.0:0"]);
    let line = hub.greeting.iter().find_map(|line| line.split_once("ws:0.0.0.0:")).unwrap();
    let port = line.1.split('/').next().unwrap();
    let said = failure(&hub.sk(&["--hub", &format!("ws:127.0.0.2:{port}/flow"), "ls"]), 1);
    assert!(said.contains("cannot be used: ") && said.contains("421 Misdirected Request: "), "{said}");
    assert_eq!(success(&hub.sk(&["--hub", &format!("ws:127.0.0.1:{port}/flow"), "ls"])), "no channels\n");
}

#[test]
fn a_hub_without_a_certificate_does_not_listen_where_one_is_shown() {
    let folder = new_folder();
    let refused = skrobot(&folder)
        .args(["--tcp", "off", "--listen", "tls:127.0.0.1:0"])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("tls:127.0.0.1:0 needs a certificate: say --tls CERTIFICATE KEY"));
    let missing =
        ["--tcp", "off", "--listen", "tls:127.0.0.1:0", "--tls", "/nowhere/a.pem", "/nowhere/a.key"];
    let refused = skrobot(&folder).args(missing).output().unwrap();
    assert!(
        text(&refused.stderr).contains("`listen.tls_certificate`: /nowhere/a.pem: "),
        "{}",
        text(&refused.stderr)
    );
    let refused = skrobot(&folder).args(["--listen", "nowhere"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Two serial devices joined by a cable. It lasts to the end of the test's process.
fn cable() -> [String; 2] {
    let [one, other] = [(); 2].map(|()| openpty(None, None).unwrap());
    let names = [&one, &other].map(|pty| ttyname(&pty.slave).unwrap().to_str().unwrap().to_owned());
    let end = |master: &OwnedFd| File::from(master.try_clone().unwrap());
    for (from, to) in [(&one.master, &other.master), (&other.master, &one.master)] {
        let (mut from, mut to) = (end(from), end(to));
        std::thread::spawn(move || std::io::copy(&mut from, &mut to));
    }
    // A device that nobody has open would end the copying.
    std::mem::forget((one, other));
    names
}

#[test]
fn a_hub_is_reached_over_a_serial_line() {
    let [ours, theirs] = cable();
    let options = ["--tcp", "off", "--without", "host", "--listen", &format!("tty:{ours}")];
    let hub = Hub::start_in(new_folder(), &options);
    assert!(
        hub.greeting
            .iter()
            .any(|line| line.contains(&format!("tty:{ours}?baud=115200"))),
        "{:?}",
        hub.greeting
    );
    let address = format!("tty:{theirs}");
    let listed = hub.sk(&["--hub", &address, "ls"]);
    assert_eq!(success(&listed), "no channels\n");
    success(&hub.sk(&["--hub", &address, "db", "create", "line"]));
    success(&hub.sk(&["--hub", &address, "db", "set", "line", "x", "1"]));
    assert_eq!(success(&hub.sk(&["db", "get", "line", "x"])), "1\n");
}

#[test]
fn t17_a_hub_may_require_that_logins_over_tls_are_bound_and_the_tool_binds_its_own() {
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_owned()]).unwrap();
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (certificate, key, config) = (path("hub.pem"), path("hub.key"), path("config.json"));
    std::fs::write(&certificate, made.cert.pem()).unwrap();
    std::fs::write(&key, made.signing_key.serialize_pem()).unwrap();
    std::fs::write(&config, "{\"listen\": {\"require_channel_binding\": true}}").unwrap();
    let options = ["--config", &config, "--tcp", "off", "--without", "host", "--tls", &certificate, &key];
    let hub = Hub::start_in(folder, &[&options[..], &["--listen", "tls:127.0.0.1:0"]].concat());
    let line = hub.greeting.iter().find_map(|line| line.split_once("tls:127.0.0.1:")).unwrap();
    let at = format!("tls:127.0.0.1:{}", line.1.split_whitespace().next().unwrap());
    assert_eq!(success(&hub.sk(&["--hub", &at, "--tls-ca", &certificate, "ls"])), "no channels\n");
    let said = success(&hub.sk_with_input(&["user", "add", "ada"], "pencil\n"));
    assert!(said.contains("no rights yet"), "{said}");
    let listed =
        hub.sk_with_input(&["--hub", &at, "--tls-ca", &certificate, "--user", "ada", "ls"], "pencil\n");
    assert_eq!(text(&listed.stdout), "no channels\n", "{}", text(&listed.stderr));
}
