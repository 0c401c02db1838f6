//! The three ticks of a loop, its rounds, and what a round does in which order.

mod objects;

use objects::*;
use sk_core::eventloop::SettingsError;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::world::Clock;

/// Counts the pulses of a zone and keeps the times of them, in milliseconds.
#[derive(Default)]
struct Beats(Vec<u64>);
impl Beats {
    fn beat(&mut self, cx: &mut Cx) {
        self.0.push(cx.now().as_nanos() / 1_000_000);
    }
}
object! { Beats { slots { beat() } } }

fn beats(app: &mut SkApp) -> [Handle<Beats>; 3] {
    let cx = app.cx();
    let beats = [(); 3].map(|()| cx.spawn(Beats::default()));
    attach!(cx, cx.fast_zone().pulse => beats[0].beat);
    attach!(cx, cx.slow_zone().pulse => beats[1].beat);
    attach!(cx, cx.one_sec_zone().pulse => beats[2].beat);
    beats
}

fn times(app: &mut SkApp, beats: Handle<Beats>) -> Vec<u64> {
    app.cx().with(beats, |beats, _| std::mem::take(&mut beats.0)).unwrap()
}

#[test]
fn s24_each_loop_emits_three_pulses() {
    let (simulation, mut app) = world();
    let zones = beats(&mut app);
    simulation.run_for(&mut app, Duration::from_secs(3));
    let [fast, slow, one_sec] = zones.map(|zone| times(&mut app, zone).len());
    assert_eq!((fast, slow, one_sec), (299, 12, 3));
}

#[test]
fn s27_the_one_second_tick_is_one_second() {
    let simulation = Simulation::new(1);
    for (interval, slow) in [(1, 10), (10, 250), (700, 900)] {
        let mut app = simulation.app_with(|settings| {
            settings.interval = ms(interval);
            settings.slow_interval = ms(slow);
        });
        let [_, _, one_sec] = beats(&mut app);
        let start = simulation.clock().now().as_nanos() / 1_000_000;
        simulation.run_for(&mut app, Duration::from_secs(10));
        let times = times(&mut app, one_sec);
        let mut before = start;
        for time in &times {
            let gap = time - before;
            assert!((1000..1000 + interval).contains(&gap), "{gap} ms at {interval} ms");
            before = *time;
        }
        assert!(times.len() >= 7, "{}", times.len());
    }
}

#[test]
fn s31_slow_ticks_are_late_by_at_most_one_fast_interval() {
    let simulation = Simulation::new(1);
    for interval in [1, 7, 10, 33] {
        let mut app = simulation.app_with(|settings| {
            settings.interval = ms(interval);
            settings.slow_interval = ms(100);
        });
        let [_, slow, _] = beats(&mut app);
        let mut before = simulation.clock().now().as_nanos() / 1_000_000;
        simulation.run_for(&mut app, Duration::from_secs(5));
        for time in times(&mut app, slow) {
            let late = time - before - 100;
            assert!(late < interval, "{late} ms at {interval} ms");
            before = time;
        }
    }
}

#[test]
fn s26_a_slow_interval_below_the_fast_is_refused() {
    let (simulation, mut app) = world();
    let refused = app.cx().set_slow_interval(ms(9));
    assert_eq!(refused, Err(SettingsError::SlowBelowFast { slow: ms(9), fast: ms(10) }));
    assert_eq!(app.cx().settings().slow_interval, ms(250), "the old one stays");
    assert_eq!(app.set_interval(Duration::ZERO), Err(SettingsError::ZeroInterval));
    assert!(matches!(
        SkApp::builder().interval(ms(10)).slow_interval(ms(5)).build(),
        Err(AppError::Settings(SettingsError::SlowBelowFast { .. }))
    ));
    app.cx().set_slow_interval(ms(10)).unwrap();
    app.set_interval(ms(30)).unwrap();
    assert_eq!(app.cx().settings().slow_interval, ms(30), "raised with the fast one");
    drop(simulation);
}

#[test]
fn s28_a_zones_pulse_is_a_signal() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let zone = cx.fast_zone();
    let (direct, queued) = (cx.spawn(Lamp::new("direct", &log)), cx.spawn(Lamp::new("queued", &log)));
    let once = cx.spawn(Lamp::new("once", &log));
    attach!(cx, zone.pulse => direct.blink);
    attach!(cx, zone.pulse => queued.blink, Queued);
    attach!(cx, zone.pulse => once.blink, OneShot);
    cx.attach_by_name(zone, "pulse", direct, "blink", Mode::Queued).unwrap();
    for _ in 0..3 {
        app.pulse();
    }
    let expected = ["direct blinks", "once blinks", "direct blinks", "queued blinks"];
    assert_eq!(log.take(), expected);
    let cx = app.cx();
    detach!(cx, zone.pulse => direct.blink);
    detach!(cx, zone.pulse => queued.blink);
    app.pulse();
    log.take();
    app.pulse();
    assert_eq!(log.take(), ["queued blinks"]);
}

#[test]
fn s25_the_fast_tick_is_indivisible() {
    // Nothing comes between the slots of a tick: not a timer that falls due, not a queued call.
    let (log, (simulation, mut app)) = (Log::default(), world());
    let clock = simulation.clock();
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let (late, queued) = (cx.spawn(Lamp::new("timer", &log)), cx.spawn(Lamp::new("queued", &log)));
    let seen = log.clone();
    let first = cx.spawn(Actor::new(move |cx, stage, _| {
        seen.note("first");
        stage.out.emit(cx, 1);
        clock.advance(ms(50));
    }));
    let second = cx.spawn(Lamp::new("second", &log));
    attach!(cx, first.out => queued.on, Queued);
    attach!(cx, timer.timeout => late.blink);
    attach!(cx, cx.fast_zone().pulse => first.go);
    attach!(cx, cx.fast_zone().pulse => second.blink);
    timer.start_once(cx, ms(15)).unwrap();
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["first", "second blinks", "timer blinks"]);
    app.pulse();
    assert_eq!(log.take(), ["first", "second blinks", "queued 1"]);
}

#[test]
fn pulse_the_steps_of_a_round_run_in_their_order() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let zone_lamps = ["fast", "slow", "one second"].map(|name| cx.spawn(Lamp::new(name, &log)));
    cx.configure(|settings| settings.slow_interval = ms(10)).unwrap();
    let timer = cx.spawn(Timer::default());
    let on_timer = cx.spawn(Lamp::new("timer", &log));
    let queued = cx.spawn(Lamp::new("queued", &log));
    let doomed = cx.spawn(Lamp::new("doomed", &log));
    let posted = cx.spawn(Lamp::new("posted", &log));
    let button = cx.spawn(Button::default());
    attach!(cx, cx.fast_zone().pulse => zone_lamps[0].blink);
    attach!(cx, cx.slow_zone().pulse => zone_lamps[1].blink);
    attach!(cx, timer.timeout => on_timer.blink);
    attach!(cx, button.pressed => queued.on, Queued);
    app.pulse();
    push(&mut app, button, 1);
    let cx = app.cx();
    cx.destroy_later(doomed);
    timer.start_once(cx, ms(10)).unwrap();
    cx.remote(posted).post(|lamp, cx| lamp.blink(cx)).unwrap();
    attach!(cx, cx.event_loop().buried => zone_lamps[2].blink());
    app.pulse();
    let expected = [
        "fast blinks",
        "slow blinks",
        "timer blinks",
        "queued 1",
        "posted blinks",
        "doomed goes",
        "doomed dropped",
        "one second blinks",
    ];
    assert_eq!(log.take(), expected, "the last is the account, by a link the same round has made");
}

#[test]
fn the_pulse_says_where_the_loop_stands() {
    let (simulation, mut app) = world();
    app.pulse();
    app.pulse();
    let pulse = *app.cx().pulse();
    assert_eq!((pulse.number, pulse.round, pulse.interval, pulse.missed), (2, 2, ms(10), 0));
    assert_eq!((pulse.due, pulse.now), (pulse.now, app.cx().now()));
    simulation.clock().advance(ms(12));
    app.pulse();
    let pulse = *app.cx().pulse();
    assert_eq!(pulse.now.since(pulse.due), Duration::ZERO, "the wait began after the time had passed");
}

#[test]
fn s44_a_new_interval_holds_from_the_next_pulse() {
    let (simulation, mut app) = world();
    let [fast, ..] = beats(&mut app);
    let cx = app.cx();
    let changer = cx.spawn(Actor::new(|cx, _, n| {
        if cx.pulse().number == 3 {
            assert_eq!(n, 0);
            cx.set_interval(ms(5)).unwrap();
        }
    }));
    attach!(cx, cx.fast_zone().pulse => changer.go);
    simulation.run_for(&mut app, ms(50));
    assert_eq!(times(&mut app, fast), [20, 30, 35, 40, 45, 50]);
    app.set_mode(TimingMode::Realtime);
    simulation.run_for(&mut app, ms(20));
    assert_eq!(times(&mut app, fast).len(), 4);
    assert_eq!(app.cx().stats().mode, TimingMode::Realtime);
    assert_eq!(app.cx().stats().interval, ms(5));
    app.set_mode(TimingMode::SelectIo);
    simulation.run_for(&mut app, ms(20));
    assert_eq!(times(&mut app, fast).len(), 4);
    app.set_mode(TimingMode::NoTiming);
    simulation.run_for(&mut app, ms(20));
    assert_eq!(times(&mut app, fast).len(), 4, "in simulation a pulse without timing takes one interval");
    app.set_mode(TimingMode::Coarse);
    simulation.run_for(&mut app, ms(20));
    assert_eq!(times(&mut app, fast).len(), 4);
}

#[test]
fn s30_only_the_fast_tick_sleeps() {
    // Slow and one-second ticks come in rounds of the fast one: a loop that has them sleeps no oftener.
    let simulation = Simulation::new(1);
    let rounds = |with_slow: bool| {
        let mut app = simulation.app_with(|settings| settings.slow_interval = ms(15));
        if with_slow {
            beats(&mut app);
        }
        simulation.run_for(&mut app, Duration::from_secs(2));
        (app.cx().stats().rounds, app.cx().stats().ticks)
    };
    assert_eq!(rounds(true), rounds(false));
    assert_eq!(rounds(true), (200, 200));
}

#[test]
fn s29_elapsed_time_counts_nanoseconds() {
    struct Blinker {
        since: SkElapsedTime,
        blinks: u32,
    }
    impl Blinker {
        fn on_tick(&mut self, cx: &mut Cx) {
            if self.since.restart_if_passed(cx.now(), ms(35)) {
                self.blinks += 1;
            }
        }
    }
    object! { Blinker { slots { on_tick() } } }
    let (simulation, mut app) = world();
    let cx = app.cx();
    let since = SkElapsedTime::started(cx.now());
    let blinker = cx.spawn(Blinker { since, blinks: 0 });
    attach!(cx, cx.fast_zone().pulse => blinker.on_tick);
    simulation.run_for(&mut app, ms(200));
    assert_eq!(app.cx().with(blinker, |blinker, _| blinker.blinks), Ok(5));
    let one_ns_later = app.cx().now() + Duration::from_nanos(1);
    assert_eq!(since.elapsed(one_ns_later), ms(200) + Duration::from_nanos(1));
}

#[test]
fn an_object_can_set_itself_up_and_then_run_at_each_tick() {
    struct Blink {
        log: Log,
        on: bool,
    }
    impl Blink {
        fn setup(&mut self, cx: &mut Cx) {
            self.log.note("setup");
            let this = cx.this(self);
            attach!(cx, cx.fast_zone().pulse => this.repeat);
        }
        fn on_spawn(&mut self, cx: &mut Cx) {
            self.setup(cx);
        }
        fn repeat(&mut self, _cx: &mut Cx) {
            self.on = !self.on;
            self.log.note(if self.on { "on" } else { "off" });
        }
    }
    object! { Blink { slots { repeat() } hooks { on_spawn } } }
    let (log, (_world, mut app)) = (Log::default(), world());
    app.cx().spawn(Blink { log: log.clone(), on: false });
    for _ in 0..4 {
        app.pulse();
    }
    assert_eq!(log.take(), ["setup", "on", "off", "on"]);
}
