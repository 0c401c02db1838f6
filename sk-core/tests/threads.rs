//! Several loops on real threads: nothing is lost, order per sender, bounds, notices.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::thread::PostError;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::ThreadId;

/// Far longer than anything here takes: reaching it means that something never came.
const WATCHDOG: Duration = Duration::from_secs(60);

/// Tells the test thread what it got.
struct Ear(Sender<(u32, u64)>);
impl Ear {
    fn hear(&mut self, _cx: &mut Cx, from: u32, n: u64) {
        // The test may have ended.
        let _ = self.0.send((from, n));
    }
}
object! { Ear { slots { hear(u32, u64) } } }

/// Emits a burst at each tick until it has said everything.
struct Mouth {
    own: u32,
    said: u64,
    all: u64,
    burst: u64,
    word: Signal<(u32, u64)>,
}
impl Mouth {
    fn talk(&mut self, cx: &mut Cx) {
        for _ in 0..self.burst.min(self.all - self.said) {
            self.word.emit(cx, (self.own, self.said));
            self.said += 1;
        }
    }
}
object! { Mouth { signals { word(u32, u64) } slots { talk() } } }

fn real_app() -> SkApp {
    SkApp::builder().interval(ms(1)).mode(TimingMode::SelectIo).build().unwrap()
}

fn thread(app: &mut SkApp, name: &str, mode: TimingMode) -> SkThread {
    SkThread::new(name).mode(mode).interval(ms(1)).start(app.cx()).unwrap()
}

fn ear(thread: &SkThread) -> (Remote<Ear>, Receiver<(u32, u64)>) {
    let (sender, receiver) = channel();
    let ear = thread
        .build(move |cx| {
            let ear = cx.spawn(Ear(sender));
            cx.remote(ear)
        })
        .unwrap();
    (ear, receiver)
}

fn mouth(thread: &SkThread, own: u32, all: u64, burst: u64) -> Remote<Mouth> {
    thread
        .build(move |cx| {
            let mouth = cx.spawn(Mouth { own, said: 0, all, burst, word: Signal::new() });
            cx.remote(mouth)
        })
        .unwrap()
}

/// The mouth talks from its next round on.
fn start(thread: &SkThread, mouth: &Remote<Mouth>) {
    let mouth = mouth.clone();
    thread
        .build(move |cx| attach!(cx, cx.fast_zone().pulse => mouth.talk, Queued))
        .unwrap();
}

/// A round of the thread's loop has passed, so links asked for before are made.
fn settle(thread: &SkThread) {
    for _ in 0..2 {
        thread.build(|_| ()).unwrap();
    }
}

#[test]
fn s63_no_queued_call_across_threads_is_lost() {
    const SENDERS: u32 = 4;
    const CALLS: u64 = 50_000;
    let mut app = real_app();
    let modes = [TimingMode::SelectIo, TimingMode::Coarse, TimingMode::Realtime, TimingMode::SelectIo];
    // Nothing is lost within the bound; so the bound is above what is sent.
    let receiver = SkThread::new("receiver")
        .configure(|settings| settings.mailbox_messages_max = 1_000_000)
        .start(app.cx())
        .unwrap();
    let (ear, heard) = ear(&receiver);
    let senders: Vec<SkThread> = (0..SENDERS)
        .map(|i| thread(&mut app, &format!("sender {i}"), modes[i as usize]))
        .collect();
    for (i, sender) in senders.iter().enumerate() {
        let mouth = mouth(sender, i as u32, CALLS, 500);
        let cx = app.cx();
        attach!(cx, mouth.word => ear.hear, Queued);
        settle(sender);
        start(sender, &mouth);
    }
    let mut next = [0; SENDERS as usize];
    for _ in 0..u64::from(SENDERS) * CALLS {
        let (from, n) = heard.recv_timeout(WATCHDOG).expect("a call was lost");
        assert_eq!(n, next[from as usize], "FIFO per sending thread");
        next[from as usize] += 1;
    }
    assert_eq!(next, [CALLS; SENDERS as usize]);
    drop(senders);
    receiver.stop();
    assert!(heard.try_recv().is_err(), "nor did one come twice");
}

#[test]
fn latest_across_threads_ends_with_the_newest() {
    let mut app = real_app();
    let receiver = thread(&mut app, "receiver", TimingMode::Coarse);
    let sender = thread(&mut app, "sender", TimingMode::SelectIo);
    let (ear, heard) = ear(&receiver);
    let mouth = mouth(&sender, 0, 20_000, 1000);
    let cx = app.cx();
    attach!(cx, mouth.word => ear.hear, Latest);
    settle(&sender);
    start(&sender, &mouth);
    let mut last = None;
    let mut count = 0;
    while last != Some(19_999) {
        let (_, n) = heard.recv_timeout(WATCHDOG).expect("the newest never came");
        assert!(last < Some(n), "never an older one after a newer: {last:?}, {n}");
        (last, count) = (Some(n), count + 1);
    }
    let replaced = sender.build(|cx| cx.counters().replaced).unwrap();
    assert_eq!(replaced + count, 20_000, "every other one is counted as replaced");
}

#[test]
fn calls_and_posts_of_one_thread_are_one_fifo() {
    let mut app = real_app();
    let receiver = thread(&mut app, "receiver", TimingMode::SelectIo);
    let (ear, heard) = ear(&receiver);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth { own: 1, said: 0, all: 1000, burst: 1, word: Signal::new() });
    attach!(cx, mouth.word => ear.hear, Queued);
    app.pulse();
    for n in 0..1000 {
        app.cx().with(mouth, |mouth, cx| mouth.talk(cx)).unwrap();
        ear.post(move |ear, cx| ear.hear(cx, 2, n)).unwrap();
    }
    for n in 0..1000 {
        assert_eq!(heard.recv_timeout(WATCHDOG), Ok((1, n)));
        assert_eq!(heard.recv_timeout(WATCHDOG), Ok((2, n)));
    }
}

#[test]
fn s09_slots_run_on_the_loop_of_their_object() {
    struct Where(Sender<(ThreadId, String)>);
    impl Where {
        fn tell(&mut self, cx: &mut Cx) {
            let _ = self.0.send((std::thread::current().id(), cx.loop_name().to_owned()));
        }
    }
    object! { Where { slots { tell() } } }
    let mut app = real_app();
    let vision = thread(&mut app, "vision", TimingMode::SelectIo);
    let (sender, told) = channel();
    let (id, there) = vision
        .build(move |cx| {
            let there = cx.spawn(Where(sender));
            (std::thread::current().id(), cx.remote(there))
        })
        .unwrap();
    assert_ne!(id, std::thread::current().id());
    let cx = app.cx();
    let button = cx.spawn(Button::default());
    attach!(cx, button.pressed => there.tell(), Queued);
    app.pulse();
    push(&mut app, button, 1);
    app.cx().invoke_method(&there, "tell", &[]).unwrap();
    there.post(|there, cx| there.tell(cx)).unwrap();
    for _ in 0..3 {
        assert_eq!(told.recv_timeout(WATCHDOG), Ok((id, "vision".to_owned())));
    }
}

#[test]
fn s23_a_thread_inherits_or_overrides() {
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(ms(3))
        .slow_interval(ms(77))
        .build()
        .unwrap();
    let heir = SkThread::new("heir").start(app.cx()).unwrap();
    let own = SkThread::new("own")
        .mode(TimingMode::Coarse)
        .interval(ms(5))
        .start(app.cx())
        .unwrap();
    let settings = |thread: &SkThread| {
        thread
            .build(|cx| (cx.settings().mode, cx.settings().interval, cx.settings().slow_interval))
            .unwrap()
    };
    assert_eq!(settings(&heir), (TimingMode::SelectIo, ms(3), ms(77)));
    assert_eq!(settings(&own), (TimingMode::Coarse, ms(5), ms(77)));
    let refused = SkThread::new("wrong").slow_interval(ms(1)).start(app.cx());
    assert!(matches!(refused, Err(ThreadError::Settings(_))));
}

#[test]
fn s21_a_thread_has_exactly_one_loop() {
    let mut app = real_app();
    let (sender, outcome) = channel();
    let cx = app.cx();
    let nester = cx.spawn(Actor::new(move |_, _, _| {
        let mut inner = SkApp::new();
        inner.pulse();
        let _ = sender.send((inner.run(), inner.cx().pulse().round));
    }));
    attach!(cx, cx.fast_zone().pulse => nester.go, OneShot);
    app.pulse();
    while app.cx().counters().links_made == 0 || app.cx().pulse().number < 2 {
        app.pulse();
    }
    assert_eq!(outcome.recv_timeout(WATCHDOG), Ok((Run::Nested, 0)));
    let vision = thread(&mut app, "vision", TimingMode::SelectIo);
    let nested = vision.build(|_| {
        let mut inner = SkApp::new();
        inner.run()
    });
    assert_eq!(nested.unwrap(), Run::Nested);
}

#[test]
fn mailbox_holds_its_bound_and_refuses_the_newest() {
    let mut app = real_app();
    let receiver = SkThread::new("receiver")
        .mode(TimingMode::SelectIo)
        .configure(|settings| settings.mailbox_messages_max = 100)
        .start(app.cx())
        .unwrap();
    let (ear, heard) = ear(&receiver);
    // The receiving loop stands still until the test lets it go on.
    let (open, gate) = channel::<()>();
    let (came, inside) = channel();
    ear.post(move |_, _| {
        let _ = came.send(());
        // It opens when the test drops its end, even by failing.
        let _ = gate.recv();
    })
    .unwrap();
    inside.recv_timeout(WATCHDOG).unwrap();
    let cx = app.cx();
    let mouth = cx.spawn(Mouth { own: 0, said: 0, all: 500, burst: 500, word: Signal::new() });
    attach!(cx, mouth.word => ear.hear, Queued);
    app.pulse();
    app.cx().with(mouth, |mouth, cx| mouth.talk(cx)).unwrap();
    let refused = app.cx().counters().refused_full;
    assert!(
        (400..=410).contains(&refused),
        "{refused}: a few messages of the bound are the link's own"
    );
    assert_eq!(ear.post(|_, _| ()), Err(PostError::Full(100)));
    drop(open);
    let delivered = 500 - refused;
    for n in 0..delivered {
        assert_eq!(heard.recv_timeout(WATCHDOG), Ok((0, n)), "the oldest are kept, in order");
    }
    settle(&receiver);
    assert!(heard.try_recv().is_err());
    ear.post(|_, _| ()).unwrap();
}

#[test]
fn burying_a_receiver_tells_every_loop_that_links_to_it() {
    let mut app = real_app();
    let receiver = thread(&mut app, "receiver", TimingMode::SelectIo);
    let (ear, heard) = ear(&receiver);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth { own: 0, said: 0, all: 10, burst: 1, word: Signal::new() });
    attach!(cx, mouth.word => ear.hear, Queued);
    app.pulse();
    settle(&receiver);
    app.cx().with(mouth, |mouth, cx| mouth.talk(cx)).unwrap();
    assert_eq!(heard.recv_timeout(WATCHDOG), Ok((0, 0)));
    ear.destroy_later().unwrap();
    assert_eq!(
        heard.recv_timeout(WATCHDOG),
        Err(std::sync::mpsc::RecvTimeoutError::Disconnected),
        "dropped there"
    );
    while !app.cx().links_of(mouth).is_empty() {
        app.pulse();
    }
    ear.destroy_later().unwrap();
    ear.post(|_, _| panic!("nobody is there")).unwrap();
    settle(&receiver);
    assert_eq!(receiver.build(|cx| cx.counters().gone).unwrap(), 1);
}

#[test]
fn a_link_to_a_loop_that_has_ended_goes_with_the_next_call() {
    let mut app = real_app();
    let receiver = thread(&mut app, "receiver", TimingMode::SelectIo);
    let (ear, _heard) = ear(&receiver);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth { own: 0, said: 0, all: 10, burst: 1, word: Signal::new() });
    attach!(cx, mouth.word => ear.hear, Queued);
    app.pulse();
    receiver.stop();
    app.cx().with(mouth, |mouth, cx| mouth.talk(cx)).unwrap();
    app.pulse();
    assert_eq!(app.cx().links_of(mouth).len(), 0);
    assert_eq!(ear.post(|_, _| ()), Err(PostError::Gone));
    assert_eq!(ear.destroy_later(), Err(PostError::Gone));
    assert_eq!(app.cx().invoke_method(&ear, "hear", &[]), Err(MetaError::Gone(Address::from(&ear).id())));
}

#[test]
fn ask_brings_the_answer_as_a_call() {
    struct Asker(Sender<Result<u64, Access>>);
    impl Asker {
        fn answer(&mut self, _cx: &mut Cx, answer: Result<u64, Access>) {
            let _ = self.0.send(answer);
        }
    }
    object! { Asker { slots { answer(Result<u64, Access>) } } }
    let mut app = real_app();
    let far = thread(&mut app, "far", TimingMode::SelectIo);
    let mouth = mouth(&far, 0, 42, 1);
    let (sender, answers) = channel();
    let cx = app.cx();
    let asker = cx.spawn(Asker(sender));
    let asker = cx.remote(asker);
    mouth.ask(|mouth, _| mouth.all, asker.slots().answer()).unwrap();
    let wait = |app: &mut SkApp| loop {
        app.pulse();
        if let Ok(answer) = answers.try_recv() {
            return answer;
        }
    };
    assert_eq!(wait(&mut app), Ok(42));
    mouth.destroy_later().unwrap();
    settle(&far);
    mouth.ask(|mouth, _| mouth.all, asker.slots().answer()).unwrap();
    assert_eq!(wait(&mut app), Err(Access::Gone));
    far.stop();
    assert_eq!(mouth.ask(|mouth, _| mouth.all, asker.slots().answer()), Err(PostError::Gone));
}

#[test]
fn by_name_across_threads_works_and_counts_what_is_wrong_there() {
    let mut app = real_app();
    let (sending, receiving) = (
        thread(&mut app, "sending", TimingMode::SelectIo),
        thread(&mut app, "receiving", TimingMode::SelectIo),
    );
    let (ear, heard) = ear(&receiving);
    let mouth = mouth(&sending, 7, 3, 1);
    let cx = app.cx();
    assert_eq!(
        cx.attach_by_name(&mouth, "word", &ear, "hear", Mode::Direct),
        Err(MetaError::Mode("Direct"))
    );
    cx.attach_by_name(&mouth, "word", &ear, "hear", Mode::Queued).unwrap();
    cx.attach_by_name(&mouth, "word", &ear, "heer", Mode::Queued).unwrap();
    cx.attach_by_name(&mouth, "wort", &ear, "hear", Mode::Queued).unwrap();
    for _ in 0..2 {
        settle(&sending);
        settle(&receiving);
    }
    cx.invoke_method(&mouth, "talk", &[]).unwrap();
    assert_eq!(heard.recv_timeout(WATCHDOG), Ok((7, 0)));
    cx.invoke_method(&ear, "hear", &[9i64.into(), 8i64.into()]).unwrap();
    assert_eq!(heard.recv_timeout(WATCHDOG), Ok((9, 8)));
    cx.invoke_method(&ear, "hear", &["nine".into()]).unwrap();
    settle(&receiving);
    let refused = |thread: &SkThread| thread.build(|cx| cx.counters().refused_by_name).unwrap();
    assert_eq!((refused(&sending), refused(&receiving)), (1, 2));
    cx.detach_by_name(&mouth, "word", &ear, "hear").unwrap();
    for _ in 0..2 {
        settle(&sending);
        settle(&receiving);
    }
    let id = Address::from(&mouth).id();
    assert_eq!(sending.build(move |cx| cx.links_of(id).len()).unwrap(), 0);
}

#[test]
fn a_duplicate_link_across_threads_changes_nothing() {
    let mut app = real_app();
    let receiver = thread(&mut app, "receiver", TimingMode::SelectIo);
    let (ear, heard) = ear(&receiver);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth { own: 0, said: 0, all: 10, burst: 1, word: Signal::new() });
    attach!(cx, mouth.word => ear.hear, Queued);
    attach!(cx, mouth.word => ear.hear, Latest);
    app.pulse();
    let cx = app.cx();
    attach!(cx, mouth.word => ear.hear, Queued.once());
    app.pulse();
    let counters = *app.cx().counters();
    assert_eq!((counters.duplicates, counters.links_made, counters.links_refused), (2, 1, 0));
    app.cx().with(mouth, |mouth, cx| mouth.talk(cx)).unwrap();
    assert_eq!(heard.recv_timeout(WATCHDOG), Ok((0, 0)));
    settle(&receiver);
    assert!(heard.try_recv().is_err());
    let cx = app.cx();
    detach!(cx, mouth.word => ear.hear);
    app.pulse();
    app.cx().with(mouth, |mouth, cx| mouth.talk(cx)).unwrap();
    settle(&receiver);
    assert!(heard.try_recv().is_err());
}

#[test]
fn a_thread_that_stops_buries_its_objects_and_drops_what_waits() {
    struct Guest(Arc<AtomicU64>);
    object! { Guest { } }
    impl Drop for Guest {
        fn drop(&mut self) {
            self.0.fetch_add(1, Ordering::SeqCst);
        }
    }
    let mut app = real_app();
    let dropped = Arc::new(AtomicU64::new(0));
    let inn = thread(&mut app, "inn", TimingMode::Coarse);
    let guests = dropped.clone();
    let guest = inn
        .build(move |cx| {
            let guests: Vec<_> = (0..10).map(|_| cx.spawn(Guest(guests.clone()))).collect();
            cx.remote(guests[0])
        })
        .unwrap();
    let token = Guest(dropped.clone());
    guest
        .post(move |_, cx| {
            cx.quit();
            drop(token)
        })
        .unwrap();
    inn.stop();
    assert_eq!(dropped.load(Ordering::SeqCst), 11);
}

#[test]
fn a_panic_of_the_work_of_build_is_an_error_and_the_thread_lives() {
    let mut app = real_app();
    let worker = thread(&mut app, "worker", TimingMode::SelectIo);
    assert!(matches!(worker.build(|_| panic!("no")), Err::<(), _>(ThreadError::Ended(_))));
    assert_eq!(worker.build(|cx| cx.counters().panics).unwrap(), 1);
    assert_eq!(worker.name(), "worker");
}

#[test]
fn work_runs_elsewhere_and_its_result_comes_as_a_call() {
    struct Reader(Sender<(ThreadId, ThreadId)>);
    impl Reader {
        fn done(&mut self, cx: &mut Cx, worker: ThreadId) {
            let _ = self.0.send((worker, std::thread::current().id()));
            cx.quit();
        }
    }
    object! { Reader { slots { done(ThreadId) } } }
    let mut app = real_app();
    let (sender, done) = channel();
    let cx = app.cx();
    let reader = cx.spawn(Reader(sender));
    cx.work(|| std::thread::current().id(), reader.slots().done()).unwrap();
    app.run();
    let (worker, own) = done.recv_timeout(WATCHDOG).unwrap();
    assert_ne!(worker, own);
    assert_eq!(own, std::thread::current().id());
}
