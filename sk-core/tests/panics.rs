//! Slots that fail or panic: reports, policies, and who goes on.

mod objects;

use objects::*;
use sk_core::eventloop::{AfterFailure, Failure};
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::cell::RefCell;

/// Keeps every failure that the loop reports.
#[derive(Clone, Default)]
struct Reports(Rc<RefCell<Vec<Failure>>>);
struct Reporter(Reports);
impl Reporter {
    fn report(&mut self, _cx: &mut Cx, failure: &Failure) {
        self.0.0.borrow_mut().push(failure.clone());
    }
}
object! { Reporter { slots { report(&Failure) } } }

fn reporting(app: &mut SkApp) -> Reports {
    let reports = Reports::default();
    let cx = app.cx();
    let reporter = cx.spawn(Reporter(reports.clone()));
    attach!(cx, cx.event_loop().slot_failed => reporter.report);
    reports
}

struct Lidar;
impl Lidar {
    fn scan(&mut self, _cx: &mut Cx) -> Result<(), String> {
        Err("the cable is out".to_owned())
    }
}
object! { Lidar { slots { scan() } } }

/// An actor that panics, under this name.
fn bomb(cx: &mut Cx, name: &str) -> Handle<Actor> {
    cx.named(name).spawn(Actor::new(|_, _, n| panic!("boom {n}")))
}

#[test]
fn a_slot_that_fails_is_recorded_and_goes_on() {
    let (_world, mut app) = world();
    let reports = reporting(&mut app);
    let cx = app.cx();
    let front = cx.named("front").spawn(Button::default());
    let lidar = cx.under(front).named("lidar").spawn(Lidar);
    attach!(cx, cx.fast_zone().pulse => lidar.scan);
    for _ in 0..4 {
        app.pulse();
    }
    assert_eq!(app.cx().counters().failures, 3);
    assert_eq!(app.cx().counters().panics, 0);
    assert!(app.cx().is_alive(lidar));
    let reports = reports.0.take();
    assert_eq!(reports.len(), 3);
    let expected = Failure {
        object: lidar.id(),
        path: "front/lidar".to_owned(),
        class: "Lidar",
        slot: "scan",
        message: "the cable is out".to_owned(),
        panicked: false,
        chain: Vec::new(),
        skipped: 0,
    };
    assert_eq!(reports[0], expected);
}

#[test]
fn a_panic_is_recorded_and_its_object_destroyed() {
    let (_world, mut app) = world();
    let reports = reporting(&mut app);
    let cx = app.cx();
    let bomb = bomb(cx, "bomb");
    attach!(cx, cx.fast_zone().pulse => bomb.go);
    app.pulse();
    app.pulse();
    assert!(!app.cx().exists(bomb));
    let reports = reports.0.take();
    assert_eq!(reports.len(), 1);
    assert_eq!((reports[0].path.as_str(), reports[0].message.as_str()), ("bomb", "boom 0"));
    assert!(reports[0].panicked);
    assert_eq!(reports[0].chain, ["bomb.go"]);
}

#[test]
fn a_panic_in_one_slot_of_a_zone_leaves_the_other_slots_running() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let lamps = [cx.spawn(Lamp::new("before", &log)), cx.spawn(Lamp::new("after", &log))];
    attach!(cx, cx.fast_zone().pulse => lamps[0].blink);
    let bomb = bomb(cx, "bomb");
    attach!(cx, cx.fast_zone().pulse => bomb.go);
    attach!(cx, cx.fast_zone().pulse => lamps[1].blink);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["before blinks", "after blinks"]);
    assert_eq!(app.cx().counters().skipped, 0);
}

#[test]
fn a_panic_unwinds_to_its_top_level_dispatch_and_names_the_chain() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let reports = reporting(&mut app);
    let cx = app.cx();
    let outer_log = log.clone();
    let outer = cx.named("outer").spawn(Actor::new(move |cx, stage, n| {
        stage.out.emit(cx, n);
        outer_log.note("outer went on");
    }));
    let middle = cx.named("middle").spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, n)));
    let inner = bomb(cx, "inner");
    let spared = cx.spawn(Lamp::new("spared", &log));
    attach!(cx, outer.out => middle.act);
    attach!(cx, outer.out => spared.on);
    attach!(cx, middle.out => inner.act);
    attach!(cx, middle.out => spared.blink());
    cx.invoke_method(outer, "act", &[7.into()]).unwrap();
    app.pulse();
    cx_invoke(&mut app, outer, 8);
    app.pulse();
    let reports = reports.0.take();
    assert_eq!(reports.len(), 1, "{reports:?}");
    assert_eq!(reports[0].chain, ["outer.act", "middle.act", "inner.act"]);
    assert_eq!(reports[0].skipped, 2, "one slot of each of the two emits");
    assert_eq!(app.cx().counters().skipped, 2);
    assert!(app.cx().is_alive(outer) && app.cx().is_alive(middle) && !app.cx().exists(inner));
    assert_eq!(log.take(), ["outer went on"], "the first call, before the links were made");

    // The way is free again: leases are gone and the depth is what it was.
    cx_invoke(&mut app, outer, 9);
    app.pulse();
    assert_eq!(log.take(), ["spared blinks", "spared 9", "outer went on"]);
}

fn cx_invoke(app: &mut SkApp, actor: Handle<Actor>, n: i64) {
    app.cx().invoke_method(actor, "act", &[n.into()]).unwrap();
}

#[test]
fn a_panic_while_calls_are_being_timed_unwinds_as_far() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app();
    let clock = simulation.clock();
    let (log, reports) = (Log::default(), reporting(&mut app));
    let cx = app.cx();
    let lazy = cx.spawn(Actor::new(move |_, _, _| clock.advance(ms(9))));
    attach!(cx, cx.fast_zone().pulse => lazy.go);
    let outer_log = log.clone();
    let outer = cx.named("outer").spawn(Actor::new(move |cx, stage, n| {
        stage.out.emit(cx, n);
        outer_log.note("outer went on");
    }));
    let inner = bomb(cx, "inner");
    attach!(cx, outer.out => inner.act);
    for _ in 0..3 {
        app.pulse();
    }
    cx_invoke(&mut app, outer, 1);
    app.pulse();
    assert_eq!(log.take(), [""; 0]);
    assert_eq!(reports.0.take()[0].chain, ["outer.act", "inner.act"]);
}

#[test]
fn policies_say_what_follows_a_failure() {
    use AfterFailure::{Destroy, GoOn, Stop};
    for (policy, alive, quits) in [(GoOn, true, false), (Destroy, false, false), (Stop, true, true)] {
        let simulation = Simulation::new(1);
        let mut app = simulation.app_with(|settings| {
            settings.after_error = policy;
            settings.after_panic = policy;
        });
        let cx = app.cx();
        let bomb = bomb(cx, "bomb");
        let lidar = cx.spawn(Lidar);
        attach!(cx, cx.fast_zone().pulse => bomb.go);
        app.pulse();
        app.pulse();
        assert_eq!((app.cx().is_alive(bomb), app.cx().is_quitting()), (alive, quits), "panic: {policy:?}");
        let cx = app.cx();
        attach!(cx, cx.fast_zone().pulse => lidar.scan);
        app.pulse();
        app.pulse();
        assert_eq!((app.cx().is_alive(lidar), app.cx().is_quitting()), (alive, quits), "error: {policy:?}");
    }
}

#[test]
fn calls_parked_for_an_object_that_was_unwound_run_in_the_next_round() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let seen = log.clone();
    let outer = cx.spawn(Actor::new(move |cx, stage, n| {
        seen.note(format!("outer {n}"));
        if n == 0 {
            stage.out.emit(cx, 1);
        }
    }));
    let back = cx.spawn(Actor::new(|cx, stage, _| {
        stage.out.emit(cx, 5);
        panic!("after the emission");
    }));
    attach!(cx, outer.out => back.act);
    attach!(cx, back.out => outer.act);
    app.pulse();
    cx_invoke(&mut app, outer, 0);
    app.pulse();
    assert_eq!(log.take(), ["outer 0"]);
    app.pulse();
    assert_eq!(log.take(), ["outer 5"], "the parked call is not lost");
    push_through(&mut app, outer, 6);
    assert_eq!(log.take(), ["outer 6"], "and nothing waits any more");
}

/// Calls the slot directly, over a link of its own.
#[test]
fn a_parked_call_that_panics_does_not_hold_up_those_behind_it() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.after_panic = AfterFailure::GoOn);
    let (log, cx) = (Log::default(), app.cx());
    let seen = log.clone();
    let own = cx.spawn(Actor::new(move |cx, stage, n| {
        seen.note(n.to_string());
        match n {
            0 => (1..=4).for_each(|n| stage.out.emit(cx, n)),
            2 => panic!("the second that waits"),
            _ => {}
        }
    }));
    attach!(cx, own.out => own.act);
    app.pulse();
    cx_invoke(&mut app, own, 0);
    app.pulse();
    assert_eq!(log.take(), ["0", "1", "2"]);
    app.pulse();
    assert_eq!(log.take(), ["3", "4"], "in the next round, each once");
    for n in [0, 2, 7] {
        cx_invoke(&mut app, own, n);
        app.pulse();
        app.pulse();
    }
    assert_eq!(log.take(), ["0", "1", "2", "3", "4", "2", "7"]);
    push_through(&mut app, own, 8);
    assert_eq!(log.take(), ["8"], "and nothing waits any more");
}

fn push_through(app: &mut SkApp, actor: Handle<Actor>, n: u32) {
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    attach!(cx, button.pressed => actor.act);
    app.pulse();
    push(app, button, n);
}

#[test]
fn each_hook_has_a_guard_of_its_own() {
    struct Fragile {
        log: Log,
        on_spawn: bool,
    }
    impl Fragile {
        fn on_spawn(&mut self, _cx: &mut Cx) {
            assert!(!self.on_spawn, "spawn hook");
        }
        fn on_destroy(&mut self, _cx: &mut Cx) {
            panic!("destroy hook");
        }
    }
    object! { Fragile { hooks { on_spawn on_destroy } } }
    impl Drop for Fragile {
        fn drop(&mut self) {
            self.log.note("dropped");
        }
    }
    let (log, (_world, mut app)) = (Log::default(), world());
    let reports = reporting(&mut app);
    app.pulse();
    let maker_log = log.clone();
    let cx = app.cx();
    let maker = cx.spawn(Actor::new(move |cx, stage, _| {
        let child = cx.under(stage.me).spawn(Fragile { log: maker_log.clone(), on_spawn: true });
        assert!(!cx.is_alive(child), "it panicked and is destroyed");
        cx.under(stage.me).spawn(Fragile { log: maker_log.clone(), on_spawn: false });
        maker_log.note("maker went on");
        cx.destroy_later(stage.me);
    }));
    attach!(cx, cx.fast_zone().pulse => maker.go);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["maker went on", "dropped", "dropped"]);
    let messages: Vec<String> = reports.0.take().into_iter().map(|report| report.message).collect();
    assert_eq!(messages, ["spawn hook", "destroy hook", "destroy hook"]);
}

#[test]
fn a_panic_in_a_timer_a_queued_call_and_a_drop_leaves_the_loop_running() {
    struct Grenade;
    object! { Grenade { } }
    impl Drop for Grenade {
        fn drop(&mut self) {
            panic!("pin");
        }
    }
    let (log, (simulation, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let (a, b) = (bomb(cx, "a"), bomb(cx, "b"));
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    let grenade = cx.spawn(Grenade);
    attach!(cx, timer.timeout => a.go);
    attach!(cx, timer.timeout => b.go, Queued);
    attach!(cx, timer.timeout => lamp.blink);
    timer.start_once(cx, ms(20)).unwrap();
    cx.destroy_later(grenade);
    simulation.run_for(&mut app, ms(60));
    assert_eq!(log.take(), ["lamp blinks"]);
    assert_eq!(app.cx().counters().panics, 3);
    assert!(!app.cx().exists(grenade));
}

#[test]
fn failures_are_reported_in_the_round_they_happen() {
    let (_world, mut app) = world();
    let reports = reporting(&mut app);
    let lidar = app.cx().spawn(Lidar);
    app.pulse();
    app.cx().invoke_method(lidar, "scan", &[]).unwrap();
    app.pulse();
    assert_eq!(reports.0.take().len(), 1);
}
