//! What a signal costs: called directly, queued in one thread, across threads; and linking it.
//!
//! `cargo bench -p sk-benches --bench signal_slot -- [--json] [--runs N] [--smoke]`
#![forbid(unsafe_code)]

mod across;
mod direct;
mod linking;
mod queued;
mod raw;

use clap::Parser;
use sk_benches::{Bench, BenchError, Options, Side};
use sk_core::testing::CountingAllocator;

/// Counts for `queued/same-thread`; the cost of counting is about a nanosecond an allocation.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Signals and slots beside their peers.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    shared: Options,
}

fn main() -> Result<(), BenchError> {
    let arguments = Arguments::parse();
    let amount = arguments.shared.amount();
    let ours = Side::ours(|sheet| {
        direct::measure(sheet, amount)?;
        queued::measure(sheet, amount)?;
        linking::measure(sheet, amount)?;
        across::measure(sheet, amount)
    });
    let floor = Side::built_in("floor", |sheet| {
        raw::closures(sheet, amount);
        Ok(())
    });
    let eventfd = Side::built_in("eventfd", |sheet| raw::eventfd(sheet, amount));
    let word = [amount.word()];
    Bench::new("signal_slot", &arguments.shared)
        .side(ours)
        .side(floor)
        .side(Side::program("sigc++", "signal_slot_sigcxx", &word))
        .side(Side::program("boost-signals2", "signal_slot_boost", &word))
        .side(Side::program("qt6", "signal_slot_qt6", &word))
        .side(eventfd)
        .side(Side::program("tokio", "tokio_peer", &["signal_slot", amount.word()]))
        .run()?;
    Ok(())
}
