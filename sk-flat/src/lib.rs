//! Plain values of SpecialK: variants, ring buffers, elapsed time and names.
#![forbid(unsafe_code)]

mod elapsed;

pub use elapsed::{Instant, SkElapsedTime};
