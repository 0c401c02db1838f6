//! `sk` looks into a running hub: what it says of channels, flows, the hub, and of what is wrong.

mod program;

use nix::sys::signal::{Signal, kill};
use program::{Hub, Running, failure, lines, new_folder, objects, sk, success, text};

/// A hub without senses, one who publishes `beat` fifty times a second, and one who hears it.
struct Scene {
    hub: Hub,
    publisher: Running,
    hearer: Running,
}

fn scene() -> Scene {
    let hub = Hub::start_in(new_folder(), &["--tcp", "off", "--without", "host"]);
    let publisher = Running::start(&hub, &["pub", "beat", "{\"n\":1}", "--rate", "50"]);
    let mut hearer = Running::start(&hub, &["echo", "beat", "--wait"]);
    assert_eq!(hearer.line(), "{\"n\":1}");
    Scene { hub, publisher, hearer }
}

/// The flows that publish and hear `beat`.
fn flows(hub: &Hub) -> (String, String) {
    let listed = objects(&hub.sk(&["ls", "beat", "--json"]));
    assert_eq!(listed.len(), 1, "{listed:?}");
    let name = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    (name(&listed[0]["owner"]), name(&listed[0]["subscribers"][0]))
}

#[test]
fn ls_tells_kind_owner_and_who_hears() {
    let scene = scene();
    let hub = &scene.hub;
    let (publisher, hearer) = flows(hub);
    assert!(publisher.starts_with("robot.sk-") && hearer.starts_with("robot.sk-") && publisher != hearer);
    let width = publisher.len();
    let expected = [
        format!("CHANNEL     KIND    {:width$}  HEARD BY", "OWNER"),
        format!("robot.beat  stream  {publisher}  1"),
    ];
    assert_eq!(lines(&hub.sk(&["ls"])), expected);
    let all = lines(&hub.sk(&["ls", "--all"]));
    assert!(all.iter().any(|line| line.starts_with("robot.modules  service  hub")), "{all:?}");
    let object = &objects(&hub.sk(&["ls", "beat", "--json"]))[0];
    assert_eq!(object["kind"], "stream");
    assert_eq!(object["properties"]["format"], "variant");
}

#[test]
fn graph_draws_who_publishes_to_whom_and_leaves_itself_out() {
    let scene = scene();
    let hub = &scene.hub;
    let (publisher, hearer) = flows(hub);
    let drawn = lines(&hub.sk(&["graph"]));
    let expected = [
        "hub".to_owned(),
        "  └─ robot.modules (service)".to_owned(),
        publisher.clone(),
        format!("  └─ robot.beat ──▶ {hearer}"),
    ];
    assert_eq!(drawn[..4], expected);
    // That of the module which is left out.
    assert_eq!(drawn[4], "robot.modules.host  (no channels)");
    assert_eq!(drawn.len(), 5);
    let dot = success(&hub.sk(&["graph", "--dot"]));
    assert!(dot.contains(&format!("\"{publisher}\" -> \"robot.beat\";")), "{dot}");
    assert!(dot.contains(&format!("\"robot.beat\" -> \"{hearer}\";")), "{dot}");
    let object = &objects(&hub.sk(&["graph", "--json"]))[0];
    assert!(
        object["channels"]
            .as_array()
            .unwrap()
            .iter()
            .any(|one| one["name"] == "robot.beat")
    );
}

#[test]
fn info_tells_of_the_hub_of_a_channel_and_of_a_flow() {
    let scene = scene();
    let hub = &scene.hub;
    let (publisher, hearer) = flows(hub);
    let told = success(&hub.sk(&["info"]));
    assert!(told.contains(concat!("version        ", env!("CARGO_PKG_VERSION"))), "{told}");
    assert!(told.contains("channels       2\n") && told.contains("subscriptions  1\n"), "{told}");
    assert_eq!(objects(&hub.sk(&["info", "--json"]))[0]["version"], env!("CARGO_PKG_VERSION"));

    let told = lines(&hub.sk(&["info", "beat"]));
    assert_eq!(
        told[..3],
        ["channel    robot.beat", "kind       stream", &format!("owner      {publisher}")]
    );
    assert!(told.contains(&"says       format: variant".to_owned()), "{told:?}");
    let heard = told.last().unwrap();
    assert!(
        heard.starts_with(&format!("{hearer}  latest 64")) && heard.contains("delivered"),
        "{heard}"
    );
    assert_eq!(objects(&hub.sk(&["info", "beat", "--json"]))[0]["subscribers"][0]["flow"], hearer);

    let told = success(&hub.sk(&["info", &hearer]));
    assert!(told.contains("owns        no channel\nhears       robot.beat\n"), "{told}");
    // What a satellite tells of its loop.
    assert!(told.contains("\npulse       every ") && told.contains(", in the mode "), "{told}");
    assert_eq!(objects(&hub.sk(&["info", &publisher, "--json"]))[0]["owns"][0], "robot.beat");
    let said = failure(&hub.sk(&["info", "baet"]), 1);
    assert_eq!(said, "sk: no channel or flow baet: did you mean robot.beat?\n");
}

#[test]
fn why_says_for_each_hop_whether_data_passes() {
    let scene = scene();
    let hub = &scene.hub;
    let (publisher, hearer) = flows(hub);
    let passes = lines(&hub.sk(&["why", "beat", &hearer]));
    assert_eq!(passes.len(), 2, "{passes:?}");
    assert!(
        passes[0].starts_with(&format!("ok    robot.beat: is published by {publisher}; ")),
        "{passes:?}"
    );
    assert!(passes[1].starts_with(&format!("ok    {hearer}: is subscribed; ")), "{passes:?}");

    let ends = hub.sk(&["why", "robot.beat", &publisher]);
    assert_eq!(failure(&ends, 1), format!("sk: data of robot.beat does not reach {publisher}\n"));
    let said = text(&ends.stdout);
    assert!(said.contains(&format!("ends  {publisher}: is not subscribed to robot.beat")), "{said}");

    let ends = hub.sk(&["why", "beat", "nobody"]);
    failure(&ends, 1);
    assert!(text(&ends.stdout).ends_with("ends  nobody: there is no such flow\n"));
    let ends = hub.sk(&["why", "nothing", &hearer]);
    assert_eq!(text(&ends.stdout), "ends  nothing: there is no such channel, and no such flow\n");
    let ends = hub.sk(&["why", "beat", "nobody", "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&ends.stdout).unwrap();
    assert_eq!(
        (report["passes"].as_bool(), report["hops"][1]["passes"].as_bool()),
        (Some(false), Some(false))
    );
}

#[test]
fn a_reader_that_goes_and_ctrl_c_end_an_echo_without_a_word() {
    let Scene { hub, mut hearer, publisher } = scene();
    // As `sk echo beat | head -1`.
    hearer.close_output();
    assert_eq!(hearer.end(), (Some(0), String::new()));
    let mut other = Running::start(&hub, &["echo", "beat"]);
    other.line();
    kill(other.pid(), Signal::SIGINT).unwrap();
    assert_eq!(other.end(), (Some(0), String::new()));
    kill(publisher.pid(), Signal::SIGINT).unwrap();
    assert_eq!(publisher.end(), (Some(0), String::new()));
}

#[test]
fn what_is_mistyped_is_answered_with_what_may_be_meant() {
    let scene = scene();
    let hub = &scene.hub;
    let said = failure(&hub.sk(&["echo", "baet"]), 1);
    assert_eq!(said, "sk: no channel baet: did you mean robot.beat? (--wait waits for it)\n");
    let said = failure(&hub.sk(&["hz", "robot.gripper"]), 1);
    assert_eq!(said, "sk: no channel robot.gripper: `sk ls --all` lists them\n");
    // Usage is another code than a refusal.
    let said = failure(&hub.sk(&["grahp"]), 2);
    assert!(said.contains("a similar subcommand exists: 'graph'"), "{said}");
    let said = failure(&hub.sk(&["pub", "x", "hello"]), 2);
    assert!(said.contains("this is no JSON") && said.contains("'\"text\"'"), "{said}");
    failure(&hub.sk(&["echo"]), 2);
}

#[test]
fn the_doctor_tells_what_is_well_and_what_to_do_about_the_rest() {
    let hub = Hub::start();
    let told = success(&hub.sk(&["doctor"]));
    let folder = format!("ok    state folder     {}, mode 700\n", hub.folder.display());
    assert!(told.contains(&folder), "{told}");
    assert!(
        told.contains("ok    hub              answers in ") && told.contains("host running\n"),
        "{told}"
    );
    for object in objects(&hub.sk(&["doctor", "--json"])) {
        let mark = object["mark"].as_str().unwrap();
        assert!(["ok", "warn"].contains(&mark), "{object}");
    }
    success(&hub.sk(&["module", "stop", "host"]));
    let told = success(&hub.sk(&["doctor"]));
    assert!(told.contains("warn  module           host is stopped\n"), "{told}");
    assert!(told.contains("→ `sk module start host`, if it should run"), "{told}");

    // Others may read the token, and then there is no hub.
    use std::os::unix::fs::PermissionsExt;
    let open = std::fs::Permissions::from_mode(0o644);
    std::fs::set_permissions(hub.folder.join("owner.token"), open).unwrap();
    let ill = hub.sk(&["doctor"]);
    assert_eq!(failure(&ill, 1), "sk: one check failed\n");
    assert!(
        text(&ill.stdout).contains("fail  owner's token    others may read"),
        "{}",
        text(&ill.stdout)
    );
    let nowhere = new_folder();
    let ill = sk(&nowhere, &["doctor"]);
    failure(&ill, 1);
    let told = text(&ill.stdout);
    assert!(told.contains("fail  hub ") && told.contains("→ start it: `skrobot`"), "{told}");
}

#[test]
fn completions_are_written_for_each_shell_without_a_hub() {
    let nowhere = new_folder();
    for (shell, word) in [("bash", "complete -F _sk"), ("zsh", "#compdef sk"), ("fish", "complete -c sk")] {
        let written = success(&sk(&nowhere, &["completions", shell]));
        assert!(written.contains(word) && written.contains("graph"), "{shell}");
    }
}

#[test]
fn the_flow_of_a_module_is_called_after_it_on_the_hubs_loop_and_on_a_thread() {
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    let config = folder.join("config.json");
    for thread in ["null", "{}"] {
        let module = format!("{{\"thread\": {thread}}}");
        std::fs::write(&config, format!("{{\"modules\": {{\"host\": {module}}}}}")).unwrap();
        let options = ["--tcp", "off", "--config", config.to_str().unwrap()];
        let hub = Hub::start_in(new_folder(), &options);
        Running::start(&hub, &["echo", "host.uptime", "--wait"]).line();
        let listed = objects(&hub.sk(&["ls", "host.uptime", "--json"]));
        assert_eq!(listed[0]["owner"], "robot.modules.host", "thread: {thread}");
        assert!(success(&hub.sk(&["info", "modules.host"])).contains("robot.host.uptime"));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
