//! Links between threads: calls that follow each other share a token in the mailbox, and nobody can tell.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::thread::PostError;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Far longer than anything here takes: reaching it means that something never came.
const WATCHDOG: Duration = Duration::from_secs(60);

/// Tells the test thread what it got, and by which way.
struct Ear(Sender<(usize, u64)>);
impl Ear {
    fn tell(&mut self, way: usize, n: u64) {
        // The test may have ended.
        let _ = self.0.send((way, n));
    }
    fn first(&mut self, _cx: &mut Cx, n: u64) {
        self.tell(0, n);
    }
    fn second(&mut self, _cx: &mut Cx, n: u64) {
        self.tell(1, n);
    }
}
object! { Ear { slots { first(u64) second(u64) } } }

#[derive(Default)]
struct Mouth {
    left: Signal<u64>,
    right: Signal<u64>,
}
object! { Mouth { signals { left(u64) right(u64) } } }

/// A sequence that looks like none.
struct Dice(u64);
impl Dice {
    fn below(&mut self, sides: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % sides
    }
}

fn ear(thread: &SkThread) -> (Remote<Ear>, Receiver<(usize, u64)>) {
    let (sender, receiver) = channel();
    let ear = thread.build(move |cx| {
        let ear = cx.spawn(Ear(sender));
        cx.remote(ear)
    });
    (ear.unwrap(), receiver)
}

/// Sends by two links and by posts in turns of any length, and now and then waits until all has come, so that
/// the receiver goes to sleep. What comes must be what was sent, in that order, although the receiver's loop
/// wakes for nothing else.
fn send_by_any_way(mode: TimingMode, interval: Duration) {
    const TURNS: u64 = 4_000;
    let mut app = SkApp::builder().mode(TimingMode::NoTiming).build().unwrap();
    let far = SkThread::new("far")
        .mode(mode)
        .interval(interval)
        .configure(|settings| settings.slow_interval = settings.slow_interval.max(settings.interval))
        .start(app.cx())
        .unwrap();
    let (ear, heard) = ear(&far);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth::default());
    attach!(cx, mouth.left => ear.first, Queued);
    attach!(cx, mouth.right => ear.second, Queued);
    app.pulse();
    let mut dice = Dice(1);
    let (mut sent, mut came) = (Vec::new(), 0);
    for turn in 0..TURNS {
        let way = dice.below(3) as usize;
        for _ in 0..=dice.below(40) {
            let n = sent.len() as u64;
            sent.push((way, n));
            let emit = |mouth: &mut Mouth, cx: &mut Cx| match way {
                0 => mouth.left.emit(cx, n),
                _ => mouth.right.emit(cx, n),
            };
            match way {
                2 => ear.post(move |ear, _| ear.tell(2, n)).unwrap(),
                _ => app.cx().with(mouth, emit).unwrap(),
            }
        }
        // The mailbox has room for all that is sent in between.
        if dice.below(4) == 0 || turn % 500 == 0 || turn + 1 == TURNS {
            while came < sent.len() {
                assert_eq!(heard.recv_timeout(WATCHDOG), Ok(sent[came]), "lost, or out of order");
                came += 1;
            }
        }
    }
    assert_eq!(app.cx().counters().refused_full, 0);
    let calls = sent.iter().filter(|(way, _)| *way < 2).count() as u64;
    assert!(far.build(|cx| cx.counters().messages).unwrap() >= calls);
}

#[test]
fn any_mixture_of_links_and_posts_is_one_fifo_to_a_loop_that_sleeps() {
    // Nothing but the sender ends its waits.
    send_by_any_way(TimingMode::SelectIo, Duration::from_secs(3600));
}

#[test]
fn any_mixture_of_links_and_posts_is_one_fifo_to_a_loop_that_spins() {
    send_by_any_way(TimingMode::Realtime, Duration::from_micros(200));
}

#[test]
fn any_mixture_of_links_and_posts_is_one_fifo_to_a_loop_that_never_waits() {
    send_by_any_way(TimingMode::NoTiming, Duration::from_millis(10));
}

#[test]
fn calls_that_share_a_token_still_count_one_by_one() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.interval = ms(10));
    let far = SkThread::new("far")
        .interval(ms(10))
        .configure(|settings| settings.mailbox_messages_max = 100)
        .start(app.cx())
        .unwrap();
    let (ear, heard) = ear(&far);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth::default());
    attach!(cx, mouth.left => ear.first, Queued);
    app.pulse();
    simulation.run_for(&mut app, ms(50));
    let mut refused_before = 0;
    for round in 1..=3u64 {
        let shout = |mouth: &mut Mouth, cx: &mut Cx| (0..150).for_each(|n| mouth.left.emit(cx, n));
        app.cx().with(mouth, shout).unwrap();
        let refused = app.cx().counters().refused_full - refused_before;
        refused_before += refused;
        // While the link grows its new rings take places too.
        assert!(if round < 3 { (50..=60).contains(&refused) } else { refused == 50 }, "{round}: {refused}");
        assert_eq!(ear.post(|_, _| ()), Err(PostError::Full(100)));
        simulation.run_for(&mut app, ms(50));
        let kept: Vec<u64> = heard.try_iter().map(|(_, n)| n).collect();
        assert_eq!(kept, (0..150 - refused).collect::<Vec<_>>(), "the oldest are kept");
    }
    assert_eq!(ear.post(|_, _| ()), Ok(()), "all places are given back");
}

#[test]
fn calls_under_way_to_one_who_is_gone_are_counted_and_their_places_given_back() {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| {
        settings.interval = Duration::from_secs(1);
        settings.slow_interval = Duration::from_secs(1);
    });
    let far = SkThread::new("far")
        .interval(ms(10))
        .configure(|settings| settings.mailbox_messages_max = 100)
        .start(app.cx())
        .unwrap();
    let (ear, heard) = ear(&far);
    let (other, other_heard) = self::ear(&far);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth::default());
    attach!(cx, mouth.left => ear.first, Queued);
    app.pulse();
    simulation.run_for(&mut app, ms(50));
    let say = |app: &mut SkApp, words: u64| {
        let say = |mouth: &mut Mouth, cx: &mut Cx| (0..words).for_each(|n| mouth.left.emit(cx, n));
        app.cx().with(mouth, say).unwrap();
    };
    // These are under way in the round in which it is buried, and these after it.
    ear.destroy_later().unwrap();
    say(&mut app, 30);
    simulation.run_for(&mut app, ms(50));
    for _ in 0..5 {
        say(&mut app, 60);
        simulation.run_for(&mut app, ms(50));
    }
    assert_eq!(far.build(|cx| cx.counters().gone).unwrap(), 330);
    assert_eq!(app.cx().counters().refused_full, 0, "their places were given back");
    assert!(heard.try_recv().is_err());
    for n in 0..100 {
        other.post(move |other, _| other.tell(3, n)).unwrap();
    }
    simulation.run_for(&mut app, Duration::from_secs(3));
    assert_eq!(app.cx().links_of(mouth).len(), 0);
    assert_eq!(other_heard.try_iter().count(), 100);
}

#[test]
fn a_burst_beyond_the_work_of_one_round_keeps_its_order() {
    const WORDS: u64 = 50_000;
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.interval = ms(10));
    let far = SkThread::new("far").interval(ms(10)).start(app.cx()).unwrap();
    let (ear, heard) = ear(&far);
    let cx = app.cx();
    let mouth = cx.spawn(Mouth::default());
    attach!(cx, mouth.left => ear.first, Queued);
    attach!(cx, mouth.right => ear.second, Queued);
    app.pulse();
    let say = |mouth: &mut Mouth, cx: &mut Cx| {
        (0..WORDS).for_each(|n| mouth.left.emit(cx, n));
        mouth.right.emit(cx, WORDS);
        mouth.left.emit(cx, WORDS + 1);
    };
    app.cx().with(mouth, say).unwrap();
    simulation.run_for(&mut app, Duration::from_secs(1));
    let came: Vec<u64> = heard.try_iter().map(|(_, n)| n).collect();
    assert_eq!(came, (0..WORDS + 2).collect::<Vec<_>>());
}
