//! The end of objects: marks, burial, and what no longer reaches them.

mod objects;

use objects::*;
use sk_core::eventloop::Reason;
use sk_core::prelude::*;
use std::cell::Cell;

#[test]
fn s04_destroy_later_acts_at_the_end_of_the_round() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    let seen = log.clone();
    let killer = cx.spawn(Actor::new(move |cx, stage, _| {
        for who in [lamp.id(), stage.me.id()] {
            cx.destroy_later(who);
            cx.destroy_later(who);
            assert!(!cx.is_alive(who) && cx.exists(who));
        }
        assert_eq!(cx.with(lamp, |lamp, _| lamp.name), Ok("lamp"), "still readable");
        seen.note("slot ends");
    }));
    attach!(cx, cx.fast_zone().pulse => killer.go);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["slot ends", "lamp goes", "lamp dropped"]);
    assert!(!app.cx().exists(lamp) && !app.cx().exists(killer));
    app.cx().destroy_later(lamp);
    app.pulse();
    assert_eq!(app.cx().counters().buried, 2, "naming the gone does nothing");
}

#[test]
fn s08_a_buried_object_is_dropped_in_that_round() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let lamp = app.cx().spawn(Lamp::new("lamp", &log));
    app.pulse();
    app.cx().destroy_later(lamp);
    assert_eq!(log.take(), [""; 0]);
    app.pulse();
    assert_eq!(log.take(), ["lamp goes", "lamp dropped"]);
}

#[test]
fn destroy_later_may_name_the_emitter_and_its_other_slots_run_still() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let killer = cx.spawn(Actor::new(move |cx, _, _| cx.destroy_later(button)));
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    attach!(cx, button.pressed => killer.act);
    attach!(cx, button.pressed => lamp.on);
    app.pulse();
    push(&mut app, button, 1);
    assert_eq!(log.take(), ["lamp 1"], "calls it makes are delivered");
    app.pulse();
    assert!(!app.cx().exists(button));
}

#[test]
fn a_marked_object_gets_no_further_call_but_what_it_queued_is_delivered() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, doomed) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("doomed", &log)));
    let heir = cx.spawn(Lamp::new("heir", &log));
    attach!(cx, button.pressed => doomed.on);
    attach!(cx, button.pressed => doomed.blink(), Queued);
    attach!(cx, button.pressed => heir.on, Queued);
    app.pulse();
    push(&mut app, button, 1);
    app.cx().destroy_later(doomed);
    app.cx().destroy_later(button);
    push(&mut app, button, 2);
    assert_eq!(log.take(), ["doomed 1"]);
    app.pulse();
    assert_eq!(log.take(), ["heir 1", "heir 2", "doomed goes", "doomed dropped"]);
    // The queued call that waited, and both calls made to the marked one.
    assert_eq!(app.cx().counters().gone, 3);
}

#[test]
fn parked_calls_of_a_destroyed_object_are_counted_gone() {
    let (_log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let calls = Rc::new(Cell::new(0));
    let counted = calls.clone();
    let a = cx.spawn(Actor::new(move |cx, stage, n| {
        counted.set(counted.get() + 1);
        if n == 0 {
            stage.out.emit(cx, 1);
            stage.out.emit(cx, 2);
            cx.destroy_later(stage.me);
        }
    }));
    attach!(cx, a.out => a.act);
    app.pulse();
    app.cx().with(a, |a, cx| a.act(cx, 0)).unwrap();
    app.pulse();
    assert_eq!((calls.get(), app.cx().counters().gone), (1, 2));
}

#[test]
fn s53_a_link_ends_with_either_object() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, other) = (cx.spawn(Button::default()), cx.spawn(Button::default()));
    let (lamp, rest) = (cx.spawn(Lamp::new("lamp", &log)), cx.spawn(Lamp::new("rest", &log)));
    for mode in [Mode::Direct, Mode::Queued] {
        let slot = if mode == Mode::Direct { "on" } else { "blink" };
        cx.attach_by_name(button, "pressed", lamp, slot, mode).unwrap();
    }
    attach!(cx, button.pressed => rest.on);
    attach!(cx, other.pressed => rest.on);
    app.pulse();
    app.cx().destroy_later(lamp);
    app.cx().destroy_later(other);
    app.pulse();
    log.take();
    push(&mut app, button, 1);
    app.pulse();
    assert_eq!(log.take(), ["rest 1"]);
    let links = app.cx().links_of(button);
    assert_eq!(links.len(), 1, "the first call that found nobody had them swept: {links:?}");
}

#[test]
fn s06_destroying_a_parent_destroys_its_children() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let top = cx.spawn(Lamp::new("top", &log));
    let left = cx.under(top).spawn(Lamp::new("left", &log));
    let leaf = cx.under(left).spawn(Lamp::new("leaf", &log));
    let right = cx.under(top).spawn(Lamp::new("right", &log));
    let stranger = cx.spawn(Lamp::new("stranger", &log));
    cx.destroy_later(top);
    for id in [left, leaf, right] {
        assert!(!cx.is_alive(id) && cx.exists(id), "marked with its parent");
    }
    app.pulse();
    let goes = |name| format!("{name} goes");
    let dropped = |name| format!("{name} dropped");
    let expected = [
        goes("top"),
        goes("left"),
        goes("leaf"),
        dropped("leaf"),
        dropped("left"),
        goes("right"),
        dropped("right"),
        dropped("top"),
    ];
    assert_eq!(log.take(), expected);
    assert!(app.cx().is_alive(stranger));
}

#[test]
fn on_destroy_of_a_parent_still_finds_its_children() {
    struct Parent {
        child: Handle<Lamp>,
        found: Rc<Cell<u32>>,
    }
    impl Parent {
        fn on_destroy(&mut self, cx: &mut Cx) {
            self.found.set(cx.with(self.child, |child, _| child.sum).unwrap());
        }
    }
    object! { Parent { hooks { on_destroy } } }
    let (log, (_world, mut app)) = (Log::default(), world());
    let found = Rc::new(Cell::new(0));
    let seen = found.clone();
    let parent = app.cx().spawn_with(move |cx, this| {
        let child = cx.under(this).spawn(Lamp::new("child", &log));
        cx.with(child, |child, _| child.sum = 42).unwrap();
        Parent { child, found: seen }
    });
    app.cx().destroy_later(parent);
    app.pulse();
    assert_eq!(found.get(), 42);
}

#[test]
fn on_destroy_may_emit_and_destroy_others() {
    struct Tree {
        felled: Signal<u32>,
        neighbour: Handle<Lamp>,
    }
    impl Tree {
        fn on_destroy(&mut self, cx: &mut Cx) {
            self.felled.emit(cx, 1);
            cx.destroy_later(self.neighbour);
        }
    }
    object! { Tree { signals { felled(u32) } hooks { on_destroy } } }
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (neighbour, heir) = (cx.spawn(Lamp::new("neighbour", &log)), cx.spawn(Lamp::new("heir", &log)));
    let tree = cx.spawn(Tree { felled: Signal::new(), neighbour });
    attach!(cx, tree.felled => heir.on);
    app.pulse();
    app.cx().destroy_later(tree);
    app.pulse();
    let expected = ["heir 1", "neighbour goes", "neighbour dropped"];
    assert_eq!(log.take(), expected, "a mark made during burial joins in");
}

/// Spawns one of its kind below itself, and a root, when it goes.
struct Hydra {
    lives: Rc<Cell<i32>>,
    heads: Rc<Cell<u32>>,
}
impl Hydra {
    fn new(lives: &Rc<Cell<i32>>, heads: &Rc<Cell<u32>>) -> Hydra {
        lives.set(lives.get() + 1);
        heads.set(heads.get() + 1);
        Hydra { lives: lives.clone(), heads: heads.clone() }
    }
    fn on_destroy(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        cx.under(this).spawn(Hydra::new(&self.lives, &self.heads));
        cx.spawn(Hydra::new(&self.lives, &self.heads));
    }
}
object! { Hydra { hooks { on_destroy } } }
impl Drop for Hydra {
    fn drop(&mut self) {
        self.lives.set(self.lives.get() - 1);
    }
}

#[test]
fn what_a_hook_spawns_below_its_dying_object_is_buried_with_it() {
    let (_world, mut app) = world();
    let (lives, heads) = (Rc::default(), Rc::default());
    let hydra = app.cx().spawn(Hydra::new(&lives, &heads));
    app.cx().destroy_later(hydra);
    app.pulse();
    assert_eq!((lives.get(), heads.get()), (1, 3), "the root that was spawned lives");
    drop(app);
    assert_eq!(lives.get(), 0, "the end of the loop is the end of the game");
}

#[test]
fn s07_the_end_of_a_loop_destroys_its_objects() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let a = cx.spawn(Lamp::new("a", &log));
    cx.under(a).spawn(Lamp::new("a/child", &log));
    cx.spawn(Lamp::new("b", &log));
    // A cycle of links holds nobody.
    let (ping, pong) = (
        cx.spawn(Actor::new(|_, _, _| ())),
        cx.spawn(Actor::new({
            let log = log.clone();
            move |_, _, n| log.note(n.to_string())
        })),
    );
    attach!(cx, ping.out => pong.act);
    attach!(cx, pong.out => ping.act, Queued);
    app.pulse();
    app.cx().with(pong, |pong, cx| pong.out.emit(cx, 1)).unwrap();
    drop(app);
    let expected = ["a goes", "a/child goes", "a/child dropped", "a dropped", "b goes", "b dropped"];
    assert_eq!(log.take(), expected);
}

#[test]
fn cycles_of_links_are_freed_at_the_end_of_the_loop() {
    struct Part {
        out: Signal<u32>,
        living: Rc<Cell<u32>>,
    }
    impl Part {
        fn take(&mut self, _cx: &mut Cx, _n: u32) {}
    }
    object! { Part { signals { out(u32) } slots { take(u32) } } }
    impl Drop for Part {
        fn drop(&mut self) {
            self.living.set(self.living.get() - 1);
        }
    }
    let living = Rc::new(Cell::new(0));
    let (_world, mut app) = world();
    let cx = app.cx();
    let parts: Vec<_> = (0..100)
        .map(|_| {
            living.set(living.get() + 1);
            cx.spawn(Part { out: Signal::new(), living: living.clone() })
        })
        .collect();
    for (i, part) in parts.iter().enumerate() {
        for step in [1, 7, 99, 0] {
            let next = parts[(i + step) % parts.len()];
            attach!(cx, part.out => next.take);
            attach!(cx, part.out => next.take, Queued);
        }
    }
    app.pulse();
    assert_eq!(living.get(), 100);
    drop(app);
    assert_eq!(living.get(), 0);
}

#[test]
fn s05_an_object_nobody_destroys_stays_and_is_listed() {
    let (log, (simulation, mut app)) = (Log::default(), world());
    let own = app.cx().stats().objects;
    let lamp = app.cx().named("forgotten").spawn(Lamp::new("forgotten", &log));
    simulation.run_for(&mut app, Duration::from_secs(10));
    let cx = app.cx();
    assert_eq!(cx.stats().objects, own + 1);
    let listed: Vec<_> = cx.objects().into_iter().filter(|info| info.path == "forgotten").collect();
    assert_eq!(listed.len(), 1);
    assert_eq!((listed[0].id, listed[0].class.name), (lamp.id(), "Lamp"));
    drop(app);
    assert_eq!(log.take(), ["forgotten goes", "forgotten dropped"]);
}

#[test]
fn a_stale_handle_never_names_the_next_tenant_of_its_place() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let old = app.cx().spawn(Lamp::new("old", &log));
    let button = app.cx().spawn(Button::default());
    let cx = app.cx();
    attach!(cx, button.pressed => old.on, Queued);
    app.pulse();
    push(&mut app, button, 1);
    app.cx().destroy_later(old);
    app.pulse();
    let new = app.cx().spawn(Lamp::new("new", &log));
    assert_ne!(old, new);
    log.take();
    push(&mut app, button, 2);
    app.pulse();
    assert_eq!(app.cx().with(old, |_, _| ()), Err(Access::Gone));
    assert_eq!(app.cx().invoke_method(old, "on", &[1.into()]), Err(MetaError::Gone(old.id())));
    app.cx().destroy_later(old);
    app.pulse();
    assert!(app.cx().is_alive(new));
    assert_eq!(log.take(), [""; 0]);
}

#[test]
fn handles_of_one_loop_name_nobody_in_another() {
    let (log, (_world, mut first)) = (Log::default(), world());
    let (_other_world, mut second) = world();
    let lamp = first.cx().spawn(Lamp::new("lamp", &log));
    let twin = second.cx().spawn(Lamp::new("twin", &log));
    assert_ne!(lamp, twin);
    assert_eq!(second.cx().with(lamp, |_, _| ()), Err(Access::Gone));
    drop(first);
    let (_third_world, mut third) = world();
    third.cx().spawn(Lamp::new("successor", &log));
    assert_eq!(third.cx().with(lamp, |_, _| ()), Err(Access::Gone), "nor in a later one of this thread");
}

#[test]
fn burial_is_told_with_its_reason_by_the_loop_and_by_a_watch() {
    struct Witness(Log);
    impl Witness {
        fn saw(&mut self, cx: &mut Cx, who: ObjectId, why: Reason) {
            assert!(!cx.exists(who));
            self.0.note(format!("{why:?}"));
        }
        fn mourn(&mut self, _cx: &mut Cx, who: ObjectId, why: Reason) {
            self.0.note(format!("mourns {who:?} {why:?}"));
        }
    }
    object! { Witness { slots { saw(ObjectId, Reason) mourn(ObjectId, Reason) } } }
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let parent = cx.spawn(Button::default());
    let child = cx.under(parent).spawn(Button::default());
    let witness = cx.spawn(Witness(log.clone()));
    attach!(cx, cx.event_loop().buried => witness.saw);
    attach!(cx, cx.watch(child).buried => witness.mourn);
    app.pulse();
    app.cx().destroy_later(parent);
    app.pulse();
    assert_eq!(
        log.take(),
        ["Parent".to_owned(), format!("mourns {:?} Parent", child.id()), "Asked".to_owned()]
    );
    app.pulse();
    assert_eq!(log.take(), ["Asked"], "the watch itself");

    let cx = app.cx();
    attach!(cx, cx.watch(child).buried => witness.mourn);
    app.pulse();
    app.pulse();
    let expected = [format!("mourns {:?} Asked", child.id()), "Asked".to_owned()];
    assert_eq!(log.take(), expected, "for one that is gone already, and then the watch's own burial");
}

#[test]
fn dead_shells_are_swept_when_they_are_many() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    for _ in 0..3000 {
        let lamp = cx.spawn(Lamp::new("lamp", &log));
        attach!(cx, button.pressed => lamp.on);
        cx.destroy_later(lamp);
    }
    let lamps: Vec<_> = (0..3000).map(|_| cx.spawn(Lamp::new("lamp", &log))).collect();
    for &lamp in &lamps {
        attach!(cx, button.pressed => lamp.on);
    }
    app.pulse();
    assert_eq!(
        app.cx().links_of(button).len(),
        3000,
        "what was marked before the rewire was never linked"
    );
    for lamp in lamps {
        app.cx().destroy_later(lamp);
    }
    app.pulse();
    assert_eq!(app.cx().links_of(button).len(), 0, "nobody pressed, but the shells were too many");
    assert_eq!(app.cx().stats().shells, 0);
}
