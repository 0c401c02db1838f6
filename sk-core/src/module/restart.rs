//! How often and how soon a module that failed is begun again.

use std::time::Duration;

/// What follows a failure: waits that grow, and an end.
///
/// The first retry comes after `first`, each further one after `factor` times as long, at most `max`. After
/// `tries` retries in a row the module stays failed until somebody starts it. A module that ran for `max`
/// or longer begins counting anew.
///
/// ```
/// use sk_core::module::RestartPolicy;
/// use std::time::Duration;
///
/// let second = Duration::from_secs;
/// let policy = RestartPolicy { first: second(1), factor: 3, max: second(5), tries: 3 };
/// let waits: Vec<_> = (1..=4).map(|failures| policy.wait_after(failures)).collect();
/// assert_eq!(waits, [Some(second(1)), Some(second(3)), Some(second(5)), None]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RestartPolicy {
    /// The wait before the first retry.
    pub first: Duration,
    /// By how much each further wait is longer.
    pub factor: u32,
    /// The longest wait.
    pub max: Duration,
    /// How many retries in a row are made.
    pub tries: u32,
}

impl Default for RestartPolicy {
    fn default() -> RestartPolicy {
        RestartPolicy {
            first: Duration::from_millis(500),
            factor: 2,
            max: Duration::from_secs(60),
            tries: 10,
        }
    }
}

impl RestartPolicy {
    /// A module that failed stays so.
    pub const NEVER: RestartPolicy =
        RestartPolicy { first: Duration::ZERO, factor: 1, max: Duration::ZERO, tries: 0 };

    /// The wait after so many failures in a row, counted from 1; none if the module is given up.
    pub fn wait_after(&self, failures: u32) -> Option<Duration> {
        if failures > self.tries {
            return None;
        }
        let factor = self.factor.checked_pow(failures.saturating_sub(1));
        let wait = factor.and_then(|factor| self.first.checked_mul(factor));
        Some(wait.map_or(self.max, |wait| wait.min(self.max)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_up_to_the_longest_whatever_the_numbers() {
        let policy = RestartPolicy { tries: u32::MAX, ..RestartPolicy::default() };
        assert_eq!(policy.wait_after(2), Some(Duration::from_secs(1)));
        assert_eq!(policy.wait_after(u32::MAX), Some(policy.max));
        let endless = RestartPolicy { first: Duration::MAX, max: Duration::MAX, ..policy };
        assert_eq!(endless.wait_after(2), Some(Duration::MAX));
    }

    #[test]
    fn never_means_not_even_once() {
        assert_eq!(RestartPolicy::NEVER.wait_after(1), None);
    }
}
