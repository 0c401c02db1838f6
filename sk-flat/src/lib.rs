//! Plain values of SpecialK: variants, ring buffers, elapsed time and names.
#![forbid(unsafe_code)]

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
pub use variant::{FromVariant, IntoVariant, Kind, Limits, SkList, SkMap, SkVariant};
