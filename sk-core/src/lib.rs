//! SpecialK's framework: event loops that pulse, objects in trees, signals and slots.
#![deny(unsafe_code)]

mod sys;
pub mod world;

pub use sk_flat::{Instant, SkElapsedTime};
