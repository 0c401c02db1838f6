//! How much memory there is and how much of it is used: `/proc/meminfo`.

use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

const FILE: &str = "proc/meminfo";

/// The reader of the memory.
#[derive(Debug, Default)]
pub struct Memory {
    buffer: Vec<u8>,
}

/// The memory in bytes.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct MemoryReading {
    /// All that the kernel manages.
    pub total: u64,
    /// What programs could still get without swapping.
    pub available: u64,
    /// What is not available.
    pub used: u64,
    /// The used share, 0 to 1.
    pub used_share: f64,
    /// The swap space.
    pub swap_total: u64,
    /// What of the swap space is used.
    pub swap_used: u64,
}

impl Sense for Memory {
    type Reading = MemoryReading;

    const ABOUT: About = About {
        name: "memory",
        doc: "Memory and swap space, and what of it is used",
        period: Duration::from_secs(1),
        parts: &[
            Part { key: "total", unit: "B", doc: "all memory that the kernel manages" },
            Part { key: "available", unit: "B", doc: "what programs could get without swapping" },
            Part { key: "used", unit: "B", doc: "what is not available" },
            Part { key: "used_share", unit: "1", doc: "the used share of all, 0 to 1" },
            Part { key: "swap_total", unit: "B", doc: "the swap space" },
            Part { key: "swap_used", unit: "B", doc: "what of the swap space is used" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<MemoryReading>, SenseError> {
        let text = kernel.read(FILE, &mut self.buffer)?;
        parse_memory(&text)
            .map(Some)
            .ok_or_else(|| kernel.malformed(FILE, "line `MemTotal`"))
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        kernel.has(FILE)
    }
}

/// Reads the text of `/proc/meminfo`; `None` without a total.
///
/// Kernels before 3.14 do not say what is available; there it is what is free and what the caches hold, which
/// is a little too much.
pub fn parse_memory(text: &str) -> Option<MemoryReading> {
    let (mut total, mut available, mut reclaimable) = (None, None, 0u64);
    let (mut swap_total, mut swap_free) = (0u64, 0);
    for (key, bytes) in text.lines().filter_map(line) {
        match key {
            "MemTotal" => total = Some(bytes),
            "MemAvailable" => available = Some(bytes),
            "MemFree" | "Buffers" | "Cached" => reclaimable = reclaimable.saturating_add(bytes),
            "SwapTotal" => swap_total = bytes,
            "SwapFree" => swap_free = bytes,
            _ => {}
        }
    }
    let total = total.filter(|total| *total > 0)?;
    // In some containers the limit is written over the total alone, so more can seem available than there is.
    let available = available.unwrap_or(reclaimable).min(total);
    let used = total - available;
    Some(MemoryReading {
        total,
        available,
        used,
        used_share: used as f64 / total as f64,
        swap_total,
        swap_used: swap_total.saturating_sub(swap_free),
    })
}

/// The key and the bytes of a line like `MemTotal:  24684084 kB`. Lines without a unit hold counts of pages.
fn line(line: &str) -> Option<(&str, u64)> {
    let (key, value) = line.split_once(':')?;
    let kilobytes = value.trim().strip_suffix("kB")?.trim_end();
    Some((key, kilobytes.parse::<u64>().ok()?.saturating_mul(1024)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Captured on Linux 6.18, shortened, with a swap space put in.
    const NEW: &str = "MemTotal:       24684084 kB\nMemFree:        22538980 kB\nMemAvailable:   24082632 kB\n\
                       Buffers:            6632 kB\nCached:          1675132 kB\nSwapCached:            0 kB\n\
                       SwapTotal:       1000000 kB\nSwapFree:         999000 kB\nHugePages_Total:       3\n";
    /// Written by hand in the format of Linux 2.6.32, which does not say what is available.
    const OLD: &str = "MemTotal:        1020116 kB\nMemFree:          120116 kB\nBuffers:          100000 kB\n\
                       Cached:           300000 kB\nSwapCached:         1234 kB\nSwapTotal:             0 kB\n\
                       SwapFree:              0 kB\n";

    #[test]
    fn kilobytes_become_bytes() {
        let memory = parse_memory(NEW).unwrap();
        assert_eq!(memory.total, 24_684_084 * 1024);
        assert_eq!(memory.available, 24_082_632 * 1024);
        assert_eq!(memory.used, (24_684_084 - 24_082_632) * 1024);
        assert_eq!((memory.swap_total, memory.swap_used), (1_000_000 * 1024, 1000 * 1024));
        assert!((memory.used_share - 0.02436).abs() < 1e-5);
    }

    #[test]
    fn an_old_kernel_has_its_caches_counted_as_available() {
        let memory = parse_memory(OLD).unwrap();
        assert_eq!(memory.available, 520_116 * 1024);
        assert_eq!(memory.swap_used, 0);
    }

    #[test]
    fn nonsense_is_no_memory() {
        for text in ["", "MemTotal:", "MemTotal: x kB", "MemTotal: 0 kB", "MemTotal: -1 kB", "MemFree: 1 kB"]
        {
            assert_eq!(parse_memory(text), None, "{text}");
        }
        let more_available =
            parse_memory("MemTotal: 10 kB\nMemAvailable: 99999999999999999999 kB\n").unwrap();
        assert_eq!((more_available.available, more_available.used), (0, 10 * 1024));
        let huge = parse_memory("MemTotal: 18446744073709551615 kB\nSwapFree: 9 kB\n").unwrap();
        assert_eq!((huge.total, huge.swap_used), (u64::MAX, 0));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "((MemTotal|MemAvailable|Cached|SwapFree|\\PC{0,3}):? {0,2}-?[0-9]{0,22} ?(kB)?\n){0,6}|\\PC*") {
            if let Some(memory) = parse_memory(&text) {
                prop_assert!((0.0..=1.0).contains(&memory.used_share));
            }
        }
    }
}
