//! The peers that are started or written here: cyclictest and a plain absolute sleep.

use crate::{Arguments, PRIORITY, PolicyName};
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};
use sk_benches::{BenchError, Sheet};
use std::io;
use std::process::{Command, Stdio};

/// The longest wake error that cyclictest's histogram tells apart.
const HISTOGRAM_US: u32 = 100_000;

/// cyclictest with the same interval, class, CPU and number of cycles; its histogram is whole microseconds
/// rounded down, told as the middle of each.
pub(crate) fn cyclictest(sheet: &mut Sheet, arguments: &Arguments) -> Result<(), BenchError> {
    let case = arguments.case();
    let mut command = Command::new("cyclictest");
    // `--default-system` keeps its hands off `/dev/cpu_dma_latency`, which is held or not for all sides alike.
    command.args(["--quiet", "--default-system", "--threads=1", "--mlockall"]);
    command.arg(format!("--histogram={HISTOGRAM_US}"));
    command.arg(format!("--interval={}", arguments.interval_us));
    command.arg(format!("--loops={}", arguments.ticks()));
    match arguments.policy {
        PolicyName::Fifo => command.arg("--policy=fifo").arg(format!("--priority={PRIORITY}")),
        PolicyName::Other => command.arg("--policy=other"),
    };
    if let Some(cpu) = arguments.cpu {
        command.arg(format!("--affinity={cpu}"));
    }
    let output = command.stdin(Stdio::null()).stderr(Stdio::inherit()).output()?;
    if !output.status.success() {
        return Err(io::Error::other(format!("cyclictest ended with {}", output.status)).into());
    }
    let text = String::from_utf8_lossy(&output.stdout);
    for (us, count) in text.lines().filter_map(histogram_line) {
        sheet.sample(&case, "wake_error", us * 1_000 + 500, count);
    }
    if let Some(beyond) = overflows(&text).filter(|count| *count > 0) {
        sheet.sample(&case, "wake_error", u64::from(HISTOGRAM_US) * 1_000, beyond);
    }
    Ok(())
}

/// `000019 000123`: a span in microseconds and how often it came.
fn histogram_line(line: &str) -> Option<(u64, u64)> {
    let mut words = line.split_whitespace();
    let (us, count) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    (words.next().is_none() && count > 0).then_some((us, count))
}

/// `# Histogram Overflows: 00003`
fn overflows(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("# Histogram Overflows:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// What everybody writes first: sleep until start + k intervals, and do it again.
pub(crate) fn absolute_sleep(sheet: &mut Sheet, arguments: &Arguments) -> Result<(), BenchError> {
    let (interval_ns, ticks) = (arguments.interval_us as i64 * 1_000, arguments.ticks());
    let mut late_ns: Vec<u64> = Vec::with_capacity(ticks as usize);
    let mut missed = 0;
    let start = now_ns()?;
    let (mut due, mut first, mut last) = (start, 0, 0);
    for _ in 0..ticks {
        due += interval_ns;
        sleep_until(due)?;
        last = now_ns()?;
        if first == 0 {
            first = last;
        }
        late_ns.push((last - due).max(0) as u64);
        let passed = (last - due) / interval_ns;
        due += passed * interval_ns;
        missed += passed;
    }
    let case = arguments.case();
    late_ns.iter().for_each(|ns| sheet.sample(&case, "wake_error", *ns, 1));
    let periods = ((due - start) / interval_ns - 1).max(1) as f64;
    let drift = ((last - first) as f64 / periods / interval_ns as f64 - 1.0) * 1e6;
    sheet.figure(&case, "drift", "ppm", drift);
    sheet.figure(&case, "missed", "1", missed as f64);
    Ok(())
}

fn now_ns() -> io::Result<i64> {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC)?;
    Ok(now.tv_sec() * 1_000_000_000 + now.tv_nsec())
}

fn sleep_until(due_ns: i64) -> io::Result<()> {
    let due = TimeSpec::new(due_ns / 1_000_000_000, due_ns % 1_000_000_000);
    match clock_nanosleep(ClockId::CLOCK_MONOTONIC, ClockNanosleepFlags::TIMER_ABSTIME, &due) {
        // Woken by a signal, it looks at the clock like at any other time.
        Ok(_) | Err(nix::errno::Errno::EINTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
