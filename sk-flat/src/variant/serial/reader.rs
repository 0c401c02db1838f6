//! From a variant to any `Deserialize` type.

use crate::error::VariantError;
use crate::variant::{FromVariant, SkVariant, VARIANT_DEPTH_MAX};
use serde::de::value::{SeqDeserializer, StrDeserializer};
use serde::de::{Deserialize, DeserializeSeed, Deserializer, EnumAccess, MapAccess, SeqAccess};
use serde::de::{Error as _, Unexpected, VariantAccess, Visitor};
use serde::forward_to_deserialize_any;
use std::collections::btree_map;

/// Any serde type out of a variant; the way back of [`to_variant`](super::to_variant). Texts and
/// bytes may be borrowed from the variant. Numbers follow the same strict rules as
/// [`FromVariant`]; `Bytes` are read as bytes or as a sequence.
///
/// # Errors
/// The variant is not what the type expects; the error names the place.
///
/// ```
/// use sk_flat::{SkVariant, variant::from_variant_serde};
///
/// #[derive(serde::Deserialize)]
/// struct Pose { x: f64, y: f64 }
///
/// let pose: Pose = from_variant_serde(&SkVariant::from_json(r#"{"x": 1, "y": 2.5}"#)?)?;
/// assert_eq!((pose.x, pose.y), (1.0, 2.5));
/// # Ok::<(), sk_flat::VariantError>(())
/// ```
pub fn from_variant_serde<'de, T: Deserialize<'de>>(value: &'de SkVariant) -> Result<T, VariantError> {
    T::deserialize(Reader { value, depth: 0 })
}

#[derive(Clone, Copy)]
struct Reader<'de> {
    value: &'de SkVariant,
    depth: usize,
}

impl<'de> Reader<'de> {
    fn inside(self) -> Result<usize, VariantError> {
        if self.depth >= VARIANT_DEPTH_MAX {
            return Err(VariantError::Limit { what: "the nesting depth", max: VARIANT_DEPTH_MAX });
        }
        Ok(self.depth + 1)
    }

    fn list<V: Visitor<'de>>(self, list: &'de [SkVariant], visitor: V) -> Result<V::Value, VariantError> {
        let mut items = Items { items: list, next: 0, depth: self.inside()? };
        let value = visitor.visit_seq(&mut items)?;
        if items.next != list.len() {
            return Err(VariantError::Length { expected: items.next, found: list.len() });
        }
        Ok(value)
    }

    fn unexpected(self) -> Unexpected<'de> {
        match self.value {
            SkVariant::Null => Unexpected::Unit,
            SkVariant::Bool(truth) => Unexpected::Bool(*truth),
            SkVariant::String(text) => Unexpected::Str(text),
            SkVariant::Bytes(bytes) => Unexpected::Bytes(bytes),
            SkVariant::List(_) => Unexpected::Seq,
            SkVariant::Map(_) => Unexpected::Map,
            number => Unexpected::Other(number.kind().name()),
        }
    }
}

impl<'de> Deserializer<'de> for Reader<'de> {
    type Error = VariantError;

    fn is_human_readable(&self) -> bool {
        false
    }

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        match self.value {
            SkVariant::Null => visitor.visit_unit(),
            SkVariant::Bool(truth) => visitor.visit_bool(*truth),
            SkVariant::I8(n) => visitor.visit_i8(*n),
            SkVariant::I16(n) => visitor.visit_i16(*n),
            SkVariant::I32(n) => visitor.visit_i32(*n),
            SkVariant::I64(n) => visitor.visit_i64(*n),
            SkVariant::U8(n) => visitor.visit_u8(*n),
            SkVariant::U16(n) => visitor.visit_u16(*n),
            SkVariant::U32(n) => visitor.visit_u32(*n),
            SkVariant::U64(n) => visitor.visit_u64(*n),
            SkVariant::F32(x) => visitor.visit_f32(*x),
            SkVariant::F64(x) => visitor.visit_f64(*x),
            SkVariant::String(text) => visitor.visit_borrowed_str(text),
            SkVariant::Bytes(bytes) => visitor.visit_borrowed_bytes(bytes),
            SkVariant::List(list) => self.list(list, visitor),
            SkVariant::Map(map) => {
                visitor.visit_map(Entries { rest: map.iter(), value: None, depth: self.inside()? })
            }
        }
    }

    // serde's own visitors would round an integer that a float cannot hold.
    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        visitor.visit_f32(f32::from_variant(self.value)?)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        visitor.visit_f64(f64::from_variant(self.value)?)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        if self.value.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, VariantError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        match self.value {
            SkVariant::Bytes(bytes) => {
                let mut items = SeqDeserializer::<_, VariantError>::new(bytes.iter().copied());
                let value = visitor.visit_seq(&mut items)?;
                items.end()?;
                Ok(value)
            }
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, _len: usize, visitor: V) -> Result<V::Value, VariantError> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _cases: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, VariantError> {
        match self.value {
            SkVariant::String(case) => visitor.visit_enum(Case { name: case, body: None }),
            SkVariant::Map(map) => match map.first_key_value() {
                Some((case, value)) if map.len() == 1 => {
                    let body = Some(Reader { value, depth: self.inside()? });
                    visitor
                        .visit_enum(Case { name: case, body })
                        .map_err(|error| error.in_field(case))
                }
                _ => Err(VariantError::custom("an enum's case is a text or a map of one entry")),
            },
            _ => Err(VariantError::invalid_type(self.unexpected(), &"an enum's case")),
        }
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        visitor.visit_unit()
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 char str string bytes byte_buf unit unit_struct
        tuple_struct map struct identifier
    }
}

struct Items<'de> {
    items: &'de [SkVariant],
    next: usize,
    depth: usize,
}

impl<'de> SeqAccess<'de> for &mut Items<'de> {
    type Error = VariantError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, VariantError> {
        let index = self.next;
        let Some(value) = self.items.get(index) else { return Ok(None) };
        self.next += 1;
        let read = seed.deserialize(Reader { value, depth: self.depth });
        read.map(Some).map_err(|error| error.in_item(index))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len() - self.next)
    }
}

struct Entries<'de> {
    rest: btree_map::Iter<'de, String, SkVariant>,
    value: Option<(&'de String, &'de SkVariant)>,
    depth: usize,
}

impl<'de> MapAccess<'de> for Entries<'de> {
    type Error = VariantError;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, VariantError> {
        self.value = self.rest.next();
        let Some((key, _)) = self.value else { return Ok(None) };
        seed.deserialize(KeyReader(key)).map(Some)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, VariantError> {
        let Some((key, value)) = self.value.take() else {
            return Err(VariantError::custom("a value was asked for before its key"));
        };
        seed.deserialize(Reader { value, depth: self.depth })
            .map_err(|error| error.in_field(key))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.rest.len())
    }
}

/// A key: a text, or the number or truth that was written as one.
struct KeyReader<'de>(&'de str);

macro_rules! parsed_keys {
    ($($method:ident => $visit:ident)*) => { $(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
            match self.0.parse() {
                Ok(key) => visitor.$visit(key),
                Err(_) => visitor.visit_borrowed_str(self.0),
            }
        }
    )* };
}

impl<'de> Deserializer<'de> for KeyReader<'de> {
    type Error = VariantError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, VariantError> {
        visitor.visit_borrowed_str(self.0)
    }

    fn is_human_readable(&self) -> bool {
        false
    }

    parsed_keys! {
        deserialize_bool => visit_bool
        deserialize_i8 => visit_i8
        deserialize_i16 => visit_i16
        deserialize_i32 => visit_i32
        deserialize_i64 => visit_i64
        deserialize_i128 => visit_i128
        deserialize_u8 => visit_u8
        deserialize_u16 => visit_u16
        deserialize_u32 => visit_u32
        deserialize_u64 => visit_u64
        deserialize_u128 => visit_u128
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, VariantError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _cases: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, VariantError> {
        visitor.visit_enum(Case { name: self.0, body: None })
    }

    forward_to_deserialize_any! {
        f32 f64 char str string bytes byte_buf option unit unit_struct seq tuple tuple_struct map
        struct identifier ignored_any
    }
}

struct Case<'de> {
    name: &'de str,
    body: Option<Reader<'de>>,
}

impl<'de> EnumAccess<'de> for Case<'de> {
    type Error = VariantError;
    type Variant = Body<'de>;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, Body<'de>), VariantError> {
        let name = seed.deserialize(StrDeserializer::<VariantError>::new(self.name))?;
        Ok((name, Body(self.body)))
    }
}

struct Body<'de>(Option<Reader<'de>>);

impl<'de> Body<'de> {
    fn wanted(self) -> Result<Reader<'de>, VariantError> {
        self.0
            .ok_or(VariantError::Custom("this case of the enum carries data, and none came".into()))
    }
}

impl<'de> VariantAccess<'de> for Body<'de> {
    type Error = VariantError;

    fn unit_variant(self) -> Result<(), VariantError> {
        match self.0 {
            None => Ok(()),
            Some(body) => <()>::deserialize(body),
        }
    }

    fn newtype_variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, VariantError> {
        seed.deserialize(self.wanted()?)
    }

    fn tuple_variant<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, VariantError> {
        self.wanted()?.deserialize_tuple(len, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, VariantError> {
        self.wanted()?.deserialize_any(visitor)
    }
}
