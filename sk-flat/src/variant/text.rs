//! Variants as JSON.
//!
//! Null, truths, texts, lists, maps, finite floats and integers are JSON. What JSON lacks is written
//! as an object with one reserved key, and read back from it:
//!
//! | value | text |
//! |---|---|
//! | bytes | `{"$bytes":"AAEC"}`: base64 with the standard alphabet and padding |
//! | a float that is not finite | `{"$f64":"NaN"}`, `"inf"`, `"-inf"`; `$f32` likewise; a NaN with other bits than the usual as `{"$f64":"0x7ff8000000000001"}` |
//! | a map of one entry whose key is reserved | `{"$map":{"$bytes":5}}`: inside `$map` the keys mean nothing |
//!
//! **Numbers.** A number with a point or an exponent is an `F64` (so floats are always written with
//! one), and so is `-0`, which no integer can hold; any other is an `I64`, or a `U64` if it is beyond `i64`. An integer beyond `u64` is read as the
//! nearest float, since JSON itself does not tell the two apart; a float beyond `f64` is refused. All
//! `F64` come back with the same bits, `-0.0` included.
//!
//! [`to_json`](SkVariant::to_json) writes numbers of the other kinds plainly too: `U8(5)` as `5`,
//! `F32(0.1)` as `0.1`. They come back as the same numbers (an `F32` as the `F64` nearest to its
//! shortest decimal digits) of another kind, and [`FromVariant`](crate::FromVariant) reads them as
//! the type they came from. Where the kind itself must survive,
//! [`to_json_exact`](SkVariant::to_json_exact) writes `{"$u8":5}`, and what it writes is always read
//! back equal. The reserved keys are `$bytes $map $f64 $f32 $i8 $i16 $i32 $u8 $u16 $u32 $u64`.
//!
//! **Keys.** Objects are written in the order of their keys. An object with the same key twice is
//! refused, for its meaning would depend on the reader.
//!
//! **Limits.** A text nests at most 64 deep (the objects above count), holds at most 262,144 values
//! and has at most 1 MiB, unless [`Limits`] say less or more; deeper than 64 is never read.

use super::serial::{Raw, RawReading, Shown, Style, unfold};
use super::{Limits, SkVariant};
use crate::error::VariantError;
use serde::de::DeserializeSeed;

impl SkVariant {
    /// Compact JSON, numbers written plainly.
    ///
    /// # Errors
    /// [`VariantError::Limit`] if the text would nest more than 64 deep.
    ///
    /// ```
    /// use sk_flat::SkVariant;
    ///
    /// let value = SkVariant::map([("raw", vec![0u8, 1, 2].into()), ("volt", 12.0.into())]);
    /// assert_eq!(value.to_json()?, r#"{"raw":{"$bytes":"AAEC"},"volt":12.0}"#);
    /// assert_eq!(SkVariant::from_json(&value.to_json()?)?, value);
    /// # Ok::<(), sk_flat::VariantError>(())
    /// ```
    pub fn to_json(&self) -> Result<String, VariantError> {
        written(serde_json::to_string(&Shown::new(self, Style::Plain)))
    }

    /// JSON on several lines with two spaces of indent, numbers written plainly.
    ///
    /// # Errors
    /// As [`to_json`](SkVariant::to_json).
    pub fn to_json_pretty(&self) -> Result<String, VariantError> {
        written(serde_json::to_string_pretty(&Shown::new(self, Style::Plain)))
    }

    /// Compact JSON that also tells the kinds of numbers, so that reading it gives an equal value.
    ///
    /// # Errors
    /// As [`to_json`](SkVariant::to_json).
    ///
    /// ```
    /// use sk_flat::SkVariant;
    ///
    /// assert_eq!(SkVariant::list([1u16]).to_json_exact()?, r#"[{"$u16":1}]"#);
    /// # Ok::<(), sk_flat::VariantError>(())
    /// ```
    pub fn to_json_exact(&self) -> Result<String, VariantError> {
        written(serde_json::to_string(&Shown::new(self, Style::Exact)))
    }

    /// Reads JSON within the limits of [`Limits::TEXT`].
    ///
    /// # Errors
    /// [`VariantError::Text`] with line and column for what is no JSON or has a key twice,
    /// [`VariantError::Limit`], and an error with its path for a reserved key with a wrong value.
    pub fn from_json(text: &str) -> Result<SkVariant, VariantError> {
        SkVariant::from_json_with(text, &Limits::TEXT)
    }

    /// Reads JSON within limits of one's own.
    ///
    /// # Errors
    /// As [`from_json`](SkVariant::from_json).
    pub fn from_json_with(text: &str, limits: &Limits) -> Result<SkVariant, VariantError> {
        limits.check_bytes(text.len())?;
        let reading = RawReading::new(*limits, true);
        let mut parser = serde_json::Deserializer::from_str(text);
        let parsed = Raw::top(&reading)
            .deserialize(&mut parser)
            .and_then(|raw| parser.end().map(|()| raw));
        match parsed {
            Ok(raw) if reading.saw_form() => unfold(raw),
            Ok(raw) => Ok(raw),
            Err(error) => Err(reading.take_refused().unwrap_or_else(|| placed(&error))),
        }
    }
}

impl std::str::FromStr for SkVariant {
    type Err = VariantError;
    fn from_str(json: &str) -> Result<SkVariant, VariantError> {
        SkVariant::from_json(json)
    }
}

// The one thing that can fail when a variant is written to a `String` is its depth.
fn written(outcome: Result<String, serde_json::Error>) -> Result<String, VariantError> {
    outcome.map_err(|_| VariantError::Limit { what: "the nesting depth", max: super::VARIANT_DEPTH_MAX })
}

fn placed(error: &serde_json::Error) -> VariantError {
    let (line, column) = (error.line(), error.column());
    let whole = error.to_string();
    let message = whole
        .strip_suffix(&format!(" at line {line} column {column}"))
        .unwrap_or(&whole);
    VariantError::Text { line, column, message: message.into() }
}

#[cfg(test)]
mod tests;
