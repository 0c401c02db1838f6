use super::{from_variant_serde, to_variant};
use crate::{Kind, SkVariant, VariantError};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};

#[derive(Debug, PartialEq, Serialize, Deserialize)]
enum Shape {
    Empty,
    Circle(f32),
    Line(i8, u64),
    Box { width: f64, label: Option<String> },
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Whole {
    nothing: (),
    truth: bool,
    letter: char,
    wide: u64,
    shapes: Vec<Shape>,
    by_name: HashMap<String, i16>,
    by_number: BTreeMap<u32, bool>,
    raw: SkVariant,
    fixed: [u8; 3],
}

fn whole() -> Whole {
    Whole {
        nothing: (),
        truth: true,
        letter: 'ß',
        wide: u64::MAX,
        shapes: vec![
            Shape::Empty,
            Shape::Circle(0.1),
            Shape::Line(-1, 2),
            Shape::Box { width: 1.5, label: None },
            Shape::Box { width: 1.5, label: Some("x".into()) },
        ],
        by_name: [("a".to_owned(), 1), ("b".to_owned(), -2)].into(),
        by_number: [(7, true), (10, false)].into(),
        raw: SkVariant::map([("$bytes", vec![1u8, 2].into()), ("f", SkVariant::F32(0.5))]),
        fixed: [1, 2, 3],
    }
}

#[test]
fn any_serde_type_goes_through_a_variant_and_back() {
    let value = to_variant(&whole()).unwrap();
    assert_eq!(value.get("wide").map(SkVariant::kind), Some(Kind::U64));
    assert_eq!(value.get("raw"), Some(&whole().raw), "a variant inside is taken as it is");
    assert_eq!(from_variant_serde::<Whole>(&value).unwrap(), whole());
}

#[test]
fn any_serde_type_goes_through_the_json_and_the_bytes_of_its_variant() {
    let value = to_variant(&whole()).unwrap();
    let from_json = SkVariant::from_json(&value.to_json().unwrap()).unwrap();
    assert_eq!(from_variant_serde::<Whole>(&from_json).unwrap().shapes, whole().shapes);
    let from_bytes = SkVariant::decode(&value.encode().unwrap()).unwrap();
    assert_eq!(from_variant_serde::<Whole>(&from_bytes).unwrap(), whole());
}

#[test]
fn a_variant_is_data_for_other_formats() {
    let value = SkVariant::map([("raw", vec![255u8].into()), ("n", 5.into())]);
    let text = serde_json::to_string(&value).unwrap();
    assert_eq!(text, r#"{"n":5,"raw":{"$bytes":"/w=="}}"#);
    let back: SkVariant = serde_json::from_str(&text).unwrap();
    assert!(back.same_value(&value));
}

#[test]
fn errors_name_the_place() {
    #[derive(Debug, Deserialize)]
    #[expect(dead_code, reason = "only its errors are looked at")]
    struct Path {
        points: Vec<(f64, f64)>,
    }
    let value = SkVariant::from_json(r#"{"points": [[1, 2], [1, "two"]]}"#).unwrap();
    let error = from_variant_serde::<Path>(&value).unwrap_err();
    assert_eq!(error.to_string(), "points[1][1]: expected f64, found string");
    let long = SkVariant::from_json(r#"{"points": [[1, 2, 3]]}"#).unwrap();
    let error = from_variant_serde::<Path>(&long).unwrap_err();
    assert_eq!(error.to_string(), "points[0]: expected a list of 2 items, found 3");
}

#[test]
fn an_integer_that_a_float_cannot_hold_is_refused() {
    let value = SkVariant::I64((1 << 53) + 1);
    assert!(matches!(from_variant_serde::<f64>(&value), Err(VariantError::OutOfRange { .. })));
    assert_eq!(from_variant_serde::<f64>(&SkVariant::I64(1 << 53)), Ok((1u64 << 53) as f64));
    assert!(from_variant_serde::<i64>(&SkVariant::F64(1.0)).is_err());
}

#[test]
fn a_map_with_a_key_that_has_no_text_is_refused() {
    let keys: HashMap<(i32, i32), i32> = [((1, 2), 3)].into();
    assert!(to_variant(&keys).unwrap_err().to_string().contains("key of a map"));
    assert!(to_variant(&(u128::from(u64::MAX) + 1)).is_err());
}

#[derive(Serialize, Deserialize)]
struct Chain {
    next: Option<Box<Chain>>,
}

#[test]
fn both_ways_stop_at_64_levels() {
    let chain = |length| (0..length).fold(Chain { next: None }, |next, _| Chain { next: Some(next.into()) });
    assert!(to_variant(&chain(63)).is_ok());
    assert!(matches!(
        to_variant(&chain(64)).as_ref().map_err(VariantError::cause),
        Err(VariantError::Limit { max: 64, .. })
    ));
    let deep = (0..100_000).fold(SkVariant::Null, |next, _| SkVariant::map([("next", next)]));
    assert!(from_variant_serde::<Chain>(&deep).is_err());
    assert!(from_variant_serde::<SkVariant>(&deep).is_err());
    assert!(to_variant(&deep).is_err());
    assert!(deep.to_json().is_err());
}
