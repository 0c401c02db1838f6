//! The three ticks as objects.

use crate::signal::Signal;

/// One of the three clocks of a loop: `fast_zone`, `slow_zone` and `one_sec_zone`. Its `pulse` is emitted
/// at the beginning of a round, before anything else.
#[derive(Debug, Default)]
pub struct Zone {
    /// The tick.
    pub pulse: Signal<()>,
}

crate::object! { pub Zone { signals { pulse() } } }
