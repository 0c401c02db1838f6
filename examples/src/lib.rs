//! Small programs on SpecialK: see the files beside this crate's manifest. Here is what two of them share.
#![forbid(unsafe_code)]

pub mod battery;
