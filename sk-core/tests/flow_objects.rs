//! Server and satellites as objects: over sockets, over pipes, in the real and the simulated world.

use sk_core::flow::server::Settings;
use sk_core::flow::{FlowMessage, HubAddress, Rights, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_core::{SkVariant, attach};

fn settings(uid: u32) -> Settings {
    Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(uid) }
}

/// Publishes a rising number on every tick.
struct Source {
    hub: Handle<SkFlowSat>,
    count: i64,
}
impl Source {
    fn tick(&mut self, cx: &mut Cx) {
        if self.hub.publish(cx, "count", self.count) {
            self.count += 1;
        }
    }
}
object! { Source { slots { tick() } } }

#[derive(Default)]
struct Sink {
    values: Vec<i64>,
    quit_after: usize,
    quit_at: Option<i64>,
    names: Vec<String>,
}
impl Sink {
    fn hear(&mut self, cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        self.names.push(message.name().to_owned());
        self.values.push(i64::try_from(&message.value()?)?);
        if self.values.len() == self.quit_after || self.values.last().copied() == self.quit_at {
            cx.quit();
        }
        Ok(())
    }
}
object! { Sink { slots { hear(&FlowMessage) } } }

fn publish_and_hear(cx: &mut Cx, source_hub: Handle<SkFlowSat>, sink_hub: Handle<SkFlowSat>) -> Handle<Sink> {
    let source = cx.spawn(Source { hub: source_hub, count: 0 });
    attach!(cx, cx.fast_zone().pulse => source.tick);
    let sink = cx.spawn(Sink { quit_after: 10, ..Sink::default() });
    sink_hub.subscribe(cx, "robot.count").unwrap();
    attach!(cx, sink_hub.message => sink.hear);
    sink
}

fn check(app: &mut SkApp, sink: Handle<Sink>) {
    app.cx()
        .with(sink, |sink, _| {
            assert_eq!(sink.values, (0..10).collect::<Vec<i64>>());
            assert!(sink.names.iter().all(|name| name == "robot.count"));
        })
        .unwrap();
}

fn over_sockets(app: &mut SkApp, at: HubAddress, uid: u32, run: impl FnOnce(&mut SkApp)) {
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(uid));
    let address = server.listen(cx, &at).unwrap();
    let (a, b) = (SkFlowSat::connect(cx, &address), SkFlowSat::connect(cx, &address));
    let sink = publish_and_hear(cx, a, b);
    run(app);
    check(app, sink);
}

#[test]
fn satellites_talk_over_a_unix_socket() {
    let path = std::env::temp_dir().join(format!("sk-flow-objects-{}.sock", std::process::id()));
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_millis(2))
        .build()
        .unwrap();
    over_sockets(&mut app, HubAddress::Unix(path), nix::unistd::getuid().as_raw(), |app| {
        app.run();
    });
}

#[test]
fn satellites_talk_in_a_simulated_world_and_repeat_exactly() {
    let run = |seed| {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        over_sockets(&mut app, HubAddress::Unix("/hub".into()), USER_ID, |app| {
            simulation.run_for(app, Duration::from_secs(5));
        });
        simulation.trace_hash()
    };
    assert_eq!(run(1), run(1));
}

#[test]
fn modules_on_the_hubs_own_loop_talk_through_pipes_without_extra_ticks() {
    let simulation = Simulation::new(3);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let (a, b) = (server.pipe(cx, Rights::ALL).unwrap(), server.pipe(cx, Rights::ALL).unwrap());
    let (a, b) = (SkFlowSat::inside(cx, a), SkFlowSat::inside(cx, b));
    let sink = publish_and_hear(cx, a, b);
    simulation.run_for(&mut app, Duration::from_secs(5));
    check(&mut app, sink);
    let ticks = app.cx().stats().ticks;
    assert!(ticks <= 40, "publishing in a pulse must not make the loop pulse faster: {ticks} ticks");
}

#[test]
fn a_module_on_a_thread_of_its_own_talks_through_a_pipe() {
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_millis(2))
        .build()
        .unwrap();
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let (a, b) = (server.pipe(cx, Rights::ALL).unwrap(), server.pipe(cx, Rights::ALL).unwrap());
    let thread = SkThread::new("module").start(cx).unwrap();
    thread
        .build(move |cx| {
            let hub = SkFlowSat::inside(cx, a);
            let source = cx.spawn(Source { hub, count: 0 });
            attach!(cx, cx.fast_zone().pulse => source.tick);
        })
        .unwrap();
    let b = SkFlowSat::inside(cx, b);
    let sink = cx.spawn(Sink { quit_after: 10, ..Sink::default() });
    b.subscribe(cx, "robot.count").unwrap();
    attach!(cx, b.message => sink.hear);
    app.run();
    check(&mut app, sink);
    thread.stop();
}

/// Publishes very many small messages in one slot, once, as soon as somebody listens.
struct Burst {
    hub: Handle<SkFlowSat>,
    count: i64,
}
impl Burst {
    fn go(&mut self, cx: &mut Cx, _channel: &str) {
        for n in 0..self.count {
            self.hub.publish(cx, "count", n);
        }
    }
}
object! { Burst { slots { go(&str) } } }

#[test]
fn a_burst_longer_than_a_pipe_gets_through_without_further_traffic() {
    for threaded in [false, true] {
        let mut app = SkApp::builder()
            .mode(TimingMode::SelectIo)
            .interval(Duration::from_millis(2))
            .build()
            .unwrap();
        let cx = app.cx();
        let server = SkFlowServer::start(cx, settings(USER_ID));
        let (a, b) = (server.pipe(cx, Rights::ALL).unwrap(), server.pipe(cx, Rights::ALL).unwrap());
        let build = move |cx: &mut Cx| {
            let hub = SkFlowSat::inside(cx, a);
            hub.open(cx, "count", SkVariant::map([("format", "variant".into())])).unwrap();
            let burst = cx.spawn(Burst { hub, count: 2000 });
            attach!(cx, hub.start_publishing => burst.go);
        };
        let thread = SkThread::new("burst").start(cx).unwrap();
        if threaded {
            thread.build(build).unwrap();
        } else {
            build(cx);
        }
        let b = SkFlowSat::inside(cx, b);
        // The newest 64 arrive whatever was dropped on the way, and the last of them is the last published.
        let sink = cx.spawn(Sink { quit_at: Some(1999), ..Sink::default() });
        b.subscribe(cx, "robot.count").unwrap();
        attach!(cx, b.message => sink.hear);
        app.run();
        let values = app.cx().with(sink, |sink, _| sink.values.clone()).unwrap();
        assert!(values.is_sorted() && values.len() >= 64, "{} values", values.len());
        thread.stop();
    }
}

#[derive(Default)]
struct Watcher {
    seen: Vec<String>,
}
impl Watcher {
    fn ready(&mut self, _cx: &mut Cx) {
        self.seen.push("ready".into());
    }
    fn lost(&mut self, _cx: &mut Cx, _why: &str) {
        self.seen.push("lost".into());
    }
    fn refused(&mut self, _cx: &mut Cx, why: &str) {
        self.seen.push(format!("refused: {why}"));
    }
}
object! { Watcher { slots { ready() lost(&str) refused(&str) } } }

#[test]
fn a_satellite_finds_a_hub_that_comes_back_and_restores_its_channels() {
    let simulation = Simulation::new(4);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let at = HubAddress::Unix("/hub".into());
    let satellite = SkFlowSat::connect(cx, &at);
    satellite.open(cx, "count", SkVariant::map([("unit", "1".into())])).unwrap();
    let watcher = cx.spawn(Watcher::default());
    attach!(cx, satellite.ready => watcher.ready);
    attach!(cx, satellite.lost => watcher.lost);
    simulation.run_for(&mut app, Duration::from_secs(1));
    for _ in 0..2 {
        let cx = app.cx();
        let server = SkFlowServer::start(cx, settings(USER_ID));
        server.listen(cx, &at).unwrap();
        simulation.run_for(&mut app, Duration::from_secs(12));
        let cx = app.cx();
        let channels = server.channels(cx).unwrap();
        assert_eq!(channels.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["robot.count"]);
        cx.destroy_later(server);
        simulation.run_for(&mut app, Duration::from_secs(1));
    }
    let seen = app.cx().with(watcher, |watcher, _| watcher.seen.clone()).unwrap();
    let ready = seen.iter().filter(|what| *what == "ready").count();
    assert_eq!(ready, 2, "{seen:?}");
    assert!(seen.iter().filter(|what| *what == "lost").count() >= 3, "{seen:?}");
}

#[test]
fn s81_a_stranger_is_not_let_in() {
    let simulation = Simulation::new(5);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let stranger = settings(USER_ID + 1);
    let server = SkFlowServer::start(cx, stranger);
    let address = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    let satellite = SkFlowSat::connect(cx, &address);
    let watcher = cx.spawn(Watcher::default());
    attach!(cx, satellite.refused => watcher.refused);
    attach!(cx, satellite.ready => watcher.ready);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let seen = app.cx().with(watcher, |watcher, _| watcher.seen.clone()).unwrap();
    assert!(seen.iter().any(|what| what.starts_with("refused")), "{seen:?}");
    assert!(!seen.iter().any(|what| what == "ready"));
}

/// Stands still for a while, as a process that was stopped and continued.
struct Sleeper {
    simulation: std::sync::Arc<sk_core::world::SimulatedClock>,
}
impl Sleeper {
    fn stand_still(&mut self, _cx: &mut Cx) {
        self.simulation.advance(Duration::from_secs(10));
    }
}
object! { Sleeper { slots { stand_still() } } }

#[test]
fn a_loop_that_stood_still_keeps_the_modules_inside() {
    let simulation = Simulation::new(6);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let pipe = server.pipe(cx, Rights::ALL).unwrap();
    let inside = SkFlowSat::inside(cx, pipe);
    inside.open(cx, "count", SkVariant::map([("unit", "1".into())])).unwrap();
    simulation.run_for(&mut app, Duration::from_secs(1));
    let cx = app.cx();
    let sleeper = cx.spawn(Sleeper { simulation: simulation.clock() });
    attach!(cx, cx.fast_zone().pulse => sleeper.stand_still, OneShot);
    simulation.run_for(&mut app, Duration::from_secs(30));
    assert_eq!(server.channels(app.cx()).unwrap().len(), 1);
}

/// Publishes some large messages in one slot.
struct Heavy {
    hub: Handle<SkFlowSat>,
}
impl Heavy {
    fn go(&mut self, cx: &mut Cx, _channel: &str) {
        for n in 0..3u8 {
            self.hub.publish_bytes(cx, "heavy", vec![n; 10 << 20]);
        }
    }
}
object! { Heavy { slots { go(&str) } } }

#[derive(Default)]
struct Weigher {
    lengths: Vec<usize>,
    at: Vec<Instant>,
}
impl Weigher {
    fn hear(&mut self, cx: &mut Cx, message: &FlowMessage) {
        self.lengths.push(message.payload().len());
        self.at.push(cx.now());
    }
}
object! { Weigher { slots { hear(&FlowMessage) } } }

#[test]
fn messages_larger_than_a_pipe_arrive_without_waiting_for_a_ping() {
    let simulation = Simulation::new(7);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let (a, b) = (server.pipe(cx, Rights::ALL).unwrap(), server.pipe(cx, Rights::ALL).unwrap());
    let (a, b) = (SkFlowSat::inside(cx, a), SkFlowSat::inside(cx, b));
    a.open(cx, "heavy", SkVariant::map([("format", "bytes".into())])).unwrap();
    let heavy = cx.spawn(Heavy { hub: a });
    attach!(cx, a.start_publishing => heavy.go);
    let weigher = cx.spawn(Weigher::default());
    b.subscribe(cx, "robot.heavy").unwrap();
    attach!(cx, b.message => weigher.hear);
    simulation.run_for(&mut app, Duration::from_millis(200));
    let (lengths, at) = app.cx().with(weigher, |w, _| (w.lengths.clone(), w.at.clone())).unwrap();
    assert_eq!(lengths, [10 << 20; 3], "at {at:?}");
}

/// Says a last word when it is buried.
struct Dying {
    hub: Handle<SkFlowSat>,
}
impl Dying {
    fn on_destroy(&mut self, cx: &mut Cx) {
        self.hub.publish(cx, "count", 4);
    }
}
object! { Dying { hooks { on_destroy } } }

#[test]
fn last_words_arrive_before_everybody_is_told_of_the_end() {
    let simulation = Simulation::new(8);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let address = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    let pipe = server.pipe(cx, Rights::ALL).unwrap();
    let inside = SkFlowSat::inside(cx, pipe);
    inside
        .open(cx, "count", SkVariant::map([("format", "variant".into())]))
        .unwrap();
    let dying = cx.under(inside).spawn(Dying { hub: inside });
    let outside = SkFlowSat::connect(cx, &address);
    let sink = cx.spawn(Sink { quit_after: usize::MAX, ..Sink::default() });
    let watcher = cx.spawn(Watcher::default());
    outside.subscribe(cx, "robot.count").unwrap();
    attach!(cx, outside.message => sink.hear);
    attach!(cx, outside.lost => watcher.lost);
    attach!(cx, server.ended => watcher.ready());
    simulation.run_for(&mut app, Duration::from_secs(1));
    let cx = app.cx();
    cx.destroy_later(dying);
    app.pulse();
    let cx = app.cx();
    cx.destroy_later(inside);
    server.shut_down(cx).unwrap();
    simulation.run_for(&mut app, Duration::from_secs(3));
    assert_eq!(app.cx().with(sink, |sink, _| sink.values.clone()), Ok(vec![4]));
    let seen = app.cx().with(watcher, |watcher, _| watcher.seen.clone()).unwrap();
    assert!(seen.contains(&"lost".to_owned()) && seen.contains(&"ready".to_owned()), "{seen:?}");
}

#[test]
fn a_timer_set_before_the_first_round_counts_from_when_it_was_set() {
    let simulation = Simulation::new(9);
    let mut app = simulation.app();
    simulation.clock().advance(Duration::from_secs(5));
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    timer.start_once(cx, Duration::from_millis(300)).unwrap();
    simulation.run_for(&mut app, Duration::from_millis(250));
    assert_eq!(timer.is_running(app.cx()), Ok(true));
    simulation.run_for(&mut app, Duration::from_millis(100));
    assert_eq!(timer.is_running(app.cx()), Ok(false));
}
