//! Between variants and single Rust values.
//!
//! Rules of reading: an integer becomes any integer type it fits, and a float type that holds it
//! exactly; a float never becomes an integer; an `f64` becomes the nearest `f32`, unless that would
//! be infinite; everything else must be of the same kind.

use super::SkVariant;
use crate::error::VariantError;
use crate::{Instant, Name};
use bytes::{Bytes, BytesMut};
use std::borrow::Cow;
use std::sync::Arc;
use std::time::Duration;

/// A Rust value that can become a variant. `derive(SkVariant)` implements it for your types.
///
/// ```
/// use sk_flat::{IntoVariant, SkVariant};
///
/// assert_eq!((1u8, "two").into_variant().to_string(), r#"[1,"two"]"#);
/// assert_eq!(vec![1u8, 2].into_variant().kind(), sk_flat::Kind::Bytes);
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot become a variant",
    label = "no `IntoVariant` for this type",
    note = "a struct or enum of your own gets it by `#[derive(SkVariant)]`"
)]
pub trait IntoVariant {
    /// The value as a variant.
    fn into_variant(self) -> SkVariant;

    /// A vector of such values as a variant: a list, except that bytes become `Bytes`.
    fn vec_into_variant(items: Vec<Self>) -> SkVariant
    where
        Self: Sized,
    {
        SkVariant::List(items.into_iter().map(IntoVariant::into_variant).collect())
    }
}

/// A Rust value that can be read from a variant. `derive(SkVariant)` implements it for your types.
///
/// ```
/// use sk_flat::{FromVariant, SkVariant};
///
/// let value = SkVariant::from(300);
/// assert_eq!(f32::from_variant(&value), Ok(300.0));
/// assert_eq!(u8::from_variant(&value).unwrap_err().to_string(), "300 does not fit u8");
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be read from a variant",
    label = "no `FromVariant` for this type",
    note = "a struct or enum of your own gets it by `#[derive(SkVariant)]`"
)]
pub trait FromVariant: Sized {
    /// Reads the value.
    ///
    /// # Errors
    /// Another kind, or a number that the type cannot hold; nothing is rounded or cut silently,
    /// except `f64` to the nearest `f32`.
    fn from_variant(v: &SkVariant) -> Result<Self, VariantError>;

    /// Reads a vector of such values: from a list; for `u8` from `Bytes` as well.
    ///
    /// # Errors
    /// No list, or an item that cannot be read.
    fn vec_from_variant(v: &SkVariant) -> Result<Vec<Self>, VariantError> {
        let items = v
            .as_list()
            .ok_or(VariantError::Expected { expected: "list", found: v.kind() })?;
        let read = |(index, item)| Self::from_variant(item).map_err(|error| error.in_item(index));
        items.iter().enumerate().map(read).collect()
    }

    /// What a field of this type is when its map lacks it: an error, but `None` for an `Option`.
    ///
    /// # Errors
    /// [`VariantError::Missing`] for all types that cannot do without a value.
    fn from_missing() -> Result<Self, VariantError> {
        Err(VariantError::Missing)
    }
}

fn wrong<T>(expected: &'static str, found: &SkVariant) -> Result<T, VariantError> {
    Err(VariantError::Expected { expected, found: found.kind() })
}

/// `From<T> for SkVariant` and `TryFrom<SkVariant> for T`, over the two traits.
macro_rules! std_twins {
    (both: $($t:ty),*) => { $(
        std_twins!(from: $t);
        impl TryFrom<SkVariant> for $t {
            type Error = VariantError;
            fn try_from(v: SkVariant) -> Result<$t, VariantError> {
                <$t>::from_variant(&v)
            }
        }
        impl TryFrom<&SkVariant> for $t {
            type Error = VariantError;
            fn try_from(v: &SkVariant) -> Result<$t, VariantError> {
                <$t>::from_variant(v)
            }
        }
    )* };
    (from: $($t:ty),*) => { $(
        impl From<$t> for SkVariant {
            fn from(value: $t) -> SkVariant {
                value.into_variant()
            }
        }
    )* };
}

macro_rules! integers {
    ($($t:ident => $kind:ident as $stored:ty),*) => { $(
        impl IntoVariant for $t {
            fn into_variant(self) -> SkVariant {
                SkVariant::$kind(self as $stored)
            }
            integers!(@bytes_out $t);
        }
        impl FromVariant for $t {
            fn from_variant(v: &SkVariant) -> Result<$t, VariantError> {
                match v.integer() {
                    Some(n) => <$t>::try_from(n).map_err(|_| VariantError::OutOfRange {
                        expected: stringify!($t),
                        value: n.to_string().into(),
                    }),
                    None => wrong(stringify!($t), v),
                }
            }
            integers!(@bytes_in $t);
        }
        std_twins!(both: $t);
    )* };
    (@bytes_out u8) => {
        fn vec_into_variant(items: Vec<u8>) -> SkVariant {
            SkVariant::Bytes(Arc::new(Bytes::from(items)))
        }
    };
    (@bytes_in u8) => {
        fn vec_from_variant(v: &SkVariant) -> Result<Vec<u8>, VariantError> {
            match v {
                SkVariant::Bytes(bytes) => Ok(bytes.to_vec()),
                SkVariant::List(list) => {
                    let read = |(index, item)| u8::from_variant(item).map_err(|error| error.in_item(index));
                    list.iter().enumerate().map(read).collect()
                }
                other => wrong("bytes", other),
            }
        }
    };
    (@bytes_out $other:ident) => {};
    (@bytes_in $other:ident) => {};
}

integers!(
    i8 => I8 as i8, i16 => I16 as i16, i32 => I32 as i32, i64 => I64 as i64, isize => I64 as i64,
    u8 => U8 as u8, u16 => U16 as u16, u32 => U32 as u32, u64 => U64 as u64, usize => U64 as u64
);

// `usize` and `isize` have at most 64 bits, or the casts above would cut.
const _: () = assert!(usize::BITS <= 64);

/// `IntoVariant` and `FromVariant` of a type that has a kind of its own or borrows another's.
macro_rules! plain {
    ($($t:ty, $expected:literal, |$value:ident| $into:expr, { $($pattern:pat => $from:expr),+ })*) => { $(
        impl IntoVariant for $t {
            fn into_variant(self) -> SkVariant {
                let $value = self;
                $into
            }
        }
        impl FromVariant for $t {
            fn from_variant(v: &SkVariant) -> Result<$t, VariantError> {
                match v {
                    $($pattern => $from,)+
                    other => wrong($expected, other),
                }
            }
        }
        std_twins!(both: $t);
    )* };
}

plain! {
    bool, "bool", |truth| SkVariant::Bool(truth), { SkVariant::Bool(truth) => Ok(*truth) }
    (), "null", |_nothing| SkVariant::Null, { SkVariant::Null => Ok(()) }
    String, "string", |text| SkVariant::String(text.into()), { SkVariant::String(text) => Ok((**text).to_owned()) }
    Box<str>, "string", |text| SkVariant::String(text.into()), { SkVariant::String(text) => Ok((**text).into()) }
    Arc<str>, "string", |text| SkVariant::String(text), { SkVariant::String(text) => Ok(Arc::clone(text)) }
    Bytes, "bytes", |bytes| SkVariant::Bytes(Arc::new(bytes)), { SkVariant::Bytes(bytes) => Ok((**bytes).clone()) }
    char, "string of one character", |c| SkVariant::String((&*c.encode_utf8(&mut [0; 4])).into()), {
        SkVariant::String(text) => one_char(text)
    }
}

fn one_char(text: &str) -> Result<char, VariantError> {
    let mut chars = text.chars();
    match (chars.next(), chars.next()) {
        (Some(c), None) => Ok(c),
        _ => {
            let found = text.chars().count();
            let problem = format!("expected a string of one character, found one of {found}");
            Err(VariantError::Custom(problem.into()))
        }
    }
}

impl IntoVariant for f32 {
    fn into_variant(self) -> SkVariant {
        SkVariant::F32(self)
    }
}

impl FromVariant for f32 {
    fn from_variant(v: &SkVariant) -> Result<f32, VariantError> {
        let out_of_range = |value: String| VariantError::OutOfRange { expected: "f32", value: value.into() };
        match (v, v.integer()) {
            (SkVariant::F32(x), _) => Ok(*x),
            (SkVariant::F64(x), _) => {
                let nearest = *x as f32;
                if nearest.is_infinite() && x.is_finite() {
                    Err(out_of_range(x.to_string()))
                } else {
                    Ok(nearest)
                }
            }
            (_, Some(n)) => {
                // Through the integer and back shows whether a bit was lost.
                if (n as f32) as i128 == n { Ok(n as f32) } else { Err(out_of_range(n.to_string())) }
            }
            _ => wrong("f32", v),
        }
    }
}

impl IntoVariant for f64 {
    fn into_variant(self) -> SkVariant {
        SkVariant::F64(self)
    }
}

impl FromVariant for f64 {
    fn from_variant(v: &SkVariant) -> Result<f64, VariantError> {
        match (v.float(), v.integer()) {
            (Some(x), _) => Ok(x),
            (_, Some(n)) if (n as f64) as i128 == n => Ok(n as f64),
            (_, Some(n)) => Err(VariantError::OutOfRange { expected: "f64", value: n.to_string().into() }),
            _ => wrong("f64", v),
        }
    }
}

/// Seconds, as an `f64`.
impl IntoVariant for Duration {
    fn into_variant(self) -> SkVariant {
        SkVariant::F64(self.as_secs_f64())
    }
}

/// Seconds: any number that is not negative.
impl FromVariant for Duration {
    fn from_variant(v: &SkVariant) -> Result<Duration, VariantError> {
        let seconds = f64::from_variant(v)?;
        Duration::try_from_secs_f64(seconds).map_err(|_| VariantError::OutOfRange {
            expected: "a duration in seconds",
            value: seconds.to_string().into(),
        })
    }
}

/// Nanoseconds since the clock began.
impl IntoVariant for Instant {
    fn into_variant(self) -> SkVariant {
        SkVariant::U64(self.as_nanos())
    }
}

impl FromVariant for Instant {
    fn from_variant(v: &SkVariant) -> Result<Instant, VariantError> {
        u64::from_variant(v).map(Instant::from_nanos)
    }
}

impl IntoVariant for Name {
    fn into_variant(self) -> SkVariant {
        SkVariant::String(self.as_str().into())
    }
}

impl FromVariant for Name {
    fn from_variant(v: &SkVariant) -> Result<Name, VariantError> {
        let text = v
            .as_str()
            .ok_or(VariantError::Expected { expected: "a name", found: v.kind() })?;
        text.parse()
            .map_err(|error: crate::NameError| VariantError::Custom(error.to_string().into()))
    }
}

std_twins!(both: f32, f64, Duration, Instant, Name);

impl IntoVariant for SkVariant {
    fn into_variant(self) -> SkVariant {
        self
    }
}

impl FromVariant for SkVariant {
    fn from_variant(v: &SkVariant) -> Result<SkVariant, VariantError> {
        Ok(v.clone())
    }
}

impl IntoVariant for &str {
    fn into_variant(self) -> SkVariant {
        SkVariant::String(self.into())
    }
}

impl IntoVariant for Cow<'_, str> {
    fn into_variant(self) -> SkVariant {
        SkVariant::String(self.into())
    }
}

impl IntoVariant for BytesMut {
    fn into_variant(self) -> SkVariant {
        self.freeze().into_variant()
    }
}

std_twins!(from: &str, Cow<'_, str>, BytesMut);

impl<T: IntoVariant + Clone> IntoVariant for &T {
    fn into_variant(self) -> SkVariant {
        self.clone().into_variant()
    }
}

impl From<&SkVariant> for SkVariant {
    fn from(value: &SkVariant) -> SkVariant {
        value.clone()
    }
}
