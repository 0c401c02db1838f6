//! How much wants to run: `/proc/loadavg` and the number of processes.

use crate::counter::number;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

const FILE: &str = "proc/loadavg";
const PROCESSES: &str = "proc";

/// The reader of the load.
#[derive(Debug, Default)]
pub struct Load {
    buffer: Vec<u8>,
}

/// What wants to run, on average and now.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct LoadReading {
    /// Tasks that ran or waited for a core or a disk, on average over the last minute.
    pub average_1min: f64,
    /// The same over five minutes.
    pub average_5min: f64,
    /// The same over fifteen minutes.
    pub average_15min: f64,
    /// Threads that run or could run now.
    pub running: u64,
    /// All threads, those of the kernel included.
    pub threads: u64,
    /// All processes that the hub may see, the kernel's own threads included.
    pub processes: u64,
}

impl Sense for Load {
    type Reading = LoadReading;

    const ABOUT: About = About {
        name: "load",
        doc: "Load averages, threads and processes",
        period: Duration::from_secs(5),
        parts: &[
            Part { key: "average_1min", unit: "1", doc: "tasks that ran or waited, over one minute" },
            Part { key: "average_5min", unit: "1", doc: "the same over five minutes" },
            Part { key: "average_15min", unit: "1", doc: "the same over fifteen minutes" },
            Part { key: "running", unit: "1", doc: "threads that run or could run now" },
            Part { key: "threads", unit: "1", doc: "all threads, those of the kernel included" },
            Part { key: "processes", unit: "1", doc: "all processes that the hub may see" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<LoadReading>, SenseError> {
        let text = kernel.read(FILE, &mut self.buffer)?;
        let mut reading = parse_load(&text).ok_or_else(|| kernel.malformed(FILE, "load averages"))?;
        kernel.each(PROCESSES, |name| {
            reading.processes += u64::from(name.bytes().all(|byte| byte.is_ascii_digit()));
        })?;
        Ok(Some(reading))
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        kernel.has(FILE)
    }
}

/// Reads a line like `1.06 1.14 0.90 3/110 10594`; `None` if the averages or the threads are not in it. The
/// processes are counted elsewhere and stay zero.
pub fn parse_load(text: &str) -> Option<LoadReading> {
    let mut words = text.split_ascii_whitespace();
    let mut average = || words.next().and_then(number).filter(|average| *average >= 0.0);
    let (average_1min, average_5min, average_15min) = (average()?, average()?, average()?);
    let (running, threads) = words.next()?.split_once('/')?;
    Some(LoadReading {
        average_1min,
        average_5min,
        average_15min,
        running: running.parse().ok()?,
        threads: threads.parse().ok()?,
        processes: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn averages_and_threads_are_read() {
        let load = parse_load("1.06 1.14 0.90 3/110 10594\n").unwrap();
        assert_eq!((load.average_1min, load.average_5min, load.average_15min), (1.06, 1.14, 0.9));
        assert_eq!((load.running, load.threads), (3, 110));
    }

    #[test]
    fn nonsense_is_no_load() {
        for text in ["", "1 2 3", "1 2 3 4", "nan 1 1 1/1 1", "-1 1 1 1/1 1", "1 1 1 1/-1 1", "1 1 1 / 1"] {
            assert_eq!(parse_load(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "([0-9.e-]{0,20} ){0,4}[0-9]{0,22}/[0-9]{0,22}|\\PC*") {
            if let Some(load) = parse_load(&text) {
                prop_assert!(load.average_1min.is_finite() && load.average_1min >= 0.0);
            }
        }
    }
}
