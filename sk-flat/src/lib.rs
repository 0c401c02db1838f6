//! Plain values of SpecialK: variants, ring buffers, elapsed time and names.
#![forbid(unsafe_code)]

#[doc(hidden)]
pub mod derived;
mod elapsed;
mod error;
mod name;
mod ring;
pub mod variant;

pub use elapsed::{Instant, SkElapsedTime};
pub use error::{NameError, VariantError};
pub use name::{NAME_BYTES_MAX, Name, channel_hash, name_hash};
pub use ring::{ByteConsumer, ByteProducer, NewestByteConsumer, NewestByteProducer};
pub use ring::{NewestConsumer, NewestProducer, RingConsumer, RingProducer, SkRingBuffer};
/// Derives [`IntoVariant`] and [`FromVariant`] for a type of your own.
pub use sk_flat_macros::SkVariant;
pub use variant::{FromVariant, IntoVariant, Kind, Limits, SkList, SkMap, SkVariant};
