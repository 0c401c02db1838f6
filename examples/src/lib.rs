//! Small programs on SpecialK: see the files beside this crate's manifest.
#![forbid(unsafe_code)]
