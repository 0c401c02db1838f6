//! How things end: last words, links that break, servers that are told to stop, panics in the middle.

use sk_core::flow::server::Settings;
use sk_core::flow::{FlowMessage, HubAddress, Rights, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_core::{SkVariant, attach};

fn settings(uid: u32) -> Settings {
    Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(uid) }
}
#[derive(Default)]
struct Sink {
    values: Vec<i64>,
}
impl Sink {
    fn hear(&mut self, _cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        self.values.push(i64::try_from(&message.value()?)?);
        Ok(())
    }
}
object! { Sink { slots { hear(&FlowMessage) } } }

thread_local! {static PRIMED: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };}
/// Two satellites publish and go in one round; `other` subscribes to one of them or not. Answers what a third
/// has heard of the other.
fn last_words(inside: bool, chatty: bool, published_before: bool) -> Vec<i64> {
    let simulation = Simulation::new(8);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let address = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    let grow = |cx: &mut Cx| {
        if inside {
            let pipe = server.pipe(cx, Rights::ALL).unwrap();
            SkFlowSat::inside(cx, pipe)
        } else {
            SkFlowSat::connect(cx, &address)
        }
    };
    let (a, b) = (grow(cx), grow(cx));
    a.open(cx, "other", SkVariant::map([("format", "variant".into())])).unwrap();
    b.open(cx, "count", SkVariant::map([("format", "variant".into())])).unwrap();
    if chatty {
        b.subscribe(cx, "robot.other").unwrap();
    }
    let outside = SkFlowSat::connect(cx, &address);
    let sink = cx.spawn(Sink::default());
    outside.subscribe(cx, "robot.count").unwrap();
    attach!(cx, outside.message => sink.hear);
    simulation.run_for(&mut app, Duration::from_secs(1));
    if published_before {
        b.publish(app.cx(), "count", 3i64);
        simulation.run_for(&mut app, Duration::from_secs(1));
    }
    let cx = app.cx();
    a.publish(cx, "other", 1i64);
    assert!(b.publish(cx, "count", 4i64));
    cx.destroy_later(a);
    cx.destroy_later(b);
    simulation.run_for(&mut app, Duration::from_secs(3));
    app.cx().with(sink, |sink, _| sink.values.clone()).unwrap()
}

#[test]
fn what_a_satellite_publishes_just_before_it_goes_arrives() {
    for inside in [true, false] {
        for chatty in [true, false] {
            assert_eq!(last_words(inside, chatty, false), [4], "inside {inside}, chatty {chatty}");
            assert_eq!(last_words(inside, chatty, true), [3, 4], "inside {inside}, chatty {chatty}");
        }
    }
}

#[test]
fn a_seed_dropped_later_is_collected() {
    let simulation = Simulation::new(8);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let seed = server.pipe(cx, Rights::ALL).unwrap();
    simulation.run_for(&mut app, Duration::from_secs(1));
    drop(seed);
    simulation.run_for(&mut app, Duration::from_secs(60));
    assert_eq!(app.cx().with(server, |s, _| s.core().connections()), Ok(0));
}

#[test]
fn a_pipe_made_after_the_end_began_does_not_hold_it() {
    struct Ended(bool);
    impl Ended {
        fn on(&mut self, _cx: &mut Cx) {
            self.0 = true;
        }
    }
    object! { Ended { slots { on() } } }
    let simulation = Simulation::new(8);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(USER_ID));
    let address = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    let _one = SkFlowSat::connect(cx, &address);
    let ended = cx.spawn(Ended(false));
    attach!(cx, server.ended => ended.on);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let cx = app.cx();
    server.shut_down(cx).unwrap();
    let seed = server.pipe(cx, Rights::ALL);
    assert!(seed.is_err(), "a server that ends takes nobody in");
    simulation.run_for(&mut app, Duration::from_secs(20));
    assert_eq!(app.cx().with(ended, |e, _| e.0), Ok(true));
}

struct Plain;
object! { Plain {} }
struct X {
    other: Handle<Plain>,
    heard: Vec<u32>,
    bump: Signal<u32>,
}
impl X {
    fn go(&mut self, cx: &mut Cx, n: u32) {
        self.heard.push(n);
        if n == 0 {
            self.bump.emit(cx, 1); // parked: own slot runs
            let other = self.other;
            let _ = cx.with(other, |_, _| panic!("boom"));
        }
    }
}
object! { X { signals { bump(u32) } slots { go(u32) } } }
struct Src {
    out: Signal<u32>,
}
object! { Src { signals { out(u32) } } }

#[test]
fn a_panic_in_an_access_does_not_deafen_the_caller() {
    let simulation = Simulation::new(8);
    let mut app = simulation.app();
    let cx = app.cx();
    let other = cx.spawn(Plain);
    let x = cx.spawn(X { other, heard: vec![], bump: Signal::new() });
    let src = cx.spawn(Src { out: Signal::new() });
    attach!(cx, x.bump => x.go);
    attach!(cx, src.out => x.go);
    app.pulse();
    let emit = |app: &mut SkApp, n: u32| {
        let cx = app.cx();
        let who = cx.spawn(Driver { src, n });
        attach!(cx, cx.fast_zone().pulse => who.tick, OneShot);
        app.pulse();
        app.pulse();
        app.pulse();
    };
    emit(&mut app, 0);
    emit(&mut app, 7);
    emit(&mut app, 8);
    assert_eq!(app.cx().with(x, |x, _| x.heard.clone()), Ok(vec![0, 1, 7, 8]));
}
struct Driver {
    src: Handle<Src>,
    n: u32,
}
impl Driver {
    fn tick(&mut self, cx: &mut Cx) {
        let n = self.n;
        let _ = cx.with(self.src, |s, cx| s.out.emit(cx, n));
    }
}
object! { Driver { slots { tick() } } }

struct Twice {
    out: Signal<u32>,
}
impl Twice {
    fn go(&mut self, cx: &mut Cx) {
        self.out.emit(cx, 1);
        self.out.emit(cx, 2);
    }
}
object! { Twice { signals { out(u32) } slots { go() } } }
#[derive(Default)]
struct Num(Vec<u32>);
impl Num {
    fn on(&mut self, _cx: &mut Cx, n: u32) {
        self.0.push(n);
    }
}
object! { Num { slots { on(u32) } } }
#[test]
fn latest_once_is_the_first_call() {
    let simulation = Simulation::new(8);
    let mut app = simulation.app();
    let cx = app.cx();
    let t = cx.spawn(Twice { out: Signal::new() });
    let n = cx.spawn(Num::default());
    attach!(cx, t.out => n.on, Latest.once());
    app.pulse();
    let cx = app.cx();
    attach!(cx, cx.fast_zone().pulse => t.go, OneShot);
    for _ in 0..4 {
        app.pulse();
    }
    assert_eq!(app.cx().with(n, |n, _| n.0.clone()), Ok(vec![1]));
}
struct Quitter;
impl Quitter {
    fn on(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}
object! { Quitter { slots { on() } } }
#[test]
fn an_end_that_comes_in_the_rounds_before_run_is_not_forgotten() {
    let simulation = Simulation::new(9);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let server = SkFlowServer::start(cx, settings(1));
    let quitter = cx.spawn(Quitter);
    attach!(cx, server.ended => quitter.on);
    app.pulse();
    app.pulse();
    server.shut_down(app.cx()).unwrap();
    for _ in 0..6 {
        app.pulse();
    }
    let rounds = app.cx().stats().rounds;
    assert_eq!(app.run(), Run::Quit);
    assert_eq!(app.cx().stats().rounds, rounds, "it returns at once");
}
