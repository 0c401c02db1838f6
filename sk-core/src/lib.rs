//! SpecialK's framework: event loops that pulse, objects in trees, signals and slots.
#![deny(unsafe_code)]

pub mod flow;
mod sys;
pub mod world;

pub use sk_flat::{Instant, SkElapsedTime};
