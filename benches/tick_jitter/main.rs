//! How exactly a loop ticks: how late its ticks come, how far its mean period is off, what it costs.
//!
//! `cargo bench -p sk-benches --bench tick_jitter -- [--mode realtime] [--interval-us 1000] [--seconds 5]
//! [--policy fifo|other] [--cpu N] [--load] [--deep-sleep] [--plot FILE.svg] [--json] [--runs N] [--smoke]`
//!
//! With `--wishes` it tells instead what each wish for the operating system buys: our loop with none of them,
//! with each alone, and with all; `--load` and the interval as above.
//!
//! All sides run at the same interval, in the same scheduling class, on the same CPU if one is named, and
//! with the same `/dev/cpu_dma_latency`: the bench itself holds it at 0 for all of them unless told not to.
#![forbid(unsafe_code)]

mod load;
mod ours;
mod peers;
mod wishes;

use clap::{Parser, ValueEnum};
use sk_benches::{Bench, BenchError, Options, Report, Side, histogram_text, plot_svg};
use sk_core::TimingMode;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

/// The priority of every side in the real-time class.
pub(crate) const PRIORITY: u8 = 80;

/// How exactly a loop ticks, beside cyclictest, an absolute sleep, tokio and Qt.
#[derive(Parser)]
pub(crate) struct Arguments {
    #[command(flatten)]
    shared: Options,
    /// How our loop waits.
    #[arg(long, value_enum, default_value_t = ModeName::Realtime)]
    mode: ModeName,
    /// The interval of the tick.
    #[arg(long, default_value_t = 1_000, value_parser = clap::value_parser!(u64).range(1..), value_name = "N")]
    interval_us: u64,
    /// How long each side ticks in each run.
    #[arg(long, default_value_t = 5.0, value_name = "S")]
    seconds: f64,
    /// The scheduling class of all sides; `fifo` needs the privilege.
    #[arg(long, value_enum, default_value_t = PolicyName::Fifo)]
    policy: PolicyName,
    /// Run every side on this CPU only.
    #[arg(long, value_name = "N")]
    cpu: Option<usize>,
    /// Keep every CPU busy meanwhile, in the normal class.
    #[arg(long)]
    load: bool,
    /// Let idle CPUs sleep as deeply as they like, for all sides.
    #[arg(long)]
    deep_sleep: bool,
    /// Tell what each wish for the operating system buys our loop: none, each alone, all together.
    #[arg(long)]
    wishes: bool,
    /// The part this process measures; given by the bench when it starts itself anew.
    #[arg(long, hide = true, value_name = "NAME")]
    part: Option<String>,
    /// Write a plot of all sides to this file.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ModeName {
    Coarse,
    Realtime,
    SelectIo,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PolicyName {
    Fifo,
    Other,
}

impl Arguments {
    fn mode(&self) -> TimingMode {
        match self.mode {
            ModeName::Coarse => TimingMode::Coarse,
            ModeName::Realtime => TimingMode::Realtime,
            ModeName::SelectIo => TimingMode::SelectIo,
        }
    }

    /// In a smoke run a few ticks.
    fn seconds(&self) -> f64 {
        if self.shared.smoke { 0.01 } else { self.seconds.max(0.01) }
    }

    /// How many ticks that are.
    fn ticks(&self) -> u64 {
        ((self.seconds() * 1e6 / self.interval_us as f64) as u64).max(2)
    }

    /// MODE/INTERVAL/POLICY/LOAD.
    fn case(&self) -> String {
        let mode = match self.mode {
            ModeName::Coarse => "coarse",
            ModeName::Realtime => "realtime",
            ModeName::SelectIo => "select-io",
        };
        let policy = if self.policy == PolicyName::Fifo { "fifo" } else { "other" };
        let load = if self.load { "load" } else { "idle" };
        format!("{mode}/{}us/{policy}/{load}", self.interval_us)
    }

    /// What starts a peer in the class and on the CPU that were asked for. Ours asks for them itself.
    fn before(&self) -> Vec<String> {
        let mut words = Vec::new();
        if self.policy == PolicyName::Fifo {
            words.extend(["chrt".to_owned(), "-f".to_owned(), PRIORITY.to_string()]);
        }
        if let Some(cpu) = self.cpu {
            words.extend(["taskset".to_owned(), "-c".to_owned(), cpu.to_string()]);
        }
        words
    }
}

fn main() -> Result<(), BenchError> {
    let arguments = Arguments::parse();
    let is_side = arguments.shared.side.is_some();
    if arguments.wishes {
        // The load is the parent's, so that it is there before a side begins; nothing else is, as each side has
        // its own wishes.
        let _load = (arguments.load && !is_side).then(load::Load::start);
        return wishes::bench(&arguments);
    }
    // Held by the process that starts the sides, so that it is the same for all; a side holds nothing.
    let latency = if is_side || arguments.deep_sleep { None } else { Some(load::hold_latency_at_zero()) };
    let load = (arguments.load && !is_side).then(load::Load::start);
    let report = bench(&arguments, latency.and_then(Result::err))?;
    drop(load);
    if !is_side {
        show(&arguments, &report)?;
    }
    Ok(())
}

fn bench(arguments: &Arguments, latency_refused: Option<std::io::Error>) -> Result<Report, BenchError> {
    let (case, before) = (arguments.case(), arguments.before());
    let (interval, seconds) = (arguments.interval_us.to_string(), arguments.seconds().to_string());
    let mut bench = Bench::new("tick_jitter", &arguments.shared)
        .side(Side::ours(|sheet| ours::measure(sheet, arguments)).with_cpu(&case))
        // It sets class and CPU of its measuring thread by itself.
        .side(Side::built_in("cyclictest", |sheet| peers::cyclictest(sheet, arguments)).with_cpu(&case))
        .side(
            Side::built_in("absolute-sleep", |sheet| peers::absolute_sleep(sheet, arguments))
                .started_by(&before)
                .with_cpu(&case),
        )
        .side(
            Side::program("tokio", "tokio_peer", &["tick", &case, &interval, &seconds])
                .started_by(&before)
                .with_cpu(&case),
        )
        .expected(Duration::from_secs_f64(arguments.seconds()));
    // QTimer counts whole milliseconds.
    if arguments.interval_us.is_multiple_of(1_000) {
        bench = bench.side(
            Side::program("qt6", "tick_qt6", &[&case, &interval, &seconds])
                .started_by(&before)
                .with_cpu(&case),
        );
    }
    if let Some(error) = latency_refused {
        bench = bench.note(&format!("/dev/cpu_dma_latency could not be held at 0 for the sides: {error}"));
    }
    bench.run()
}

/// The histograms, and the plot if one was asked for.
fn show(arguments: &Arguments, report: &Report) -> Result<(), BenchError> {
    let mut text = String::new();
    for (_, peer, spread) in report.spreads() {
        text.push_str(&histogram_text(&format!("wake error of {}", peer.unwrap_or("ours")), spread));
    }
    if arguments.shared.json {
        eprint!("{text}");
    } else {
        std::io::stdout().write_all(text.as_bytes())?;
    }
    if let Some(file) = &arguments.plot {
        let sides: Vec<_> = report
            .spreads()
            .iter()
            .map(|(_, peer, spread)| (peer.unwrap_or("ours").to_owned(), spread))
            .collect();
        std::fs::write(file, plot_svg(&format!("Wake error, {}", arguments.case()), &sides))?;
    }
    Ok(())
}
