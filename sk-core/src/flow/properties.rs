//! The properties of a channel: a variant that is kept as it came over the wire.

use super::limits::PROPERTIES_BYTES_MAX;
use bytes::Bytes;
use sk_flat::{SkVariant, VariantError};
use std::fmt;

/// A variant in its binary form, checked when it was made. A hub hands it on as often as it likes without
/// encoding it again; a clone shares the bytes.
///
/// ```
/// use sk_core::flow::Properties;
/// use sk_flat::SkVariant;
///
/// let properties = Properties::new(&SkVariant::map([("unit", "m/s".into())]))?;
/// assert!(properties.is_map());
/// assert_eq!(properties.variant().get("unit").and_then(SkVariant::as_str), Some("m/s"));
/// # Ok::<(), sk_flat::VariantError>(())
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Properties {
    encoded: Bytes,
}

impl Properties {
    /// Encodes a variant.
    ///
    /// # Errors
    /// If its binary form is longer than 16 KiB, or it is nested too deeply for one.
    pub fn new(variant: &SkVariant) -> Result<Properties, VariantError> {
        let encoded = variant.encode()?;
        if encoded.len() > PROPERTIES_BYTES_MAX {
            return Err(VariantError::Limit { what: "properties in bytes", max: PROPERTIES_BYTES_MAX });
        }
        Ok(Properties { encoded: encoded.into() })
    }

    /// Checks bytes that are said to be a variant, and copies them, so that the buffer they came in is
    /// not kept.
    ///
    /// # Errors
    /// If they are not exactly one variant.
    pub fn from_encoded(encoded: &[u8]) -> Result<Properties, VariantError> {
        SkVariant::decode(encoded)?;
        Ok(Properties { encoded: Bytes::copy_from_slice(encoded) })
    }

    /// The binary form.
    pub fn encoded(&self) -> &Bytes {
        &self.encoded
    }

    /// The variant. The bytes were checked, so this never falls back to `Null`.
    pub fn variant(&self) -> SkVariant {
        SkVariant::decode(&self.encoded).unwrap_or_default()
    }

    /// Whether the variant is a map, as the properties of a channel must be.
    pub fn is_map(&self) -> bool {
        self.variant().as_map().is_some()
    }
}

impl fmt::Debug for Properties {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Properties({})", self.variant())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn properties_have_a_limit_of_bytes() {
        let of = |bytes: usize| Properties::new(&SkVariant::from("x".repeat(bytes)));
        let overhead = of(100).expect("small").encoded().len() - 100;
        let room = PROPERTIES_BYTES_MAX - overhead;
        // The length prefix of a longer text may take more bytes than that of a short one.
        assert!(of(room - 8).is_ok());
        assert!(of(room + 1).is_err());
    }

    #[test]
    fn what_is_no_variant_is_refused() {
        assert!(Properties::from_encoded(&[]).is_err());
        let mut bytes = SkVariant::from(7).encode().expect("a number");
        assert!(Properties::from_encoded(&bytes).is_ok());
        bytes.push(0);
        assert!(Properties::from_encoded(&bytes).is_err(), "one byte too many");
    }
}
