//! `derive(SkVariant)`.
#![forbid(unsafe_code)]
