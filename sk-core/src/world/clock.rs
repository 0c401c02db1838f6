//! Time.

use sk_flat::Instant;
use std::time::Duration;

/// A monotonic clock and the two ways of waiting on it.
///
/// Reading the real clock costs about 20 ns: a loop reads it at the steps of a round and hands the
/// instant on.
pub trait Clock: Send + Sync {
    /// The present.
    fn now(&self) -> Instant;

    /// Time since 1970-01-01 00:00 UTC. It may jump when the operator sets the machine's clock; use it
    /// for labels only.
    fn since_epoch(&self) -> Duration;

    /// Waits for `span`, as the papers' `usleep`: never shorter, as much longer as the kernel likes.
    fn sleep(&self, span: Duration);

    /// Waits until the absolute instant `until`; returns at once if it has passed.
    fn sleep_until(&self, until: Instant);
}
