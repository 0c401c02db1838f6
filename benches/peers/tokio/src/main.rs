//! tokio's share of the benches: a tick by `interval`, and messages to a task on another thread.
//!
//! `tokio_peer signal_slot full|smoke` or `tokio_peer tick CASE INTERVAL_US SECONDS`
#![forbid(unsafe_code)]

use std::hint::black_box;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

/// How long the sender pauses between single messages.
const PAUSE: Duration = Duration::from_millis(1);

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let outcome = match words[..] {
        ["signal_slot", amount] => signal_slot(amount == "smoke"),
        ["tick", case, interval_us, seconds] => match (interval_us.parse(), seconds.parse()) {
            (Ok(interval_us), Ok(seconds)) => tick(case, interval_us, seconds),
            _ => return ExitCode::from(2),
        },
        _ => return ExitCode::from(2),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn runtime() -> std::io::Result<Runtime> {
    Builder::new_current_thread().enable_time().build()
}

fn tick(case: &str, interval_us: u64, seconds: f64) -> std::io::Result<()> {
    let interval = Duration::from_micros(interval_us.max(1));
    let wanted = (seconds * 1e9 / interval.as_nanos() as f64) as usize;
    let mut late_ns: Vec<u64> = Vec::with_capacity(wanted);
    let (mut first, mut last) = (None, Instant::now());
    runtime()?.block_on(async {
        let mut ticks = tokio::time::interval(interval);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        // The first tick comes at once and belongs to no wait.
        ticks.tick().await;
        while late_ns.len() < wanted {
            let due = ticks.tick().await.into_std();
            last = Instant::now();
            first.get_or_insert(last);
            late_ns.push(last.saturating_duration_since(due).as_nanos() as u64);
        }
    });
    let passed = last.duration_since(first.unwrap_or(last)).as_nanos() as f64;
    let periods = (passed / interval.as_nanos() as f64).round().max(1.0);
    for ns in &late_ns {
        println!("sample\t{case}\twake_error\t{ns}\t1");
    }
    println!("figure\t{case}\tdrift\tppm\t{}", (passed / periods / interval.as_nanos() as f64 - 1.0) * 1e6);
    println!("figure\t{case}\tmissed\t1\t{}", (periods + 1.0 - late_ns.len() as f64).max(0.0));
    Ok(())
}

/// A task on a runtime of another thread that takes numbers from a channel.
struct Far {
    sender: mpsc::Sender<u64>,
    taken: Arc<AtomicU64>,
    thread: JoinHandle<Vec<u64>>,
}

impl Far {
    fn new(origin: Instant, room: usize, timed: bool) -> Far {
        let (sender, mut receiver) = mpsc::channel::<u64>(room);
        let taken = Arc::new(AtomicU64::new(0));
        let count = taken.clone();
        let thread = thread::spawn(move || {
            let mut spans = Vec::new();
            let Ok(runtime) = runtime() else { return spans };
            runtime.block_on(async {
                while let Some(sent_ns) = receiver.recv().await {
                    if timed {
                        spans.push((origin.elapsed().as_nanos() as u64).saturating_sub(sent_ns));
                    }
                    count.fetch_add(1, Ordering::Release);
                }
            });
            spans
        });
        Far { sender, taken, thread }
    }

    fn send(&self, number: u64) -> Result<(), std::io::Error> {
        self.sender.try_send(number).map_err(std::io::Error::other)
    }

    fn wait_for(&self, taken: u64) {
        while self.taken.load(Ordering::Acquire) < taken {
            thread::yield_now();
        }
    }

    fn end(self) -> std::io::Result<Vec<u64>> {
        drop(self.sender);
        self.thread.join().map_err(|_| std::io::Error::other("the receiver panicked"))
    }
}

fn signal_slot(smoke: bool) -> std::io::Result<()> {
    let (burst, bursts) = if smoke { (10, 2) } else { (10_000, 100) };
    let origin = Instant::now();
    let far = Far::new(origin, 65_536, false);
    let mut began = origin;
    // The first burst warms up.
    for number in 0..=bursts {
        for i in 0..burst {
            far.send(black_box(i))?;
        }
        far.wait_for((number + 1) * burst);
        if number == 0 {
            began = Instant::now();
        }
    }
    let per_call = began.elapsed().as_nanos() as f64 / (burst * bursts) as f64;
    println!("figure\tqueued/cross-thread\tns_per_call\tns\t{per_call}");
    far.end()?;
    let far = Far::new(origin, 65_536, true);
    let samples = if smoke { 3 } else { 1_000 };
    for _ in 0..samples {
        thread::sleep(PAUSE);
        far.send(origin.elapsed().as_nanos() as u64)?;
    }
    for ns in far.end()? {
        println!("sample\tqueued/idle-one-way\t\t{ns}\t1");
    }
    Ok(())
}
