//! What each wish of a `Realtime` loop buys on this machine.

use crate::ours::{self, Asked};
use crate::{Arguments, PRIORITY};
use sk_benches::{Bench, BenchError, Side};
use sk_core::eventloop::{RealtimeWishes, SchedulingPolicy};
use std::time::Duration;

/// What the kernel gives a thread that asks for nothing.
const SLACK_NS_DEFAULT: u32 = 50_000;
/// The processor of those that want one: not the first, which most interrupts go to.
const CPU: usize = 1;

/// None of them, each alone, all together. The slack of 1 ns comes with the mode, so those before it go without.
fn rows() -> [(&'static str, Asked); 7] {
    let nothing = RealtimeWishes::default();
    let fifo = SchedulingPolicy::Fifo(PRIORITY);
    let cpu = std::thread::available_parallelism().map_or(0, |cpus| CPU.min(cpus.get() - 1));
    let without_slack = |realtime| Asked { realtime, slack_ns: Some(SLACK_NS_DEFAULT) };
    let all = RealtimeWishes { policy: fifo, cpu: Some(cpu), lock_memory: true, no_cpu_sleep: true };
    [
        ("nothing", without_slack(nothing)),
        ("slack-1ns", Asked { realtime: nothing, slack_ns: None }),
        ("fifo", without_slack(RealtimeWishes { policy: fifo, ..nothing })),
        ("no-cpu-sleep", without_slack(RealtimeWishes { no_cpu_sleep: true, ..nothing })),
        ("one-cpu", without_slack(RealtimeWishes { cpu: Some(cpu), ..nothing })),
        ("locked-memory", without_slack(RealtimeWishes { lock_memory: true, ..nothing })),
        ("all", Asked { realtime: all, slack_ns: None }),
    ]
}

/// One side for each row; peers have no part in this.
pub(crate) fn bench(arguments: &Arguments) -> Result<(), BenchError> {
    let load = if arguments.load { "load" } else { "idle" };
    let mut bench =
        Bench::new("tick_jitter", &arguments.shared).expected(Duration::from_secs_f64(arguments.seconds()));
    for (wish, asked) in rows() {
        let case = format!("wishes/{wish}/{}us/{load}", arguments.interval_us);
        let of_side = case.clone();
        let side = Side::ours(move |sheet| ours::tick(sheet, arguments, &of_side, asked));
        bench = bench.side(side.part(wish).with_cpu(&case));
    }
    bench.run_part(arguments.part.as_deref()).map(drop)
}
