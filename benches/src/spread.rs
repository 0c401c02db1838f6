//! A distribution of spans, exact.

use std::collections::BTreeMap;

/// Spans in nanoseconds and how often each came.
///
/// ```
/// let mut spread = sk_benches::Spread::default();
/// for ns in 1..=1000 { spread.add(ns, 1) }
/// assert_eq!((spread.quantile(0.5), spread.quantile(0.99), spread.max()), (500, 990, 1000));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Spread {
    counts: BTreeMap<u64, u64>,
    total: u64,
}

impl Spread {
    /// `count` more spans of `ns`.
    pub fn add(&mut self, ns: u64, count: u64) {
        if count > 0 {
            *self.counts.entry(ns).or_default() += count;
            self.total += count;
        }
    }

    /// Everything of another one.
    pub fn add_all(&mut self, other: &Spread) {
        other.counts.iter().for_each(|(ns, count)| self.add(*ns, *count));
    }

    /// How many spans there are.
    pub fn count(&self) -> u64 {
        self.total
    }

    /// The smallest span that at least this share of all do not exceed; 0 if there is none.
    pub fn quantile(&self, share: f64) -> u64 {
        let rank = ((self.total as f64 * share).ceil() as u64).max(1);
        let mut seen = 0;
        for (ns, count) in &self.counts {
            seen += count;
            if seen >= rank {
                return *ns;
            }
        }
        self.max()
    }

    /// The shortest span; 0 if there is none.
    pub fn min(&self) -> u64 {
        self.counts.keys().next().copied().unwrap_or(0)
    }

    /// The longest span; 0 if there is none.
    pub fn max(&self) -> u64 {
        self.counts.keys().next_back().copied().unwrap_or(0)
    }

    /// The spans in ascending order, and how often each came.
    pub fn iter(&self) -> impl Iterator<Item = (u64, u64)> {
        self.counts.iter().map(|(ns, count)| (*ns, *count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_spread_has_no_spans_and_does_not_fail() {
        let empty = Spread::default();
        assert_eq!((empty.min(), empty.quantile(0.99), empty.max(), empty.count()), (0, 0, 0, 0));
    }

    #[test]
    fn the_quantiles_of_one_span_are_that_span() {
        let mut one = Spread::default();
        one.add(7, 3);
        one.add(9, 0);
        assert_eq!((one.quantile(0.0), one.quantile(1.0), one.count()), (7, 7, 3));
    }
}
