//! What a round of the loop costs, and whether idle sockets, timers and objects make it dearer.
//!
//! `cargo bench -p sk-benches --bench loop_scale -- [--json] [--runs N] [--smoke]`
//!
//! The loop is in `NoTiming`: its rounds do everything but wait. With sockets a round asks the system which
//! of them are ready, without waiting; without any it does not ask.
#![forbid(unsafe_code)]

mod timers;

use clap::Parser;
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use sk_benches::{Amount, Bench, BenchError, Options, Sheet, Side, ns_per_unit};
use sk_core::prelude::*;
use std::net::{Ipv4Addr, SocketAddr};

/// How many idle ones there are.
const COUNTS: [usize; 4] = [10, 100, 1_000, 10_000];
/// Longer than any run.
const NEVER: Duration = Duration::from_secs(3_600);
/// Descriptors of the process itself, beside the sockets.
const DESCRIPTORS_OWN: u64 = 100;

/// The cost of a pulse with many idle sockets, timers and objects.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    shared: Options,
}

/// Makes one idle thing.
type Add = fn(&mut Cx) -> Result<(), BenchError>;

#[derive(Default)]
struct Idle;
object! { Idle {} }

fn main() -> Result<(), BenchError> {
    let arguments = Arguments::parse();
    let amount = arguments.shared.amount();
    let word = [amount.word()];
    let mut bench = Bench::new("loop_scale", &arguments.shared)
        .side(Side::ours(|sheet| measure(sheet, amount)))
        .side(Side::program("qt6", "loop_scale_qt6", &word));
    for what in ["sockets", "timers", "objects"] {
        let (most, least) = (COUNTS[COUNTS.len() - 1], COUNTS[0]);
        bench = bench.growth("pulse_ns", &format!("loop/{what}/{most}"), &format!("loop/{what}/{least}"));
    }
    for metric in ["start_ns", "stop_ns", "fire_ns"] {
        bench = bench.growth(metric, "timers/10000", "timers/10");
    }
    bench.run()?;
    Ok(())
}

fn ours(error: impl std::fmt::Display) -> BenchError {
    BenchError::Ours(error.to_string())
}

fn measure(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    raise_descriptor_limit(COUNTS[COUNTS.len() - 1] as u64 + DESCRIPTORS_OWN)?;
    let counts = amount.pick(&COUNTS[..], &COUNTS[..1]);
    let pulse_ns = pulse_ns(&mut app()?, amount);
    sheet.figure("loop/empty", "pulse_ns", "ns", pulse_ns);
    let kinds: [(&str, Add); 3] =
        [("sockets", idle_socket), ("timers", idle_timer), ("objects", idle_object)];
    for (what, add) in kinds {
        for &count in counts {
            let mut app = app()?;
            for _ in 0..count {
                add(app.cx())?;
            }
            let pulse_ns = self::pulse_ns(&mut app, amount);
            sheet.figure(&format!("loop/{what}/{count}"), "pulse_ns", "ns", pulse_ns);
        }
    }
    counts.iter().try_for_each(|&count| timers::measure(sheet, count, amount))
}

fn app() -> Result<SkApp, BenchError> {
    SkApp::builder().mode(TimingMode::NoTiming).build().map_err(ours)
}

fn idle_socket(cx: &mut Cx) -> Result<(), BenchError> {
    Datagrams::bind(cx, SocketAddr::from((Ipv4Addr::LOCALHOST, 0)))
        .map(drop)
        .map_err(ours)
}

fn idle_timer(cx: &mut Cx) -> Result<(), BenchError> {
    let timer = cx.spawn(Timer::default());
    timer.start(cx, NEVER).map_err(ours)
}

fn idle_object(cx: &mut Cx) -> Result<(), BenchError> {
    cx.spawn(Idle);
    Ok(())
}

/// One round, after as many as settle what was just made.
fn pulse_ns(app: &mut SkApp, amount: Amount) -> f64 {
    ns_per_unit(amount.pick(100_000, 20), |rounds| (0..rounds).for_each(|_| app.pulse()))
}

/// As far as the hard limit allows; what is missing then shows as an error of a socket.
fn raise_descriptor_limit(wanted: u64) -> Result<(), BenchError> {
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE).map_err(ours)?;
    if soft < wanted {
        setrlimit(Resource::RLIMIT_NOFILE, wanted.min(hard), hard).map_err(ours)?;
    }
    Ok(())
}
