//! Keys of maps written through serde: a text, or what has one obvious text.

use crate::error::VariantError;
use serde::Serialize;
use serde::ser::{Impossible, Serializer};

/// Writes a key as text: texts as they are, integers in decimal, truths as `true` and `false`, and
/// the cases of an enum by name.
pub(super) struct KeyWriter;

type No = Impossible<String, VariantError>;

fn refuse<T>() -> Result<T, VariantError> {
    Err(VariantError::Custom("the key of a map must be a text, an integer or a truth".into()))
}

macro_rules! texts {
    ($($method:ident($t:ty))*) => { $(
        fn $method(self, key: $t) -> Result<String, VariantError> {
            Ok(key.to_string())
        }
    )* };
}

impl Serializer for KeyWriter {
    type Ok = String;
    type Error = VariantError;
    type SerializeSeq = No;
    type SerializeTuple = No;
    type SerializeTupleStruct = No;
    type SerializeTupleVariant = No;
    type SerializeMap = No;
    type SerializeStruct = No;
    type SerializeStructVariant = No;

    texts! {
        serialize_bool(bool)
        serialize_i8(i8)
        serialize_i16(i16)
        serialize_i32(i32)
        serialize_i64(i64)
        serialize_i128(i128)
        serialize_u8(u8)
        serialize_u16(u16)
        serialize_u32(u32)
        serialize_u64(u64)
        serialize_u128(u128)
        serialize_char(char)
        serialize_str(&str)
    }

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_unit_variant(
        self,
        _name: &'static str,
        _index: u32,
        case: &'static str,
    ) -> Result<String, VariantError> {
        Ok(case.to_owned())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        key: &T,
    ) -> Result<String, VariantError> {
        key.serialize(self)
    }

    // An integer has one text; a float has several, and an absent key has none.
    fn serialize_f32(self, _key: f32) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_f64(self, _key: f64) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_bytes(self, _key: &[u8]) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_none(self) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_some<T: Serialize + ?Sized>(self, _key: &T) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_unit(self) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_unit_struct(self, _name: &'static str) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        _index: u32,
        _case: &'static str,
        _value: &T,
    ) -> Result<String, VariantError> {
        refuse()
    }

    fn serialize_seq(self, _len: Option<usize>) -> Result<No, VariantError> {
        refuse()
    }

    fn serialize_tuple(self, _len: usize) -> Result<No, VariantError> {
        refuse()
    }

    fn serialize_tuple_struct(self, _name: &'static str, _len: usize) -> Result<No, VariantError> {
        refuse()
    }

    fn serialize_tuple_variant(
        self,
        _name: &'static str,
        _index: u32,
        _case: &'static str,
        _len: usize,
    ) -> Result<No, VariantError> {
        refuse()
    }

    fn serialize_map(self, _len: Option<usize>) -> Result<No, VariantError> {
        refuse()
    }

    fn serialize_struct(self, _name: &'static str, _len: usize) -> Result<No, VariantError> {
        refuse()
    }

    fn serialize_struct_variant(
        self,
        _name: &'static str,
        _index: u32,
        _case: &'static str,
        _len: usize,
    ) -> Result<No, VariantError> {
        refuse()
    }
}
