//! Direct calls to 0, 1, 10 and 100 slots, with a number and with a short text.

use sk_benches::{Amount, BenchError, Sheet, ns_per_unit};
use sk_core::prelude::*;
use std::hint::black_box;

/// The short text.
pub(crate) const TEXT: &str = "left wheel";
/// How many slots listen.
pub(crate) const SLOTS: [usize; 4] = [0, 1, 10, 100];

/// How many calls one measurement makes, over all slots.
pub(crate) fn calls(amount: Amount) -> usize {
    amount.pick(20_000_000, 1_000)
}

/// The name of a case by its number of slots.
pub(crate) fn case(slots: usize, end: &str) -> String {
    if slots == 0 { format!("direct/none{end}") } else { format!("direct/{slots}{end}") }
}

/// Emits that many times.
type Send = fn(&mut Sender, &mut Cx, usize);

#[derive(Default)]
struct Sender {
    number: Signal<i64>,
    text: Signal<str>,
}
object! { Sender { signals { number(i64) text(&str) } } }

impl Sender {
    #[inline(never)]
    fn send_numbers(&mut self, cx: &mut Cx, count: usize) {
        for i in 0..count {
            self.number.emit(cx, black_box(i as i64));
        }
    }

    #[inline(never)]
    fn send_texts(&mut self, cx: &mut Cx, count: usize) {
        for _ in 0..count {
            self.text.emit(cx, black_box(TEXT));
        }
    }
}

#[derive(Default)]
struct Receiver {
    sum: i64,
}
impl Receiver {
    fn take(&mut self, _cx: &mut Cx, number: i64) {
        self.sum = self.sum.wrapping_add(number);
    }
    fn read(&mut self, _cx: &mut Cx, text: &str) {
        self.sum = self.sum.wrapping_add(text.len() as i64);
    }
}
object! { Receiver { slots { take(i64) read(&str) } } }

/// Measures all cases.
pub(crate) fn measure(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    for slots in SLOTS {
        let mut app = crate::queued::app()?;
        let cx = app.cx();
        let sender = cx.spawn(Sender::default());
        for _ in 0..slots {
            let receiver = cx.spawn(Receiver::default());
            attach!(cx, sender.number => receiver.take);
            attach!(cx, sender.text => receiver.read);
        }
        app.pulse();
        let emits = calls(amount) / slots.max(1);
        let cases: [(&str, Send); 2] = [("", Sender::send_numbers), ("/str", Sender::send_texts)];
        for (end, send) in cases {
            let mut reached = Ok(());
            let per_emit = ns_per_unit(emits, |count| {
                reached = reached.and(app.cx().with(sender, |sender, cx| send(sender, cx, count)));
            });
            reached.map_err(|error| BenchError::Ours(error.to_string()))?;
            let per_call = per_emit / slots.max(1) as f64;
            sheet.figure(&case(slots, end), "ns_per_call", "ns", per_call);
        }
    }
    Ok(())
}
