//! The time of one call, from many calls made in slices.

use std::time::Instant;

/// How many slices a measurement has: enough for a few that were interrupted not to matter.
const SLICES: usize = 11;

/// Runs `work` on slices of `units / 11` each, after one that does not count, and answers the median of the
/// nanoseconds per unit. On a busy machine the mean would tell of the interruptions.
///
/// ```
/// let mut sum = 0;
/// let ns = sk_benches::ns_per_unit(11_000, |units| (0..units).for_each(|n| sum += std::hint::black_box(n)));
/// assert!(ns > 0.0);
/// ```
pub fn ns_per_unit(units: usize, work: impl FnMut(usize)) -> f64 {
    let mut work = work;
    let slice = (units / SLICES).max(1);
    work(slice);
    let mut spans: Vec<f64> = (0..SLICES)
        .map(|_| {
            let began = Instant::now();
            work(slice);
            began.elapsed().as_nanos() as f64 / slice as f64
        })
        .collect();
    spans.sort_by(f64::total_cmp);
    spans[SLICES / 2]
}
