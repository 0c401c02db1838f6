//! What it costs to attach and to detach: the request and the rewiring at the end of the round.

use sk_benches::{Amount, BenchError, Sheet};
use sk_core::prelude::*;
use std::time::Instant as Moment;

#[derive(Default)]
struct Sender {
    number: Signal<i64>,
}
object! { Sender { signals { number(i64) } } }

#[derive(Default)]
struct Receiver {
    sum: i64,
}
impl Receiver {
    fn take(&mut self, _cx: &mut Cx, number: i64) {
        self.sum = self.sum.wrapping_add(number);
    }
}
object! { Receiver { slots { take(i64) } } }

/// Measures `attach` and `detach` over many pairs, so that each signal has one link.
pub(crate) fn measure(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let count = amount.pick(100_000, 10);
    let mut app = crate::queued::app()?;
    let cx = app.cx();
    let pairs: Vec<_> = (0..count)
        .map(|_| (cx.spawn(Sender::default()), cx.spawn(Receiver::default())))
        .collect();
    app.pulse();
    let began = Moment::now();
    for &(sender, receiver) in &pairs {
        attach!(app.cx(), sender.number => receiver.take);
    }
    app.pulse();
    sheet.figure("attach", "ns_per_call", "ns", began.elapsed().as_nanos() as f64 / count as f64);
    let made = app.cx().stats().counters.links_made;
    if made != count as u64 {
        return Err(BenchError::Ours(format!("{made} of {count} links were made")));
    }
    let began = Moment::now();
    for &(sender, receiver) in &pairs {
        detach!(app.cx(), sender.number => receiver.take);
    }
    app.pulse();
    sheet.figure("detach", "ns_per_call", "ns", began.elapsed().as_nanos() as f64 / count as f64);
    Ok(())
}
