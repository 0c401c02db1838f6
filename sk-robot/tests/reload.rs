//! A configuration that is read again: what changes, what does not, and what a mistake does.

mod program;

use nix::fcntl::OFlag;
use nix::pty::{grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::signal::Signal;
use program::{Hub, new_folder, text};
use sk_core::module::ModuleState;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_robot::config::Config;
use sk_robot::{Hub as Library, registry};
use std::path::{Path, PathBuf};

fn write(folder: &Path, text: &str) -> PathBuf {
    std::fs::create_dir_all(folder).unwrap();
    let file = folder.join("own.json");
    std::fs::write(&file, text).unwrap();
    file
}

#[test]
fn s169_sighup_changes_what_can_change_and_says_what_cannot() {
    let folder = new_folder();
    let file = write(&folder, r#"{"listen": {"tcp": []}}"#);
    let mut hub = Hub::start_in(folder.clone(), &["--config", file.to_str().unwrap()]);
    write(
        &folder,
        r#"{"account": "other", "listen": {"tcp": []}, "loop": {"interval_us": 20000},
            "modules": {"host": {"parameters": {"period_factor": 0.1}}}}"#,
    );
    hub.signal(Signal::SIGHUP);
    hub.logged("the loop keeps time anew");
    hub.logged("module host has taken its parameters over");
    let said = hub.logged("the configuration is taken over");
    assert!(said.contains("when the hub is started again: account"), "{said}");

    // A mistake changes nothing, and the hub runs on.
    write(&folder, "{\n  \"modules\": {\"host\": {\"parameters\": {\"period_factor\": 0}}}}");
    hub.signal(Signal::SIGHUP);
    hub.logged("the configuration stays as it is");
    let said = hub.logged("period_factor");
    assert!(said.contains("own.json:2:56: ") && said.contains("0.1..=60.0"), "{said}");

    // What the module itself refuses, it keeps.
    write(
        &folder,
        r#"{"listen": {"tcp": []}, "modules": {"host": {"parameters": {"senses": ["cpu"]}}}}"#,
    );
    hub.signal(Signal::SIGHUP);
    let said = hub.logged("module host keeps its parameters");
    assert!(said.contains("decided at start"), "{said}");
    assert!(text(&hub.sk(&["ls"]).stdout).contains("robot.host.memory"));
    assert!(hub.end().0);
}

#[test]
fn the_end_of_its_terminal_ends_a_hub_that_was_started_there() {
    // Closed in every process that is started: else the terminal would live on in the hub itself.
    let terminal = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_CLOEXEC).unwrap();
    grantpt(&terminal).unwrap();
    unlockpt(&terminal).unwrap();
    let slave = std::fs::File::open(ptsname_r(&terminal).unwrap()).unwrap();
    let mut hub = Hub::start_with(new_folder(), &["--tcp", "off"], |command| {
        command.stdin(slave);
    });
    hub.signal(Signal::SIGHUP);
    hub.logged("the configuration is taken over");
    drop(terminal);
    hub.signal(Signal::SIGHUP);
    hub.logged("ending");
    assert!(hub.end_by_itself());
}

#[test]
fn a_reload_reaches_modules_here_and_on_threads() {
    for thread in ["null", r#"{"mode": "coarse"}"#] {
        let simulation = Simulation::new(1);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let builder = registry::builtin(Library::builder()).no_tcp().state_dir("/state".as_ref());
        let classes = builder.classes();
        let read = |rest: &str| {
            let text = format!(
                r#"{{"listen": {{"tcp": []}}, "modules": {{"host": {{"thread": {thread}{rest}}}}}}}"#
            );
            Config::read(&text, &classes).unwrap()
        };
        let mut hub = builder.configure(&read("")).start(app.cx()).unwrap();
        let run = |app: &mut SkApp| simulation.run_for(app, Duration::from_millis(200));
        run(&mut app);
        let host = hub.module(app.cx(), "host").unwrap();
        assert_eq!(host.state(app.cx()), Ok(ModuleState::Running), "{thread}");

        let next = read(r#", "parameters": {"period_factor": 2}, "restart": {"tries": 0}"#);
        assert_eq!(hub.reconfigure(app.cx(), &next), Vec::<String>::new());
        run(&mut app);
        let factor = |app: &mut SkApp| host.parameters(app.cx()).unwrap().get("period_factor").cloned();
        assert_eq!(factor(&mut app), Some(2.0.into()));

        // What the module refuses leaves its parameters as they are, all of them.
        let refused = read(r#", "parameters": {"period_factor": 3, "senses": ["cpu"]}"#);
        hub.reconfigure(app.cx(), &refused);
        run(&mut app);
        assert_eq!(factor(&mut app), Some(2.0.into()));

        // It can be stopped and started, and begins with what it has been told.
        hub.reconfigure(app.cx(), &read(r#", "enabled": false, "parameters": {"period_factor": 4}"#));
        run(&mut app);
        assert_eq!(host.state(app.cx()), Ok(ModuleState::Stopped), "{thread}");
        hub.reconfigure(app.cx(), &read(r#", "parameters": {"period_factor": 4}"#));
        run(&mut app);
        assert_eq!(host.state(app.cx()), Ok(ModuleState::Running), "{thread}");
        assert_eq!(factor(&mut app), Some(4.0.into()));

        // A thread is for its whole life.
        let other = Config::read(
            r#"{"listen": {"tcp": []}, "modules": {"host": {"thread": {"mode": "realtime"}, "parameters": {"period_factor": 4}}}}"#,
            &classes,
        );
        assert_eq!(hub.reconfigure(app.cx(), &other.unwrap()), ["modules.host.thread"]);
        hub.stop(app.cx());
        run(&mut app);
    }
}
