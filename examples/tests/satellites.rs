//! The example satellites, as processes, against a hub.

use sk_core::prelude::*;
use sk_core::world::OsSignal;
use sk_robot::Hub;
use std::io::{BufRead, BufReader};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
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
    let heard = with_hub("pubsub", |at| {
        // The subscriber first: it waits for a channel that does not exist yet.
        let mut subscriber = example("11_subscriber", &at);
        let publisher = example("10_publisher", &at);
        let heard: Vec<String> = lines(&mut subscriber).take(5).collect();
        end(publisher);
        end(subscriber);
        heard
    });
    assert!(heard.iter().all(|line| line.starts_with("robot.pendulum: ")), "{heard:?}");
    assert_ne!(heard[0], heard[4], "values change");
}

/// Runs a hub and, on another thread, what `watch` does with its satellites.
fn with_hub<T: Send + 'static>(what: &str, watch: impl FnOnce(PathBuf) -> T + Send + 'static) -> T {
    let folder = std::env::temp_dir().join(format!("sk-examples-{what}-{}", std::process::id()));
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let hub = Hub::builder().state_dir(&folder).no_tcp().start(app.cx()).unwrap();
    let cx = app.cx();
    let remote = cx.remote(cx.event_loop());
    let at = folder.clone();
    let watch = std::thread::spawn(move || {
        // The hub ends also if what it was for has failed.
        let seen = catch_unwind(AssertUnwindSafe(|| watch(at)));
        remote.post(|_, cx| cx.quit()).unwrap();
        seen
    });
    app.run();
    hub.stop(app.cx());
    app.pulse();
    let seen = watch.join().unwrap();
    let _ = std::fs::remove_dir_all(&folder);
    seen.unwrap_or_else(|panic| resume_unwind(panic))
}

fn lines(child: &mut Child) -> impl Iterator<Item = String> + use<> {
    BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap)
}

fn end(mut child: Child) {
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn example_service_answers_its_caller() {
    let heard = with_hub("service", |at| {
        // The caller first: it waits for a service that does not exist yet.
        let mut caller = example("15_caller", &at);
        let service = example("14_service", &at);
        let heard: Vec<String> = lines(&mut caller).collect();
        assert!(caller.wait().unwrap().success());
        end(service);
        heard
    });
    assert_eq!(heard.last().map(String::as_str), Some("robot.gripper reached 0.04 m"), "{heard:?}");
    assert!(heard.len() >= 3 && heard[0].starts_with("robot.gripper at 0.01"), "{heard:?}");
}

#[test]
fn example_blob_store_keeps_a_map() {
    let heard = with_hub("blobs", |at| {
        // The second time the folder is there already, and the map is replaced.
        [(); 2].map(|()| {
            let mut mapper = example("19_blob_store", &at);
            let heard: Vec<String> = lines(&mut mapper).collect();
            assert!(mapper.wait().unwrap().success());
            heard
        })
    });
    for heard in heard {
        assert_eq!(heard.last().map(String::as_str), Some("here be dragons"), "{heard:?}");
        assert!(heard.iter().any(|line| line == "floors/1.txt is on the hub's disk"), "{heard:?}");
    }
}

#[test]
fn example_targets_follow_their_source() {
    let (followed, reported) = with_hub("sync", |at| {
        let mut source = example("16_sync_source", &at);
        let mut targets = [(); 2].map(|()| example("17_sync_target", &at));
        let mut outputs = targets.each_mut().map(lines);
        let followed = outputs
            .each_mut()
            .map(|lines| lines.skip_while(|line| line != "following").take(3).collect::<Vec<String>>());
        let mut names: Vec<String> = Vec::new();
        let mut reports = lines(&mut source);
        while names.len() < 2 {
            let report = reports.next().unwrap();
            let name = report.split(':').next().unwrap().to_owned();
            if !names.contains(&name) {
                names.push(name);
            }
        }
        targets.into_iter().for_each(end);
        end(source);
        (followed, names)
    });
    assert!(followed.iter().all(|lines| lines[1].starts_with("beat ")), "{followed:?}");
    assert!(reported.iter().all(|name| name.starts_with("target ")), "{reported:?}");
}

#[test]
fn example_odometer_goes_on_after_a_kill() {
    let folder = std::env::temp_dir().join(format!("sk-odometer-{}", std::process::id()));
    let number =
        |line: &str, word: &str| line.strip_prefix(word).map(|number| number.parse::<i64>().unwrap());
    let mut saved = 0;
    for life in 0..3 {
        let mut odometer = example("18_odometer", &folder);
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
