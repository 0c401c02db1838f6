//! Plain values of SpecialK: variants, ring buffers, elapsed time and names.
#![forbid(unsafe_code)]

mod elapsed;
mod error;
mod name;
pub mod variant;

pub use elapsed::{Instant, SkElapsedTime};
pub use error::{NameError, VariantError};
pub use name::{NAME_BYTES_MAX, Name, channel_hash, name_hash};
pub use variant::{FromVariant, IntoVariant, Kind, Limits, SkList, SkMap, SkVariant};
