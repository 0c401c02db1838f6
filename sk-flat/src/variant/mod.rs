//! [`SkVariant`]: one value of any plain kind.

pub mod binary;
mod compare;
mod containers;
mod convert;
pub(crate) mod kind;
mod limits;
mod serial;
mod show;
pub mod text;
mod tree;

pub use convert::{FromVariant, IntoVariant};
pub use kind::Kind;
pub use limits::{Limits, TEXT_BYTES_MAX, VARIANT_BYTES_MAX, VARIANT_DEPTH_MAX, VARIANT_NODES_MAX};
pub use serial::{from_variant_serde, to_variant};
pub use tree::{SkList, SkMap};

use bytes::Bytes;
use std::collections::BTreeMap;
use std::sync::Arc;

/// One value: nothing, a truth, a number, a text, bytes, a list or a map of values.
///
/// It takes 24 bytes, and a clone never copies a payload: texts, bytes, lists and maps are shared,
/// and a shared list or map copies its top level when it is first changed.
///
/// **Equality** (`==`) asks whether a receiver could tell the two apart: same kind and same value,
/// floats by their bits. So `I32(1)` differs from `I64(1)`, `0.0` from `-0.0`, and a NaN equals
/// itself. [`same_value`](SkVariant::same_value) compares numbers across kinds.
///
/// Pointers and live objects of the papers have no kind here: an address means nothing to another
/// process, so an object is named by its path and a payload travels as `Bytes`.
///
/// ```
/// use sk_flat::SkVariant;
///
/// let reading = SkVariant::map([("volt", 12.4.into()), ("cells", vec![4.1, 4.2, 4.1].into())]);
/// assert_eq!(reading.get("volt").and_then(SkVariant::as_f64), Some(12.4));
/// assert_eq!(reading.to_string(), r#"{"cells":[4.1,4.2,4.1],"volt":12.4}"#);
/// ```
#[derive(Clone, Default)]
pub enum SkVariant {
    /// Nothing.
    #[default]
    Null,
    /// A truth.
    Bool(bool),
    /// A signed integer of 8 bits.
    I8(i8),
    /// A signed integer of 16 bits.
    I16(i16),
    /// A signed integer of 32 bits.
    I32(i32),
    /// A signed integer of 64 bits.
    I64(i64),
    /// An unsigned integer of 8 bits.
    U8(u8),
    /// An unsigned integer of 16 bits.
    U16(u16),
    /// An unsigned integer of 32 bits.
    U32(u32),
    /// An unsigned integer of 64 bits.
    U64(u64),
    /// A float of 32 bits.
    F32(f32),
    /// A float of 64 bits.
    F64(f64),
    /// A text.
    String(Arc<str>),
    /// Bytes. The `Arc` keeps every variant small: a `Bytes` alone takes 32 bytes.
    Bytes(Arc<Bytes>),
    /// Values in order.
    List(SkList),
    /// Values by key, ordered by key.
    Map(SkMap),
}

// Queues and tables hold variants by the thousand, on any thread.
const fn is_shared_by_threads<T: Send + Sync>() {}
const _: () = is_shared_by_threads::<SkVariant>();
const _: () = assert!(size_of::<SkVariant>() <= 24 || size_of::<usize>() != 8);

impl SkVariant {
    /// A list of what the iterator gives.
    pub fn list<T: IntoVariant>(items: impl IntoIterator<Item = T>) -> SkVariant {
        SkVariant::List(items.into_iter().map(IntoVariant::into_variant).collect())
    }

    /// A map of what the iterator gives; of a repeated key the last value stays.
    pub fn map<K: Into<String>>(entries: impl IntoIterator<Item = (K, SkVariant)>) -> SkVariant {
        SkVariant::Map(entries.into_iter().map(|(key, value)| (key.into(), value)).collect())
    }

    /// What kind of value this is.
    pub const fn kind(&self) -> Kind {
        match self {
            SkVariant::Null => Kind::Null,
            SkVariant::Bool(_) => Kind::Bool,
            SkVariant::I8(_) => Kind::I8,
            SkVariant::I16(_) => Kind::I16,
            SkVariant::I32(_) => Kind::I32,
            SkVariant::I64(_) => Kind::I64,
            SkVariant::U8(_) => Kind::U8,
            SkVariant::U16(_) => Kind::U16,
            SkVariant::U32(_) => Kind::U32,
            SkVariant::U64(_) => Kind::U64,
            SkVariant::F32(_) => Kind::F32,
            SkVariant::F64(_) => Kind::F64,
            SkVariant::String(_) => Kind::String,
            SkVariant::Bytes(_) => Kind::Bytes,
            SkVariant::List(_) => Kind::List,
            SkVariant::Map(_) => Kind::Map,
        }
    }

    /// Whether this is `Null`.
    pub const fn is_null(&self) -> bool {
        matches!(self, SkVariant::Null)
    }

    /// The truth, if this is one.
    pub const fn as_bool(&self) -> Option<bool> {
        match self {
            SkVariant::Bool(truth) => Some(*truth),
            _ => None,
        }
    }

    /// The integer, of whatever kind, if it fits an `i64`.
    pub fn as_i64(&self) -> Option<i64> {
        i64::from_variant(self).ok()
    }

    /// The integer, of whatever kind, if it fits a `u64`.
    pub fn as_u64(&self) -> Option<u64> {
        u64::from_variant(self).ok()
    }

    /// The number as a float: a float, or an integer that an `f64` holds exactly.
    pub fn as_f64(&self) -> Option<f64> {
        f64::from_variant(self).ok()
    }

    /// The text, if this is one.
    pub fn as_str(&self) -> Option<&str> {
        match self {
            SkVariant::String(text) => Some(text),
            _ => None,
        }
    }

    /// The bytes, if this is some. Clone them to share the payload.
    pub fn as_bytes(&self) -> Option<&Bytes> {
        match self {
            SkVariant::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    /// The items, if this is a list.
    pub fn as_list(&self) -> Option<&[SkVariant]> {
        match self {
            SkVariant::List(list) => Some(list),
            _ => None,
        }
    }

    /// The items to change, if this is a list.
    pub fn as_list_mut(&mut self) -> Option<&mut Vec<SkVariant>> {
        match self {
            SkVariant::List(list) => Some(list),
            _ => None,
        }
    }

    /// The entries, if this is a map.
    pub fn as_map(&self) -> Option<&BTreeMap<String, SkVariant>> {
        match self {
            SkVariant::Map(map) => Some(map),
            _ => None,
        }
    }

    /// The entries to change, if this is a map.
    pub fn as_map_mut(&mut self) -> Option<&mut BTreeMap<String, SkVariant>> {
        match self {
            SkVariant::Map(map) => Some(map),
            _ => None,
        }
    }

    /// The value of a key, if this is a map that has it.
    pub fn get(&self, key: &str) -> Option<&SkVariant> {
        self.as_map()?.get(key)
    }

    /// The item at a place, if this is a list that long.
    pub fn at(&self, index: usize) -> Option<&SkVariant> {
        self.as_list()?.get(index)
    }
}
