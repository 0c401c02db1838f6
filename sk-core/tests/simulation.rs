//! Whole programs in a simulated world: determinism, several loops, workers, POSIX signals.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::world::OsSignal;

/// Writes into a list on the other side who ticked.
#[derive(Default)]
struct Scribe(Vec<u32>);
impl Scribe {
    fn note(&mut self, _cx: &mut Cx, who: u32) {
        self.0.push(who);
    }
}
object! { Scribe { slots { note(u32) } } }

struct Ticker {
    own: u32,
    ticked: Signal<u32>,
}
impl Ticker {
    fn tick(&mut self, cx: &mut Cx) {
        self.ticked.emit(cx, self.own);
    }
}
object! { Ticker { signals { ticked(u32) } slots { tick() } } }

/// Three loops that tick at the same moments and write to a fourth.
fn run(seed: u64) -> (Vec<u32>, u64) {
    let simulation = Simulation::new(seed);
    let mut app = simulation.app();
    let scribe = app.cx().spawn(Scribe::default());
    let remote = app.cx().remote(scribe);
    let threads: Vec<SkThread> = (0..3)
        .map(|own| {
            let thread = SkThread::new(&format!("ticker {own}")).start(app.cx()).unwrap();
            let scribe = remote.clone();
            thread
                .build(move |cx| {
                    let ticker = cx.spawn(Ticker { own, ticked: Signal::new() });
                    attach!(cx, cx.fast_zone().pulse => ticker.tick);
                    attach!(cx, ticker.ticked => scribe.note, Queued);
                })
                .unwrap();
            thread
        })
        .collect();
    simulation.run_for(&mut app, ms(200));
    let seen = app.cx().with(scribe, |scribe, _| scribe.0.clone()).unwrap();
    drop(threads);
    (seen, simulation.trace_hash())
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another_order() {
    let runs: Vec<_> = (0..8).map(run).collect();
    for (seed, first) in runs.iter().enumerate() {
        assert_eq!(*first, run(seed as u64), "seed {seed}");
    }
    let orders: std::collections::BTreeSet<_> = runs.iter().map(|(order, _)| order.clone()).collect();
    let hashes: std::collections::BTreeSet<_> = runs.iter().map(|(_, hash)| *hash).collect();
    assert!(orders.len() > 4, "ties are broken by the seed: {} orders", orders.len());
    assert_eq!(hashes.len(), runs.len());
    let mut sorted = runs[0].0.clone();
    sorted.sort_unstable();
    assert!(sorted.len() > 50 && sorted.chunk_by(|a, b| a == b).count() == 3);
}

#[test]
fn s43_loops_keep_step_or_go_their_own_way() {
    let (simulation, mut app) = world();
    let together = SkThread::new("together").start(app.cx()).unwrap();
    let apart = SkThread::new("apart").interval(ms(3)).start(app.cx()).unwrap();
    simulation.run_for(&mut app, ms(300));
    let ticks = |thread: &SkThread| thread.build(|cx| cx.stats().ticks).unwrap();
    assert_eq!(app.cx().stats().ticks, 30);
    assert_eq!((ticks(&together), ticks(&apart)), (30, 100));
}

#[test]
fn a_message_wakes_a_loop_that_waits_for_it_at_once() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.interval = ms(1));
    let waiter = SkThread::new("waiter")
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_secs(1))
        .start(app.cx())
        .unwrap();
    let scribe = waiter
        .build(|cx| {
            let scribe = cx.spawn(Scribe::default());
            cx.remote(scribe)
        })
        .unwrap();
    simulation.run_for(&mut app, ms(10));
    scribe.post(|scribe, cx| scribe.note(cx, cx.now().as_nanos() as u32)).unwrap();
    simulation.run_for(&mut app, ms(10));
    let (seen, ticks) = waiter
        .build({
            let id = Address::from(&scribe).id();
            move |cx| (cx.objects().iter().any(|info| info.id == id), cx.stats().ticks)
        })
        .unwrap();
    assert!(seen);
    assert_eq!(ticks, 1, "a round begun after a wait is a tick");
}

#[test]
fn queued_calls_of_a_select_io_loop_do_not_make_it_tick_faster() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    attach!(cx, cx.fast_zone().pulse => button.press, Queued);
    simulation.run_for(&mut app, ms(100));
    let stats = app.cx().stats();
    assert_eq!(stats.ticks, 10);
    assert!(
        stats.rounds >= 19 && stats.rounds <= 22,
        "one more round for each queued call: {}",
        stats.rounds
    );
}

#[test]
fn work_completes_later_and_its_result_comes_as_a_call() {
    struct Reader(Log);
    impl Reader {
        fn read(&mut self, cx: &mut Cx, bytes: Vec<u8>) {
            self.0.note(format!("{bytes:?} at {}", cx.now() > Instant::ZERO));
        }
    }
    object! { Reader { slots { read(Vec<u8>) } } }
    let (log, (simulation, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (reader, gone) = (cx.spawn(Reader(log.clone())), cx.spawn(Reader(log.clone())));
    cx.work(|| vec![1, 2], reader.slots().read()).unwrap();
    cx.work(|| vec![3], gone.slots().read()).unwrap();
    cx.destroy_later(gone);
    assert_eq!(log.take(), [""; 0]);
    simulation.run_for(&mut app, Duration::from_secs(1));
    assert_eq!(log.take(), ["[1, 2] at true"]);
    assert_eq!(app.cx().counters().gone, 1);
}

#[test]
fn a_posix_signal_is_a_signal_of_the_app_and_ends_it_if_nobody_listens() {
    struct Listener(Log);
    impl Listener {
        fn heard(&mut self, _cx: &mut Cx, signal: OsSignal) {
            self.0.note(format!("{signal:?}"));
        }
    }
    object! { Listener { slots { heard(OsSignal) } } }
    for mode in [TimingMode::Coarse, TimingMode::Realtime, TimingMode::SelectIo, TimingMode::NoTiming] {
        let simulation = Simulation::new(1);
        let log = Log::default();
        let mut app = simulation.app_with(|settings| settings.mode = mode);
        let cx = app.cx();
        let listener = cx.spawn(Listener(log.clone()));
        attach!(cx, cx.event_loop().os_signal => listener.heard);
        simulation.run_for(&mut app, ms(50));
        simulation.raise(OsSignal::Terminate);
        simulation.run_for(&mut app, ms(200));
        assert_eq!(log.take(), ["Terminate"], "{mode:?}");
        assert!(!app.cx().is_quitting());
        let cx = app.cx();
        detach!(cx, cx.event_loop().os_signal => listener.heard);
        simulation.run_for(&mut app, ms(50));
        simulation.raise(OsSignal::Interrupt);
        simulation.run_for(&mut app, ms(200));
        assert!(app.cx().is_quitting(), "{mode:?}");
    }
}

#[test]
fn s22_interval_and_mode_take_effect() {
    for mode in [TimingMode::Coarse, TimingMode::Realtime, TimingMode::SelectIo, TimingMode::NoTiming] {
        let simulation = Simulation::new(1);
        let mut app = simulation.app_with(|settings| {
            settings.mode = mode;
            settings.interval = ms(4);
        });
        simulation.run_for(&mut app, ms(400));
        let stats = app.cx().stats();
        assert_eq!((stats.mode, stats.interval, stats.mean_interval), (mode, ms(4), ms(4)));
        assert_eq!(stats.ticks, 100, "{mode:?}");
    }
}

#[test]
fn s33_realtime_keeps_its_schedule() {
    // The same job, in both modes: coarse adds the job's time to every period, realtime does not.
    let ticks_in_a_second = |mode| {
        let simulation = Simulation::new(1);
        let mut app = simulation.app_with(|settings| settings.mode = mode);
        let clock = simulation.clock();
        let cx = app.cx();
        let job = cx.spawn(Actor::new(move |_, _, _| clock.advance(ms(2))));
        attach!(cx, cx.fast_zone().pulse => job.go);
        simulation.run_for(&mut app, Duration::from_secs(12));
        let stats = app.cx().stats();
        (stats.ticks, stats.wake_error.max)
    };
    assert_eq!(ticks_in_a_second(TimingMode::Realtime), (1200, Duration::ZERO));
    assert_eq!(ticks_in_a_second(TimingMode::Coarse).0, 1000);
}

#[test]
fn a_thread_that_quits_by_itself_is_over() {
    let (simulation, mut app) = world();
    let short = SkThread::new("short").start(app.cx()).unwrap();
    let scribe = short
        .build(|cx| {
            let scribe = cx.spawn(Scribe::default());
            cx.remote(scribe)
        })
        .unwrap();
    scribe.post(|_, cx| cx.quit()).unwrap();
    simulation.run_for(&mut app, ms(100));
    assert!(scribe.post(|_, _| ()).is_err());
    short.stop();
}
