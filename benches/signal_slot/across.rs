//! Queued calls to another thread: how many get through, how soon one arrives at a sleeping loop, and what
//! the sender pays when the loop is awake.

use sk_benches::{Amount, BenchError, Sheet};
use sk_core::prelude::*;
use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant as Moment;

/// How long the sender pauses between single calls.
pub(crate) const PAUSE: Duration = Duration::from_millis(1);
/// How many calls are under way at most: below the mailbox's limit.
const BURST_CALLS: u64 = 10_000;
/// The beat of the loop whose spin window is aimed at, and how long before its tick.
const BEAT: Duration = Duration::from_millis(1);
const BEFORE_TICK: Duration = Duration::from_micros(15);
/// How many calls are sent into one spin window.
const VOLLEY_CALLS: u64 = 8;

/// What the receiver shares with the sender of the measurement.
struct Shared {
    origin: Moment,
    calls: AtomicU64,
    last_tick_ns: AtomicU64,
}

impl Shared {
    fn new() -> Arc<Shared> {
        Arc::new(Shared { origin: Moment::now(), calls: AtomicU64::new(0), last_tick_ns: AtomicU64::new(0) })
    }

    fn now_ns(&self) -> u64 {
        self.origin.elapsed().as_nanos() as u64
    }

    fn wait_for(&self, calls: u64) {
        while self.calls.load(Ordering::Acquire) < calls {
            std::thread::yield_now();
        }
    }
}

#[derive(Default)]
struct Sender {
    sent_ns: Signal<u64>,
}
object! { Sender { signals { sent_ns(u64) } } }

impl Sender {
    fn send(&mut self, cx: &mut Cx, count: u64) {
        for i in 0..count {
            self.sent_ns.emit(cx, black_box(i));
        }
    }
}

struct Receiver {
    shared: Arc<Shared>,
    spans: Vec<u64>,
}
impl Receiver {
    fn count(&mut self, _cx: &mut Cx, _number: u64) {
        self.shared.calls.fetch_add(1, Ordering::Release);
    }
    fn arrive(&mut self, _cx: &mut Cx, sent_ns: u64) {
        self.spans.push(self.shared.now_ns().saturating_sub(sent_ns));
        self.shared.calls.fetch_add(1, Ordering::Release);
    }
    fn on_tick(&mut self, _cx: &mut Cx) {
        self.shared.last_tick_ns.store(self.shared.now_ns(), Ordering::Release);
    }
}
object! { Receiver { slots { count(u64) arrive(u64) on_tick() } } }

/// A sender here, a receiver on a thread in that mode.
struct Pair {
    app: SkApp,
    thread: SkThread,
    sender: Handle<Sender>,
    receiver: Remote<Receiver>,
    shared: Arc<Shared>,
}

fn ours(error: impl std::fmt::Display) -> BenchError {
    BenchError::Ours(error.to_string())
}

impl Pair {
    fn new(mode: TimingMode, interval: Duration) -> Result<Pair, BenchError> {
        let mut app = crate::queued::app()?;
        let cx = app.cx();
        let sender = cx.spawn(Sender::default());
        let thread = SkThread::new("receiver")
            .mode(mode)
            .interval(interval)
            .start(cx)
            .map_err(ours)?;
        let shared = Shared::new();
        let there = shared.clone();
        let receiver = thread.build(move |cx| {
            let receiver = cx.spawn(Receiver { shared: there, spans: Vec::new() });
            if mode == TimingMode::Realtime {
                // Whoever aims at its ticks has to know them; to the others it would be work on the way.
                attach!(cx, cx.fast_zone().pulse => receiver.on_tick);
            }
            cx.remote(receiver)
        });
        let receiver = receiver.map_err(ours)?;
        Ok(Pair { app, thread, sender, receiver, shared })
    }

    fn emit(&mut self, count: u64) -> Result<(), BenchError> {
        self.app
            .cx()
            .with(self.sender, |sender, cx| sender.send(cx, count))
            .map_err(ours)
    }
}

/// Measures `queued/cross-thread`, `queued/idle-one-way` and `queued/to-spinning`.
pub(crate) fn measure(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    throughput(sheet, amount)?;
    one_way(sheet, amount)?;
    to_spinning(sheet, amount)
}

fn throughput(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let (burst, bursts) = (amount.pick(BURST_CALLS, 10), amount.pick(100, 2));
    let mut pair = Pair::new(TimingMode::SelectIo, Duration::from_secs(1))?;
    let (sender, receiver) = (pair.sender, pair.receiver.clone());
    attach!(pair.app.cx(), sender.sent_ns => receiver.count, Queued);
    pair.app.pulse();
    pair.emit(burst)?;
    pair.shared.wait_for(burst);
    let began = Moment::now();
    for number in 1..=bursts {
        pair.emit(burst)?;
        pair.shared.wait_for((number + 1) * burst);
    }
    let per_call = began.elapsed().as_nanos() as f64 / (bursts * burst) as f64;
    sheet.figure("queued/cross-thread", "ns_per_call", "ns", per_call);
    pair.thread.stop();
    Ok(())
}

fn one_way(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let samples = amount.pick(1_000, 3);
    let mut pair = Pair::new(TimingMode::SelectIo, Duration::from_secs(1))?;
    let (sender, receiver) = (pair.sender, pair.receiver.clone());
    attach!(pair.app.cx(), sender.sent_ns => receiver.arrive, Queued);
    pair.app.pulse();
    for _ in 0..samples {
        std::thread::sleep(PAUSE);
        let shared = pair.shared.clone();
        let send = |sender: &mut Sender, cx: &mut Cx| sender.sent_ns.emit(cx, shared.now_ns());
        pair.app.cx().with(sender, send).map_err(ours)?;
    }
    pair.shared.wait_for(samples);
    let (answer, spans) = std::sync::mpsc::channel();
    let fetch = move |receiver: &mut Receiver, _cx: &mut Cx| {
        // The asker waits for the one answer.
        let _ = answer.send(std::mem::take(&mut receiver.spans));
    };
    receiver.post(fetch).map_err(ours)?;
    spans
        .recv()
        .map_err(ours)?
        .into_iter()
        .for_each(|ns| sheet.sample("queued/idle-one-way", "", ns, 1));
    pair.thread.stop();
    Ok(())
}

/// The loop pulses on a schedule; each volley is sent shortly before a tick, when it has left its sleep.
fn to_spinning(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let volleys = amount.pick(300, 2);
    let mut pair = Pair::new(TimingMode::Realtime, BEAT)?;
    let (sender, receiver) = (pair.sender, pair.receiver.clone());
    attach!(pair.app.cx(), sender.sent_ns => receiver.count, Queued);
    pair.app.pulse();
    pair.emit(VOLLEY_CALLS)?;
    pair.shared.wait_for(VOLLEY_CALLS);
    let aim_ns = (BEAT - BEFORE_TICK).as_nanos() as u64;
    let mut spans: Vec<f64> = Vec::with_capacity(volleys);
    for number in 0..volleys as u64 {
        let last = pair.shared.last_tick_ns.load(Ordering::Acquire);
        while pair.shared.last_tick_ns.load(Ordering::Acquire) == last {
            std::thread::yield_now();
        }
        let due = pair.shared.last_tick_ns.load(Ordering::Acquire) + aim_ns;
        while pair.shared.now_ns() < due {
            std::hint::spin_loop();
        }
        let began = Moment::now();
        pair.emit(VOLLEY_CALLS)?;
        spans.push(began.elapsed().as_nanos() as f64 / VOLLEY_CALLS as f64);
        pair.shared.wait_for((number + 2) * VOLLEY_CALLS);
    }
    spans.sort_by(f64::total_cmp);
    sheet.figure("queued/to-spinning", "send_ns", "ns", spans[spans.len() / 2]);
    pair.thread.stop();
    Ok(())
}
