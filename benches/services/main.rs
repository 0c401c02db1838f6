//! How long a call of a service takes, from the asker over the hub to the owner and back, beside the same way
//! over bare sockets: what the hub adds to the network.
//!
//! `cargo bench -p sk-benches --bench services -- [--json] [--runs N] [--smoke]`
#![forbid(unsafe_code)]

mod ours;
mod sockets;

use clap::Parser;
use sk_benches::{Bench, BenchError, Options, Report, Sheet, Side};

/// The bytes that are asked and answered.
pub(crate) const PAYLOAD_BYTES: usize = 64;

/// A call of a service and bare sockets over the same hops.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    shared: Options,
}

fn main() -> Result<(), BenchError> {
    let arguments = Arguments::parse();
    let calls = arguments.shared.amount().pick(20_000, 50);
    let _: Report = Bench::new("services", &arguments.shared)
        .side(Side::ours(move |sheet| ours::measure(sheet, calls)))
        .side(Side::built_in("sockets", move |sheet| Ok(sockets::measure(sheet, calls)?)))
        .run()?;
    Ok(())
}

/// One round trip.
pub(crate) fn note(sheet: &mut Sheet, ns: u64) {
    sheet.sample("call/tcp", "round_trip", ns, 1);
}
