//! The configuration: what is checked, and what is said of it.

mod program;

use program::{Hub, new_folder, skrobot, text};
use sk_core::SkVariant;
use sk_core::module::ModuleClass;
use sk_robot::config::{Config, LoopMode, Problem};
use sk_robot::{Hub as Library, registry};
use std::path::{Path, PathBuf};
use std::process::Output;

fn classes() -> Vec<ModuleClass> {
    registry::builtin(Library::builder()).classes()
}

/// The problems of a text, as `line:column: what`.
fn problems(text: &str) -> Vec<String> {
    let refused = Config::read(text, &classes()).expect_err(text);
    refused.problems().iter().map(Problem::to_string).collect()
}

#[test]
fn what_is_not_said_has_its_default() {
    assert_eq!(Config::read("{}", &classes()).unwrap(), Config::new(&classes()));
    let some = r#"{ "$schema": "x", "account": "ship", "loop": { "interval_us": 500000 },
        "modules": { "host": { "thread": { "mode": "realtime" }, "parameters": { "period_factor": 2 } } } }"#;
    let config = Config::read(some, &classes()).unwrap();
    assert_eq!((config.hub.account.as_str(), config.listen.unix), ("ship", true));
    // A slow tick that was not asked for is never faster than the fast one.
    assert_eq!((config.event_loop.interval_us, config.event_loop.slow_interval_us), (500_000, 500_000));
    let host = &config.modules["host"];
    assert_eq!(host.thread.as_ref().unwrap().mode, LoopMode::Realtime);
    assert_eq!(host.parameters.get("period_factor"), Some(&2.0.into()));
    assert_eq!(host.parameters.get("pulse_period"), Some(&1.0.into()));
}

#[test]
fn what_is_shown_can_be_read_again_and_is_the_same() {
    let mut config = Config::new(&classes());
    config.modules.get_mut("host").unwrap().enabled = false;
    config.hub.state_dir = Some("/somewhere".to_owned());
    let shown = config.to_variant().to_json_pretty().unwrap();
    assert_eq!(Config::read(&shown, &classes()).unwrap(), config);
}

#[test]
fn an_unknown_key_is_an_error_at_its_place_with_the_nearest_known_one() {
    assert_eq!(problems("{\n  \"acount\": \"x\"\n}"), ["2:3: no key `acount`; did you mean `account`?"]);
    assert_eq!(problems(r#"{"listen": {"tpc": []}}"#), ["1:13: no key `tpc`; did you mean `tcp`?"]);
    assert_eq!(problems(r#"{"modules": {"hots": {}}}"#), ["1:14: no module `hots`; did you mean `host`?"]);
    assert_eq!(
        problems(r#"{"modules": {"host": {"enable": true}}}"#),
        ["1:23: no key `enable`; did you mean `enabled`?"]
    );
    assert_eq!(
        problems(r#"{"modules": {"host": {"parameters": {"period": 2}}}}"#),
        ["1:38: no key `period`; there are period_factor, pulse_period, senses"]
    );
    assert_eq!(
        problems(r#"{"xyzzy": 1}"#),
        ["1:2: no key `xyzzy`; there are account, state_dir, log, listen, loop, modules"]
    );
}

#[test]
fn a_value_that_cannot_be_is_an_error_at_its_place_that_says_what_can() {
    let cases = [
        (
            r#"{"loop": {"interval_us": 0}}"#,
            "1:26: parameter `interval_us` takes u64 in 50..=10000000 us, found 0",
        ),
        (
            r#"{"loop": {"mode": "fast"}}"#,
            "1:19: parameter `mode` takes LoopMode: no such case \"fast\"; the known ones are coarse, realtime, select-io",
        ),
        (
            r#"{"loop": {"interval_us": 2000, "slow_interval_us": 1000}}"#,
            "1:52: the slow interval is below the fast one, which is 2000 us",
        ),
        (r#"{"modules": []}"#, "1:13: an object is wanted here, found list"),
        (
            r#"{"modules": {"host": {"restart": {"tries": -1}}}}"#,
            "1:44: parameter `tries` takes u32: -1 does not fit u32",
        ),
        (
            r#"{"modules": {"host": {"parameters": {"period_factor": 100}}}}"#,
            "1:55: parameter `period_factor` takes f64 in 0.1..=60.0, found 100",
        ),
    ];
    for (text, problem) in cases {
        assert_eq!(problems(text), [problem]);
    }
    let address = problems(r#"{"listen": {"tcp": ["localhost:1"]}}"#);
    assert!(address[0].starts_with("1:20: ") && address[0].contains("numeric host"), "{address:?}");
    let account = problems(r#"{"account": "a.b"}"#);
    assert!(account[0].starts_with("1:13: the account cannot be: "), "{account:?}");
    let log = problems(r#"{"log": "a=loud"}"#);
    assert!(log[0].starts_with("1:9: the filter cannot be read: "), "{log:?}");
}

#[test]
fn all_problems_are_told_at_once_in_the_order_of_the_file() {
    let text = "{\n \"modules\": {\"host\": {\"enabled\": 1}},\n \"acount\": 1,\n \"log\": 5\n}";
    let found = problems(text);
    let lines: Vec<&str> = found.iter().map(|problem| problem.split(' ').next().unwrap()).collect();
    assert_eq!(lines, ["2:34:", "3:2:", "4:9:"], "{found:?}");
}

#[test]
fn text_that_is_no_json_or_says_a_thing_twice_is_refused_at_its_place() {
    assert!(problems("{\n \"log\": }")[0].starts_with("2:9: "), "{:?}", problems("{\n \"log\": }"));
    let twice = problems("{\"log\": \"info\",\n \"log\": \"warn\"}");
    assert!(twice[0].starts_with("2:"), "{twice:?}");
    assert!(problems("[]")[0].contains("an object is wanted here"));
    assert_eq!(problems("").len(), 1);
}

/// The schema in the tree is the one that follows from the declarations. With the environment variable
/// `SK_REWRITE` set, as `cargo xtask schema` does, it is written anew.
#[test]
fn the_published_schema_is_the_present_one() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/skrobot.schema.json");
    let made = sk_robot::config::schema(&classes()).to_json_pretty().unwrap() + "\n";
    if std::fs::read_to_string(&path).is_ok_and(|found| found == made) {
        return;
    }
    assert!(
        std::env::var_os("SK_REWRITE").is_some(),
        "docs/skrobot.schema.json is out of date: cargo xtask schema"
    );
    std::fs::write(path, made).unwrap();
}

/// Every key that is shown stands in the schema, with the same default, and nothing else does.
#[test]
fn the_schema_knows_exactly_what_can_be_said() {
    fn compare(path: &str, shown: &SkVariant, schema: &SkVariant) {
        let Some(properties) = schema.get("properties").and_then(SkVariant::as_map) else {
            assert_eq!(schema.get("default"), Some(shown), "{path}");
            return;
        };
        assert_eq!(schema.get("additionalProperties"), Some(&false.into()), "{path}");
        let shown = shown.as_map().unwrap();
        let names: Vec<&String> = properties.keys().filter(|name| *name != "$schema").collect();
        assert_eq!(names, shown.keys().collect::<Vec<_>>(), "{path}");
        for (name, value) in shown {
            compare(&format!("{path}.{name}"), value, &properties[name]);
        }
    }
    compare("", &Config::new(&classes()).to_variant(), &sk_robot::config::schema(&classes()));
}

/// What the guide shows as the whole of the defaults is that.
#[test]
fn the_guide_shows_all_defaults() {
    let page =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide/hub.md")).unwrap();
    let example = page
        .split("```json\n")
        .nth(1)
        .and_then(|rest| rest.split("```").next())
        .unwrap();
    let defaults = Config::new(&classes());
    assert_eq!(Config::read(example, &classes()).unwrap(), defaults);
    // Not only nothing else, but everything: leaving a key out would be reading it as its default, too.
    let mut shown = SkVariant::from_json(example).unwrap();
    shown.as_map_mut().unwrap().remove("$schema").unwrap();
    let as_json = |value: &SkVariant| value.to_json().unwrap();
    assert_eq!(as_json(&shown), as_json(&defaults.to_variant()));
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    std::fs::create_dir_all(folder).unwrap();
    let file = folder.join(name);
    std::fs::write(&file, text).unwrap();
    file
}

fn printed(folder: &Path, options: &[&str]) -> Output {
    skrobot(folder).args(options).arg("--print-config").output().unwrap()
}

#[test]
fn the_file_the_environment_and_the_command_line_go_one_before_the_other() {
    let folder = new_folder();
    let file = write(
        &folder,
        "own.json",
        r#"{"account": "file", "log": "warn", "listen": {"tcp": ["127.0.0.1:1"]}}"#,
    );
    let file = file.to_str().unwrap();
    let mut command = skrobot(&folder);
    command
        .env("SKROBOT_LOG", "error")
        .env("SKROBOT_CONFIG", file)
        .env("SKROBOT_ACCOUNT", "environment");
    let output = command.args(["--print-config", "--account", "typed"]).output().unwrap();
    let shown: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(shown["account"], "typed");
    assert_eq!(shown["log"], "error");
    assert_eq!(shown["listen"]["tcp"][0], "127.0.0.1:1");
    assert_eq!(
        shown["modules"]["host"]["parameters"]["period_factor"], 1.0,
        "also what nobody said is shown"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_users_own_file_is_found_and_need_not_be_there() {
    let folder = new_folder();
    let account = |folder: &Path| {
        let shown: serde_json::Value = serde_json::from_slice(&printed(folder, &[]).stdout).unwrap();
        shown["account"].clone()
    };
    assert_eq!(account(&folder), "robot");
    write(&folder.join("config/skrobot"), "skrobot.json", r#"{"account": "own"}"#);
    assert_eq!(account(&folder), "own");
    // One that is named must be there.
    let missing = printed(&folder, &["--config", "/nowhere/skrobot.json"]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(text(&missing.stderr).contains("/nowhere/skrobot.json"), "{}", text(&missing.stderr));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_hub_with_a_mistake_in_its_file_does_not_start_and_says_where_it_is() {
    let folder = new_folder();
    let file = write(&folder, "own.json", "{\n  \"modules\": { \"hots\": {} }\n}\n");
    let refused = skrobot(&folder).arg("--config").arg(&file).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    let wanted = format!("skrobot: {}:2:16: no module `hots`; did you mean `host`?\n", file.display());
    assert_eq!(text(&refused.stderr), wanted);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_module_on_a_thread_of_its_own_is_only_a_line_in_the_file() {
    let folder = new_folder();
    let file = write(
        &folder,
        "own.json",
        r#"{"listen": {"tcp": []}, "modules": {"host": {"thread": {"mode": "coarse", "interval_us": 5000}}}}"#,
    );
    let hub = Hub::start_in(folder, &["--config", file.to_str().unwrap()]);
    assert!(hub.greeting.join("\n").contains("robot.host.cpu"), "{:?}", hub.greeting);
    let echoed = hub.sk(&["echo", "host.uptime", "-n", "2"]);
    assert_eq!(text(&echoed.stdout).lines().count(), 2, "{}", text(&echoed.stderr));
    let (success, _, log) = hub.end();
    assert!(success, "{log}");
}

#[test]
fn a_state_folder_of_somebody_else_or_open_to_others_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = new_folder();
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o777)).unwrap();
    let start = |folder: &Path| {
        let refused = skrobot(folder).args(["--tcp", "off"]).output().unwrap();
        assert_eq!(refused.status.code(), Some(1));
        text(&refused.stderr)
    };
    let said = start(&folder);
    assert!(said.contains("777") && said.contains("chmod go-w"), "{said}");
    std::fs::remove_dir_all(&folder).unwrap();
    // The superuser gives a folder away; anybody else takes one of the superuser's.
    let said = if nix::unistd::geteuid().is_root() {
        std::fs::create_dir_all(&folder).unwrap();
        std::os::unix::fs::chown(&folder, Some(4242), None).unwrap();
        let said = start(&folder);
        std::fs::remove_dir_all(&folder).unwrap();
        said
    } else {
        start(Path::new("/usr"))
    };
    assert!(said.contains("belongs to user id") && said.contains("--state-dir"), "{said}");
}

#[test]
fn a_port_that_is_taken_is_told_with_what_chooses_another() {
    let hub = Hub::start();
    let folder = new_folder();
    let refused = skrobot(&folder).args(["--tcp", &hub.tcp()]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    let said = text(&refused.stderr);
    assert!(said.contains(&hub.tcp()) && said.contains("--tcp (`listen.tcp`)"), "{said}");
    std::fs::remove_dir_all(&folder).unwrap();
}
