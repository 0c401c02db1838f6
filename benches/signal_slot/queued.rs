//! Queued calls within one thread: emitted, then run in the next round.

use sk_benches::{Amount, BenchError, Sheet, ns_per_unit};
use sk_core::prelude::*;
use sk_core::testing::CountingAllocator;
use std::hint::black_box;

/// How many calls wait at a time: below the queue's limit.
const BURST_CALLS: usize = 10_000;

#[derive(Default)]
struct Sender {
    number: Signal<i64>,
}
object! { Sender { signals { number(i64) } } }

#[derive(Default)]
struct Receiver {
    sum: i64,
    calls: usize,
}
impl Receiver {
    fn take(&mut self, _cx: &mut Cx, number: i64) {
        self.sum = self.sum.wrapping_add(number);
        self.calls += 1;
    }
}
object! { Receiver { slots { take(i64) } } }

/// A loop that pulses when it is told to.
pub(crate) fn app() -> Result<SkApp, BenchError> {
    let built = SkApp::builder().mode(TimingMode::NoTiming).build();
    built.map_err(|error| BenchError::Ours(error.to_string()))
}

/// Measures `queued/same-thread`.
pub(crate) fn measure(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let burst = amount.pick(BURST_CALLS, 10);
    let bursts = amount.pick(200, 2);
    let mut app = app()?;
    let cx = app.cx();
    let sender = cx.spawn(Sender::default());
    let receiver = cx.spawn(Receiver::default());
    attach!(cx, sender.number => receiver.take, Queued);
    app.pulse();
    let gone = |error: Access| BenchError::Ours(error.to_string());
    let round = |app: &mut SkApp| -> Result<(), BenchError> {
        let before = app.cx().with(receiver, |receiver, _| receiver.calls).map_err(gone)?;
        let send = |sender: &mut Sender, cx: &mut Cx| {
            for i in 0..burst {
                sender.number.emit(cx, black_box(i as i64));
            }
        };
        app.cx().with(sender, send).map_err(gone)?;
        while app.cx().with(receiver, |receiver, _| receiver.calls).map_err(gone)? < before + burst {
            app.pulse();
        }
        Ok(())
    };
    for _ in 0..bursts / 10 + 1 {
        round(&mut app)?;
    }
    let taken = CountingAllocator::taken();
    for _ in 0..bursts / 10 + 1 {
        round(&mut app)?;
    }
    let calls = ((bursts / 10 + 1) * burst) as f64;
    let allocations = (CountingAllocator::taken() - taken) as f64 / calls;
    let mut outcome = Ok(());
    let per_burst = ns_per_unit(bursts, |bursts| {
        for _ in 0..bursts {
            if outcome.is_ok() {
                outcome = round(&mut app);
            }
        }
    });
    outcome?;
    sheet.figure("queued/same-thread", "ns_per_call", "ns", per_burst / burst as f64);
    sheet.figure("queued/same-thread", "allocations", "1/call", allocations);
    Ok(())
}
