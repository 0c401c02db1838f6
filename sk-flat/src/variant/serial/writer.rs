//! From any `Serialize` type to a variant.

use super::keys::KeyWriter;
use crate::error::VariantError;
use crate::variant::{IntoVariant, SkVariant, VARIANT_DEPTH_MAX};
use serde::Serialize;
use serde::ser::{Error as _, Serializer};
use serde::ser::{SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant};
use serde::ser::{SerializeTuple, SerializeTupleStruct, SerializeTupleVariant};
use std::collections::BTreeMap;

/// Any serde type as a variant, without a detour over text: structs become maps, enums a text (no
/// data) or a map of one entry, `None` and `()` become `Null`. Number kinds are kept.
///
/// # Errors
/// What the type itself reports, a map whose keys are no texts, numbers or truths, or more than 64
/// containers inside each other.
///
/// ```
/// use sk_flat::variant::to_variant;
///
/// #[derive(serde::Serialize)]
/// struct Pose { x: f64, y: f64 }
///
/// assert_eq!(to_variant(&Pose { x: 1.0, y: 2.0 })?.to_string(), r#"{"x":1.0,"y":2.0}"#);
/// # Ok::<(), sk_flat::VariantError>(())
/// ```
pub fn to_variant<T: Serialize + ?Sized>(value: &T) -> Result<SkVariant, VariantError> {
    value.serialize(Writer { depth: 0 })
}

#[derive(Clone, Copy)]
struct Writer {
    depth: usize,
}

impl Writer {
    fn inside(self) -> Result<Writer, VariantError> {
        if self.depth >= VARIANT_DEPTH_MAX {
            return Err(VariantError::Limit { what: "the nesting depth", max: VARIANT_DEPTH_MAX });
        }
        Ok(Writer { depth: self.depth + 1 })
    }

    fn items(self, case: Option<&'static str>) -> Result<Items, VariantError> {
        let depth = if case.is_some() { self.inside()? } else { self };
        Ok(Items { inside: depth.inside()?, items: Vec::new(), case })
    }

    fn entries(self, case: Option<&'static str>) -> Result<Entries, VariantError> {
        let depth = if case.is_some() { self.inside()? } else { self };
        Ok(Entries { inside: depth.inside()?, entries: BTreeMap::new(), key: None, case })
    }
}

macro_rules! scalars {
    ($($method:ident($t:ty))*) => { $(
        fn $method(self, scalar: $t) -> Result<SkVariant, VariantError> {
            Ok(scalar.into_variant())
        }
    )* };
}

fn in_case(case: Option<&'static str>, value: SkVariant) -> SkVariant {
    match case {
        Some(case) => SkVariant::map([(case, value)]),
        None => value,
    }
}

fn wide<T>(n: T) -> Result<SkVariant, VariantError>
where
    T: ToString + Copy + TryInto<i64> + TryInto<u64>,
{
    let signed = TryInto::<i64>::try_into(n).map(SkVariant::I64);
    signed
        .or_else(|_| TryInto::<u64>::try_into(n).map(SkVariant::U64))
        .map_err(|_| VariantError::OutOfRange {
            expected: "an integer of 64 bits",
            value: n.to_string().into(),
        })
}

impl Serializer for Writer {
    type Ok = SkVariant;
    type Error = VariantError;
    type SerializeSeq = Items;
    type SerializeTuple = Items;
    type SerializeTupleStruct = Items;
    type SerializeTupleVariant = Items;
    type SerializeMap = Entries;
    type SerializeStruct = Entries;
    type SerializeStructVariant = Entries;

    scalars! {
        serialize_bool(bool)
        serialize_i8(i8)
        serialize_i16(i16)
        serialize_i32(i32)
        serialize_i64(i64)
        serialize_u8(u8)
        serialize_u16(u16)
        serialize_u32(u32)
        serialize_u64(u64)
        serialize_f32(f32)
        serialize_f64(f64)
        serialize_char(char)
        serialize_str(&str)
        serialize_bytes(&[u8])
    }

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_i128(self, n: i128) -> Result<SkVariant, VariantError> {
        wide(n)
    }

    fn serialize_u128(self, n: u128) -> Result<SkVariant, VariantError> {
        wide(n)
    }

    fn serialize_none(self) -> Result<SkVariant, VariantError> {
        Ok(SkVariant::Null)
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<SkVariant, VariantError> {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<SkVariant, VariantError> {
        Ok(SkVariant::Null)
    }

    fn serialize_unit_struct(self, _name: &'static str) -> Result<SkVariant, VariantError> {
        Ok(SkVariant::Null)
    }

    fn serialize_unit_variant(
        self,
        _name: &'static str,
        _index: u32,
        case: &'static str,
    ) -> Result<SkVariant, VariantError> {
        Ok(SkVariant::from(case))
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        value: &T,
    ) -> Result<SkVariant, VariantError> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        _index: u32,
        case: &'static str,
        value: &T,
    ) -> Result<SkVariant, VariantError> {
        let value = value.serialize(self.inside()?).map_err(|error| error.in_field(case))?;
        Ok(in_case(Some(case), value))
    }

    fn serialize_seq(self, _len: Option<usize>) -> Result<Items, VariantError> {
        self.items(None)
    }

    fn serialize_tuple(self, _len: usize) -> Result<Items, VariantError> {
        self.items(None)
    }

    fn serialize_tuple_struct(self, _name: &'static str, _len: usize) -> Result<Items, VariantError> {
        self.items(None)
    }

    fn serialize_tuple_variant(
        self,
        _name: &'static str,
        _index: u32,
        case: &'static str,
        _len: usize,
    ) -> Result<Items, VariantError> {
        self.items(Some(case))
    }

    fn serialize_map(self, _len: Option<usize>) -> Result<Entries, VariantError> {
        self.entries(None)
    }

    fn serialize_struct(self, _name: &'static str, _len: usize) -> Result<Entries, VariantError> {
        self.entries(None)
    }

    fn serialize_struct_variant(
        self,
        _name: &'static str,
        _index: u32,
        case: &'static str,
        _len: usize,
    ) -> Result<Entries, VariantError> {
        self.entries(Some(case))
    }
}

struct Items {
    inside: Writer,
    items: Vec<SkVariant>,
    case: Option<&'static str>,
}

impl Items {
    fn push<T: Serialize + ?Sized>(&mut self, item: &T) -> Result<(), VariantError> {
        let written = item.serialize(self.inside).map_err(|error| error.in_item(self.items.len()))?;
        self.items.push(written);
        Ok(())
    }

    fn finish(self) -> Result<SkVariant, VariantError> {
        Ok(in_case(self.case, SkVariant::List(self.items.into())))
    }
}

struct Entries {
    inside: Writer,
    entries: BTreeMap<String, SkVariant>,
    key: Option<String>,
    case: Option<&'static str>,
}

impl Entries {
    fn put<T: Serialize + ?Sized>(&mut self, key: String, value: &T) -> Result<(), VariantError> {
        let written = value.serialize(self.inside).map_err(|error| error.in_field(&key))?;
        if self.entries.contains_key(&key) {
            return Err(VariantError::custom(format!("the key {key:?} stands twice")));
        }
        self.entries.insert(key, written);
        Ok(())
    }

    fn finish(self) -> Result<SkVariant, VariantError> {
        Ok(in_case(self.case, SkVariant::Map(self.entries.into())))
    }
}

macro_rules! compound {
    ($($trait:ident::$method:ident for $t:ty)*) => { $(
        impl $trait for $t {
            type Ok = SkVariant;
            type Error = VariantError;
            fn $method<T: Serialize + ?Sized>(&mut self, item: &T) -> Result<(), VariantError> {
                self.push(item)
            }
            fn end(self) -> Result<SkVariant, VariantError> {
                self.finish()
            }
        }
    )* };
    (fields: $($trait:ident for $t:ty)*) => { $(
        impl $trait for $t {
            type Ok = SkVariant;
            type Error = VariantError;
            fn serialize_field<T: Serialize + ?Sized>(
                &mut self,
                key: &'static str,
                value: &T,
            ) -> Result<(), VariantError> {
                self.put(key.to_owned(), value)
            }
            fn end(self) -> Result<SkVariant, VariantError> {
                self.finish()
            }
        }
    )* };
}

compound! {
    SerializeSeq::serialize_element for Items
    SerializeTuple::serialize_element for Items
    SerializeTupleStruct::serialize_field for Items
    SerializeTupleVariant::serialize_field for Items
}

compound! { fields: SerializeStruct for Entries SerializeStructVariant for Entries }

impl SerializeMap for Entries {
    type Ok = SkVariant;
    type Error = VariantError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), VariantError> {
        self.key = Some(key.serialize(KeyWriter)?);
        Ok(())
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), VariantError> {
        match self.key.take() {
            Some(key) => self.put(key, value),
            None => Err(VariantError::custom("a map gave a value before its key")),
        }
    }

    fn end(self) -> Result<SkVariant, VariantError> {
        self.finish()
    }
}
