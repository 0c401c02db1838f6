//! Calls of one link that were queued one after the other: they share an entry of the queue and a guard, and
//! nobody must be able to tell. A simulated loop looks at every call by itself, so a real one is tested too.

mod objects;

use objects::*;
use sk_core::eventloop::AfterFailure;
use sk_core::prelude::*;

/// The same test in a simulated loop and in a real one.
fn in_both_worlds(test: impl Fn(&mut SkApp, Log)) {
    let (_world, mut simulated) = world();
    test(&mut simulated, Log::default());
    let mut real = SkApp::builder().mode(TimingMode::NoTiming).build().unwrap();
    test(&mut real, Log::default());
}

#[test]
fn a_panic_ends_its_own_call_and_the_rest_of_the_run_goes_on() {
    in_both_worlds(|app, log| {
        let cx = app.cx();
        cx.configure(|settings| settings.after_panic = AfterFailure::GoOn).unwrap();
        let note = log.clone();
        let actor = cx.spawn(Actor::new(move |cx, _, n| {
            note.note(format!("{n} in {}", cx.counters().queued_calls));
            assert!(n % 2 == 0, "odd");
        }));
        let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
        attach!(cx, button.pressed => actor.act, Queued);
        app.pulse();
        (1..=5).for_each(|n| push(app, button, n));
        attach!(app.cx(), button.pressed => lamp.on, Queued);
        app.pulse();
        assert_eq!(log.take(), ["1 in 1", "2 in 2", "3 in 3", "4 in 4", "5 in 5"]);
        assert_eq!(app.cx().counters().panics, 3);
        push(app, button, 6);
        app.pulse();
        assert_eq!(log.take(), ["6 in 6", "lamp 6"]);
    });
}

#[test]
fn what_a_run_adds_to_its_own_link_waits_for_the_next_round() {
    in_both_worlds(|app, log| {
        let note = log.clone();
        let ping = app.cx().spawn(Actor::new(move |cx, stage, n| {
            note.note(n.to_string());
            if n < 20 {
                stage.out.emit(cx, n + 10);
            }
        }));
        attach!(app.cx(), ping.out => ping.act, Queued);
        app.pulse();
        for n in 1..=3 {
            app.cx().with(ping, |ping, cx| ping.out.emit(cx, n)).unwrap();
        }
        assert_eq!(app.cx().stats().queue_depth, 3);
        app.pulse();
        assert_eq!(log.take(), ["1", "2", "3"]);
        assert_eq!(app.cx().stats().queue_depth, 3);
        app.pulse();
        assert_eq!(log.take(), ["11", "12", "13"]);
        app.pulse();
        assert_eq!(log.take(), ["21", "22", "23"]);
        assert_eq!(app.cx().stats().queue_depth, 0);
    });
}

#[test]
fn a_receiver_that_goes_in_the_middle_of_a_run_gets_no_more_of_it() {
    in_both_worlds(|app, log| {
        let note = log.clone();
        let actor = app.cx().spawn(Actor::new(move |cx, stage, n| {
            note.note(n.to_string());
            if n == 2 {
                cx.destroy_later(stage.me);
            }
        }));
        let button = app.cx().spawn(Button::default());
        attach!(app.cx(), button.pressed => actor.act, Queued);
        app.pulse();
        (1..=4).for_each(|n| push(app, button, n));
        app.pulse();
        assert_eq!(log.take(), ["1", "2"]);
        assert_eq!(app.cx().counters().gone, 2);
        assert!(!app.cx().exists(actor));
    });
}
