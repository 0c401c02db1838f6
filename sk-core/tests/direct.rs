//! Direct links: the slot runs inside the emission.

mod objects;

use objects::*;
use sk_core::prelude::*;
use std::cell::{Cell, RefCell};

#[test]
fn direct_runs_inside_emit_in_attach_order() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let lamps = ["a", "b", "c"].map(|name| cx.spawn(Lamp::new(name, &log)));
    for lamp in [lamps[2], lamps[0], lamps[1]] {
        attach!(cx, button.pressed => lamp.on);
    }
    app.pulse();
    let before = log.clone();
    app.cx()
        .with(button, |button, cx| {
            before.note("before");
            button.push(cx, 7);
            before.note("after");
        })
        .unwrap();
    assert_eq!(log.take(), ["before", "c 7", "a 7", "b 7", "after"]);
}

#[test]
fn s56_direct_runs_inside_the_emission() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let thread = std::thread::current().id();
    let cx = app.cx();
    let inner = log.clone();
    let lamp = cx.spawn(Actor::new(move |_, _, n| {
        assert_eq!(std::thread::current().id(), thread);
        inner.note(format!("slot {n}"));
    }));
    let outer = log.clone();
    let emitter = cx.spawn(Actor::new(move |cx, stage, n| {
        stage.out.emit(cx, n);
        outer.note("emitted");
    }));
    attach!(cx, emitter.out => lamp.act);
    attach!(cx, cx.fast_zone().pulse => emitter.go);
    app.pulse();
    app.pulse();
    assert_eq!(log.take(), ["slot 0", "emitted"]);
}

#[test]
fn s49_slots_run_in_the_order_of_attaching() {
    struct Panel(Log);
    impl Panel {
        fn first(&mut self, _cx: &mut Cx, n: u32) {
            self.0.note(format!("first {n}"));
        }
        fn second(&mut self, _cx: &mut Cx, n: u32) {
            self.0.note(format!("second {n}"));
        }
    }
    object! { Panel { slots { first(u32) second(u32) } } }

    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    let panel = cx.spawn(Panel(log.clone()));
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    attach!(cx, button.pressed => panel.second);
    attach!(cx, button.pressed => lamp.on);
    attach!(cx, button.pressed => panel.first);
    app.pulse();
    push(&mut app, button, 3);
    assert_eq!(log.take(), ["second 3", "lamp 3", "first 3"]);
}

#[test]
fn s55_emitting_is_an_ordinary_call() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let button = app.cx().spawn(Button::default());
    let after = log.clone();
    app.cx()
        .with(button, |button, cx| {
            button.push(cx, 1);
            after.note("after nobody");
        })
        .unwrap();
    let cx = app.cx();
    let lamp = cx.spawn(Lamp::new("lamp", &log));
    attach!(cx, button.pressed => lamp.on);
    app.pulse();
    let after = log.clone();
    app.cx()
        .with(button, |button, cx| {
            button.push(cx, 2);
            after.note("after somebody");
        })
        .unwrap();
    assert_eq!(log.take(), ["after nobody", "lamp 2", "after somebody"]);
}

#[test]
fn s61_a_direct_slot_sees_the_originals() {
    #[derive(Clone, Default)]
    struct Question {
        text: String,
        answer: Cell<Option<u32>>,
    }
    #[derive(Default)]
    struct Asker {
        asked: Signal<Question>,
        got: Option<u32>,
    }
    impl Asker {
        fn ask(&mut self, cx: &mut Cx) {
            let question = Question { text: "six times seven".to_owned(), ..Default::default() };
            SEEN_AT.set(&raw const question as usize);
            self.asked.emit(cx, &question);
            self.got = question.answer.get();
        }
    }
    object! { Asker { signals { asked(&Question) } slots { ask() } } }
    struct Knower;
    impl Knower {
        fn answer(&mut self, _cx: &mut Cx, question: &Question) {
            assert_eq!(std::ptr::from_ref(question) as usize, SEEN_AT.get(), "no copy was made");
            question.answer.set(Some(question.text.len() as u32));
        }
    }
    object! { Knower { slots { answer(&Question) } } }
    thread_local!(static SEEN_AT: Cell<usize> = const { Cell::new(0) });

    let (_world, mut app) = world();
    let cx = app.cx();
    let (asker, knower) = (cx.spawn(Asker::default()), cx.spawn(Knower));
    attach!(cx, asker.asked => knower.answer);
    app.pulse();
    app.cx().with(asker, |asker, cx| asker.ask(cx)).unwrap();
    assert_eq!(app.cx().with(asker, |asker, _| asker.got), Ok(Some(15)));
}

#[test]
fn s60_any_arguments_pass() {
    #[derive(Clone, PartialEq, Debug)]
    struct Own {
        x: f64,
    }
    #[derive(Default)]
    struct Sender {
        none: Signal<()>,
        text: Signal<str>,
        bytes: Signal<[u8]>,
        own: Signal<Own>,
        many: Signal<(u8, String, Vec<i64>, bool, Own)>,
        shared: Signal<Rc<str>>,
        count: Signal<u64>,
    }
    object! { Sender { signals {
        none() text(&str) bytes(&[u8]) own(&Own) many(u8, &str, &[i64], bool, &Own) shared(Rc<str>) count(u64)
    } } }
    struct Taker(Rc<RefCell<Vec<String>>>);
    impl Taker {
        fn note(&mut self, what: String) {
            self.0.borrow_mut().push(what);
        }
        fn none(&mut self, _: &mut Cx) {
            self.note("()".into());
        }
        fn text(&mut self, _: &mut Cx, text: &str) {
            self.note(text.into());
        }
        fn owned_text(&mut self, _: &mut Cx, text: String) {
            self.note(text);
        }
        fn bytes(&mut self, _: &mut Cx, bytes: &[u8]) {
            self.note(format!("{bytes:?}"));
        }
        fn vec(&mut self, _: &mut Cx, bytes: Vec<u8>) {
            self.note(format!("{bytes:?}"));
        }
        fn own(&mut self, _: &mut Cx, own: Own) {
            self.note(format!("{own:?}"));
        }
        fn many(&mut self, _: &mut Cx, a: u8, b: &str, c: &[i64], d: bool, e: &Own) {
            self.note(format!("{a} {b} {c:?} {d} {e:?}"));
        }
        fn shared(&mut self, _: &mut Cx, text: &Rc<str>) {
            self.note(text.to_string());
        }
        fn count(&mut self, _: &mut Cx, n: &u64) {
            self.note(n.to_string());
        }
    }
    object! { Taker { slots {
        none() text(&str) owned_text(String) bytes(&[u8]) vec(Vec<u8>) own(Own)
        many(u8, &str, &[i64], bool, &Own) shared(&Rc<str>) count(&u64)
    } } }

    let (_world, mut app) = world();
    let got = Rc::new(RefCell::new(Vec::new()));
    let cx = app.cx();
    let (s, direct, queued) =
        (cx.spawn(Sender::default()), cx.spawn(Taker(got.clone())), cx.spawn(Taker(got.clone())));
    attach!(cx, s.none => direct.none);
    attach!(cx, s.text => direct.text);
    attach!(cx, s.text => direct.owned_text);
    attach!(cx, s.bytes => direct.bytes);
    attach!(cx, s.bytes => direct.vec);
    attach!(cx, s.own => direct.own);
    attach!(cx, s.many => direct.many);
    attach!(cx, s.shared => direct.shared);
    attach!(cx, s.count => direct.count);
    attach!(cx, s.none => queued.none, Queued);
    attach!(cx, s.text => queued.text, Queued);
    attach!(cx, s.text => queued.owned_text, Queued);
    attach!(cx, s.bytes => queued.bytes, Queued);
    attach!(cx, s.bytes => queued.vec, Queued);
    attach!(cx, s.own => queued.own, Queued);
    attach!(cx, s.many => queued.many, Queued);
    attach!(cx, s.shared => queued.shared, Queued);
    attach!(cx, s.count => queued.count, Queued);
    app.pulse();
    app.cx()
        .with(s, |s, cx| {
            s.none.emit(cx, ());
            s.text.emit(cx, "text");
            s.bytes.emit(cx, [1, 2].as_slice());
            s.own.emit(cx, Own { x: 0.5 });
            s.many.emit(cx, (1, "two".to_owned(), vec![3], true, Own { x: 4.0 }));
            s.shared.emit(cx, Rc::<str>::from("shared"));
            s.count.emit(cx, 9);
        })
        .unwrap();
    let many = r#"1 two [3] true Own { x: 4.0 }"#;
    let expected =
        ["()", "text", "text", "[1, 2]", "[1, 2]", "Own { x: 0.5 }", many, "shared", "9"].map(str::to_owned);
    assert_eq!(got.take(), expected);
    app.pulse();
    assert_eq!(got.take(), expected, "and the same by copies");
}

#[test]
fn depth_a_chain_of_100_000_direct_links_is_queued_every_64_levels() {
    struct Link {
        next: Signal<u32>,
        reached: Rc<Cell<u32>>,
    }
    impl Link {
        fn pass(&mut self, cx: &mut Cx, n: u32) {
            self.reached.set(self.reached.get() + 1);
            self.next.emit(cx, n + 1);
        }
    }
    object! { Link { signals { next(u32) } slots { pass(u32) } } }
    const LINKS: u32 = 100_000;

    let run = || {
        let (_world, mut app) = world();
        let reached = Rc::new(Cell::new(0));
        let cx = app.cx();
        let links: Vec<_> = (0..LINKS)
            .map(|_| cx.spawn(Link { next: Signal::new(), reached: reached.clone() }))
            .collect();
        for pair in links.windows(2) {
            attach!(cx, pair[0].next => pair[1].pass);
        }
        app.pulse();
        app.cx().with(links[0], |link, cx| link.pass(cx, 0)).unwrap();
        assert_eq!(reached.get(), 65, "the first and 64 nested in it");
        let mut rounds = 0u64;
        while reached.get() < LINKS {
            app.pulse();
            rounds += 1;
        }
        assert_eq!(rounds, app.cx().counters().deepened);
    };
    std::thread::Builder::new()
        .stack_size(512 * 1024)
        .spawn(run)
        .unwrap()
        .join()
        .unwrap();
}

#[test]
fn a_signal_of_an_object_that_nobody_hears_costs_no_links() {
    let (_world, mut app) = world();
    let button = app.cx().spawn(Button::default());
    push(&mut app, button, 1);
    assert_eq!(app.cx().with(button, |button, _| button.pressed.listeners()), Ok(0));
    assert_eq!(std::mem::size_of::<Signal<String>>(), 8);
}
