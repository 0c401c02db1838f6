//! A source of ticks and the loops that follow it, in the simulated and the real world.

use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::Credentials;
use sk_core::flow::server::Settings;
use sk_core::flow::{Divisor, HubAddress, SkFlowSat, SkFlowServer, TickReport};
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

const TARGETS: usize = 8;
const INTERVAL: Duration = Duration::from_millis(10);

fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

fn credentials() -> Credentials {
    Credentials::Token(OwnerToken::new([7; 32]))
}

/// Notes when its loop ticked.
struct Beat {
    ticks: Arc<Mutex<Vec<Instant>>>,
}
impl Beat {
    fn tick(&mut self, cx: &mut Cx) {
        self.ticks.lock().unwrap().push(cx.now());
    }
    /// A loop too slow for its source: it looks at the network every 25 ms only.
    fn be_slow(&mut self, cx: &mut Cx, synced: bool) {
        if synced {
            cx.set_mode(TimingMode::Coarse).unwrap();
            cx.set_interval(ms(25)).unwrap();
        }
    }
}
object! { Beat { slots { tick() be_slow(bool) } } }

/// Notes the newest report about each target.
#[derive(Default)]
struct Watcher {
    reports: BTreeMap<u64, TickReport>,
    synced: Vec<bool>,
    quit_when_divided: bool,
}
impl Watcher {
    fn report(&mut self, cx: &mut Cx, report: TickReport) {
        self.reports.insert(report.target, report);
        let divided = self.reports.values().any(|report| report.divisor > 1);
        let good = self
            .reports
            .values()
            .filter(|report| report.divisor == 1 && report.done >= 50)
            .count();
        if self.quit_when_divided && divided && good == TARGETS - 1 {
            cx.quit();
        }
    }
    fn synced(&mut self, _cx: &mut Cx, synced: bool) {
        self.synced.push(synced);
    }
}
object! { Watcher { slots { report(TickReport) synced(bool) } } }

type Ticks = Arc<Mutex<Vec<Instant>>>;

/// A hub on the main loop, a source on a thread of its own, and eight loops that follow it, the last of them too
/// slow: all over TCP.
struct Party {
    watcher: Handle<Watcher>,
    source: Ticks,
    targets: Vec<Ticks>,
    threads: Vec<SkThread>,
}

fn beat(cx: &mut Cx, ticks: Ticks) -> Handle<Beat> {
    let beat = cx.spawn(Beat { ticks });
    attach!(cx, cx.fast_zone().pulse => beat.tick);
    beat
}

fn party(cx: &mut Cx) -> Party {
    let settings =
        Settings { user: "robot".parse().unwrap(), token: Some(OwnerToken::new([7; 32])), owner_uid: None };
    let server = SkFlowServer::start(cx, settings);
    let at: HubAddress = server.listen(cx, &"tcp:127.0.0.1:0".parse().unwrap()).unwrap();
    let watcher = cx.spawn(Watcher::default());
    let source = Ticks::default();
    let (remote, to, ticks) = (cx.remote(watcher), at.clone(), source.clone());
    let thread = SkThread::new("source")
        .mode(TimingMode::Realtime)
        .interval(INTERVAL)
        .start(cx)
        .unwrap();
    thread
        .build(move |cx| {
            let hub = SkFlowSat::connect_as(cx, &to, credentials());
            hub.sync_source(cx, "clock").unwrap();
            attach!(cx, hub.sync_report => remote.report, Queued);
            beat(cx, ticks);
        })
        .unwrap();
    let targets: Vec<Ticks> = (0..TARGETS).map(|_| Ticks::default()).collect();
    let mut threads = vec![thread];
    for (index, ticks) in targets.iter().cloned().enumerate() {
        let thread = SkThread::new(&format!("target{index}"))
            .mode(TimingMode::SelectIo)
            .start(cx)
            .unwrap();
        let (at, slow) = (at.clone(), index + 1 == TARGETS);
        thread
            .build(move |cx| {
                let hub = SkFlowSat::connect_as(cx, &at, credentials());
                // The good ones get every tick, come what may: the machine may be busy.
                let divisor = if slow { Divisor::Auto } else { Divisor::Every };
                hub.sync_to(cx, "robot.clock", divisor).unwrap();
                let beat = beat(cx, ticks);
                if slow {
                    attach!(cx, hub.synced => beat.be_slow);
                }
            })
            .unwrap();
        threads.push(thread);
    }
    Party { watcher, source, targets, threads }
}

#[test]
fn s165_s162_eight_targets_follow_with_bounded_skew_and_a_slow_one_disturbs_nobody() {
    for seed in 0..5 {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let party = party(app.cx());
        simulation.run_for(&mut app, Duration::from_secs(4));
        let (from, to) = (Instant::ZERO + ms(1005), Instant::ZERO + ms(3005));
        let within = |ticks: &Ticks| -> Vec<Instant> {
            let ticks = ticks.lock().unwrap();
            ticks.iter().copied().filter(|at| (from..to).contains(at)).collect()
        };
        let source = within(&party.source);
        assert_eq!(source.len(), 200);
        for target in &party.targets[..TARGETS - 1] {
            let ticks = within(target);
            assert_eq!(ticks.len(), 200, "seed {seed}: every tick of the source and none besides");
            for (tick, source) in ticks.iter().zip(&source) {
                let late = tick.since(*source);
                assert!(late <= ms(1), "seed {seed}: {late:?} after the source");
            }
        }
        let skew = (0..200).map(|tick| {
            let at = party.targets[..TARGETS - 1].iter().map(|target| within(target)[tick]);
            at.clone().max().unwrap().since(at.min().unwrap())
        });
        assert!(skew.max().unwrap() <= ms(1), "the targets are together");
        let watcher = party.watcher;
        let reports = app.cx().with(watcher, |watcher, _| watcher.reports.clone()).unwrap();
        assert_eq!(reports.len(), TARGETS);
        let (slow, good): (Vec<&TickReport>, Vec<&TickReport>) =
            reports.values().partition(|report| report.divisor > 1);
        assert!(good.iter().all(|report| report.missed == 0 && report.done > 200), "{good:?}");
        assert_eq!(slow.len(), 1);
        assert!(slow[0].missed > 0 && slow[0].lag >= ms(25), "{slow:?}");
    }
}

#[test]
fn s165_eight_targets_follow_over_the_machines_own_tcp_and_a_slow_one_is_divided() {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let party = party(app.cx());
    let watcher = party.watcher;
    app.cx().with(watcher, |watcher, _| watcher.quit_when_divided = true).unwrap();
    app.run();
    for target in &party.targets[..TARGETS - 1] {
        assert!(target.lock().unwrap().len() >= 50);
    }
    for thread in party.threads {
        thread.stop();
    }
}

/// One loop that may follow another's clock, in the simulation.
struct Pair {
    simulation: Simulation,
    app: SkApp,
    server: Handle<SkFlowServer>,
    hub: Handle<SkFlowSat>,
    source: Remote<Source>,
    watcher: Handle<Watcher>,
    ticks: Ticks,
    _thread: SkThread,
}

/// The source's end of the pair.
struct Source {
    hub: Handle<SkFlowSat>,
}
object! { Source { } }

impl Pair {
    /// A target of 40 ms and a source of 10 ms that is not one yet.
    fn new(seed: u64) -> Pair {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| {
            settings.mode = TimingMode::SelectIo;
            settings.interval = ms(40);
        });
        let cx = app.cx();
        let server = SkFlowServer::start(cx, hub_settings());
        let at = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
        let hub = SkFlowSat::connect(cx, &at);
        let watcher = cx.spawn(Watcher::default());
        attach!(cx, hub.synced => watcher.synced);
        attach!(cx, hub.sync_report => watcher.report);
        let thread = SkThread::new("source")
            .mode(TimingMode::Coarse)
            .interval(INTERVAL)
            .start(cx)
            .unwrap();
        let source = thread
            .build(move |cx| {
                let hub = SkFlowSat::connect(cx, &at);
                let source = cx.spawn(Source { hub });
                cx.remote(source)
            })
            .unwrap();
        let ticks = Ticks::default();
        beat(cx, ticks.clone());
        Pair { simulation, app, server, hub, source, watcher, ticks, _thread: thread }
    }

    fn run(&mut self, span: u64) -> usize {
        self.ticks.lock().unwrap().clear();
        self.simulation.run_for(&mut self.app, ms(span));
        self.ticks.lock().unwrap().len()
    }

    fn mode(&mut self) -> (TimingMode, Duration) {
        let settings = self.app.cx().settings();
        (settings.mode, settings.interval)
    }

    fn begin_source(&mut self) {
        self.source
            .post(|source, cx| source.hub.sync_source(cx, "clock").unwrap())
            .unwrap();
    }
}

fn hub_settings() -> Settings {
    let owner_uid = Some(sk_core::testing::USER_ID);
    Settings { user: "robot".parse().unwrap(), token: None, owner_uid }
}

#[test]
fn s166_a_loop_follows_a_source_while_there_is_one_and_keeps_its_own_time_otherwise() {
    let mut pair = Pair::new(1);
    let hub = pair.hub;
    hub.sync_to(pair.app.cx(), "robot.clock", Divisor::Auto).unwrap();
    pair.run(1000);
    assert_eq!(pair.mode(), (TimingMode::SelectIo, ms(40)), "there is no such source yet");
    pair.begin_source();
    pair.run(100);
    assert_eq!(pair.mode(), (TimingMode::Synced, INTERVAL));
    assert_eq!(pair.run(1000), 100, "the source's ticks and no others");

    pair.source.post(|source, cx| source.hub.end_sync_source(cx).unwrap()).unwrap();
    pair.run(100);
    assert_eq!(pair.mode(), (TimingMode::SelectIo, ms(40)));
    assert!(pair.run(400) >= 10, "it has its own time again");
    pair.begin_source();
    pair.run(100);
    assert_eq!(pair.run(1000), 100);

    hub.end_sync_to(pair.app.cx()).unwrap();
    pair.run(100);
    assert_eq!(pair.mode(), (TimingMode::SelectIo, ms(40)));
    hub.sync_to(pair.app.cx(), "robot.clock", Divisor::Fourth).unwrap();
    pair.run(100);
    assert_eq!(pair.mode(), (TimingMode::Synced, ms(40)));
    assert_eq!(pair.run(1000), 25);
    hub.sync_to(pair.app.cx(), "robot.clock", Divisor::Second).unwrap();
    pair.run(100);
    assert_eq!((pair.mode(), pair.run(1000)), ((TimingMode::Synced, ms(20)), 50));
    let watcher = pair.watcher;
    let synced = pair.app.cx().with(watcher, |watcher, _| watcher.synced.clone()).unwrap();
    assert_eq!(synced, [true, false, true, false, true]);
}

#[test]
fn s166_a_lost_hub_gives_the_loop_its_own_time_until_it_is_back() {
    let mut pair = Pair::new(2);
    let hub = pair.hub;
    hub.sync_to(pair.app.cx(), "robot.clock", Divisor::Every).unwrap();
    pair.begin_source();
    pair.run(500);
    assert_eq!(pair.mode().0, TimingMode::Synced);
    let server = pair.server;
    pair.app.cx().destroy_later(server);
    pair.run(100);
    assert_eq!(pair.mode(), (TimingMode::SelectIo, ms(40)));
    let cx = pair.app.cx();
    let server = SkFlowServer::start(cx, hub_settings());
    server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    pair.run(12_000);
    assert_eq!(pair.mode().0, TimingMode::Synced);
    assert_eq!(pair.run(1000), 100);
}

#[test]
fn s163_a_satellite_that_does_not_follow_is_unchanged() {
    let mut pair = Pair::new(3);
    pair.begin_source();
    pair.run(500);
    assert_eq!(pair.mode(), (TimingMode::SelectIo, ms(40)));
    let watcher = pair.watcher;
    let heard = pair
        .app
        .cx()
        .with(watcher, |watcher, _| watcher.reports.len() + watcher.synced.len());
    assert_eq!(heard, Ok(0));
}

#[test]
fn s160_nothing_is_sent_while_nobody_follows_and_the_numbers_go_on() {
    let mut pair = Pair::new(4);
    pair.begin_source();
    pair.run(1000);
    let hub = pair.hub;
    hub.sync_to(pair.app.cx(), "robot.clock", Divisor::Every).unwrap();
    pair.run(3000);
    let watcher = pair.watcher;
    let reports = pair.app.cx().with(watcher, |watcher, _| watcher.reports.clone()).unwrap();
    let report = reports.values().next().expect("its own");
    assert!(report.is_own && report.missed == 0, "what came before it is none of its: {report:?}");
    assert!((100..300).contains(&report.done), "{report:?}");
}

/// In `SelectIo` whatever comes in makes a tick: the answers of those who follow must not cause the ticks that they
/// answer.
#[test]
fn s160_the_answers_to_a_loop_in_select_io_are_no_ticks_of_its_clock() {
    let simulation = Simulation::new(5);
    let mut app = simulation.app_with(|settings| {
        settings.mode = TimingMode::SelectIo;
        settings.interval = INTERVAL;
    });
    let cx = app.cx();
    let server = SkFlowServer::start(cx, hub_settings());
    let at = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    let pipe = server.pipe(cx, sk_core::flow::Rights::ALL).unwrap();
    let clock = SkFlowSat::inside(cx, pipe);
    clock.sync_source(cx, "clock").unwrap();
    let ticks = Ticks::default();
    let heard = ticks.clone();
    let thread = SkThread::new("target").mode(TimingMode::SelectIo).start(cx).unwrap();
    thread
        .build(move |cx| {
            let hub = SkFlowSat::connect(cx, &at);
            hub.sync_to(cx, "robot.clock", Divisor::Every).unwrap();
            beat(cx, heard);
        })
        .unwrap();
    simulation.run_for(&mut app, ms(1000));
    ticks.lock().unwrap().clear();
    simulation.run_for(&mut app, ms(1000));
    let (ticks, possible) =
        (ticks.lock().unwrap().len(), (ms(1000).as_nanos() / INTERVAL.as_nanos()) as usize);
    assert!((possible / 2..=possible).contains(&ticks), "{ticks} ticks where {possible} are possible");
    drop(thread);
}
