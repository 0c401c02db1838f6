//! Calls that a full queue or a full mailbox refused: what is lost with them, and what is not.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::sync::mpsc::{Receiver, Sender, channel};

/// How many messages the slow thread takes.
const ROOM: usize = 20;

struct Ear(Sender<u32>);
impl Ear {
    fn hear(&mut self, _cx: &mut Cx, n: u32) {
        // The test may have ended.
        let _ = self.0.send(n);
    }
}
object! { Ear { slots { hear(u32) } } }

/// An application that ticks often, and a thread that seldom looks into its small mailbox.
fn slow_thread() -> (Simulation, SkApp, SkThread) {
    let (simulation, mut app) = world();
    let slow = SkThread::new("slow")
        .interval(Duration::from_secs(1))
        .configure(|settings| settings.mailbox_messages_max = ROOM)
        .start(app.cx())
        .unwrap();
    (simulation, app, slow)
}

fn ear(thread: &SkThread) -> (Remote<Ear>, Receiver<u32>) {
    let (sender, receiver) = channel();
    let ear = thread
        .build(move |cx| {
            let ear = cx.spawn(Ear(sender));
            cx.remote(ear)
        })
        .unwrap();
    (ear, receiver)
}

fn fill(ear: &Remote<Ear>) -> usize {
    (0..).take_while(|_| ear.post(|_, _| ()).is_ok()).count()
}

fn round_of_the_slow_one(simulation: &Simulation, app: &mut SkApp) {
    simulation.run_for(app, Duration::from_secs(2));
}

#[test]
fn a_latest_link_to_a_full_mailbox_goes_on_when_there_is_room_again() {
    let (simulation, mut app, slow) = slow_thread();
    let (ear, heard) = ear(&slow);
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    attach!(cx, button.pressed => ear.hear, Latest);
    app.pulse();
    round_of_the_slow_one(&simulation, &mut app);
    assert_eq!(fill(&ear), ROOM);
    push(&mut app, button, 1);
    push(&mut app, button, 2);
    round_of_the_slow_one(&simulation, &mut app);
    assert_eq!(heard.try_iter().collect::<Vec<_>>(), [2], "its one call is not refused: it has a place");
    push(&mut app, button, 3);
    round_of_the_slow_one(&simulation, &mut app);
    assert_eq!(heard.try_iter().collect::<Vec<_>>(), [3]);
    let link = &app.cx().links_of(button)[0].1;
    assert_eq!((link.replaced, link.refused), (1, 0));
    assert_eq!(app.cx().counters().refused_full, 0);
}

#[test]
fn a_one_shot_whose_call_a_full_mailbox_refused_is_not_spent() {
    let (simulation, mut app, slow) = slow_thread();
    let (ear, heard) = ear(&slow);
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    attach!(cx, button.pressed => ear.hear, Queued.once());
    app.pulse();
    round_of_the_slow_one(&simulation, &mut app);
    fill(&ear);
    push(&mut app, button, 1);
    assert_eq!(app.cx().counters().refused_full, 1);
    round_of_the_slow_one(&simulation, &mut app);
    assert_eq!(app.cx().links_of(button).len(), 1, "it waits for a call that gets through");
    push(&mut app, button, 2);
    push(&mut app, button, 3);
    round_of_the_slow_one(&simulation, &mut app);
    assert_eq!(heard.try_iter().collect::<Vec<_>>(), [2]);
    assert_eq!(app.cx().links_of(button).len(), 0);
}

#[test]
fn a_one_shot_whose_call_a_full_queue_refused_is_not_spent() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.queue_calls_max = 1);
    let log = Log::default();
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let (queued, latest) = (cx.spawn(Lamp::new("queued", &log)), cx.spawn(Lamp::new("latest", &log)));
    let filler = cx.spawn(Lamp::new("filler", &log));
    attach!(cx, button.pressed => queued.on, Queued.once());
    attach!(cx, button.pressed => latest.on, Latest.once());
    app.pulse();
    app.cx().invoke_method(filler, "blink", &[]).unwrap();
    push(&mut app, button, 1);
    app.pulse();
    assert_eq!(log.take(), ["filler blinks"]);
    for n in 2..=4 {
        push(&mut app, button, n);
        app.pulse();
    }
    assert_eq!(log.take(), ["queued 2", "latest 3"], "each had its one call when there was room");
    assert_eq!(app.cx().links_of(button).len(), 0);
}

#[test]
fn a_direct_one_shot_that_could_not_be_parked_is_not_spent() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.queue_calls_max = 1);
    let log = Log::default();
    let cx = app.cx();
    let (filler, button) = (cx.spawn(Button::default()), cx.spawn(Button::default()));
    // The busy one emits to itself: the first call takes the only place, the second is the one-shot's.
    let seen = log.clone();
    let busy = cx.spawn(Actor::new(move |cx, _, n| {
        seen.note(n.to_string());
        if n == 0 {
            cx.with(filler, |filler, cx| filler.push(cx, 1)).unwrap();
            cx.with(button, |button, cx| button.push(cx, 2)).unwrap();
        }
    }));
    attach!(cx, filler.pressed => busy.act);
    attach!(cx, button.pressed => busy.act, OneShot);
    app.pulse();
    app.cx().with(busy, |busy, cx| busy.go(cx)).unwrap();
    assert_eq!(log.take(), ["0", "1"]);
    app.pulse();
    push(&mut app, button, 3);
    push(&mut app, button, 4);
    assert_eq!(log.take(), ["3"]);
}

#[test]
fn a_one_shot_beyond_the_depth_limit_that_found_the_queue_full_is_not_spent() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.queue_calls_max = 1);
    let log = Log::default();
    let cx = app.cx();
    let chain: Vec<_> = (0..64)
        .map(|_| cx.spawn(Actor::new(|cx, stage, n| stage.out.emit(cx, n))))
        .collect();
    for pair in chain.windows(2) {
        attach!(cx, pair[0].out => pair[1].act);
    }
    let (start, end) = (cx.spawn(Button::default()), cx.spawn(Lamp::new("end", &log)));
    attach!(cx, start.pressed => chain[0].act);
    attach!(cx, chain[63].out => end.on, OneShot);
    app.pulse();
    app.cx().invoke_method(end, "blink", &[]).unwrap();
    push(&mut app, start, 1);
    app.pulse();
    assert_eq!(log.take(), ["end blinks"]);
    push(&mut app, start, 2);
    app.pulse();
    assert_eq!(log.take(), ["end 2"]);
}

#[test]
fn requests_to_attach_beyond_their_bound_are_refused_and_counted() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.rewires_max = 3);
    let log = Log::default();
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let lamps: Vec<_> = (0..5).map(|_| cx.spawn(Lamp::new("lamp", &log))).collect();
    for &lamp in &lamps {
        attach!(cx, button.pressed => lamp.on);
    }
    assert_eq!(cx.counters().links_refused, 2);
    assert_eq!(
        cx.attach_by_name(button, "pressed", lamps[4], "on", Mode::Direct),
        Err(MetaError::Full(3))
    );
    detach!(cx, button.pressed => lamps[0].on);
    assert_eq!(cx.counters().links_refused, 4);
    app.pulse();
    assert_eq!(app.cx().links_of(button).len(), 3, "the oldest are kept");
    let cx = app.cx();
    attach!(cx, button.pressed => lamps[4].on);
    app.pulse();
    assert_eq!(app.cx().links_of(button).len(), 4, "and there is room again");
}

#[test]
fn requests_to_attach_to_a_full_mailbox_are_refused_and_counted() {
    let (simulation, mut app, slow) = slow_thread();
    let (button, other) = slow
        .build(|cx| {
            let (button, other) = (cx.spawn(Button::default()), cx.spawn(Button::default()));
            (cx.remote(button), cx.remote(other))
        })
        .unwrap();
    let cx = app.cx();
    for _ in 0..2 * ROOM {
        attach!(cx, button.pressed => other.push, Queued);
    }
    assert_eq!(cx.counters().links_refused, ROOM as u64);
    assert_eq!(other.post(|_, _| ()), Err(sk_core::thread::PostError::Full(ROOM)));
    round_of_the_slow_one(&simulation, &mut app);
    let counters = slow.build(|cx| *cx.counters()).unwrap();
    assert_eq!((counters.links_made, counters.duplicates), (1, ROOM as u64 - 1));
}

/// Gets the answers.
#[derive(Default)]
struct Asker(u64);
impl Asker {
    fn answer(&mut self, _cx: &mut Cx, answer: Result<u32, Access>) {
        self.0 += u64::from(answer.is_ok());
    }
    fn done(&mut self, _cx: &mut Cx, _result: u32) {
        self.0 += 1;
    }
}
object! { Asker { slots { answer(Result<u32, Access>) done(u32) } } }

#[test]
fn answers_are_bounded_where_they_are_asked_for_and_none_is_lost() {
    let (simulation, mut app, slow) = slow_thread();
    let asker = slow
        .build(|cx| {
            let asker = cx.spawn(Asker::default());
            cx.remote(asker)
        })
        .unwrap();
    let button = app.cx().spawn(Button::default());
    let button = app.cx().remote(button);
    // The answers come faster than the slow thread looks at them.
    let mut taken = 0;
    for _ in 0..2 * ROOM {
        taken += u64::from(button.ask(|button, _| button.presses, asker.slots().answer()).is_ok());
        app.pulse();
    }
    assert_eq!(taken, ROOM as u64);
    assert_eq!(
        button.ask(|button, _| button.presses, asker.slots().answer()),
        Err(sk_core::thread::PostError::Full(ROOM))
    );
    round_of_the_slow_one(&simulation, &mut app);
    let heard = || {
        let asker = asker.clone();
        let (sender, receiver) = channel();
        asker.post(move |asker, _| sender.send(asker.0).unwrap()).unwrap();
        receiver
    };
    let count = heard();
    round_of_the_slow_one(&simulation, &mut app);
    assert_eq!(count.try_recv(), Ok(taken));
    button.ask(|button, _| button.presses, asker.slots().answer()).unwrap();
    drop(slow);
    assert_eq!(
        button.ask(|button, _| button.presses, asker.slots().answer()),
        Err(sk_core::thread::PostError::Gone)
    );
}

#[test]
fn results_of_work_are_bounded_by_the_mailbox_too() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.mailbox_messages_max = 3);
    let cx = app.cx();
    let asker = cx.spawn(Asker::default());
    for _ in 0..3 {
        cx.work(|| 7u32, asker.slots().done()).unwrap();
    }
    assert!(cx.work(|| 7u32, asker.slots().done()).is_err());
    simulation.run_for(&mut app, Duration::from_secs(10));
    assert_eq!(app.cx().with(asker, |asker, _| asker.0), Ok(3));
    app.cx().work(|| 7u32, asker.slots().done()).unwrap();
}
