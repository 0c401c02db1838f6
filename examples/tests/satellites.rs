//! The example satellites, as processes, against a hub.

use sk_core::prelude::*;
use sk_core::world::OsSignal;
use sk_robot::Hub;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// Cargo builds the examples beside the tests of their package.
fn example(name: &str, state: &std::path::Path) -> Child {
    let own = std::env::current_exe().unwrap();
    let folder: PathBuf = own.parent().unwrap().parent().unwrap().join("examples");
    Command::new(folder.join(name))
        .env("SKROBOT_STATE_DIR", state)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn example_satellites_talk_through_the_hub() {
    let folder = std::env::temp_dir().join(format!("sk-examples-{}", std::process::id()));
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let hub = Hub::builder().state_dir(&folder).no_tcp().start(app.cx()).unwrap();
    let cx = app.cx();
    let remote = cx.remote(cx.event_loop());
    let at = folder.clone();
    let watch = std::thread::spawn(move || {
        // The subscriber first: it waits for a channel that does not exist yet.
        let mut subscriber = example("11_subscriber", &at);
        let mut publisher = example("10_publisher", &at);
        let lines = BufReader::new(subscriber.stdout.take().unwrap()).lines();
        let heard: Vec<String> = lines.take(5).map(Result::unwrap).collect();
        publisher.kill().unwrap();
        publisher.wait().unwrap();
        subscriber.kill().unwrap();
        subscriber.wait().unwrap();
        remote.post(|_, cx| cx.quit()).unwrap();
        heard
    });
    app.run();
    hub.stop(app.cx());
    app.pulse();
    let heard = watch.join().unwrap();
    assert!(heard.iter().all(|line| line.starts_with("robot.pendulum: ")), "{heard:?}");
    assert_ne!(heard[0], heard[4], "values change");
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn example_odometer_goes_on_after_a_kill() {
    let folder = std::env::temp_dir().join(format!("sk-odometer-{}", std::process::id()));
    let number =
        |line: &str, word: &str| line.strip_prefix(word).map(|number| number.parse::<i64>().unwrap());
    let mut saved = 0;
    for life in 0..3 {
        let mut odometer = example("16_odometer", &folder);
        let mut lines = BufReader::new(odometer.stdout.take().unwrap()).lines().map(Result::unwrap);
        let found = lines.find_map(|line| number(&line, "found ")).expect("it says what it found");
        assert!(found >= saved, "life {life}: {saved} were saved, {found} found");
        saved = lines
            .find_map(|line| number(&line, "saved ").filter(|saved| *saved >= found + 5))
            .unwrap();
        odometer.kill().unwrap();
        odometer.wait().unwrap();
    }
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn a_hub_in_a_program_of_ones_own_hears_the_operating_system_through_the_program() {
    // Embedding takes nothing from the program: its signals are its own.
    struct Own(u32);
    impl Own {
        fn hear(&mut self, cx: &mut Cx, _signal: OsSignal) {
            self.0 += 1;
            cx.quit();
        }
    }
    object! { Own { slots { hear(OsSignal) } } }
    let simulation = sk_core::testing::Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let hub = Hub::builder().state_dir("/state".as_ref()).no_tcp().start(cx).unwrap();
    let own = cx.spawn(Own(0));
    attach!(cx, cx.event_loop().os_signal => own.hear);
    app.pulse();
    simulation.raise(OsSignal::Terminate);
    app.run();
    assert_eq!(app.cx().with(own, |own, _| own.0), Ok(1));
    hub.stop(app.cx());
}
