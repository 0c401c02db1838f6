//! Histograms with fixed bounds: recording costs some nanoseconds and never allocates.

use hdrhistogram::Histogram as Hdr;
use std::time::Duration;

/// Longest span that is told apart; longer ones count as this.
const SPAN_NS_MAX: u64 = 60_000_000_000;

/// A histogram of spans from 1 ns to 60 s, exact to 1 %.
#[derive(Clone, Debug)]
pub struct Histogram(Hdr<u64>);

impl Histogram {
    pub(crate) fn new() -> Histogram {
        // Two significant digits over this range are 30 KB; the bounds are valid, as the test shows.
        match Hdr::new_with_bounds(1, SPAN_NS_MAX, 2) {
            Ok(hdr) => Histogram(hdr),
            Err(_) => unreachable!("the bounds of the histogram are constants"),
        }
    }

    #[inline]
    pub(crate) fn record(&mut self, span: Duration) {
        self.0.saturating_record(span.as_nanos() as u64);
    }

    pub(crate) fn clear(&mut self) {
        self.0.reset();
    }

    /// The span below which this share (0 to 1) of the recorded ones lie.
    pub fn quantile(&self, share: f64) -> Duration {
        Duration::from_nanos(self.0.value_at_quantile(share))
    }

    /// How many spans were recorded.
    pub fn count(&self) -> u64 {
        self.0.len()
    }

    /// The usual figures.
    pub fn distribution(&self) -> Distribution {
        Distribution {
            count: self.0.len(),
            min: Duration::from_nanos(if self.0.is_empty() { 0 } else { self.0.min() }),
            mean: Duration::from_nanos(self.0.mean() as u64),
            p50: self.quantile(0.5),
            p99: self.quantile(0.99),
            p999: self.quantile(0.999),
            max: Duration::from_nanos(self.0.max()),
        }
    }
}

/// The usual figures of a histogram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Distribution {
    /// How many spans were recorded.
    pub count: u64,
    /// The shortest.
    pub min: Duration,
    /// The mean.
    pub mean: Duration,
    /// The median.
    pub p50: Duration,
    /// 99 of 100 are below.
    pub p99: Duration,
    /// 999 of 1000 are below.
    pub p999: Duration,
    /// The longest.
    pub max: Duration,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_exact_to_one_per_cent_and_the_ends_hold() {
        let mut histogram = Histogram::new();
        for us in 1..=1000u64 {
            histogram.record(Duration::from_micros(us));
        }
        histogram.record(Duration::from_secs(3600));
        let figures = histogram.distribution();
        assert_eq!(figures.count, 1001);
        let p50 = figures.p50.as_nanos() as f64;
        assert!((p50 / 501_000.0 - 1.0).abs() < 0.011, "{p50}");
        assert!(
            figures.max >= Duration::from_secs(59),
            "longer spans count as the longest: {:?}",
            figures.max
        );
        histogram.clear();
        assert_eq!(histogram.distribution(), Distribution::default());
    }
}
