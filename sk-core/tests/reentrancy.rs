//! What happens when a call reaches an object whose slot is running.

mod objects;

use objects::*;
use sk_core::prelude::*;
use std::cell::Cell;

/// A script that writes down what came.
fn note(log: &Log, name: &'static str) -> impl FnMut(&mut Cx, &Stage<'_>, u32) + 'static {
    let log = log.clone();
    move |_, _, n| log.note(format!("{name} {n}"))
}

#[test]
fn busy_calls_are_parked_and_run_when_the_lease_ends() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let outer = log.clone();
    let a = cx.spawn(Actor::new(move |cx, stage, n| {
        outer.note(format!("a {n} begins"));
        if n == 0 {
            stage.out.emit(cx, 1);
        }
        outer.note(format!("a {n} ends"));
    }));
    let inner = log.clone();
    let b = cx.spawn(Actor::new(move |cx, stage, n| {
        inner.note(format!("b {n} begins"));
        stage.out.emit(cx, n + 1);
        inner.note(format!("b {n} ends"));
    }));
    attach!(cx, a.out => b.act);
    attach!(cx, b.out => a.act);
    attach!(cx, cx.fast_zone().pulse => a.go, OneShot);
    app.pulse();
    app.pulse();
    let expected =
        ["a 0 begins", "b 1 begins", "b 1 ends", "a 0 ends", "a 2 begins", "a 2 ends"].map(str::to_owned);
    assert_eq!(log.take(), expected, "all in one round");
    assert_eq!(app.cx().counters().parked, 1);
}

#[test]
fn a_direct_link_to_oneself_always_parks() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let own = log.clone();
    let a = cx.spawn(Actor::new(move |cx, stage, n| {
        own.note(format!("{n} in round {}", cx.pulse().round));
        if n < 3 {
            stage.out.emit(cx, n + 1);
        }
        own.note(format!("{n} ends"));
    }));
    attach!(cx, a.out => a.act);
    app.pulse();
    app.cx().with(a, |a, cx| a.act(cx, 0)).unwrap();
    for _ in 0..3 {
        app.pulse();
    }
    let expected = [
        "0 in round 1",
        "0 ends",
        "1 in round 1",
        "1 ends",
        "2 in round 2",
        "2 ends",
        "3 in round 3",
        "3 ends",
    ];
    assert_eq!(log.take(), expected, "what is parked while draining waits for the next round");
}

#[test]
fn values_never_overtake_each_other_while_calls_wait() {
    // The target is called by its own emission while busy (1, 2) and by a third party while draining (3).
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let seen = log.clone();
    let third = cx.spawn(Button::default());
    let target = cx.spawn(Actor::new(move |cx, stage, n| {
        seen.note(format!("{n}"));
        match n {
            0 => {
                stage.out.emit(cx, 1);
                stage.out.emit(cx, 2);
            }
            1 => {
                // Draining: 2 waits still, so 3 must come behind it.
                let _ = cx.with(third, |third, cx| third.push(cx, 3));
            }
            _ => {}
        }
    }));
    let relay = cx.spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, n)));
    attach!(cx, target.out => relay.act);
    attach!(cx, relay.out => target.act);
    attach!(cx, third.pressed => target.act);
    app.pulse();
    app.cx().with(target, |target, cx| target.act(cx, 0)).unwrap();
    assert_eq!(log.take(), ["0", "1", "2"]);
    // A direct call from outside, before the deferred one has run, waits behind it.
    push(&mut app, third, 4);
    assert_eq!(log.take(), [""; 0]);
    app.pulse();
    assert_eq!(log.take(), ["3", "4"]);
    push(&mut app, third, 5);
    assert_eq!(log.take(), ["5"], "and then the way is free again");
}

#[test]
fn two_objects_that_call_each_other_for_ever_do_not_spin() {
    let (_log, (_world, mut app)) = (Log::default(), world());
    let calls = Rc::new(Cell::new(0u32));
    let cx = app.cx();
    let make = |calls: &Rc<Cell<u32>>| {
        let calls = calls.clone();
        Actor::new(move |cx, stage, n| {
            calls.set(calls.get() + 1);
            stage.out.emit(cx, n + 1);
        })
    };
    let (a, b) = (cx.spawn(make(&calls)), cx.spawn(make(&calls)));
    attach!(cx, a.out => b.act);
    attach!(cx, b.out => a.act);
    attach!(cx, cx.fast_zone().pulse => a.go, OneShot);
    for _ in 0..20 {
        let before = calls.get();
        app.pulse();
        assert!(calls.get() - before <= 4, "{} calls in one round", calls.get() - before);
    }
    assert!(calls.get() >= 20, "and they go on: {}", calls.get());
}

#[test]
fn parked_arguments_are_copies() {
    #[derive(Default)]
    struct Book {
        page: Signal<str>,
        read: Vec<String>,
    }
    impl Book {
        fn open(&mut self, cx: &mut Cx) {
            let mut text = "one".to_owned();
            self.page.emit(cx, text.as_str());
            text.clear();
            text.push_str("two");
            self.page.emit(cx, text.as_str());
        }
        fn hear(&mut self, _cx: &mut Cx, text: &str) {
            self.read.push(text.to_owned());
        }
    }
    object! { Book { signals { page(&str) } slots { open() hear(&str) } } }
    let (_world, mut app) = world();
    let cx = app.cx();
    let book = cx.spawn(Book::default());
    attach!(cx, book.page => book.hear);
    app.pulse();
    app.cx().with(book, |book, cx| book.open(cx)).unwrap();
    assert_eq!(app.cx().with(book, |book, _| book.read.clone()).unwrap(), ["one", "two"]);
}

#[test]
fn a_queued_call_keeps_its_own_place_beside_parked_ones() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let seen = log.clone();
    let a = cx.spawn(Actor::new(move |cx, stage, n| {
        seen.note(n.to_string());
        if n < 2 {
            stage.out.emit(cx, n + 1);
        }
    }));
    let button = cx.spawn(Button::default());
    attach!(cx, a.out => a.act);
    attach!(cx, button.pressed => a.act, Queued);
    app.pulse();
    push(&mut app, button, 10);
    app.cx().with(a, |a, cx| a.act(cx, 0)).unwrap();
    app.pulse();
    assert_eq!(log.take(), ["0", "1", "10", "2"], "queued first, so it runs first");
}

#[test]
fn with_answers_busy_inside_the_objects_own_slot_and_gone_after_burial() {
    let (_world, mut app) = world();
    let cx = app.cx();
    let answers = Rc::new(Cell::new(None));
    let heard = answers.clone();
    let probe = cx.spawn(Actor::new(move |cx, stage, _| {
        heard.set(Some(cx.with(stage.me, |_, _| ()).unwrap_err()));
    }));
    attach!(cx, cx.fast_zone().pulse => probe.go);
    app.pulse();
    app.pulse();
    assert_eq!(answers.get(), Some(Access::Busy));
    app.cx().destroy_later(probe);
    assert_eq!(app.cx().with(probe, |_, _| ()), Ok(()), "still readable");
    app.pulse();
    assert_eq!(app.cx().with(probe, |_, _| ()), Err(Access::Gone));
    assert_eq!(app.cx().with(Handle::<Actor>::nobody(), |_, _| ()), Err(Access::Gone));
}

#[test]
fn the_emitter_of_a_slot_is_leased_but_the_loops_own_objects_are_not() {
    let (log, (simulation, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let seen = log.clone();
    let timer = cx.spawn(Timer::default());
    let listener = cx.spawn(Actor::new(move |cx, _, _| {
        seen.note(format!("timer {:?}", timer.is_running(cx)));
        timer.start_once(cx, ms(20)).unwrap();
        let zone = cx.fast_zone();
        seen.note(format!("zone {:?}", cx.with(zone, |zone, _| zone.pulse.listeners())));
    }));
    attach!(cx, timer.timeout => listener.go);
    timer.start_once(cx, ms(20)).unwrap();
    simulation.run_for(&mut app, ms(45));
    assert_eq!(log.take(), ["timer Ok(false)", "zone Ok(0)", "timer Ok(false)", "zone Ok(0)"]);

    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let seen = log.clone();
    let asker = cx.spawn(Actor::new(move |cx, _, _| {
        seen.note(format!("{:?}", cx.with(button, |button, _| button.presses)));
    }));
    attach!(cx, button.pressed => asker.act);
    app.pulse();
    log.take();
    push(&mut app, button, 1);
    assert_eq!(log.take(), ["Err(Busy)"]);
}

#[test]
fn a_diamond_of_direct_links_reaches_its_foot_twice_in_order() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let top = cx.spawn(Button::default());
    let left = cx.spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, 10 + n)));
    let right = cx.spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, 20 + n)));
    let foot = cx.spawn(Actor::new(note(&log, "foot")));
    attach!(cx, top.pressed => left.act);
    attach!(cx, top.pressed => right.act);
    attach!(cx, left.out => foot.act);
    attach!(cx, right.out => foot.act);
    app.pulse();
    push(&mut app, top, 1);
    assert_eq!(log.take(), ["foot 11", "foot 21"]);
    assert_eq!(app.cx().counters().parked, 0);
}
