//! What an object costs: to make, to keep, to bury; flat, connected, as a chain, in random order.
//!
//! `cargo bench -p sk-benches --bench objects -- [--json] [--runs N] [--smoke]`
//!
//! Memory is what the process has more of in RAM, divided by the number of objects: the same measure for all
//! sides, with all that allocators add. It is only right in a process that did nothing before, so every part
//! has a process of its own.
#![forbid(unsafe_code)]

mod parts;

use clap::Parser;
use sk_benches::{Bench, BenchError, Options, Report, Side};

/// Making, keeping and burying objects.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    shared: Options,
    /// The part this process measures; given by the bench when it starts itself anew.
    #[arg(long, hide = true, value_name = "NAME")]
    part: Option<String>,
}

fn main() -> Result<(), BenchError> {
    let arguments = Arguments::parse();
    let amount = arguments.shared.amount();
    let mut bench = Bench::new("objects", &arguments.shared);
    for (part, work) in parts::ALL {
        bench = bench.side(Side::ours(move |sheet| work(sheet, amount)).part(part));
    }
    for part in ["flat", "connected", "chain", "order"] {
        bench = bench.side(Side::program("qt6", "objects_qt6", &[amount.word(), part]).part(part));
    }
    let _: Report = bench.run_part(arguments.part.as_deref())?;
    Ok(())
}
