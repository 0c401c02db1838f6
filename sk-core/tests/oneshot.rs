//! Links that are gone after their first call.

mod objects;

use objects::*;
use sk_core::prelude::*;

#[test]
fn s58_one_shot_runs_once() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let (direct, queued) = (cx.spawn(Lamp::new("direct", &log)), cx.spawn(Lamp::new("queued", &log)));
    let latest = cx.spawn(Lamp::new("latest", &log));
    attach!(cx, button.pressed => direct.on, OneShot);
    attach!(cx, button.pressed => queued.on, Queued.once());
    attach!(cx, button.pressed => latest.on, Latest.once());
    app.pulse();
    for n in 1..=3 {
        push(&mut app, button, n);
    }
    app.pulse();
    push(&mut app, button, 4);
    app.pulse();
    assert_eq!(log.take(), ["direct 1", "queued 1", "latest 1"]);
    assert_eq!(app.cx().links_of(button).len(), 0, "the links are gone");
}

#[test]
fn one_shot_is_spent_before_its_call_so_that_a_nested_emit_cannot_run_it_twice() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let again = cx.spawn(Button::default());
    let seen = log.clone();
    let slot = cx.spawn(Actor::new(move |cx, stage, n| {
        seen.note(n.to_string());
        stage.out.emit(cx, n + 1);
    }));
    attach!(cx, again.pressed => slot.act, OneShot);
    attach!(cx, slot.out => again.push, Direct);
    app.pulse();
    push(&mut app, again, 1);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["1"]);
}

#[test]
fn one_shot_can_be_armed_anew_in_its_own_slot() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    for (name, once) in [("direct", false), ("queued", true)] {
        let seen = log.clone();
        let slot = cx.spawn(Actor::new(move |cx, stage, n| {
            seen.note(format!("{name} {n}"));
            if once {
                attach!(cx, button.pressed => stage.me.act, Queued.once());
            } else {
                attach!(cx, button.pressed => stage.me.act, OneShot);
            }
        }));
        if once {
            attach!(cx, button.pressed => slot.act, Queued.once());
        } else {
            attach!(cx, button.pressed => slot.act, OneShot);
        }
    }
    app.pulse();
    for n in 1..=3 {
        push(&mut app, button, n);
        push(&mut app, button, 100 + n);
        app.pulse();
        app.pulse();
    }
    let expected = ["direct 1", "queued 1", "direct 2", "queued 2", "direct 3", "queued 3"];
    assert_eq!(log.take(), expected);
    assert_eq!(app.cx().counters().duplicates, 0);
}

#[test]
fn one_shot_beyond_the_depth_limit_is_spent_and_can_be_armed_anew() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let chain: Vec<_> = (0..64)
        .map(|_| cx.spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, n))))
        .collect();
    for pair in chain.windows(2) {
        attach!(cx, pair[0].out => pair[1].act);
    }
    let last = chain[63];
    let seen = log.clone();
    let end = cx.spawn(Actor::new(move |cx, stage, n| {
        seen.note(n.to_string());
        attach!(cx, last.out => stage.me.act, OneShot);
    }));
    let start = cx.spawn(Button::default());
    attach!(cx, start.pressed => chain[0].act);
    attach!(cx, last.out => end.act, OneShot);
    app.pulse();
    for n in 1..=3 {
        push(&mut app, start, n);
        app.pulse();
        app.pulse();
    }
    assert_eq!(log.take(), ["1", "2", "3"]);
    assert_eq!(app.cx().counters().deepened, 3);
    assert_eq!(app.cx().counters().duplicates, 0);
}

#[test]
fn one_shot_by_name_runs_once_too() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    cx.attach_by_name(button, "pressed", lamp, "on", Mode::OneShot).unwrap();
    app.pulse();
    push(&mut app, button, 1);
    push(&mut app, button, 2);
    assert_eq!(log.take(), ["lamp 1"]);
}
