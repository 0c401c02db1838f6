//! The peers that need no library: bare closures, and a bare eventfd.

use crate::direct::{SLOTS, TEXT, calls, case};
use nix::sys::eventfd::EventFd;
use sk_benches::{Amount, BenchError, Sheet, ns_per_unit};
use std::cell::Cell;
use std::hint::black_box;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// A closure that is shown a text.
type Reader = Box<dyn FnMut(&str)>;

/// What nobody can undercut who calls listeners unknown at compile time.
pub(crate) fn closures(sheet: &mut Sheet, amount: Amount) {
    for slots in SLOTS {
        let emits = calls(amount) / slots.max(1);
        let mut numbers: Vec<Box<dyn FnMut(i64)>> = Vec::new();
        let mut texts: Vec<Reader> = Vec::new();
        for _ in 0..slots {
            let sum = Rc::new(Cell::new(0i64));
            let same = sum.clone();
            numbers.push(Box::new(move |number| sum.set(sum.get().wrapping_add(number))));
            texts.push(Box::new(move |text| same.set(same.get().wrapping_add(text.len() as i64))));
        }
        let calls_each = slots.max(1) as f64;
        let per_emit = ns_per_unit(emits, |count| {
            for i in 0..count {
                let number = black_box(i as i64);
                black_box(&mut numbers).iter_mut().for_each(|call| call(number));
            }
        });
        sheet.figure(&case(slots, ""), "ns_per_call", "ns", per_emit / calls_each);
        let per_emit = ns_per_unit(emits, |count| {
            for _ in 0..count {
                let text = black_box(TEXT);
                black_box(&mut texts).iter_mut().for_each(|call| call(text));
            }
        });
        sheet.figure(&case(slots, "/str"), "ns_per_call", "ns", per_emit / calls_each);
    }
}

/// One thread writes an eventfd, the other sleeps in reading it: the least a wake-up can cost.
pub(crate) fn eventfd(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let samples = amount.pick(1_000, 3);
    let origin = Instant::now();
    let bell = Arc::new(EventFd::new().map_err(std::io::Error::from)?);
    let sent_ns = Arc::new(AtomicU64::new(0));
    let taken = Arc::new(AtomicU64::new(0));
    let (there, sent_there, taken_there) = (bell.clone(), sent_ns.clone(), taken.clone());
    let receiver = std::thread::spawn(move || {
        let mut spans = Vec::with_capacity(samples);
        while spans.len() < samples && there.read().is_ok() {
            let now = origin.elapsed().as_nanos() as u64;
            spans.push(now.saturating_sub(sent_there.load(Ordering::Acquire)));
            taken_there.store(spans.len() as u64, Ordering::Release);
        }
        spans
    });
    for number in 0..samples as u64 {
        // Long enough for the receiver to have gone to sleep. An eventfd adds up what is written before it is
        // read, so each write waits for the reading of the one before.
        std::thread::sleep(crate::across::PAUSE);
        while taken.load(Ordering::Acquire) < number {
            std::thread::sleep(crate::across::PAUSE);
        }
        sent_ns.store(origin.elapsed().as_nanos() as u64, Ordering::Release);
        bell.write(1).map_err(std::io::Error::from)?;
    }
    let spans = receiver.join().map_err(|_| BenchError::Ours("the receiver panicked".into()))?;
    spans.into_iter().for_each(|ns| sheet.sample("queued/idle-one-way", "", ns, 1));
    Ok(())
}
