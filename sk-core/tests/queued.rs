//! Queued and Latest links, and the bounds of the queue.

mod objects;

use objects::*;
use sk_core::prelude::*;

#[test]
fn s57_queued_runs_in_the_next_round() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on, Queued);
    attach!(cx, cx.fast_zone().pulse => button.press);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), [""; 0], "emitted in this round");
    app.pulse();
    assert_eq!(log.take(), ["lamp 1"]);
}

#[test]
fn queued_copies_the_arguments_and_keeps_their_order() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let (a, b) = (cx.spawn(Lamp::new("a", &log)), cx.spawn(Lamp::new("b", &log)));
    attach!(cx, button.pressed => a.on, Queued);
    attach!(cx, button.pressed => b.on, Queued);
    app.pulse();
    for n in 1..=3 {
        push(&mut app, button, n);
    }
    app.pulse();
    assert_eq!(log.take(), ["a 1", "b 1", "a 2", "b 2", "a 3", "b 3"]);
    assert_eq!(app.cx().counters().queued_calls, 6);
}

#[test]
fn what_a_queued_call_queues_runs_one_round_later() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let note = log.clone();
    let ping = cx.spawn(Actor::new(move |cx, stage, n| {
        note.note(format!("{n} in round {}", cx.pulse().round));
        stage.out.emit(cx, n + 1);
    }));
    attach!(cx, ping.out => ping.act, Queued);
    app.pulse();
    app.cx().with(ping, |ping, cx| ping.act(cx, 0)).unwrap();
    log.take();
    for _ in 0..3 {
        app.pulse();
    }
    assert_eq!(log.take(), ["1 in round 2", "2 in round 3", "3 in round 4"]);
}

#[test]
fn s62_a_queued_slot_gets_copies() {
    #[derive(Default)]
    struct Writer {
        written: Signal<Vec<u32>>,
        page: Vec<u32>,
    }
    impl Writer {
        fn write(&mut self, cx: &mut Cx, n: u32) {
            self.page.push(n);
            self.written.emit(cx, &self.page);
            self.page.clear();
        }
    }
    object! { Writer { signals { written(&Vec<u32>) } slots { write(u32) } } }
    struct Reader(Log);
    impl Reader {
        fn read(&mut self, _cx: &mut Cx, page: &Vec<u32>) {
            self.0.note(format!("{page:?}"));
        }
    }
    object! { Reader { slots { read(&Vec<u32>) } } }

    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (writer, reader) = (cx.spawn(Writer::default()), cx.spawn(Reader(log.clone())));
    attach!(cx, writer.written => reader.read, Queued);
    app.pulse();
    app.cx().with(writer, |writer, cx| writer.write(cx, 5)).unwrap();
    app.pulse();
    assert_eq!(log.take(), ["[5]"]);
}

#[test]
fn latest_keeps_the_newest_call_and_counts_the_replaced() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    attach!(cx, button.pressed => lamp.on, Latest);
    app.pulse();
    for n in 1..=5 {
        push(&mut app, button, n);
    }
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["lamp 5"]);
    assert_eq!(app.cx().counters().replaced, 4);
    assert_eq!(app.cx().links_of(button)[0].1.replaced, 4, "the link knows its own");
    push(&mut app, button, 6);
    app.pulse();
    assert_eq!(log.take(), ["lamp 6"]);
}

#[test]
fn latest_keeps_one_call_for_each_link() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    let buttons = [cx.spawn(Button::default()), cx.spawn(Button::default())];
    for button in buttons {
        attach!(cx, button.pressed => lamp.on, Latest);
    }
    app.pulse();
    push(&mut app, buttons[0], 1);
    push(&mut app, buttons[1], 2);
    push(&mut app, buttons[0], 3);
    app.pulse();
    assert_eq!(log.take(), ["lamp 3", "lamp 2"]);
}

#[test]
fn queue_full_refuses_the_newest_and_says_so_once_per_episode() {
    let simulation = sk_core::testing::Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.queue_calls_max = 4);
    let log = Log::default();
    let cx = app.cx();
    let (button, lamp) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("lamp", &log)));
    let guard = cx.spawn(Lamp::new("guard", &log));
    attach!(cx, button.pressed => lamp.on, Queued);
    attach!(cx, cx.event_loop().mailbox_full => guard.blink);
    app.pulse();
    for round in 0..3 {
        for n in 0..6 {
            push(&mut app, button, 10 * round + n);
        }
        app.pulse();
        assert_eq!(app.cx().counters().refused_full, 2 * u64::from(round + 1));
        assert_eq!(app.cx().links_of(button)[0].1.refused, 2 * u64::from(round + 1));
    }
    let told = log.take();
    assert_eq!(told.iter().filter(|line| *line == "guard blinks").count(), 1, "{told:?}");
    assert_eq!(told[..4], ["lamp 0", "lamp 1", "lamp 2", "lamp 3"]);

    app.pulse();
    app.pulse();
    for n in 0..5 {
        push(&mut app, button, n);
    }
    app.pulse();
    let told = log.take();
    assert_eq!(told.iter().filter(|line| *line == "guard blinks").count(), 1, "a new episode: {told:?}");
}

#[test]
fn queue_full_is_an_error_of_an_explicit_call() {
    let simulation = sk_core::testing::Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.queue_calls_max = 2);
    let log = Log::default();
    let cx = app.cx();
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    cx.invoke_method(lamp, "on", &[1.into()]).unwrap();
    cx.invoke_method(lamp, "on", &[2.into()]).unwrap();
    assert_eq!(cx.invoke_method(lamp, "on", &[3.into()]), Err(MetaError::Full(2)));
    app.pulse();
    assert_eq!(log.take(), ["lamp 1", "lamp 2"]);
    app.cx().invoke_method(lamp, "on", &[3.into()]).unwrap();
}

#[test]
fn s41_many_activities_interleave_on_one_thread() {
    let (log, (simulation, mut app)) = (Log::default(), world());
    let cx = app.cx();
    for (name, period) in [("slow", 30), ("quick", 10)] {
        let lamp = cx.spawn(Lamp::new(name, &log));
        let timer = cx.under(lamp).spawn(Timer::default());
        attach!(cx, timer.timeout => lamp.blink);
        timer.start(cx, ms(period)).unwrap();
    }
    let chain = cx.spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, n + 1)));
    attach!(cx, chain.out => chain.act, Queued);
    attach!(cx, cx.fast_zone().pulse => chain.go, OneShot);
    simulation.run_for(&mut app, ms(100));
    let seen = log.take();
    assert_eq!(seen.iter().filter(|line| *line == "quick blinks").count(), 9, "{seen:?}");
    assert_eq!(seen.iter().filter(|line| *line == "slow blinks").count(), 3, "{seen:?}");
    assert_eq!(app.cx().counters().queued_calls, 8);
}
