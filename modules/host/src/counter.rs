//! What a counter of the kernel gained between two readings.

use std::time::Duration;

/// What a counter gained from `before` to `now`; `None` if it began anew.
///
/// Counters of 32-bit kernels and of some drivers wrap at 32 bits, the others at 64. A counter that is smaller
/// than before has wrapped if the way over its end is the shorter one; otherwise the device was reset, or it
/// left and another came under its name, and nobody knows what was counted in between.
pub(crate) fn gained(before: u64, now: u64) -> Option<u64> {
    if now >= before {
        return Some(now - before);
    }
    match (u32::try_from(before), u32::try_from(now)) {
        (Ok(before), Ok(now)) => {
            let over_the_end = now.wrapping_sub(before);
            (over_the_end <= u32::MAX / 2).then_some(u64::from(over_the_end))
        }
        _ => {
            let over_the_end = now.wrapping_sub(before);
            (over_the_end <= u64::MAX / 2).then_some(over_the_end)
        }
    }
}

/// What a counter gained per second of `span`, which must not be zero.
pub(crate) fn rate(before: u64, now: u64, span: Duration) -> Option<f64> {
    gained(before, now).map(|gain| gain as f64 / span.as_secs_f64())
}

/// A number as the kernel prints it: digits, perhaps a sign and a point. Rust would also read `inf` and `nan`.
pub(crate) fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrap_is_bridged_and_a_reset_is_not() {
        assert_eq!(gained(5, 7), Some(2));
        assert_eq!(gained(u64::from(u32::MAX) - 9, 5), Some(15));
        assert_eq!(gained(u64::MAX - 9, 5), Some(15));
        assert_eq!(gained(1000, 5), None);
        // More than 32 bits were counted, so this counter is a wide one, and it began anew.
        assert_eq!(gained(1 << 33, 5), None);
    }

    #[test]
    fn only_real_numbers_are_numbers() {
        assert_eq!(number("-1.5"), Some(-1.5));
        assert!(["inf", "nan", "1e999", "", "x"].iter().all(|text| number(text).is_none()));
    }
}
