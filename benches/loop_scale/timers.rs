//! What starting, stopping and firing a timer costs among many others.

use crate::{app, ours};
use sk_benches::{Amount, BenchError, Sheet};
use sk_core::prelude::*;
use std::time::Instant as Moment;

/// Due times are spread over this many milliseconds, all of them beyond the end of the measurement.
const SPREAD_MS: u64 = 100_000;
/// A step between due times that has no order: prime to the spread.
const STRIDE_MS: u64 = 61_803;
/// How many timers are started over all rounds.
const STARTS: usize = 200_000;
/// Rounds there are at least.
const ROUNDS_MIN: usize = 11;

/// Spans per timer, one of each round.
#[derive(Default)]
struct Spans {
    start: Vec<f64>,
    stop: Vec<f64>,
    fire: Vec<f64>,
}

/// Measures `timers/COUNT`: `start_ns` and `stop_ns` of one among so many that run, `fire_ns` when all are due
/// in one round.
pub(crate) fn measure(sheet: &mut Sheet, count: usize, amount: Amount) -> Result<(), BenchError> {
    let mut app = app()?;
    let timers: Vec<Handle<Timer>> = (0..count).map(|_| app.cx().spawn(Timer::default())).collect();
    app.pulse();
    let mut spans = Spans::default();
    for _ in 0..amount.pick((STARTS / count).max(ROUNDS_MIN), 2) {
        round(&mut app, &timers, &mut spans).map_err(ours)?;
    }
    let case = format!("timers/{count}");
    sheet.figure(&case, "start_ns", "ns", median(spans.start));
    sheet.figure(&case, "stop_ns", "ns", median(spans.stop));
    sheet.figure(&case, "fire_ns", "ns", median(spans.fire));
    Ok(())
}

fn round(app: &mut SkApp, timers: &[Handle<Timer>], spans: &mut Spans) -> Result<(), Access> {
    let each = |began: Moment| began.elapsed().as_nanos() as f64 / timers.len() as f64;
    let began = Moment::now();
    for (number, timer) in (1u64..).zip(timers) {
        let after = SPREAD_MS + number * STRIDE_MS % SPREAD_MS;
        timer.start(app.cx(), Duration::from_millis(after))?;
    }
    spans.start.push(each(began));
    let began = Moment::now();
    for timer in timers {
        timer.stop(app.cx())?;
    }
    spans.stop.push(each(began));
    let goal = app.cx().stats().counters.timers_fired + timers.len() as u64;
    for timer in timers {
        timer.start_once(app.cx(), Duration::ZERO)?;
    }
    // One round fires what is due; the account is read outside of what is measured.
    let mut took = Duration::ZERO;
    while app.cx().stats().counters.timers_fired < goal {
        let began = Moment::now();
        app.pulse();
        took += began.elapsed();
    }
    spans.fire.push(took.as_nanos() as f64 / timers.len() as f64);
    Ok(())
}

fn median(mut spans: Vec<f64>) -> f64 {
    spans.sort_by(f64::total_cmp);
    spans[spans.len() / 2]
}
