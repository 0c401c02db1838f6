//! Plain values beside objects: their end, their conversions, and rings between threads.

mod objects;

use objects::*;
use sk_core::prelude::*;
use sk_flat::{FromVariant, IntoVariant, NewestConsumer, NewestProducer, SkRingBuffer};
use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};

/// A flat value with a name: a field, where one is wanted.
struct Flat {
    name: &'static str,
    log: Log,
}
impl Drop for Flat {
    fn drop(&mut self) {
        self.log.note(format!("{} ends", self.name));
    }
}

#[test]
fn s01_a_flat_value_ends_with_its_scope() {
    let log = Log::default();
    {
        let outer = Flat { name: "outer", log: log.clone() };
        {
            let _inner = Flat { name: "inner", log: log.clone() };
            assert_eq!(log.take(), [""; 0]);
        }
        assert_eq!((outer.name, log.take()), ("outer", vec!["inner ends".to_owned()]));
    }
    assert_eq!(log.take(), ["outer ends"]);
}

#[test]
fn s02_containers_free_what_they_hold() {
    let held = Rc::new(());
    {
        let _list: VecDeque<Rc<()>> = (0..10).map(|_| held.clone()).collect();
        let _map: BTreeMap<u32, Rc<()>> = (0..10).map(|i| (i, held.clone())).collect();
        assert_eq!(Rc::strong_count(&held), 21);
    }
    assert_eq!(Rc::strong_count(&held), 1);
    let shared = Arc::new(());
    let (mut producer, consumer) = SkRingBuffer::bounded(8);
    for _ in 0..8 {
        producer.push(shared.clone()).unwrap();
    }
    drop((producer, consumer));
    assert_eq!(Arc::strong_count(&shared), 1);
    let text: Arc<str> = "text".into();
    drop(SkVariant::List(
        vec![SkVariant::String(text.clone()), SkVariant::String(text.clone())].into(),
    ));
    assert_eq!(Arc::strong_count(&text), 1);
}

#[test]
fn s13_standard_containers_convert_both_ways() {
    fn there_and_back<T: IntoVariant + FromVariant + Clone + PartialEq + Debug>(value: T) {
        assert_eq!(T::from_variant(&value.clone().into_variant()), Ok(value));
    }
    there_and_back(vec![1i64, -2, 3]);
    there_and_back(vec![vec!["a".to_owned()], vec![]]);
    there_and_back([1.5f64, -0.0, f64::MAX]);
    there_and_back(VecDeque::from([1u8, 2]));
    there_and_back(BTreeSet::from(["x".to_owned(), "y".to_owned()]));
    there_and_back(BTreeMap::from([("k".to_owned(), vec![Some(1u32), None])]));
    there_and_back(HashMap::<String, String>::from([("k".to_owned(), "v".to_owned())]));
    there_and_back((1u8, "two".to_owned(), 3.0f32));
    there_and_back(Some(u64::MAX));
}

/// Fills a ring at each tick, far more often than anybody reads it.
struct Microphone {
    ring: NewestProducer<u64>,
    taken: u64,
    written: Arc<AtomicU64>,
}
impl Microphone {
    fn sample(&mut self, _cx: &mut Cx) {
        for _ in 0..100 {
            self.taken += 1;
            self.ring.push(self.taken);
        }
        self.written.store(self.taken, Ordering::Release);
    }
}
object! { Microphone { slots { sample() } } }

/// Samples on purpose: the newest, now and then.
struct Meter {
    ring: NewestConsumer<u64>,
    shown: Sender<(u64, u64)>,
}
impl Meter {
    fn show(&mut self, _cx: &mut Cx) {
        if let Some(newest) = self.ring.pop_newest() {
            // The test may have seen enough.
            let _ = self.shown.send((newest, self.ring.replaced()));
        }
    }
}
object! { Meter { slots { show() } } }

#[test]
fn s39_a_ring_buffer_is_shared_without_blocking() {
    let mut app = SkApp::builder().interval(ms(1)).build().unwrap();
    let (producer, consumer) = SkRingBuffer::newest(16);
    let (written, (shown, seen)) = (Arc::new(AtomicU64::new(0)), channel());
    let fast = SkThread::new("microphone").mode(TimingMode::SelectIo).start(app.cx()).unwrap();
    let slow = SkThread::new("meter").interval(ms(3)).start(app.cx()).unwrap();
    let counted = written.clone();
    fast.build(move |cx| {
        let microphone = cx.spawn(Microphone { ring: producer, taken: 0, written: counted });
        attach!(cx, cx.fast_zone().pulse => microphone.sample);
    })
    .unwrap();
    slow.build(move |cx| {
        let meter = cx.spawn(Meter { ring: consumer, shown });
        attach!(cx, cx.fast_zone().pulse => meter.show);
    })
    .unwrap();
    let mut before = 0;
    for _ in 0..20 {
        let (newest, replaced) = seen.recv_timeout(Duration::from_secs(60)).expect("the meter stands still");
        assert!(newest > before, "never an old one");
        assert!(replaced > 0 && replaced < newest, "what it did not see is counted");
        before = newest;
    }
    drop(slow);
    let at_least = written.load(Ordering::Acquire);
    while written.load(Ordering::Acquire) == at_least {
        std::thread::yield_now();
    }
    drop(fast);
}
