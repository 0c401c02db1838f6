//! Timers as objects: due times, phase, restarting and stopping, also in their own slot.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;

/// A lamp that writes down the virtual time at which the timer fired.
fn watched(simulation: &Simulation, app: &mut SkApp) -> (Log, Handle<Timer>) {
    let log = Log::default();
    let seen = log.clone();
    let clock = simulation.clock();
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let listener = cx.spawn(Actor::new(move |_, _, _| {
        use sk_core::world::Clock;
        seen.note((clock.now().as_nanos() / 1_000_000).to_string());
    }));
    attach!(cx, timer.timeout => listener.go);
    (log, timer)
}

#[test]
fn a_timer_repeats_until_it_is_stopped() {
    let (simulation, mut app) = world();
    let (log, timer) = watched(&simulation, &mut app);
    timer.start(app.cx(), ms(30)).unwrap();
    assert_eq!(timer.is_running(app.cx()), Ok(true));
    simulation.run_for(&mut app, ms(100));
    assert_eq!(log.take(), ["30", "60", "90"]);
    timer.stop(app.cx()).unwrap();
    timer.stop(app.cx()).unwrap();
    simulation.run_for(&mut app, ms(100));
    assert_eq!(log.take(), [""; 0]);
    assert_eq!(timer.is_running(app.cx()), Ok(false));
    assert_eq!(app.cx().counters().timers_fired, 3);
}

#[test]
fn a_timer_started_once_fires_once() {
    let (simulation, mut app) = world();
    let (log, timer) = watched(&simulation, &mut app);
    timer.start_once(app.cx(), ms(25)).unwrap();
    simulation.run_for(&mut app, ms(200));
    assert_eq!(log.take(), ["30"], "in the first round at or after it is due");
    assert_eq!(timer.is_running(app.cx()), Ok(false));
}

#[test]
fn starting_again_begins_anew() {
    let (simulation, mut app) = world();
    let (log, timer) = watched(&simulation, &mut app);
    timer.start(app.cx(), ms(50)).unwrap();
    simulation.run_for(&mut app, ms(40));
    timer.start(app.cx(), ms(50)).unwrap();
    simulation.run_for(&mut app, ms(60));
    assert_eq!(log.take(), ["90"]);
    timer.start_once(app.cx(), ms(20)).unwrap();
    simulation.run_for(&mut app, ms(100));
    assert_eq!(log.take(), ["120"], "and is no longer a repeating one");
}

#[test]
fn a_late_timer_keeps_its_phase_and_leaves_out_what_it_missed() {
    let (simulation, mut app) = world();
    let (log, timer) = watched(&simulation, &mut app);
    timer.start(app.cx(), ms(20)).unwrap();
    simulation.run_for(&mut app, ms(20));
    simulation.clock().advance(ms(75));
    simulation.run_for(&mut app, ms(60));
    // The wait that stood till 30 ends at 95; 40, 60 and 80 are one call, and the next are in phase: 100, 120, 140.
    assert_eq!(log.take(), ["20", "95", "105", "125", "145"]);
}

#[test]
fn a_period_below_the_interval_fires_once_a_round() {
    let (simulation, mut app) = world();
    let (log, timer) = watched(&simulation, &mut app);
    app.pulse();
    timer.start(app.cx(), ms(1)).unwrap();
    simulation.run_for(&mut app, ms(30));
    assert_eq!(log.take(), ["20", "30", "40"]);
    timer.start(app.cx(), Duration::ZERO).unwrap();
    simulation.run_for(&mut app, ms(20));
    assert_eq!(log.take(), ["50", "60"], "even one without any period");
}

#[test]
fn a_timer_may_be_restarted_and_stopped_in_its_own_slot() {
    let (log, (simulation, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let seen = log.clone();
    let mut left = 3;
    let slot = cx.spawn(Actor::new(move |cx, _, _| {
        seen.note((cx.now().as_nanos() / 1_000_000).to_string());
        left -= 1;
        if left > 0 {
            timer.start(cx, ms(10 * left)).unwrap();
        } else {
            timer.stop(cx).unwrap();
        }
    }));
    attach!(cx, timer.timeout => slot.go);
    app.pulse();
    timer.start_once(app.cx(), Duration::ZERO).unwrap();
    simulation.run_for(&mut app, ms(200));
    assert_eq!(log.take(), ["20", "40", "50"]);
}

#[test]
fn a_timer_armed_while_timers_fire_waits_for_the_next_round() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (first, second) = (cx.spawn(Timer::default()), cx.spawn(Timer::default()));
    let lamp = cx.spawn(Lamp::new("second", &log));
    let arm = cx.spawn(Actor::new(move |cx, _, _| second.start_once(cx, Duration::ZERO).unwrap()));
    attach!(cx, first.timeout => arm.go);
    attach!(cx, second.timeout => lamp.blink);
    app.pulse();
    first.start_once(app.cx(), Duration::ZERO).unwrap();
    app.pulse();
    assert_eq!(log.take(), [""; 0]);
    app.pulse();
    assert_eq!(log.take(), ["second blinks"]);
}

#[test]
fn timers_due_at_once_fire_in_the_order_they_were_due_and_armed() {
    let (log, (simulation, mut app)) = (Log::default(), world());
    let cx = app.cx();
    for (name, after) in [("c", 9), ("a", 5), ("b", 5), ("d", 9)] {
        let (timer, lamp) = (cx.spawn(Timer::default()), cx.spawn(Lamp::new(name, &log)));
        attach!(cx, timer.timeout => lamp.blink);
        timer.start_once(cx, ms(after)).unwrap();
    }
    app.pulse();
    let cx = app.cx();
    assert_eq!(cx.counters().timers_fired, 4);
    assert_eq!(log.take(), [""; 0], "fired in the very round that made the links");
    drop(app);
    log.take();

    let mut app = simulation.app();
    let cx = app.cx();
    let mut timers = Vec::new();
    for (name, after) in [("c", 19), ("a", 15), ("b", 15), ("d", 19)] {
        let (timer, lamp) = (cx.spawn(Timer::default()), cx.spawn(Lamp::new(name, &log)));
        attach!(cx, timer.timeout => lamp.blink);
        timers.push((timer, after));
    }
    for (timer, after) in timers {
        timer.start_once(cx, ms(after)).unwrap();
    }
    simulation.run_for(&mut app, ms(30));
    assert_eq!(log.take(), ["a blinks", "b blinks", "c blinks", "d blinks"]);
}

#[test]
fn a_timer_that_is_destroyed_stops_at_once() {
    let (simulation, mut app) = world();
    let (log, timer) = watched(&simulation, &mut app);
    timer.start(app.cx(), ms(10)).unwrap();
    let cx = app.cx();
    let killer = cx.spawn(Actor::new(move |cx, _, _| cx.destroy_later(timer)));
    attach!(cx, cx.fast_zone().pulse => killer.go);
    simulation.run_for(&mut app, ms(50));
    assert_eq!(log.take(), [""; 0], "at 20 ms it was marked in the tick, before the timers");
    assert_eq!(app.cx().counters().timers_fired, 1, "at 10 ms, with no link yet");
    assert_eq!(timer.start(app.cx(), ms(1)), Err(Access::Gone));
    assert_eq!(timer.stop(app.cx()), Err(Access::Gone));
    assert_eq!(timer.is_running(app.cx()), Err(Access::Gone));
}

#[test]
fn many_timers_come_and_go() {
    let (simulation, mut app) = world();
    let before = app.cx().stats().objects;
    let log = Log::default();
    let lamp = app.cx().spawn(Lamp::new("lamp", &log));
    for round in 0..50u64 {
        let cx = app.cx();
        let timers: Vec<_> = (0..40).map(|_| cx.spawn(Timer::default())).collect();
        for (i, &timer) in timers.iter().enumerate() {
            attach!(cx, timer.timeout => lamp.blink);
            // Half of them would fire in an hour only; all are destroyed by the next round but ten.
            timer
                .start_once(cx, if i % 2 == 0 { Duration::from_secs(3600) } else { ms(15) })
                .unwrap();
        }
        simulation.run_for(&mut app, ms(10));
        for &timer in &timers[10..] {
            app.cx().destroy_later(timer);
        }
        simulation.run_for(&mut app, ms(20));
        assert_eq!(log.take().len(), 5, "round {round}");
        for &timer in &timers[..10] {
            app.cx().destroy_later(timer);
        }
    }
    simulation.run_for(&mut app, ms(20));
    assert_eq!(app.cx().stats().objects, before + 1);
}
