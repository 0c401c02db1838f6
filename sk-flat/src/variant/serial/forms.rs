//! The objects with one reserved key that stand for what a human-readable format lacks.

use crate::error::VariantError;
use crate::variant::{FromVariant, SkMap, SkVariant};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bytes::Bytes;
use std::borrow::Cow;

pub(super) const BYTES: &str = "$bytes";
pub(super) const F64: &str = "$f64";
pub(super) const F32: &str = "$f32";
pub(super) const I8: &str = "$i8";
pub(super) const I16: &str = "$i16";
pub(super) const I32: &str = "$i32";
pub(super) const U8: &str = "$u8";
pub(super) const U16: &str = "$u16";
pub(super) const U32: &str = "$u32";
pub(super) const U64: &str = "$u64";
pub(super) const MAP: &str = "$map";

const RESERVED: [&str; 11] = [BYTES, F64, F32, I8, I16, I32, U8, U16, U32, U64, MAP];

/// Whether a real map looks like a form, so that it must be wrapped in `$map`.
pub(super) fn looks_like_form(map: &SkMap) -> bool {
    map.len() == 1 && map.keys().all(|key| RESERVED.contains(&key.as_str()))
}

pub(super) fn base64_text(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// The text of a float that is not finite. A NaN with unusual bits is written as its bits.
pub(super) fn f64_text(x: f64) -> Cow<'static, str> {
    match named_float(x) {
        Some(name) if x.to_bits() == f64_named(name).to_bits() => name.into(),
        _ => format!("0x{:016x}", x.to_bits()).into(),
    }
}

/// As [`f64_text`], for an `f32`.
pub(super) fn f32_text(x: f32) -> Cow<'static, str> {
    match named_float(x.into()) {
        Some(name) if x.to_bits() == (f64_named(name) as f32).to_bits() => name.into(),
        _ => format!("0x{:08x}", x.to_bits()).into(),
    }
}

fn named_float(x: f64) -> Option<&'static str> {
    match x {
        f64::INFINITY => Some("inf"),
        f64::NEG_INFINITY => Some("-inf"),
        x if x.is_nan() => Some("NaN"),
        _ => None,
    }
}

fn f64_named(name: &str) -> f64 {
    match name {
        "inf" => f64::INFINITY,
        "-inf" => f64::NEG_INFINITY,
        _ => f64::NAN,
    }
}

/// Turns the forms in a raw tree into what they stand for. The tree is at most 64 deep.
pub(in crate::variant) fn unfold(raw: SkVariant) -> Result<SkVariant, VariantError> {
    match raw {
        SkVariant::List(list) => {
            let items = list.into_inner().into_iter().enumerate();
            let unfolded = items.map(|(index, item)| unfold(item).map_err(|error| error.in_item(index)));
            Ok(SkVariant::List(unfolded.collect::<Result<_, _>>()?))
        }
        SkVariant::Map(map) if looks_like_form(&map) => match map.into_inner().pop_first() {
            Some((key, body)) => unfold_form(&key, body).map_err(|error| error.in_field(&key)),
            None => Ok(SkVariant::Map(SkMap::new())),
        },
        SkVariant::Map(map) => unfold_entries(map),
        scalar => Ok(scalar),
    }
}

fn unfold_entries(map: SkMap) -> Result<SkVariant, VariantError> {
    let unfolded = map.into_inner().into_iter().map(|(key, value)| match unfold(value) {
        Ok(value) => Ok((key, value)),
        Err(error) => Err(error.in_field(&key)),
    });
    Ok(SkVariant::Map(unfolded.collect::<Result<_, _>>()?))
}

fn unfold_form(key: &str, body: SkVariant) -> Result<SkVariant, VariantError> {
    Ok(match key {
        BYTES => SkVariant::from(bytes_of(&body)?),
        F64 => SkVariant::F64(match float_bits(&body, 16)? {
            Ok(bits) => f64::from_bits(bits),
            Err(named) => named,
        }),
        F32 if body.as_str().is_some() => SkVariant::F32(match float_bits(&body, 8)? {
            Ok(bits) => f32::from_bits(bits as u32),
            Err(named) => named as f32,
        }),
        F32 => SkVariant::F32(f32::from_variant(&body)?),
        I8 => SkVariant::I8(i8::from_variant(&body)?),
        I16 => SkVariant::I16(i16::from_variant(&body)?),
        I32 => SkVariant::I32(i32::from_variant(&body)?),
        U8 => SkVariant::U8(u8::from_variant(&body)?),
        U16 => SkVariant::U16(u16::from_variant(&body)?),
        U32 => SkVariant::U32(u32::from_variant(&body)?),
        U64 => SkVariant::U64(u64::from_variant(&body)?),
        // What stands inside `$map` is a map whatever its keys are.
        _ => match body {
            SkVariant::Map(map) => unfold_entries(map)?,
            other => return Err(VariantError::Expected { expected: "map", found: other.kind() }),
        },
    })
}

fn bytes_of(body: &SkVariant) -> Result<Bytes, VariantError> {
    let found = body.kind();
    let text = body
        .as_str()
        .ok_or(VariantError::Expected { expected: "text in base64", found })?;
    let bytes = STANDARD.decode(text);
    bytes
        .map(Bytes::from)
        .map_err(|error| VariantError::Custom(format!("no base64: {error}").into()))
}

/// The bits of a float given in hexadecimal digits, or the float that has a name.
fn float_bits(body: &SkVariant, digits: usize) -> Result<Result<u64, f64>, VariantError> {
    const EXPECTED: &str = "NaN, inf, -inf or the bits as 0x and hexadecimal digits";
    let text = body
        .as_str()
        .ok_or(VariantError::Expected { expected: EXPECTED, found: body.kind() })?;
    if matches!(text, "NaN" | "inf" | "-inf") {
        return Ok(Err(f64_named(text)));
    }
    let hex = text
        .strip_prefix("0x")
        .filter(|hex| hex.len() == digits && !hex.starts_with('+'));
    let bits = hex.and_then(|hex| u64::from_str_radix(hex, 16).ok());
    bits.map(Ok)
        .ok_or_else(|| VariantError::Custom(format!("expected {EXPECTED}").into()))
}
