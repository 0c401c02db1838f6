//! What the loop takes from the heap, counted by the allocator.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn held() -> i64 {
    CountingAllocator::held_bytes()
}

/// How many allocations `f` makes.
fn taken(f: impl FnOnce()) -> u64 {
    let before = CountingAllocator::taken();
    f();
    CountingAllocator::taken() - before
}

struct Sink(u64);
impl Sink {
    fn take(&mut self, _cx: &mut Cx, n: u32) {
        self.0 += u64::from(n);
    }
}
object! { Sink { slots { take(u32) } } }

struct Burst {
    calls: u32,
    out: Signal<u32>,
}
impl Burst {
    fn fire(&mut self, cx: &mut Cx) {
        for n in 0..self.calls {
            self.out.emit(cx, n);
        }
    }
}
object! { Burst { signals { out(u32) } slots { fire() } } }

#[test]
fn a_call_in_steady_state_takes_nothing_from_the_heap() {
    for calls in [1, 50, 1000] {
        let (_world, mut app) = world();
        let cx = app.cx();
        let burst = cx.spawn(Burst { calls, out: Signal::new() });
        let sinks = [(); 4].map(|()| cx.spawn(Sink(0)));
        attach!(cx, cx.fast_zone().pulse => burst.fire);
        attach!(cx, burst.out => sinks[0].take);
        attach!(cx, burst.out => sinks[1].take, Queued);
        attach!(cx, burst.out => sinks[2].take, Latest);
        let timer = cx.spawn(Timer::default());
        attach!(cx, timer.timeout => burst.fire, Queued);
        timer.start(cx, ms(20)).unwrap();
        for _ in 0..10 {
            app.pulse();
        }
        let allocations = taken(|| (0..100).for_each(|_| app.pulse()));
        assert_eq!(allocations, 0, "{calls} calls a round");
        assert!(app.cx().counters().queued_calls > 100 * u64::from(calls));
    }
}

#[test]
fn calls_to_another_thread_share_their_allocations() {
    const ROUNDS: u32 = 100;
    const CALLS: u32 = 1000;
    let (_world, mut app) = world();
    let far = SkThread::new("far").start(app.cx()).unwrap();
    let sinks = far
        .build(|cx| {
            [(); 2].map(|()| {
                let sink = cx.spawn(Sink(0));
                cx.remote(sink)
            })
        })
        .unwrap();
    let cx = app.cx();
    let burst = cx.spawn(Burst { calls: CALLS, out: Signal::new() });
    attach!(cx, cx.fast_zone().pulse => burst.fire);
    attach!(cx, burst.out => sinks[0].take, Queued);
    attach!(cx, burst.out => sinks[1].take, Latest);
    let mut rounds = |calls| {
        app.cx().with(burst, |burst, _| burst.calls = calls).unwrap();
        // The rings find their size first.
        (0..20).for_each(|_| app.pulse());
        taken(|| (0..ROUNDS).for_each(|_| app.pulse()))
    };
    rounds(CALLS);
    // The simulation's own allocations are there without any call too.
    let (quiet, busy) = (rounds(0), rounds(CALLS));
    let sent = u64::from(ROUNDS * CALLS);
    let own = busy.saturating_sub(quiet);
    assert!(own <= sent / 30, "{own} allocations for {sent} calls");
    assert!(far.build(|cx| cx.counters().messages).unwrap() > sent);
}

#[test]
fn an_empty_pulse_takes_nothing_from_the_heap() {
    let (_world, mut app) = world();
    app.pulse();
    assert_eq!(taken(|| (0..100).for_each(|_| app.pulse())), 0);
}

#[test]
fn memory_is_given_back_after_a_burst() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let burst = cx.spawn(Burst { calls: 1, out: Signal::new() });
    let sink = cx.spawn(Sink(0));
    attach!(cx, burst.out => sink.take, Queued);
    attach!(cx, cx.fast_zone().pulse => burst.fire);
    for _ in 0..10 {
        app.pulse();
    }
    let before = held();
    app.cx().with(burst, |burst, _| burst.calls = 60_000).unwrap();
    app.pulse();
    app.cx().with(burst, |burst, _| burst.calls = 1).unwrap();
    assert!(held() - before > 60_000 * 4, "the calls wait");
    for _ in 0..30 {
        app.pulse();
    }
    assert!(held() - before < 40_000, "{} bytes more are held", held() - before);
}

#[test]
fn links_to_the_dead_are_noted_once_however_often_they_are_emitted() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let bursts = [(); 2].map(|()| cx.spawn(Burst { calls: 1, out: Signal::new() }));
    let sink = cx.spawn(Sink(0));
    attach!(cx, bursts[0].out => sink.take);
    attach!(cx, bursts[1].out => sink.take);
    app.pulse();
    let cx = app.cx();
    cx.destroy_later(sink);
    let before = held();
    for _ in 0..10_000 {
        for burst in bursts {
            cx.with(burst, Burst::fire).unwrap();
        }
    }
    assert_eq!(cx.counters().gone, 20_000);
    assert!(held() - before < 1000, "{} bytes more are held", held() - before);
    app.pulse();
    // They are dead now, and noted anew.
    for burst in bursts {
        app.cx().with(burst, Burst::fire).unwrap();
    }
    app.pulse();
    assert_eq!(bursts.map(|burst| app.cx().links_of(burst).len()), [0, 0]);
}

#[test]
fn everything_is_given_back_at_the_end_of_the_loop() {
    let run = || {
        let (_world, mut app) = world();
        let cx = app.cx();
        let objects: Vec<_> = (0..10).map(|_| cx.spawn(Burst { calls: 1, out: Signal::new() })).collect();
        for pair in objects.windows(2) {
            attach!(cx, pair[0].out => pair[1].fire());
            attach!(cx, pair[1].out => pair[0].fire(), Queued);
        }
        for _ in 0..3 {
            app.cx().invoke_method(objects[0], "fire", &[]).unwrap();
            app.pulse();
        }
    };
    run();
    let before = held();
    run();
    assert_eq!(held() - before, 0, "bytes leaked");
}
