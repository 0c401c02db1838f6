//! Databases through the objects of a program: handles, signals, reconnection, and a hub that keeps them.
#![cfg(feature = "store")]

use sk_core::flow::database::disk::Store;
use sk_core::flow::server::Settings;
use sk_core::flow::{FlowDatabase, HubAddress, Rights, SkFlowSat, SkFlowServer, Variable};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_core::{SkVariant, attach};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

const ADDRESS: &str = "/hub.sock";

fn start_hub(cx: &mut Cx) -> Handle<SkFlowServer> {
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    server.listen(cx, &HubAddress::Unix(ADDRESS.into())).unwrap();
    let opened = Store::open(cx.world().storage.clone(), "/state/databases.redb".into()).unwrap();
    assert_eq!(opened.damage, None);
    server.keep_databases(cx, opened.store, opened.saved).unwrap();
    server
}

fn world(seed: u64) -> (Simulation, SkApp) {
    let simulation = Simulation::new(seed);
    let app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    (simulation, app)
}

/// Writes down what a database tells.
#[derive(Default)]
struct Listener {
    values: BTreeMap<String, SkVariant>,
    changes: Vec<String>,
    done: Vec<String>,
    refused: Vec<String>,
    watching: u32,
}
impl Listener {
    fn changed(&mut self, _cx: &mut Cx, variable: &Variable) {
        self.changes.push(variable.key().to_owned());
        match variable.value() {
            Some(value) => drop(self.values.insert(variable.key().to_owned(), value.clone())),
            None => drop(self.values.remove(variable.key())),
        }
    }
    fn done(&mut self, _cx: &mut Cx, key: String) {
        self.done.push(key);
    }
    fn refused(&mut self, _cx: &mut Cx, why: String) {
        self.refused.push(why);
    }
    fn watching(&mut self, _cx: &mut Cx, _prefix: String) {
        self.watching += 1;
    }
}
object! { Listener { slots { changed(&Variable) done(String) refused(String) watching(String) } } }

fn listen(cx: &mut Cx, database: Handle<FlowDatabase>) -> Handle<Listener> {
    let listener = cx.spawn(Listener::default());
    attach!(cx, database.changed => listener.changed);
    attach!(cx, database.done => listener.done);
    attach!(cx, database.refused => listener.refused);
    attach!(cx, database.watching => listener.watching);
    listener
}

fn seconds(count: u64) -> Duration {
    Duration::from_secs(count)
}

#[test]
fn s105_values_are_set_watched_and_asked_for_by_satellites_and_modules_alike() {
    let (simulation, mut app) = world(1);
    let cx = app.cx();
    let server = start_hub(cx);
    let pipe = server.pipe(cx, Rights::ALL).unwrap();
    let module = SkFlowSat::inside(cx, pipe);
    let satellite = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    let arm = module.flow("arm").database(cx, "arm").unwrap();
    arm.create(cx, true);
    arm.watch(cx, "gain.");
    let listener = listen(cx, arm);
    let remote = satellite.database(cx, "arm").unwrap();
    assert_eq!(satellite.database(cx, "arm").unwrap(), remote, "one object for one name");
    // Before there is a link, and before the database exists at the hub.
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    let heard = listen(cx, remote);
    for (key, value) in [("gain.p", 1.5), ("gain.i", 0.1), ("mode", 3.0)] {
        assert!(remote.set(cx, key, value));
    }
    remote.delete(cx, "gain.i");
    let answers = Rc::new(RefCell::new(Vec::new()));
    for key in ["gain.p", "gain.i"] {
        let answers = answers.clone();
        remote.get(cx, key, move |_cx, value| answers.borrow_mut().push(value));
    }
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    assert_eq!(*answers.borrow(), [Ok(Some(1.5.into())), Ok(None)]);
    assert_eq!(arm.known(cx, "gain.p"), Some(1.5.into()));
    cx.with(heard, |heard, _| {
        assert_eq!(heard.done, ["gain.p", "gain.i", "mode", "gain.i"], "each when the disk has it");
        assert_eq!(heard.refused, [""; 0]);
    })
    .unwrap();
    cx.with(listener, |listener, _| {
        assert_eq!(listener.values, BTreeMap::from([("gain.p".to_owned(), 1.5.into())]));
        assert_eq!(listener.watching, 1);
    })
    .unwrap();
}

#[test]
fn commands_for_a_database_that_is_not_there_never_act_on_another_one() {
    let (simulation, mut app) = world(2);
    let cx = app.cx();
    start_hub(cx);
    let satellite = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    let [arm, nobody] = ["arm", "nobody"].map(|name| satellite.database(cx, name).unwrap());
    arm.create(cx, false);
    let listener = listen(cx, nobody);
    let answers = Rc::new(RefCell::new(Vec::new()));
    for round in 0..3 {
        arm.set(cx, "x", round);
        nobody.set(cx, "x", 100 + round);
        let answers = answers.clone();
        arm.get(cx, "x", move |_cx, value| answers.borrow_mut().push(value));
    }
    simulation.run_for(&mut app, seconds(2));
    assert_eq!(*answers.borrow(), [Ok(Some(0.into())), Ok(Some(1.into())), Ok(Some(2.into()))]);
    let refused = app.cx().with(listener, |listener, _| listener.refused.clone()).unwrap();
    assert_eq!(refused, ["There is no database of this name."; 3]);
}

#[test]
fn after_a_reconnection_databases_are_created_selected_and_watched_as_before() {
    let (simulation, mut app) = world(3);
    let cx = app.cx();
    let server = start_hub(cx);
    let satellite = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    let arm = satellite.database(cx, "arm").unwrap();
    let leg = satellite.database(cx, "leg").unwrap();
    arm.create(cx, true);
    leg.create(cx, false);
    arm.watch(cx, "");
    for (key, value) in [("a", 1), ("b", 2)] {
        arm.set(cx, key, value);
    }
    let own = satellite.own_database(cx).unwrap();
    own.set(cx, "battery", 12);
    let listener = listen(cx, arm);
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    server.shut_down(cx).unwrap();
    simulation.run_for(&mut app, seconds(3));
    let cx = app.cx();
    cx.destroy_later(server);
    // What is told while there is no hub goes when there is one.
    arm.set(cx, "c", 3);
    arm.delete(cx, "a");
    leg.set(cx, "x", 4);
    simulation.run_for(&mut app, seconds(1));
    start_hub(app.cx());
    simulation.run_for(&mut app, seconds(12));
    let cx = app.cx();
    let (values, changes) = cx
        .with(listener, |listener, _| (listener.values.clone(), listener.changes.clone()))
        .unwrap();
    assert_eq!(values, BTreeMap::from([("b".to_owned(), 2.into()), ("c".to_owned(), 3.into())]));
    assert_eq!(
        changes.iter().filter(|key| *key == "b").count(),
        1,
        "what did not change is not told again"
    );
    let answers = Rc::new(RefCell::new(Vec::new()));
    for (database, key) in [(leg, "x"), (own, "battery"), (own, "hub.user"), (own, "pulse.mode")] {
        let answers = answers.clone();
        database.get(cx, key, move |_cx, value| answers.borrow_mut().push(value.unwrap().unwrap()));
    }
    simulation.run_for(&mut app, seconds(1));
    assert_eq!(
        *answers.borrow(),
        [4.into(), 12.into(), SkVariant::from("robot"), SkVariant::from("SelectIo")]
    );
}

#[test]
fn a_satellite_tells_its_pulse_once_a_second() {
    let (simulation, mut app) = world(6);
    let cx = app.cx();
    start_hub(cx);
    let at = HubAddress::Unix(ADDRESS.into());
    let pacer = SkFlowSat::connect(cx, &at);
    pacer.name_flow(cx, "pacer").unwrap();
    let reader = SkFlowSat::connect(cx, &at);
    let pulse = reader.database(cx, "flow:robot.pacer").unwrap();
    let told = Rc::new(RefCell::new(SkVariant::Null));
    let mut ask = |key: &str| {
        let answer = told.clone();
        simulation.run_for(&mut app, seconds(2));
        pulse.get(app.cx(), key, move |_cx, value| *answer.borrow_mut() = value.unwrap().unwrap());
        simulation.run_for(&mut app, seconds(1));
        (told.take(), app.cx().stats().ticks)
    };
    let mut before = 0;
    for _ in 0..3 {
        let (statistics, ticks) = ask("pulse.statistics");
        let known = u64::try_from(statistics.get("ticks").unwrap()).unwrap();
        assert!(before < known && known <= ticks, "{before} {known} {ticks}");
        before = known;
        let keys: Vec<&str> = statistics.as_map().unwrap().keys().map(String::as_str).collect();
        let plain = ["interval", "job_time", "mean_interval", "missed", "overruns", "sync_lost", "ticks"];
        assert_eq!(keys, [&plain[..], &["wake_error"]].concat());
        assert_eq!(
            statistics.get("interval"),
            Some(&sk_core::eventloop::INTERVAL_DEFAULT.as_secs_f64().into())
        );
        let spans = statistics.get("job_time").unwrap();
        let [p50, p99, max] = ["p50", "p99", "max"].map(|key| spans.get(key).unwrap().as_f64().unwrap());
        assert!(p50 <= p99 && p99 <= max, "{spans}");
        assert_eq!(statistics.get("wake_error"), Some(&SkVariant::Null), "this mode promises no moment");
    }
    app.cx().set_interval(Duration::from_millis(20)).unwrap();
    app.cx().set_mode(TimingMode::Coarse).unwrap();
    let mut ask = |key: &str| {
        let answer = told.clone();
        simulation.run_for(&mut app, seconds(2));
        pulse.get(app.cx(), key, move |_cx, value| *answer.borrow_mut() = value.unwrap().unwrap());
        simulation.run_for(&mut app, seconds(1));
        told.take()
    };
    assert_eq!((ask("pulse.interval_ms"), ask("pulse.mode")), (20.0.into(), "Coarse".into()));
    let late = ask("pulse.statistics").get("wake_error").unwrap().clone();
    assert!(late.get("p99").and_then(SkVariant::as_f64).is_some(), "this one does: {late}");
}

#[test]
fn a_watch_waits_for_a_database_that_comes_later() {
    let (simulation, mut app) = world(4);
    let cx = app.cx();
    start_hub(cx);
    let satellite = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    let early = satellite.database(cx, "chan:robot.imu").unwrap();
    early.watch(cx, "");
    let listener = listen(cx, early);
    simulation.run_for(&mut app, seconds(2));
    let cx = app.cx();
    satellite.open(cx, "imu", SkVariant::map([("unit", "m".into())])).unwrap();
    simulation.run_for(&mut app, seconds(1));
    early.set(app.cx(), "mounted", "left");
    simulation.run_for(&mut app, seconds(3));
    let values = app.cx().with(listener, |listener, _| listener.values.clone()).unwrap();
    assert_eq!(values, BTreeMap::from([("mounted".to_owned(), "left".into())]));
}

#[test]
fn a_whole_world_with_a_store_repeats_exactly() {
    let run = |seed| {
        let (simulation, mut app) = world(seed);
        let cx = app.cx();
        start_hub(cx);
        let satellite = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
        let arm = satellite.database(cx, "arm").unwrap();
        arm.create(cx, true);
        for index in 0..20 {
            arm.set(cx, &format!("k{index}"), index);
        }
        let listener = listen(cx, arm);
        simulation.run_for(&mut app, seconds(2));
        let done = app.cx().with(listener, |listener, _| listener.done.len()).unwrap();
        assert_eq!(done, 20);
        simulation.trace_hash()
    };
    assert_eq!(run(7), run(7));
}

#[test]
fn a_server_that_ends_writes_what_it_was_told_before() {
    let (simulation, mut app) = world(5);
    let cx = app.cx();
    let server = start_hub(cx);
    let pipe = server.pipe(cx, Rights::ALL).unwrap();
    let module = SkFlowSat::inside(cx, pipe);
    let arm = module.database(cx, "arm").unwrap();
    arm.create(cx, true);
    simulation.run_for(&mut app, seconds(1));
    let cx = app.cx();
    for index in 0..200 {
        arm.set(cx, &format!("k{index:03}"), index);
    }
    app.pulse();
    cx_ends(&mut app, module, server);
    simulation.run_for(&mut app, seconds(4));
    let storage = app.cx().world().storage.clone();
    drop(app);
    let opened = Store::open(storage, "/state/databases.redb".into()).unwrap();
    assert_eq!(opened.saved.iter().map(|(_, saved)| saved.keys).sum::<usize>(), 200);
}

fn cx_ends(app: &mut SkApp, module: Handle<SkFlowSat>, server: Handle<SkFlowServer>) {
    let cx = app.cx();
    cx.destroy_later(module);
    server.shut_down(cx).unwrap();
}

#[test]
fn whoever_watches_and_ceases_to_again_and_again_may_still_do_everything() {
    let (simulation, mut app) = world(9);
    let cx = app.cx();
    start_hub(cx);
    let satellite = SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()));
    let arm = satellite.database(cx, "arm").unwrap();
    arm.create(cx, false);
    simulation.run_for(&mut app, seconds(1));
    for _ in 0..45 {
        for _ in 0..100 {
            arm.watch(app.cx(), "gain.");
            arm.unwatch(app.cx(), "gain.");
        }
        simulation.run_for(&mut app, Duration::from_millis(50));
    }
    let cx = app.cx();
    let listener = listen(cx, arm);
    assert!(arm.set(cx, "x", 1), "nothing of 4,500 former watches stands in the way");
    simulation.run_for(&mut app, seconds(1));
    assert_eq!(app.cx().with(listener, |heard, _| heard.done.clone()), Ok(vec!["x".to_owned()]));
}
