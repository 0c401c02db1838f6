//! How long the machine has been running: `/proc/uptime`.

use crate::counter::number;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

const FILE: &str = "proc/uptime";

/// The reader of the uptime.
#[derive(Debug, Default)]
pub struct Uptime {
    buffer: Vec<u8>,
}

/// How long the machine has been running.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct UptimeReading {
    /// Seconds since the kernel started, those asleep included.
    pub seconds: f64,
}

impl Sense for Uptime {
    type Reading = UptimeReading;

    const ABOUT: About = About {
        name: "uptime",
        doc: "How long the machine has been running",
        period: Duration::from_secs(1),
        parts: &[Part { key: "seconds", unit: "s", doc: "since the kernel started, sleep included" }],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<UptimeReading>, SenseError> {
        let text = kernel.read(FILE, &mut self.buffer)?;
        parse_uptime(&text)
            .map(Some)
            .ok_or_else(|| kernel.malformed(FILE, "number of seconds"))
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        kernel.has(FILE)
    }
}

/// Reads a line like `3220.56 4932.51`, whose second number, the idle time of all cores, is not used.
pub fn parse_uptime(text: &str) -> Option<UptimeReading> {
    let seconds = text.split_ascii_whitespace().next().and_then(number)?;
    (seconds >= 0.0).then_some(UptimeReading { seconds })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_first_number_counts() {
        assert_eq!(parse_uptime("3220.56 4932.51\n"), Some(UptimeReading { seconds: 3220.56 }));
        assert_eq!(parse_uptime("12"), Some(UptimeReading { seconds: 12.0 }));
        for text in ["", "\n", "x 1", "-1 1", "inf 1"] {
            assert_eq!(parse_uptime(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[-0-9.e+]{0,24} ?|\\PC*") {
            prop_assert!(parse_uptime(&text).is_none_or(|uptime| uptime.seconds >= 0.0));
        }
    }
}
