//! Rings against a queue of the standard library, and with two real threads.

use super::*;
use proptest::prelude::*;
use std::collections::VecDeque;
use std::thread;

const ITEMS: u64 = 200_000;

#[derive(Clone, Debug)]
enum Step {
    Push(u8),
    Pop,
    PopNewest,
    Write(Vec<u8>),
    WriteWhole(Vec<u8>),
    Read(usize),
    ReadWhole(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let run = || prop::collection::vec(any::<u8>(), 0..12);
    let step = prop_oneof![
        3 => any::<u8>().prop_map(Step::Push),
        2 => Just(Step::Pop),
        1 => Just(Step::PopNewest),
        3 => run().prop_map(Step::Write),
        2 => run().prop_map(Step::WriteWhole),
        3 => (0..12usize).prop_map(Step::Read),
        1 => (0..12usize).prop_map(Step::ReadWhole),
    ];
    prop::collection::vec(step, 0..60)
}

proptest! {
    #[test]
    fn a_bounded_ring_is_a_queue_that_refuses(capacity in 0..6usize, steps in steps()) {
        let (mut producer, mut consumer) = SkRingBuffer::bounded(capacity);
        let (room, mut model, mut refused) = (capacity.max(1), VecDeque::new(), 0);
        for step in steps {
            match step {
                Step::Push(item) if model.len() < room => {
                    prop_assert_eq!(producer.push(item), Ok(()));
                    model.push_back(item);
                }
                Step::Push(item) => {
                    prop_assert_eq!(producer.push(item), Err(item));
                    refused += 1;
                }
                _ => {
                    prop_assert_eq!(consumer.peek(), model.front());
                    prop_assert_eq!(consumer.pop(), model.pop_front());
                }
            }
            prop_assert_eq!(consumer.len(), model.len());
            prop_assert_eq!(producer.room(), room - model.len());
            prop_assert_eq!((producer.refused(), consumer.refused()), (refused, refused));
        }
    }

    #[test]
    fn a_sampling_ring_is_a_queue_that_forgets_its_oldest(capacity in 0..6usize, steps in steps()) {
        let (mut producer, mut consumer) = SkRingBuffer::newest(capacity);
        let (room, mut model, mut replaced) = (capacity.max(1), VecDeque::new(), 0);
        for step in steps {
            match step {
                Step::Push(item) => {
                    let oldest = if model.len() == room { model.pop_front() } else { None };
                    replaced += u64::from(oldest.is_some());
                    prop_assert_eq!(producer.push(item), oldest);
                    model.push_back(item);
                }
                Step::PopNewest => {
                    prop_assert_eq!(consumer.pop_newest(), model.pop_back());
                    model.clear();
                }
                _ => prop_assert_eq!(consumer.pop(), model.pop_front()),
            }
            prop_assert_eq!(consumer.len(), model.len());
            prop_assert_eq!((producer.replaced(), consumer.replaced()), (replaced, replaced));
        }
    }

    #[test]
    fn a_byte_ring_writes_and_reads_runs(capacity in 0..20usize, steps in steps()) {
        let (mut producer, mut consumer) = SkRingBuffer::bytes(capacity);
        let (room, mut model, mut refused) = (capacity.max(1), VecDeque::new(), 0);
        for step in steps {
            match step {
                Step::Write(run) => {
                    let fits = run.len().min(room - model.len());
                    prop_assert_eq!(producer.write(&run), fits);
                    model.extend(&run[..fits]);
                }
                Step::WriteWhole(run) => {
                    let fits = run.len() <= room - model.len();
                    prop_assert_eq!(producer.write_whole(&run), fits);
                    if fits { model.extend(&run) } else { refused += run.len() as u64 }
                }
                Step::Read(most) => {
                    let mut into = vec![0; most];
                    let read = consumer.read(&mut into);
                    prop_assert_eq!(&into[..read], &model.drain(..most.min(model.len())).collect::<Vec<u8>>());
                }
                Step::ReadWhole(len) => {
                    let mut into = vec![0; len];
                    let enough = len <= model.len();
                    prop_assert_eq!(consumer.read_whole(&mut into), enough);
                    if enough { prop_assert_eq!(into, model.drain(..len).collect::<Vec<u8>>()) }
                }
                _ => {}
            }
            prop_assert_eq!(consumer.len(), model.len());
            prop_assert_eq!((producer.refused(), consumer.refused()), (refused, refused));
        }
    }

    #[test]
    fn a_sampling_byte_ring_keeps_the_last_bytes(capacity in 0..20usize, steps in steps()) {
        let (mut producer, mut consumer) = SkRingBuffer::newest_bytes(capacity);
        let (room, mut model, mut replaced) = (capacity.max(1), VecDeque::new(), 0);
        for step in steps {
            match step {
                Step::Write(run) => {
                    producer.write(&run);
                    model.extend(&run);
                    let over = model.len().saturating_sub(room);
                    model.drain(..over);
                    replaced += over as u64;
                }
                Step::Read(most) => {
                    let mut into = vec![0; most];
                    let read = consumer.read(&mut into);
                    prop_assert_eq!(&into[..read], &model.drain(..most.min(model.len())).collect::<Vec<u8>>());
                }
                _ => {}
            }
            prop_assert_eq!(consumer.len(), model.len());
            prop_assert_eq!((producer.replaced(), consumer.replaced()), (replaced, replaced));
        }
    }
}

#[test]
fn a_bounded_ring_carries_every_item_between_two_threads() {
    let (mut producer, mut consumer) = SkRingBuffer::bounded(64);
    let (mut pushed, mut refused) = (0u64, 0u64);
    let mut seen = 0;
    thread::scope(|scope| {
        let producing = scope.spawn(move || {
            while pushed < ITEMS {
                match producer.push(Box::new(pushed)) {
                    Ok(()) => pushed += 1,
                    Err(back) => {
                        assert_eq!(*back, pushed);
                        refused += 1;
                        thread::yield_now();
                    }
                }
            }
            refused
        });
        loop {
            // Asked before the ring is emptied: what a producer that ended left behind is then seen.
            let ended = consumer.is_abandoned();
            while let Some(item) = consumer.pop() {
                assert_eq!(*item, seen, "in order and complete");
                seen += 1;
            }
            if ended {
                break;
            }
            thread::yield_now();
        }
        let refused = producing.join().expect("the producer does not panic");
        assert_eq!(consumer.refused(), refused);
    });
    assert_eq!(seen, ITEMS);
}

#[test]
fn a_sampling_ring_loses_nothing_uncounted_between_two_threads() {
    let (mut producer, mut consumer) = SkRingBuffer::newest(16);
    let (mut seen, mut last) = (0, None);
    thread::scope(|scope| {
        scope.spawn(move || (0..ITEMS).for_each(|n| drop(producer.push(Box::new(n)))));
        loop {
            let ended = consumer.is_abandoned();
            while let Some(item) = consumer.pop() {
                assert!(last.is_none_or(|last| last < *item), "{last:?} came before {item}");
                last = Some(*item);
                seen += 1;
            }
            if ended {
                break;
            }
            thread::yield_now();
        }
    });
    assert_eq!(last, Some(ITEMS - 1), "the newest item is never lost");
    assert_eq!(seen + consumer.replaced(), ITEMS);
}

#[test]
fn a_byte_ring_carries_every_byte_between_two_threads() {
    let (mut producer, mut consumer) = SkRingBuffer::bytes(100);
    let sent: Vec<u8> = (0..ITEMS).map(|n| (n % 251) as u8).collect();
    let mut received = Vec::new();
    thread::scope(|scope| {
        let sent = &sent;
        scope.spawn(move || {
            let mut rest = &sent[..];
            while !rest.is_empty() {
                let written = producer.write(&rest[..rest.len().min(37)]);
                rest = &rest[written..];
                if written == 0 {
                    thread::yield_now();
                }
            }
        });
        let mut into = [0; 53];
        loop {
            let ended = consumer.is_abandoned();
            loop {
                let read = consumer.read(&mut into);
                received.extend_from_slice(&into[..read]);
                if read == 0 {
                    break;
                }
            }
            if ended {
                break;
            }
            thread::yield_now();
        }
    });
    assert!(received == sent, "in order and complete");
}

#[test]
fn a_sampling_byte_ring_counts_what_it_replaced_between_two_threads() {
    let (mut producer, mut consumer) = SkRingBuffer::newest_bytes(64);
    let mut received = 0;
    thread::scope(|scope| {
        scope.spawn(move || (0..ITEMS / 10).for_each(|n| producer.write(&[n as u8; 10])));
        let mut into = [0; 24];
        loop {
            let ended = consumer.is_abandoned();
            loop {
                let read = consumer.read(&mut into);
                received += read as u64;
                if read == 0 {
                    break;
                }
            }
            if ended {
                break;
            }
            thread::yield_now();
        }
    });
    assert_eq!(received + consumer.replaced(), ITEMS);
}

#[test]
fn what_a_ring_still_holds_is_dropped_with_it() {
    let item = Arc::new(());
    let (mut bounded, consumer) = SkRingBuffer::bounded(4);
    bounded.push(Arc::clone(&item)).expect("the ring is empty");
    drop((bounded, consumer));
    let (mut newest, consumer) = SkRingBuffer::newest(1);
    newest.push(Arc::clone(&item));
    newest.push(Arc::clone(&item));
    drop((newest, consumer));
    assert_eq!(Arc::strong_count(&item), 1);
}
