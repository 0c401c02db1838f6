//! The senses of the machine the hub runs on.
#![forbid(unsafe_code)]
