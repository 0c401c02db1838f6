//! Plain values of SpecialK: variants, ring buffers, elapsed time and names.
//!
//! Nothing here knows a thread, a file or a socket; the event loops and the network of SpecialK are
//! built on it. Readers of the papers find their class names in [`papers`].
//!
//! - [`SkVariant`](enum@SkVariant) is one value of any plain kind. It goes to and from [JSON](variant::text), a
//!   [binary form](variant::binary), serde types and, by `derive(SkVariant)`, types of your own.
//! - [`SkRingBuffer`] carries items or bytes between two threads, refusing the new or replacing the old.
//! - [`SkElapsedTime`] answers how long ago something was, on whatever clock the program has.
//! - [`Name`] is a checked name; [`name_hash`] and [`channel_hash`] are the numbers for names.
//!
//! What comes from outside is limited before it costs memory ([`Limits`]), and what is wrong with it
//! is a value of [`VariantError`] or [`NameError`], never a panic.
//!
//! # A program
//!
//! ```
//! use sk_flat::{Instant, Name, SkElapsedTime, SkRingBuffer, SkVariant};
//! use std::time::Duration;
//!
//! #[derive(SkVariant, Debug, PartialEq)]
//! struct Battery {
//!     volt: f32,
//!     cells: Vec<f64>,
//!     #[variant(default)]
//!     charging: bool,
//! }
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     // A sensor's thread would hold one half of the ring and the loop the other.
//!     let (mut sensor, mut readings) = SkRingBuffer::newest(2);
//!     for volt in [12.5, 12.25, 12.0] {
//!         sensor.push(Battery { volt, cells: vec![4.0; 3], charging: false });
//!     }
//!     assert_eq!(readings.replaced(), 1);
//!
//!     // What is published is a variant, as compact bytes or as JSON for those without them.
//!     let battery = readings.pop_newest().ok_or("no reading yet")?;
//!     let value = SkVariant::from(battery);
//!     assert_eq!(SkVariant::decode(&value.encode()?)?, value);
//!     assert_eq!(value.to_json()?, r#"{"cells":[4.0,4.0,4.0],"charging":false,"volt":12.0}"#);
//!
//!     // What comes back is checked, and what is wrong has a place.
//!     let answer = SkVariant::from_json(r#"{"volt": 12, "cells": [4.0, "low"]}"#)?;
//!     let error = Battery::try_from(answer).unwrap_err();
//!     assert_eq!(error.to_string(), "cells[1]: expected f64, found string");
//!
//!     // Names are checked when they are made; time is told, not read.
//!     let channel = Name::compose(&"nao".parse()?, &"battery".parse()?)?;
//!     let since = SkElapsedTime::started(Instant::ZERO);
//!     let now = Instant::from_nanos(1_500_000_000);
//!     assert_eq!(format!("{channel} after {:?}", since.elapsed(now)), "nao.battery after 1.5s");
//!     assert_eq!(since.elapsed(now), Duration::from_millis(1500));
//!     Ok(())
//! }
//! ```
#![forbid(unsafe_code)]

#[doc(hidden)]
pub mod derived;
mod elapsed;
mod error;
mod name;
mod ring;
pub mod variant;

#[doc = include_str!("../docs/papers.md")]
pub mod papers {}

pub use elapsed::{Instant, SkElapsedTime};
pub use error::{NameError, VariantError};
pub use name::{NAME_BYTES_MAX, Name, channel_hash, name_hash};
pub use ring::{ByteConsumer, ByteProducer, NewestByteConsumer, NewestByteProducer};
pub use ring::{NewestConsumer, NewestProducer, RingConsumer, RingProducer, SkRingBuffer};
/// Derives [`IntoVariant`] and [`FromVariant`] for a type of your own.
pub use sk_flat_macros::SkVariant;
pub use variant::{FromVariant, IntoVariant, Kind, Limits, SkList, SkMap, SkVariant};
