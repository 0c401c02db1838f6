//! Rounds that take too long: overruns, overload and its culprit.

mod objects;

use objects::*;
use sk_core::eventloop::{Overload, Overrun, Step};
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::thread::PostError;
use sk_core::world::{Clock, SimulatedClock};
use std::cell::{Cell, RefCell};
use std::sync::Arc;

#[derive(Clone, Default)]
struct Warnings {
    overloads: Rc<RefCell<Vec<Overload>>>,
    missed: Rc<RefCell<Vec<u64>>>,
}
struct Guard(Warnings);
impl Guard {
    fn overloaded(&mut self, _cx: &mut Cx, overload: &Overload) {
        self.0.overloads.borrow_mut().push(overload.clone());
    }
    fn overrun(&mut self, _cx: &mut Cx, missed: u64) {
        self.0.missed.borrow_mut().push(missed);
    }
}
object! { Guard { slots { overloaded(&Overload) overrun(u64) } } }

fn guarded(app: &mut SkApp) -> Warnings {
    let warnings = Warnings::default();
    let cx = app.cx();
    let guard = cx.spawn(Guard(warnings.clone()));
    attach!(cx, cx.event_loop().overloaded => guard.overloaded);
    attach!(cx, cx.event_loop().overrun => guard.overrun);
    warnings
}

/// An object whose slot takes as long as the cell says.
fn worker(simulation: &Simulation, app: &mut SkApp, name: &str, takes: &Rc<Cell<u64>>) -> Handle<Actor> {
    let (clock, takes) = (simulation.clock(), takes.clone());
    app.cx().named(name).spawn(Actor::new(move |cx, stage, n| {
        clock.advance(Duration::from_micros(takes.get()));
        stage.out.emit(cx, n);
    }))
}

#[test]
fn s37_an_overrun_is_measured_and_named() {
    let (simulation, mut app) = world();
    let warnings = guarded(&mut app);
    let takes = Rc::new(Cell::new(0));
    let (quick, slow) = (
        worker(&simulation, &mut app, "quick", &Rc::new(Cell::new(200))),
        worker(&simulation, &mut app, "slow", &takes),
    );
    let cx = app.cx();
    attach!(cx, cx.fast_zone().pulse => quick.go);
    attach!(cx, cx.fast_zone().pulse => slow.go);
    simulation.run_for(&mut app, Duration::from_secs(1));
    assert_eq!((app.cx().stats().overruns, warnings.missed.take().len()), (0, 0));
    assert!(app.cx().stats().mean_interval < ms(11));

    takes.set(12_000);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let stats = app.cx().stats();
    assert!(stats.overruns > 40, "{}", stats.overruns);
    assert!(stats.mean_interval > ms(12), "overruns raise the mean period: {:?}", stats.mean_interval);
    assert_eq!(stats.job_time.max.as_millis(), 12);
    assert_eq!(warnings.missed.borrow().len() as u64, stats.overruns);
    let overloads = warnings.overloads.take();
    assert_eq!(overloads.len(), 1, "once per episode");
    assert_eq!(overloads[0].step, Step::Tick);
    let culprit = overloads[0].culprit.as_ref().unwrap();
    assert_eq!((culprit.path.as_str(), culprit.slot.as_str()), ("slow", "Actor.go"));
    assert_eq!(culprit.time, ms(12));
    assert!(overloads[0].to_string().contains("Actor.go of slow took 12ms"), "{}", overloads[0]);
}

#[test]
fn overloaded_is_told_once_per_episode() {
    let (simulation, mut app) = world();
    let warnings = guarded(&mut app);
    let takes = Rc::new(Cell::new(0));
    let slow = worker(&simulation, &mut app, "slow", &takes);
    let cx = app.cx();
    attach!(cx, cx.fast_zone().pulse => slow.go);
    for episode in 1..=3 {
        takes.set(9_000);
        simulation.run_for(&mut app, Duration::from_secs(5));
        takes.set(0);
        simulation.run_for(&mut app, Duration::from_secs(5));
        assert_eq!(warnings.overloads.borrow().len(), episode);
    }
    assert_eq!(app.cx().stats().overruns, 0, "nine of ten milliseconds are no overrun");
}

#[test]
fn the_culprit_is_named_without_the_time_of_the_slots_it_called() {
    let (simulation, mut app) = world();
    let warnings = guarded(&mut app);
    let innocent = worker(&simulation, &mut app, "innocent", &Rc::new(Cell::new(1_000)));
    let guilty = worker(&simulation, &mut app, "guilty", &Rc::new(Cell::new(8_000)));
    let cx = app.cx();
    attach!(cx, cx.fast_zone().pulse => innocent.go);
    attach!(cx, innocent.out => guilty.act);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let overload = warnings.overloads.take().remove(0);
    let culprit = overload.culprit.unwrap();
    assert_eq!(
        (culprit.path.as_str(), culprit.slot.as_str(), culprit.time),
        ("guilty", "Actor.act", ms(8))
    );
}

#[test]
fn s45_slow_work_on_the_fast_tick_is_shown() {
    let (simulation, mut app) = world();
    let warnings = guarded(&mut app);
    let display = worker(&simulation, &mut app, "display", &Rc::new(Cell::new(9_500)));
    let cx = app.cx();
    attach!(cx, cx.fast_zone().pulse => display.go);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let stats = app.cx().stats();
    assert!(stats.step_time[Step::Tick as usize] > ms(400), "{:?}", stats.step_time);
    assert_eq!(warnings.overloads.take()[0].culprit.as_ref().unwrap().path, "display");

    // The remedy: on the slow zone it costs one tick in many.
    let cx = app.cx();
    detach!(cx, cx.fast_zone().pulse => display.go);
    attach!(cx, cx.slow_zone().pulse => display.go);
    let before = app.cx().stats();
    simulation.run_for(&mut app, Duration::from_secs(10));
    let spent = app.cx().stats().step_time[Step::Tick as usize] - before.step_time[Step::Tick as usize];
    assert!(spent < ms(500), "{spent:?}");
}

/// Sends what its loop warns of to another loop's guard.
struct Reporter(Remote<Guard>);
impl Reporter {
    fn report(&mut self, _cx: &mut Cx, overload: &Overload) -> Result<(), PostError> {
        let overload = overload.clone();
        self.0.post(move |guard, cx| guard.overloaded(cx, &overload))
    }
}
object! { Reporter { slots { report(&Overload) } } }

/// Takes longer for a frame than its producer.
struct Detector(Arc<SimulatedClock>);
impl Detector {
    fn look(&mut self, _cx: &mut Cx, _frame: u32) {
        self.0.advance(ms(25));
    }
}
object! { Detector { slots { look(u32) } } }

#[test]
fn s38_a_slow_consumer_is_named() {
    let (simulation, mut app) = world();
    let warnings = guarded(&mut app);
    let vision = SkThread::new("vision").start(app.cx()).unwrap();
    let cx = app.cx();
    let guard = cx.spawn(Guard(warnings.clone()));
    let (guard, clock) = (cx.remote(guard), simulation.clock());
    let detector = vision
        .build(move |cx| {
            let reporter = cx.spawn(Reporter(guard));
            attach!(cx, cx.event_loop().overloaded => reporter.report);
            let detector = cx.named("detector").spawn(Detector(clock));
            cx.remote(detector)
        })
        .unwrap();
    let cx = app.cx();
    let camera = cx.spawn(Button::default());
    attach!(cx, cx.fast_zone().pulse => camera.press);
    attach!(cx, camera.pressed => detector.look, Latest);
    simulation.run_for(&mut app, Duration::from_secs(2));
    let overloads = warnings.overloads.take();
    assert_eq!(overloads.len(), 1, "{overloads:?}");
    assert_eq!(overloads[0].culprit.as_ref().unwrap().path, "detector");
    assert_eq!(overloads[0].step, Step::Queued);
    vision.stop();
}

fn schedule(overrun: Overrun) -> (Simulation, SkApp) {
    let simulation = Simulation::new(1);
    let app = simulation.app_with(|settings| {
        settings.mode = TimingMode::Realtime;
        settings.overrun = overrun;
    });
    (simulation, app)
}

/// Ticks at which the first of the given rounds took 35 ms, in milliseconds.
fn ticks_after_a_stall(overrun: Overrun) -> (Vec<u64>, u64, u64) {
    let (simulation, mut app) = schedule(overrun);
    let times = Rc::new(RefCell::new(Vec::new()));
    let (seen, clock) = (times.clone(), simulation.clock());
    let cx = app.cx();
    let beat = cx.spawn(Actor::new(move |cx, _, _| {
        seen.borrow_mut().push(clock.now().as_nanos() / 1_000_000);
        if cx.pulse().number == 3 {
            clock.advance(ms(35));
        }
    }));
    attach!(cx, cx.fast_zone().pulse => beat.go);
    simulation.run_for(&mut app, ms(100));
    let stats = app.cx().stats();
    (times.take(), stats.missed, stats.overruns)
}

#[test]
fn skip_keeps_the_phase_and_counts_what_it_left_out() {
    let (ticks, missed, overruns) = ticks_after_a_stall(Overrun::Skip);
    assert_eq!(ticks, [20, 30, 70, 80, 90, 100]);
    assert_eq!((missed, overruns), (3, 1));
}

#[test]
fn catch_up_makes_up_for_missed_ticks_up_to_its_bound() {
    let (ticks, missed, _) = ticks_after_a_stall(Overrun::CatchUp(10));
    assert_eq!(ticks, [20, 30, 65, 65, 65, 70, 80, 90, 100]);
    assert_eq!(missed, 0);
    let (ticks, missed, _) = ticks_after_a_stall(Overrun::CatchUp(1));
    assert_eq!(ticks, [20, 30, 65, 70, 80, 90, 100]);
    assert_eq!(missed, 2);
}
