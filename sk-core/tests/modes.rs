//! The timing modes on the machine's own clock. Only bounds that cannot fail on a busy machine are asserted.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::world::Clock;
use std::cell::RefCell;
use std::sync::mpsc::channel;

/// Runs so many ticks of one millisecond and gives the instants at which they came.
fn ticks(mode: TimingMode, count: usize) -> (Vec<Instant>, SkApp) {
    let mut app = SkApp::builder().mode(mode).interval(ms(1)).build().unwrap();
    let times = Rc::new(RefCell::new(Vec::new()));
    let seen = times.clone();
    let cx = app.cx();
    let beat = cx.spawn(Actor::new(move |cx, _, _| {
        seen.borrow_mut().push(cx.now());
        if seen.borrow().len() == count {
            cx.quit();
        }
    }));
    attach!(cx, cx.fast_zone().pulse => beat.go);
    assert_eq!(app.run(), Run::Quit);
    (times.take(), app)
}

#[test]
fn s32_coarse_never_ticks_early() {
    let (times, mut app) = ticks(TimingMode::Coarse, 50);
    for pair in times.windows(2) {
        let gap = pair[1].since(pair[0]);
        assert!(gap > ms(1), "the period is never at or under the asked one: {gap:?}");
    }
    let stats = app.cx().stats();
    assert!(stats.mean_interval > ms(1));
    assert!(stats.wake_error.count >= 50);
}

#[test]
fn realtime_ticks_on_the_phase_of_its_schedule_and_never_before() {
    let (_, mut app) = ticks(TimingMode::Realtime, 50);
    let mut before: Option<Instant> = None;
    for _ in 0..100 {
        app.pulse();
        let pulse = *app.cx().pulse();
        assert!(pulse.now >= pulse.due);
        if let Some(before) = before {
            let apart = pulse.due.since(before);
            assert!(
                apart >= ms(1) && apart.as_nanos().is_multiple_of(1_000_000),
                "the phase is kept: {apart:?}"
            );
        }
        before = Some(pulse.due);
    }
}

#[test]
fn realtime_says_what_it_was_refused_and_runs_all_the_same() {
    let mut app = SkApp::builder()
        .mode(TimingMode::Realtime)
        .interval(ms(1))
        .configure(|settings| settings.realtime.cpu = Some(100_000))
        .build()
        .unwrap();
    app.pulse();
    app.pulse();
    let stats = app.cx().stats();
    assert_eq!(stats.ticks, 2);
    assert!(
        stats.refused_wishes.iter().any(|wish| wish.contains("CPU 100000")),
        "{:?}",
        stats.refused_wishes
    );
}

#[test]
fn s34_traffic_wakes_the_loop_early() {
    // The interval is an hour: only the message can end the wait.
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_secs(3600))
        .build()
        .unwrap();
    let (sender, receiver) = channel();
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let remote = cx.remote(button);
    let other = std::thread::spawn(move || {
        for _ in 0..100 {
            let sender = sender.clone();
            remote.post(move |_, cx| sender.send(cx.pulse().number).unwrap()).unwrap();
            receiver.recv().unwrap();
        }
        remote.post(|_, cx| cx.quit()).unwrap();
    });
    assert_eq!(app.run(), Run::Quit);
    other.join().unwrap();
    assert!(app.cx().stats().ticks >= 100, "each was a tick of its own");
}

#[test]
fn a_timer_ends_the_wait_of_a_select_io_loop() {
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_secs(3600))
        .build()
        .unwrap();
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let end = cx.spawn(Actor::new(|cx, _, _| cx.quit()));
    attach!(cx, timer.timeout => end.go);
    timer.start_once(cx, ms(5)).unwrap();
    assert_eq!(app.run(), Run::Quit);
    assert!(app.cx().now() >= Instant::ZERO + ms(5));
}

#[test]
fn s36_a_blocking_call_sets_the_pace() {
    let mut app = SkApp::builder().mode(TimingMode::NoTiming).build().unwrap();
    let (sender, receiver) = channel::<u32>();
    let feeder = std::thread::spawn(move || (0..20).for_each(|n| sender.send(n).unwrap()));
    let got = Rc::new(RefCell::new(Vec::new()));
    let seen = got.clone();
    let cx = app.cx();
    let reader = cx.spawn(Actor::new(move |cx, _, _| match receiver.recv() {
        Ok(n) => seen.borrow_mut().push((n, cx.pulse().number)),
        Err(_) => cx.quit(),
    }));
    attach!(cx, cx.fast_zone().pulse => reader.go);
    app.run();
    feeder.join().unwrap();
    let expected: Vec<(u32, u64)> = (0..20).map(|n| (n, u64::from(n) + 2)).collect();
    assert_eq!(got.take(), expected, "one pulse for each");
    assert_eq!(app.cx().stats().overruns, 0, "however long it blocked");
}

#[test]
fn without_a_blocking_call_no_timing_spins() {
    let mut app = SkApp::builder()
        .mode(TimingMode::NoTiming)
        .interval(Duration::from_secs(3600))
        .build()
        .unwrap();
    for _ in 0..1000 {
        app.pulse();
    }
    assert_eq!(app.cx().stats().ticks, 1000, "and nothing waited for the interval");
}

#[test]
fn an_app_can_run_again_after_it_ended() {
    let (_, mut app) = ticks(TimingMode::SelectIo, 3);
    let before = app.cx().stats().ticks;
    let cx = app.cx();
    let end = cx.spawn(Actor::new(|cx, _, _| cx.quit()));
    attach!(cx, cx.fast_zone().pulse => end.go);
    assert_eq!(app.run(), Run::Quit);
    assert!(app.cx().stats().ticks > before);
}

#[test]
fn s15_a_program_embeds_the_framework() {
    // A world of one's own around the loop: here another clock, with all else as it is.
    struct Slow(std::sync::Arc<dyn Clock>);
    impl Clock for Slow {
        fn now(&self) -> Instant {
            Instant::from_nanos(self.0.now().as_nanos() / 2)
        }
        fn since_epoch(&self) -> Duration {
            self.0.since_epoch()
        }
        fn sleep(&self, span: Duration) {
            self.0.sleep(span * 2);
        }
        fn sleep_until(&self, until: Instant) {
            self.0.sleep_until(Instant::from_nanos(until.as_nanos() * 2));
        }
    }
    let mut world = sk_core::world::World::real().unwrap();
    let real = world.clock.clone();
    world.clock = std::sync::Arc::new(Slow(real.clone()));
    let mut app = SkApp::builder().name("embedded").world(world).interval(ms(1)).build().unwrap();
    let before = real.now();
    for _ in 0..5 {
        app.pulse();
    }
    assert_eq!(app.cx().loop_name(), "embedded");
    assert!(real.now().since(before) >= ms(10), "five intervals of its own clock");
}
