//! Trees of objects: parents, names, paths, constructors, and how deep they may be.

mod objects;

use objects::*;
use sk_core::object::NameError;
use sk_core::prelude::*;
use std::cell::Cell;

#[test]
fn s03_an_object_has_signals_slots_a_parent_and_a_loop() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let base = cx.named("base").spawn(Button::default());
    let left = cx.under(base).named("left").spawn(Button::default());
    let class = cx.class_of(left).unwrap();
    assert_eq!(class.name, "Button");
    assert_eq!(class.signals.iter().map(|signal| signal.name).collect::<Vec<_>>(), ["pressed"]);
    assert_eq!(class.slots.iter().map(|slot| slot.name).collect::<Vec<_>>(), ["press", "push"]);
    assert_eq!(cx.parent_of(left), Some(base.id()));
    assert_eq!(cx.children_of(base), [left.id()]);
    assert_eq!(cx.parent_of(base), None);
    assert_eq!(cx.loop_name(), "main");
}

#[test]
fn names_make_paths_and_paths_find_objects() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let base = cx.named("base").spawn(Button::default());
    let arm = cx.under(base).spawn(Button::default());
    let lamp = cx.under(arm).named("lamp").spawn(Lamp::new("lamp", &log));
    let left = cx.under(base).named("left").spawn(Lamp::new("left", &log));
    assert_eq!(cx.find("base/left"), Some(left.id()));
    assert_eq!(cx.find_as::<Lamp>("base/left"), Some(left));
    assert_eq!(cx.find_as::<Button>("base/left"), None);
    assert_eq!(cx.name_of(left), Some("left"));
    assert_eq!(
        cx.path_of(lamp),
        format!("base/{}/lamp", arm.id()),
        "an id stands where no name was given"
    );
    for nobody in ["left", "base/right", "base/left/", "", "/", "base//left"] {
        assert_eq!(cx.find(nobody), None, "{nobody:?}");
    }
}

#[test]
fn a_name_that_is_taken_or_malformed_is_an_error_and_never_loses_the_object() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    cx.named("one").spawn(Button::default());
    let refused = cx.named("one").try_spawn(Lamp::new("refused", &log));
    assert_eq!(refused, Err(NameError::Taken("one".into())));
    assert_eq!(log.take(), ["refused dropped"]);
    for name in ["", "a/b"] {
        assert_eq!(cx.named(name).try_spawn(Button::default()), Err(NameError::Malformed(name.into())));
    }
    let nameless = cx.named("one").spawn(Lamp::new("kept", &log));
    assert!(cx.is_alive(nameless));
    assert_eq!(cx.name_of(nameless), None);
    let gone = cx.spawn(Button::default());
    cx.destroy_later(gone);
    app.pulse();
    let cx = app.cx();
    assert_eq!(cx.under(gone).try_spawn(Button::default()), Err(NameError::NoParent(gone.id())));
    let orphan = cx.under(gone).spawn(Lamp::new("orphan", &log));
    assert!(!cx.is_alive(orphan) && cx.exists(orphan));
    app.pulse();
    assert!(!app.cx().exists(orphan), "a child of nobody is buried at the end of the round");
}

#[test]
fn a_name_is_free_again_after_burial() {
    let (_world, mut app) = world();
    let first = app.cx().named("pid").spawn(Button::default());
    app.cx().destroy_later(first);
    assert!(app.cx().named("pid").try_spawn(Button::default()).is_err());
    app.pulse();
    let second = app.cx().named("pid").spawn(Button::default());
    assert_eq!(app.cx().find("pid"), Some(second.id()));
}

#[test]
fn s54_links_made_in_the_constructor_work() {
    struct Door {
        timer: Handle<Timer>,
        log: Log,
        moved: Signal<u32>,
    }
    impl Door {
        fn new(cx: &mut Cx, this: Handle<Door>, log: &Log) -> Door {
            let timer = cx.under(this).spawn(Timer::default());
            attach!(cx, timer.timeout => this.on_timeout);
            attach!(cx, this.moved => this.on_moved, Queued);
            Door { timer, log: log.clone(), moved: Signal::new() }
        }
        fn on_spawn(&mut self, cx: &mut Cx) {
            self.timer.start(cx, ms(20)).unwrap();
            self.log.note("spawned");
            self.moved.emit(cx, 0);
        }
        fn on_timeout(&mut self, cx: &mut Cx) {
            self.log.note("timeout");
            self.moved.emit(cx, 1);
        }
        fn on_moved(&mut self, _cx: &mut Cx, n: u32) {
            self.log.note(format!("moved {n}"));
        }
    }
    object! { Door { signals { moved(u32) } slots { on_timeout() on_moved(u32) } hooks { on_spawn } } }
    let (log, (simulation, mut app)) = (Log::default(), world());
    let door = app.cx().spawn_with(|cx, this| Door::new(cx, this, &log));
    let timer = app.cx().with(door, |door, _| door.timer).unwrap();
    assert_eq!(app.cx().parent_of(timer), Some(door.id()));
    simulation.run_for(&mut app, ms(45));
    assert_eq!(log.take(), ["spawned", "timeout", "moved 1", "timeout"]);
}

#[test]
fn a_constructor_that_fails_leaves_nothing_behind() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let before = app.cx().stats().objects;
    let children = log.clone();
    let failed: Result<Handle<Button>, &str> =
        app.cx().named("broken").try_spawn_with(|cx, this: Handle<Button>| {
            cx.under(this).spawn(Lamp::new("child", &children));
            attach!(cx, cx.fast_zone().pulse => this.press);
            Err("no such device")
        });
    assert_eq!(failed, Err("no such device"));
    app.pulse();
    assert_eq!(log.take(), ["child goes", "child dropped"]);
    assert_eq!(app.cx().stats().objects, before);
    assert_eq!(app.cx().find("broken"), None);
    app.pulse();
    let zone = app.cx().fast_zone();
    assert_eq!(app.cx().with(zone, |zone, _| zone.pulse.listeners()), Ok(0));
}

#[test]
fn a_constructor_that_panics_in_a_slot_leaves_nothing_behind() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let children = log.clone();
    let maker = app.cx().spawn(Actor::new(move |cx, _, _| {
        let children = children.clone();
        cx.spawn_with(|cx, this: Handle<Button>| {
            cx.under(this).spawn(Lamp::new("child", &children));
            panic!("no such device")
        });
    }));
    let before = app.cx().stats().objects;
    let cx = app.cx();
    attach!(cx, cx.fast_zone().pulse => maker.go, OneShot);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["child goes", "child dropped"]);
    assert_eq!(app.cx().stats().objects, before - 1, "the maker is gone too: it panicked");
    assert_eq!(app.cx().counters().panics, 1);
}

#[test]
fn on_spawn_runs_once_the_object_stands_in_its_tree() {
    struct Child {
        path: Rc<Cell<String>>,
    }
    impl Child {
        fn on_spawn(&mut self, cx: &mut Cx) {
            self.path.set(cx.path_of(cx.this(self)));
        }
    }
    object! { Child { hooks { on_spawn } } }
    let (_world, mut app) = world();
    let path = Rc::new(Cell::default());
    let base = app.cx().named("base").spawn(Button::default());
    app.cx().under(base).named("arm").spawn(Child { path: path.clone() });
    assert_eq!(path.take(), "base/arm");
}

#[test]
fn siblings_keep_the_order_of_their_birth_whoever_leaves() {
    let (_world, mut app) = world();
    let base = app.cx().spawn(Button::default());
    let mut children: Vec<_> = (0..6).map(|_| app.cx().under(base).spawn(Button::default())).collect();
    for leaver in [3, 0, 3] {
        let leaver = children.remove(leaver);
        app.cx().destroy_later(leaver);
        app.pulse();
        children.push(app.cx().under(base).spawn(Button::default()));
        let expected: Vec<ObjectId> = children.iter().map(|child| child.id()).collect();
        assert_eq!(app.cx().children_of(base), expected);
    }
}

#[test]
fn a_tree_a_million_deep_is_buried_without_recursion() {
    struct Knot(Rc<Cell<u32>>);
    object! { Knot { } }
    impl Drop for Knot {
        fn drop(&mut self) {
            self.0.set(self.0.get() - 1);
        }
    }
    const DEPTH: u32 = 1_000_000;
    let run = || {
        let (_world, mut app) = world();
        let living = Rc::new(Cell::new(0));
        for end_of_loop in [false, true] {
            let top = app.cx().spawn(Button::default());
            let mut at = top.id();
            for _ in 0..DEPTH {
                living.set(living.get() + 1);
                at = app.cx().under(at).spawn(Knot(living.clone())).id();
            }
            if !end_of_loop {
                app.cx().destroy_later(top);
                app.pulse();
                assert_eq!(living.get(), 0, "one subtree is buried in one round");
            }
        }
        drop(app);
        assert_eq!(living.get(), 0);
    };
    std::thread::Builder::new()
        .stack_size(256 * 1024)
        .spawn(run)
        .unwrap()
        .join()
        .unwrap();
}

#[test]
fn many_burials_are_spread_over_rounds_between_subtrees() {
    let (_world, mut app) = world();
    let before = app.cx().stats().objects;
    for _ in 0..70_000 {
        let object = app.cx().spawn(Button::default());
        app.cx().destroy_later(object);
    }
    app.pulse();
    assert_eq!(app.cx().counters().buried, 65_536);
    app.pulse();
    assert_eq!(app.cx().stats().objects, before);
}
