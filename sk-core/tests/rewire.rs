//! Attach and detach are requests, carried out at the end of the round.

mod objects;

use objects::*;
use sk_core::prelude::*;

/// A button, pressed at each tick, with a lamp on it.
fn ticking(log: &Log) -> (SkApp, Handle<Button>, Handle<Lamp>) {
    let (_world, mut app) = world();
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", log)));
    attach!(cx, cx.fast_zone().pulse => button.press);
    app.pulse();
    (app, button, lamp)
}

#[test]
fn s51_attach_acts_from_the_next_round() {
    let log = Log::default();
    let (mut app, button, lamp) = ticking(&log);
    let cx = app.cx();
    attach!(cx, button.pressed => lamp.on);
    push(&mut app, button, 100);
    assert_eq!(log.take(), [""; 0], "a trigger right after the request does not arrive");
    app.pulse();
    assert_eq!(log.take(), [""; 0], "nor one in the round that makes the link");
    app.pulse();
    assert_eq!(log.take(), ["lamp 2"]);
}

#[test]
fn s52_detach_acts_after_the_round() {
    let log = Log::default();
    let (mut app, button, lamp) = ticking(&log);
    let cx = app.cx();
    attach!(cx, button.pressed => lamp.on);
    app.pulse();
    let cx = app.cx();
    detach!(cx, button.pressed => lamp.on);
    push(&mut app, button, 100);
    app.pulse();
    assert_eq!(log.take(), ["lamp 100", "lamp 2"], "what is triggered in the same round arrives");
    app.pulse();
    assert_eq!(log.take(), [""; 0], "later ones do not");
}

#[test]
fn s48_detach_removes_the_link() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on);
    attach!(cx, button.pressed => lamp.blink());
    app.pulse();
    let cx = app.cx();
    detach!(cx, button.pressed => lamp.blink());
    detach!(cx, lamp_of(cx, button).pressed => lamp.blink);
    app.pulse();
    assert_eq!(app.cx().links_of(button).len(), 1);
    push(&mut app, button, 1);
    assert_eq!(log.take(), ["lamp 1"]);
    let cx = app.cx();
    detach!(cx, button.pressed => lamp.on);
    app.pulse();
    push(&mut app, button, 2);
    assert_eq!(log.take(), [""; 0]);
}

/// Source and target of `attach!` may be expressions.
fn lamp_of(cx: &Cx, button: Handle<Button>) -> Handle<Button> {
    assert!(cx.is_alive(button));
    button
}

#[test]
fn calls_that_are_queued_already_are_delivered_after_a_detach() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on, Queued);
    attach!(cx, cx.fast_zone().pulse => button.press);
    app.pulse();
    app.pulse();
    let cx = app.cx();
    detach!(cx, button.pressed => lamp.on);
    app.pulse();
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["lamp 1", "lamp 2"], "both were emitted before the cut");
}

#[test]
fn s50_a_second_attach_changes_nothing() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on);
    attach!(cx, button.pressed => lamp.on);
    attach!(cx, button.pressed => lamp.on, Queued);
    app.pulse();
    let cx = app.cx();
    attach!(cx, button.pressed => lamp.on, OneShot);
    cx.attach_by_name(button, "pressed", lamp, "on", Mode::Latest).unwrap();
    app.pulse();
    let links = app.cx().links_of(button);
    assert_eq!(links.len(), 1);
    assert_eq!(links[0].1.mode, Mode::Direct, "whatever the mode asked for");
    let counters = *app.cx().counters();
    assert_eq!((counters.duplicates, counters.links_made, counters.links_refused), (4, 2 - 1, 0));
    push(&mut app, button, 1);
    app.pulse();
    assert_eq!(log.take(), ["lamp 1"]);
}

#[test]
fn requests_of_a_round_are_carried_out_in_their_order() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on);
    detach!(cx, button.pressed => lamp.on);
    detach!(cx, button.pressed => lamp.blink);
    attach!(cx, button.pressed => lamp.blink());
    app.pulse();
    push(&mut app, button, 1);
    assert_eq!(log.take(), ["lamp blinks"]);
}

#[test]
fn links_are_frozen_while_a_signal_is_being_emitted() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let late = cx.spawn(Lamp::new("late", &log));
    let cut = cx.spawn(Lamp::new("cut", &log));
    let changer = cx.spawn(Actor::new(move |cx, _, _| {
        attach!(cx, button.pressed => late.on);
        detach!(cx, button.pressed => cut.on);
    }));
    attach!(cx, button.pressed => changer.act);
    attach!(cx, button.pressed => cut.on);
    app.pulse();
    push(&mut app, button, 1);
    assert_eq!(log.take(), ["cut 1"]);
    app.pulse();
    push(&mut app, button, 2);
    assert_eq!(log.take(), ["late 2"]);
}

#[test]
fn a_zone_whose_links_change_in_its_own_pulse_goes_on_with_the_old_ones() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let lamps = [cx.spawn(Lamp::new("a", &log)), cx.spawn(Lamp::new("b", &log))];
    let changer = cx.spawn(Actor::new(move |cx, stage, _| {
        detach!(cx, cx.fast_zone().pulse => stage.me.go);
        detach!(cx, cx.fast_zone().pulse => lamps[1].blink);
    }));
    attach!(cx, cx.fast_zone().pulse => changer.go);
    for lamp in lamps {
        attach!(cx, cx.fast_zone().pulse => lamp.blink);
    }
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["a blinks", "b blinks"]);
    app.pulse();
    assert_eq!(log.take(), ["a blinks"]);
}

#[test]
fn a_link_whose_end_is_gone_is_refused_and_counted() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on);
    cx.destroy_later(lamp);
    app.pulse();
    let cx = app.cx();
    attach!(cx, button.pressed => lamp.on);
    attach!(cx, Handle::<Button>::nobody().pressed => lamp.on);
    app.pulse();
    assert_eq!(app.cx().counters().links_refused, 3);
    assert_eq!(app.cx().links_of(button).len(), 0);
}

#[test]
fn a_request_made_between_the_rounds_is_carried_out_in_the_next() {
    let log = Log::default();
    let (mut app, button, lamp) = ticking(&log);
    for round in 0..3 {
        let cx = app.cx();
        attach!(cx, button.pressed => lamp.on);
        app.pulse();
        assert_eq!(app.cx().links_of(button).len(), 1, "round {round}");
        let cx = app.cx();
        detach!(cx, button.pressed => lamp.on);
        app.pulse();
        assert_eq!(app.cx().links_of(button).len(), 0, "round {round}");
    }
    assert_eq!(app.cx().counters().duplicates, 0);
}
