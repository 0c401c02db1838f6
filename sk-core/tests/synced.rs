//! The timing mode `Synced`: rounds are ticks only when a source says so.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;

fn synced(simulation: &Simulation) -> SkApp {
    simulation.app_with(|settings| {
        settings.mode = TimingMode::Synced;
        settings.interval = ms(10);
    })
}

#[test]
fn a_sync_tick_makes_the_next_round_a_tick_without_a_wait_and_every_other_round_has_none() {
    let simulation = Simulation::new(1);
    let mut app = synced(&simulation);
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let source = cx.spawn(Actor::new(|cx, _, _| {
        cx.sync_tick();
        cx.sync_tick();
    }));
    attach!(cx, timer.timeout => source.go);
    let ticks = Rc::new(std::cell::RefCell::new(Vec::new()));
    let seen = ticks.clone();
    let beat = cx.spawn(Actor::new(move |cx, _, _| seen.borrow_mut().push(cx.now())));
    attach!(cx, cx.fast_zone().pulse => beat.go);
    timer.start(cx, ms(7)).unwrap();
    simulation.run_for(&mut app, ms(7 * 20) + Duration::from_micros(1));
    let wanted: Vec<Instant> = (1..=20).map(|tick| Instant::ZERO + ms(7 * tick)).collect();
    assert_eq!(*ticks.borrow(), wanted, "at the moment of the timer, once each");
    let stats = app.cx().stats();
    assert_eq!((stats.ticks, stats.counters.sync_lost), (20, 0));
    assert!(stats.rounds > 40, "the rounds of the timer itself are none");
}

#[test]
fn s164_each_four_intervals_without_a_tick_are_counted_and_told() {
    let simulation = Simulation::new(2);
    let mut app = synced(&simulation);
    let cx = app.cx();
    let told = Rc::new(std::cell::Cell::new(0));
    let seen = told.clone();
    let alarm = cx.spawn(Actor::new(move |_, _, _| seen.set(seen.get() + 1)));
    attach!(cx, cx.event_loop().sync_lost => alarm.go);
    simulation.run_for(&mut app, ms(399));
    assert_eq!(app.cx().counters().sync_lost, 9);
    assert_eq!(told.get(), 9);
    app.cx().sync_tick();
    simulation.run_for(&mut app, ms(39));
    assert_eq!(app.cx().counters().sync_lost, 9, "the wait began anew with the tick");
    simulation.run_for(&mut app, ms(10));
    assert_eq!((app.cx().counters().sync_lost, app.cx().stats().ticks), (10, 1));
}

#[test]
fn calls_and_timers_run_in_rounds_that_are_no_ticks() {
    let simulation = Simulation::new(3);
    let mut app = synced(&simulation);
    let cx = app.cx();
    let (first, second) = (cx.spawn(Button::default()), cx.spawn(Button::default()));
    let ran = Rc::new(std::cell::Cell::new(0));
    let seen = ran.clone();
    let worker = cx.spawn(Actor::new(move |cx, _, _| {
        seen.set(seen.get() + 1);
        assert_eq!(cx.pulse().number, 0);
    }));
    attach!(cx, first.pressed => worker.go(), Queued);
    attach!(cx, second.pressed => worker.go());
    app.pulse();
    for button in [first, second] {
        app.cx().with(button, |button, cx| button.press(cx)).unwrap();
    }
    simulation.run_for(&mut app, ms(5));
    assert_eq!(ran.get(), 2);
}

#[test]
fn in_another_mode_a_sync_tick_does_nothing_then_or_later() {
    let simulation = Simulation::new(4);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    app.pulse();
    app.cx().sync_tick();
    app.set_mode(TimingMode::Synced);
    let before = app.cx().stats().ticks;
    simulation.run_for(&mut app, ms(5));
    assert_eq!(app.cx().stats().ticks, before);
    app.cx().sync_tick();
    app.set_mode(TimingMode::Coarse);
    app.pulse();
    app.set_mode(TimingMode::Synced);
    let before = app.cx().stats().ticks;
    simulation.run_for(&mut app, ms(5));
    assert_eq!(app.cx().stats().ticks, before, "what came in between the modes is forgotten");
}
