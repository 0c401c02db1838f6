//! A variant as serde data. Human-readable formats get the forms, all others the kinds as they are.

use super::forms;
use crate::error::VariantError;
use crate::variant::limits::Budget;
use crate::variant::{Limits, SkMap, SkVariant, VARIANT_DEPTH_MAX};
use bytes::Bytes;
use serde::de::{DeserializeSeed, MapAccess, SeqAccess, Visitor};
use serde::ser::{Error as _, SerializeMap, SerializeSeq};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt;

/// How much of a number's kind is written to a human-readable format.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::variant) enum Style {
    /// The number alone.
    Plain,
    /// A form, wherever the number alone would be read as another kind.
    Exact,
}

/// A variant to be written, with its depth: a user's tree may be deeper than the stack.
#[derive(Clone, Copy)]
pub(in crate::variant) struct Shown<'a> {
    value: &'a SkVariant,
    style: Style,
    depth: usize,
}

impl<'a> Shown<'a> {
    pub(in crate::variant) fn new(value: &'a SkVariant, style: Style) -> Shown<'a> {
        Shown { value, style, depth: 0 }
    }

    fn inside<E: serde::ser::Error>(self) -> Result<usize, E> {
        if self.depth >= VARIANT_DEPTH_MAX {
            let limit = VariantError::Limit { what: "the nesting depth", max: VARIANT_DEPTH_MAX };
            return Err(E::custom(limit));
        }
        Ok(self.depth + 1)
    }

    fn form<S: Serializer>(self, serializer: S, key: &str, body: &impl Serialize) -> Result<S::Ok, S::Error> {
        self.inside::<S::Error>()?;
        let mut object = serializer.serialize_map(Some(1))?;
        object.serialize_entry(key, body)?;
        object.end()
    }
}

impl Serialize for SkVariant {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Shown::new(self, Style::Plain).serialize(serializer)
    }
}

impl Serialize for Shown<'_> {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        let readable = s.is_human_readable();
        let exact = readable && self.style == Style::Exact;
        match self.value {
            SkVariant::Null => s.serialize_unit(),
            SkVariant::Bool(truth) => s.serialize_bool(*truth),
            SkVariant::I8(n) if exact => self.form(s, forms::I8, n),
            SkVariant::I16(n) if exact => self.form(s, forms::I16, n),
            SkVariant::I32(n) if exact => self.form(s, forms::I32, n),
            SkVariant::U8(n) if exact => self.form(s, forms::U8, n),
            SkVariant::U16(n) if exact => self.form(s, forms::U16, n),
            SkVariant::U32(n) if exact => self.form(s, forms::U32, n),
            // Beyond `i64` the number alone is read as an `u64`.
            SkVariant::U64(n) if exact && i64::try_from(*n).is_ok() => self.form(s, forms::U64, n),
            SkVariant::F32(x) if readable && !x.is_finite() => self.form(s, forms::F32, &forms::f32_text(*x)),
            SkVariant::F64(x) if readable && !x.is_finite() => self.form(s, forms::F64, &forms::f64_text(*x)),
            // All digits of the `f64` that is exactly this `f32`.
            SkVariant::F32(x) if exact => self.form(s, forms::F32, &f64::from(*x)),
            SkVariant::I8(n) => s.serialize_i8(*n),
            SkVariant::I16(n) => s.serialize_i16(*n),
            SkVariant::I32(n) => s.serialize_i32(*n),
            SkVariant::I64(n) => s.serialize_i64(*n),
            SkVariant::U8(n) => s.serialize_u8(*n),
            SkVariant::U16(n) => s.serialize_u16(*n),
            SkVariant::U32(n) => s.serialize_u32(*n),
            SkVariant::U64(n) => s.serialize_u64(*n),
            SkVariant::F32(x) => s.serialize_f32(*x),
            SkVariant::F64(x) => s.serialize_f64(*x),
            SkVariant::String(text) => s.serialize_str(text),
            SkVariant::Bytes(bytes) if readable => self.form(s, forms::BYTES, &forms::base64_text(bytes)),
            SkVariant::Bytes(bytes) => s.serialize_bytes(bytes),
            SkVariant::List(list) => {
                let depth = self.inside::<S::Error>()?;
                let mut seq = s.serialize_seq(Some(list.len()))?;
                for value in list.iter() {
                    seq.serialize_element(&Shown { value, depth, ..*self })?;
                }
                seq.end()
            }
            SkVariant::Map(map) if readable && forms::looks_like_form(map) => {
                let depth = self.inside::<S::Error>()?;
                self.form(s, forms::MAP, &ShownMap { map, style: self.style, depth })
            }
            SkVariant::Map(map) => ShownMap { map, style: self.style, depth: self.depth }.serialize(s),
        }
    }
}

struct ShownMap<'a> {
    map: &'a SkMap,
    style: Style,
    depth: usize,
}

impl Serialize for ShownMap<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.depth >= VARIANT_DEPTH_MAX {
            let limit = VariantError::Limit { what: "the nesting depth", max: VARIANT_DEPTH_MAX };
            return Err(S::Error::custom(limit));
        }
        let mut object = serializer.serialize_map(Some(self.map.len()))?;
        for (key, value) in self.map.iter() {
            object.serialize_entry(key, &Shown { value, style: self.style, depth: self.depth + 1 })?;
        }
        object.end()
    }
}

impl<'de> Deserialize<'de> for SkVariant {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<SkVariant, D::Error> {
        let readable = deserializer.is_human_readable();
        let reading = RawReading::new(Limits::BINARY, readable);
        let raw = Raw::top(&reading).deserialize(deserializer)?;
        if readable && reading.saw_form() { unfold(raw) } else { Ok(raw) }
    }
}

fn unfold<E: serde::de::Error>(raw: SkVariant) -> Result<SkVariant, E> {
    forms::unfold(raw).map_err(E::custom)
}

/// One reading of a variant: what is left of its limits, and what was seen on the way.
pub(in crate::variant) struct RawReading {
    budget: Budget,
    readable: bool,
    saw_form: Cell<bool>,
    refused: RefCell<Option<VariantError>>,
}

impl RawReading {
    pub(in crate::variant) fn new(limits: Limits, readable: bool) -> RawReading {
        RawReading {
            budget: Budget::new(limits),
            readable,
            saw_form: Cell::new(false),
            refused: RefCell::new(None),
        }
    }

    /// Whether some object has one reserved key.
    pub(in crate::variant) fn saw_form(&self) -> bool {
        self.saw_form.get()
    }

    /// The limit that ended the reading, which the format's error holds only as text.
    pub(in crate::variant) fn take_refused(&self) -> Option<VariantError> {
        self.refused.take()
    }

    fn limited<T, E: serde::de::Error>(&self, outcome: Result<T, VariantError>) -> Result<T, E> {
        outcome.map_err(|error| {
            let text = E::custom(&error);
            self.refused.replace(Some(error));
            text
        })
    }
}

/// Reads one value as it stands, forms included.
#[derive(Clone, Copy)]
pub(in crate::variant) struct Raw<'r> {
    reading: &'r RawReading,
    depth: usize,
}

impl<'r> Raw<'r> {
    pub(in crate::variant) fn top(reading: &'r RawReading) -> Raw<'r> {
        Raw { reading, depth: 0 }
    }

    fn inside<E: serde::de::Error>(self) -> Result<Raw<'r>, E> {
        let depth = self.reading.limited(self.reading.budget.enter(self.depth))?;
        Ok(Raw { depth, ..self })
    }
}

impl<'de> DeserializeSeed<'de> for Raw<'_> {
    type Value = SkVariant;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<SkVariant, D::Error> {
        self.reading.limited(self.reading.budget.take_nodes(1))?;
        deserializer.deserialize_any(self)
    }
}

macro_rules! visit_scalars {
    ($($method:ident($t:ty) => $kind:ident)*) => { $(
        fn $method<E: serde::de::Error>(self, scalar: $t) -> Result<SkVariant, E> {
            Ok(SkVariant::$kind(scalar))
        }
    )* };
}

impl<'de> Visitor<'de> for Raw<'_> {
    type Value = SkVariant;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value that a variant can hold")
    }

    visit_scalars! {
        visit_bool(bool) => Bool
        visit_i8(i8) => I8
        visit_i16(i16) => I16
        visit_i32(i32) => I32
        visit_i64(i64) => I64
        visit_u8(u8) => U8
        visit_u16(u16) => U16
        visit_u32(u32) => U32
        visit_f32(f32) => F32
        visit_f64(f64) => F64
    }

    fn visit_u64<E: serde::de::Error>(self, n: u64) -> Result<SkVariant, E> {
        // A text has no kinds, and its parser calls every number without a sign unsigned.
        match i64::try_from(n) {
            Ok(signed) if self.reading.readable => Ok(SkVariant::I64(signed)),
            _ => Ok(SkVariant::U64(n)),
        }
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<SkVariant, E> {
        Ok(SkVariant::from(text))
    }

    fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<SkVariant, E> {
        Ok(SkVariant::from(bytes))
    }

    fn visit_byte_buf<E: serde::de::Error>(self, bytes: Vec<u8>) -> Result<SkVariant, E> {
        Ok(SkVariant::from(Bytes::from(bytes)))
    }

    fn visit_unit<E: serde::de::Error>(self) -> Result<SkVariant, E> {
        Ok(SkVariant::Null)
    }

    fn visit_none<E: serde::de::Error>(self) -> Result<SkVariant, E> {
        Ok(SkVariant::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<SkVariant, D::Error> {
        deserializer.deserialize_any(self.inside()?)
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, deserializer: D) -> Result<SkVariant, D::Error> {
        deserializer.deserialize_any(self.inside()?)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<SkVariant, A::Error> {
        let inside = self.inside()?;
        // The size hint may be a peer's number: the list grows with what is really there.
        let mut items = Vec::new();
        while let Some(item) = seq.next_element_seed(inside)? {
            items.push(item);
        }
        Ok(SkVariant::List(items.into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<SkVariant, A::Error> {
        let inside = self.inside()?;
        let mut entries = BTreeMap::new();
        while let Some(key) = map.next_key::<String>()? {
            match entries.entry(key) {
                Entry::Vacant(place) => place.insert(map.next_value_seed(inside)?),
                Entry::Occupied(place) => {
                    let key = place.key();
                    return Err(serde::de::Error::custom(format!("the key {key:?} stands twice")));
                }
            };
        }
        let entries = SkMap::from(entries);
        if forms::looks_like_form(&entries) {
            self.reading.saw_form.set(true);
        }
        Ok(SkVariant::Map(entries))
    }
}
