//! A user's `Drop` that panics, wherever the loop itself drops what users made.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Panics when it is dropped.
#[derive(Clone)]
struct Bomb(Arc<AtomicU32>);
impl Bomb {
    fn new() -> (Bomb, Arc<AtomicU32>) {
        let drops = Arc::new(AtomicU32::new(0));
        (Bomb(drops.clone()), drops)
    }
}
impl Drop for Bomb {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::SeqCst);
        // Two panics at once end the process, whoever catches.
        if !std::thread::panicking() {
            panic!("a drop that fails");
        }
    }
}

#[derive(Default)]
struct Thrower {
    thrown: Signal<Bomb>,
}
object! { Thrower { signals { thrown(Bomb) } } }

struct Catcher;
impl Catcher {
    fn catch(&mut self, _cx: &mut Cx, bomb: Bomb) {
        std::mem::forget(bomb);
    }
}
object! { Catcher { slots { catch(Bomb) } } }

fn throw(app: &mut SkApp, thrower: Handle<Thrower>, bomb: &Bomb) {
    app.cx().with(thrower, |thrower, cx| thrower.thrown.emit(cx, bomb)).unwrap();
}

#[test]
fn calls_that_wait_at_the_end_of_a_loop() {
    let (_simulation, mut app) = world();
    let (bomb, drops) = Bomb::new();
    let cx = app.cx();
    let (thrower, catcher) = (cx.spawn(Thrower::default()), cx.spawn(Catcher));
    attach!(cx, thrower.thrown => catcher.catch, Queued);
    app.pulse();
    for _ in 0..3 {
        throw(&mut app, thrower, &bomb);
    }
    drop(app);
    assert_eq!(drops.load(Ordering::SeqCst), 3, "each was dropped, whatever the others did");
    std::mem::forget(bomb);
}

#[test]
fn messages_that_wait_at_the_end_of_a_loop() {
    let (_simulation, mut app) = world();
    let (bomb, drops) = Bomb::new();
    let cx = app.cx();
    let catcher = cx.spawn(Catcher);
    let remote = cx.remote(catcher);
    for _ in 0..3 {
        let bomb = bomb.clone();
        remote.post(move |catcher, cx| catcher.catch(cx, bomb)).unwrap();
    }
    drop(app);
    assert_eq!(drops.load(Ordering::SeqCst), 3);
    std::mem::forget(bomb);
}

#[test]
fn arguments_under_way_to_another_thread_whose_receiver_is_buried() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| {
        settings.interval = Duration::from_secs(1);
        settings.slow_interval = Duration::from_secs(1);
    });
    let far = SkThread::new("far").interval(ms(10)).start(app.cx()).unwrap();
    let catcher = far
        .build(|cx| {
            let catcher = cx.spawn(Catcher);
            cx.remote(catcher)
        })
        .unwrap();
    let (bomb, drops) = Bomb::new();
    let cx = app.cx();
    let (thrower, log) = (cx.spawn(Thrower::default()), Log::default());
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, thrower.thrown => catcher.catch, Queued);
    app.pulse();
    simulation.run_for(&mut app, ms(50));
    catcher.destroy_later().unwrap();
    simulation.run_for(&mut app, ms(50));
    // The receiver is buried and this loop has not heard of it: the arguments stay in the link.
    for _ in 0..3 {
        throw(&mut app, thrower, &bomb);
    }
    simulation.run_for(&mut app, ms(50));
    let cx = app.cx();
    attach!(cx, button.pressed => lamp.on);
    assert_eq!(drops.load(Ordering::SeqCst), 0);
    app.pulse();
    assert!(drops.load(Ordering::SeqCst) > 0);
    assert_eq!(app.cx().counters().panics, 1);
    assert_eq!(app.cx().links_of(thrower).len(), 0);
    push(&mut app, button, 1);
    assert_eq!(log.take(), ["lamp 1"], "the requests after it are carried out");
    std::mem::forget(bomb);
}

/// Panics when it is dropped, once somebody has lit it.
#[derive(Clone)]
struct Fuse(Arc<AtomicBool>);
impl Drop for Fuse {
    fn drop(&mut self) {
        if self.0.load(Ordering::SeqCst) && !std::thread::panicking() {
            panic!("a drop that fails");
        }
    }
}

#[derive(Default)]
struct Spool {
    unwound: Signal<Fuse>,
}
object! { Spool { signals { unwound(Fuse) } } }

/// Lights the fuse when it is buried.
struct Lighter(Fuse);
impl Lighter {
    fn pass(&mut self, cx: &mut Cx, _fuse: Fuse) {
        cx.destroy_later(cx.this(self));
    }
    fn on_destroy(&mut self, _cx: &mut Cx) {
        self.0.0.store(true, Ordering::SeqCst);
    }
}
object! { Lighter { slots { pass(Fuse) } hooks { on_destroy } } }

#[test]
fn a_ring_that_comes_when_its_receiver_is_buried() {
    // So many that one round does not run them all, and the last ring but one is left behind full.
    const CALLS: usize = 70_000;
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| {
        settings.interval = Duration::from_secs(1);
        settings.slow_interval = Duration::from_secs(1);
    });
    let far = SkThread::new("far")
        .interval(ms(10))
        .configure(|settings| settings.mailbox_messages_max = 2 * CALLS)
        .start(app.cx())
        .unwrap();
    let fuse = Fuse(Arc::new(AtomicBool::new(false)));
    let own = fuse.clone();
    let lighter = far
        .build(move |cx| {
            let lighter = cx.spawn(Lighter(own));
            cx.remote(lighter)
        })
        .unwrap();
    let cx = app.cx();
    let spool = cx.spawn(Spool::default());
    attach!(cx, spool.unwound => lighter.pass, Queued);
    app.pulse();
    simulation.run_for(&mut app, ms(50));
    let unwind = |spool: &mut Spool, cx: &mut Cx| (0..CALLS).for_each(|_| spool.unwound.emit(cx, &fuse));
    app.cx().with(spool, unwind).unwrap();
    assert_eq!(app.cx().counters().refused_full, 0);
    simulation.run_for(&mut app, ms(50));
    assert!(fuse.0.load(Ordering::SeqCst));
    let panics = far.build(|cx| cx.counters().panics).unwrap();
    assert_eq!(panics, 3, "its own, one of the ring it had, one of the ring after that");
    fuse.0.store(false, Ordering::SeqCst);
}

#[test]
fn arguments_that_come_before_their_link_finds_nobody() {
    let (simulation, mut app) = world();
    let far = SkThread::new("far").interval(Duration::from_secs(1)).start(app.cx()).unwrap();
    let (doomed, catcher) = far
        .build(|cx| {
            let (doomed, catcher) = (cx.spawn(Catcher), cx.spawn(Catcher));
            cx.destroy_later(doomed);
            (cx.remote(doomed), cx.remote(catcher))
        })
        .unwrap();
    let (bomb, drops) = Bomb::new();
    let cx = app.cx();
    let thrower = cx.spawn(Thrower::default());
    attach!(cx, thrower.thrown => doomed.catch, Queued);
    app.pulse();
    throw(&mut app, thrower, &bomb);
    throw(&mut app, thrower, &bomb);
    // The sender's end goes first, so that the far end drops the arguments.
    let cx = app.cx();
    detach!(cx, thrower.thrown => doomed.catch);
    app.pulse();
    simulation.run_for(&mut app, Duration::from_secs(3));
    assert!(drops.load(Ordering::SeqCst) > 0);
    assert!(far.build(|cx| cx.counters().panics).unwrap() >= 1);
    catcher.post(|_, cx| cx.quit()).unwrap();
    std::mem::forget(bomb);
}
