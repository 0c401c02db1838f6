//! A variant on the wire: kept as it came, in the binary form or as JSON.

use super::super::limits::{PROPERTIES_BYTES_MAX, PROPERTIES_JSON_BYTES_MAX, VALUE_BYTES_MAX};
use bytes::Bytes;
use sk_flat::{SkVariant, VariantError};
use std::fmt;

/// How a variant is written on the wire. Every command that carries one has both forms, with the same
/// effect; a satellite without variants lives on JSON alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Form {
    /// The binary form of a variant.
    #[default]
    Binary = 0,
    /// JSON text in UTF-8.
    Json = 1,
}

impl Form {
    /// The form of a number on the wire.
    pub const fn from_wire(number: u8) -> Option<Form> {
        match number {
            0 => Some(Form::Binary),
            1 => Some(Form::Json),
            _ => None,
        }
    }
}

/// A variant in its binary form, checked when it was made, and the form in which it travels. A hub hands it
/// on as often as it likes without encoding it again; a clone shares the bytes.
///
/// The first limit holds for the binary form, the second for JSON on the wire, both in bytes.
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
pub struct ValueOf<const BYTES_MAX: usize, const JSON_BYTES_MAX: usize> {
    encoded: Bytes,
    form: Form,
}

/// What the owner of a channel says about it: a map of at most 16 KiB.
pub type Properties = ValueOf<PROPERTIES_BYTES_MAX, PROPERTIES_JSON_BYTES_MAX>;

/// A variable of a database: at most 1 MiB in either form.
pub type Value = ValueOf<VALUE_BYTES_MAX, VALUE_BYTES_MAX>;

impl<const BYTES_MAX: usize, const JSON_BYTES_MAX: usize> ValueOf<BYTES_MAX, JSON_BYTES_MAX> {
    /// Encodes a variant. It travels in the binary form.
    ///
    /// # Errors
    /// If its binary form is longer than allowed, or it is nested too deeply for one.
    pub fn new(variant: &SkVariant) -> Result<Self, VariantError> {
        Self::of_encoded(variant.encode()?.into())
    }

    /// Checks bytes that are said to be a variant, and copies them, so that the buffer they came in is
    /// not kept.
    ///
    /// # Errors
    /// If they are not exactly one variant, or too long.
    pub fn from_encoded(encoded: &[u8]) -> Result<Self, VariantError> {
        SkVariant::decode(encoded)?;
        Self::of_encoded(Bytes::copy_from_slice(encoded))
    }

    /// Reads JSON text. It travels as JSON.
    ///
    /// # Errors
    /// If it is not exactly one JSON value, or too long in either form.
    pub fn from_json(text: &str) -> Result<Self, VariantError> {
        if text.len() > JSON_BYTES_MAX {
            return Err(VariantError::Limit { what: "JSON in bytes", max: JSON_BYTES_MAX });
        }
        Ok(Self::new(&SkVariant::from_json(text)?)?.in_form(Form::Json))
    }

    fn of_encoded(encoded: Bytes) -> Result<Self, VariantError> {
        if encoded.len() > BYTES_MAX {
            return Err(VariantError::Limit { what: "a value in bytes", max: BYTES_MAX });
        }
        Ok(ValueOf { encoded, form: Form::Binary })
    }

    /// The same value, to travel in this form.
    pub fn in_form(mut self, form: Form) -> Self {
        self.form = form;
        self
    }

    /// The form in which it travels.
    pub fn form(&self) -> Form {
        self.form
    }

    /// The binary form.
    pub fn encoded(&self) -> &Bytes {
        &self.encoded
    }

    /// The variant. The bytes were checked, so this never falls back to `Null`.
    pub fn variant(&self) -> SkVariant {
        SkVariant::decode(&self.encoded).unwrap_or_default()
    }

    /// The bytes on the wire, in the value's form.
    ///
    /// # Errors
    /// If its JSON is longer than allowed: that is seldom, and only for a value near the limit.
    pub fn wire_bytes(&self) -> Result<Bytes, VariantError> {
        match self.form {
            Form::Binary => Ok(self.encoded.clone()),
            Form::Json => {
                let json = self.variant().to_json()?;
                if json.len() > JSON_BYTES_MAX {
                    return Err(VariantError::Limit { what: "JSON in bytes", max: JSON_BYTES_MAX });
                }
                Ok(json.into())
            }
        }
    }

    /// Whether the variant is a map, as the properties of a channel must be.
    pub fn is_map(&self) -> bool {
        self.variant().as_map().is_some()
    }
}

impl Properties {
    /// Whether the owner asks the hub to keep the last message for late joiners: `latch` is `true`.
    pub fn is_latched(&self) -> bool {
        self.variant().get("latch") == Some(&SkVariant::Bool(true))
    }

    /// Whether the owner waits for its slowest subscriber: `delivery` is `reliable`.
    pub fn is_reliable(&self) -> bool {
        self.variant().get("delivery").and_then(SkVariant::as_str) == Some("reliable")
    }
}

impl<const BYTES_MAX: usize, const JSON_BYTES_MAX: usize> fmt::Debug for ValueOf<BYTES_MAX, JSON_BYTES_MAX> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}({})", self.form, self.variant())
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
    fn bytes_that_are_not_one_variant_are_refused() {
        let good = SkVariant::from(1.5).encode().expect("small");
        assert!(Properties::from_encoded(&good).is_ok());
        assert!(Properties::from_encoded(&good[..good.len() - 1]).is_err());
        assert!(Properties::from_encoded(&[good, vec![0]].concat()).is_err());
    }

    #[test]
    fn json_has_the_effect_of_the_variant() {
        let json = Value::from_json(r#"{"p":1.5,"on":true}"#).expect("JSON");
        let binary = Value::new(&SkVariant::map([("p", 1.5.into()), ("on", true.into())])).expect("small");
        assert_eq!(json.variant(), binary.variant());
        assert_eq!(json.encoded(), binary.encoded());
        assert_eq!(json.wire_bytes().expect("short"), r#"{"on":true,"p":1.5}"#);
        assert!(Value::from_json("{\"p\":").is_err());
    }

    #[test]
    fn properties_of_the_longest_kind_have_room_as_json() {
        // Control characters take six bytes of JSON each, which is the worst there is.
        let worst =
            Properties::new(&SkVariant::from("\u{1}".repeat(PROPERTIES_BYTES_MAX - 16))).expect("fits");
        assert!(worst.in_form(Form::Json).wire_bytes().is_ok());
    }
}
