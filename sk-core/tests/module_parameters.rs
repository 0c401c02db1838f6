//! Declared parameters: each test is one of their rules.

use sk_core::module::*;
use sk_core::{SkVariant, parameters};
use std::collections::BTreeMap;
use std::time::Duration;

const CHANNELS_MAX: u16 = 16;

parameters! {
    /// What a battery watch can be told.
    struct Battery {
        /// Time between
        /// two readings.
        period_ms: u64 = 20, 5..=1000, "ms";
        /// Below this the alarm rings.
        low: f64 = 11.0, 9.0..=13.0, "V";
        offset: i32 = -4, -10..;
        channels: u16 = 4, ..=CHANNELS_MAX;
        label: String = "main", "as printed";
        loud: bool = true;
        cells: Vec<String> = vec!["a".into()];
        r#type: Option<f32> = None, "kg";
        pause: Duration = Duration::from_millis(500), "s";
        gains: BTreeMap<String, f64> = BTreeMap::new();
    }
}

parameters! { struct Nothing {} }

fn info(name: &str) -> &'static ParameterInfo {
    let known = Battery::describe().iter().find(|info| info.name == name);
    known.unwrap_or_else(|| panic!("{name} is declared"))
}

#[test]
fn defaults_are_what_was_declared() {
    let battery = Battery::default();
    assert_eq!((battery.period_ms, battery.low, battery.offset), (20, 11.0, -4));
    assert_eq!((&*battery.label, battery.loud, battery.r#type), ("main", true, None));
    assert_eq!(battery.cells, ["a"]);
    for info in Battery::describe() {
        assert_eq!(battery.get(info.name), Some(info.default.clone()), "{}", info.name);
    }
}

#[test]
fn a_declaration_tells_type_unit_range_default_and_meaning() {
    let period = info("period_ms");
    assert_eq!((period.type_name, period.unit), ("u64", "ms"));
    assert_eq!((period.low.clone(), period.high.clone()), (Some(5u64.into()), Some(1000u64.into())));
    assert_eq!(format!("{period:?}"), "period_ms: u64 in 5..=1000 ms = 20  (Time between two readings.)");
    assert_eq!(info("offset").to_string(), "i32 in -10..");
    assert_eq!(info("channels").to_string(), "u16 in ..=16");
    assert_eq!(info("label").to_string(), "String as printed");
    assert_eq!(info("type").name, "type");
    let names: Vec<&str> = Battery::describe().iter().map(|info| info.name).collect();
    let written =
        ["period_ms", "low", "offset", "channels", "label", "loud", "cells", "type", "pause", "gains"];
    assert_eq!(names, written);
}

#[test]
fn both_ends_of_a_range_are_allowed_and_what_lies_beyond_is_not() {
    let mut battery = Battery::default();
    let allowed: [(&str, SkVariant); 6] = [
        ("period_ms", 5.into()),
        ("period_ms", 1000.into()),
        ("offset", (-10).into()),
        ("offset", i32::MAX.into()),
        ("channels", 0.into()),
        ("channels", 16.into()),
    ];
    for (name, value) in allowed {
        assert_eq!(battery.set(name, &value), Ok(()), "{name} {value}");
        assert!(battery.get(name).is_some_and(|now| now.same_value(&value)));
    }
    let before = battery.clone();
    let refused: [(&str, SkVariant); 6] = [
        ("period_ms", 4.into()),
        ("period_ms", 1001.into()),
        ("offset", (-11).into()),
        ("channels", 17.into()),
        ("low", 13.000001.into()),
        ("low", f64::NAN.into()),
    ];
    for (name, value) in refused {
        let error = battery.set(name, &value);
        assert!(matches!(error, Err(ParameterError::Range { .. })), "{name} {value}: {error:?}");
    }
    assert_eq!(battery, before);
}

#[test]
fn an_error_says_name_type_unit_range_and_what_came() {
    let mut battery = Battery::default();
    let mut said =
        |name: &str, value: SkVariant| battery.set(name, &value).map_err(|error| error.to_string());
    let error = |text: &str| Err(text.to_owned());
    assert_eq!(said("low", 20.into()), error("parameter `low` takes f64 in 9.0..=13.0 V, found 20"));
    let wrong = "parameter `low` takes f64 in 9.0..=13.0 V: expected f64, found string";
    assert_eq!(said("low", "high".into()), error(wrong));
    let negative = "parameter `period_ms` takes u64 in 5..=1000 ms: -1 does not fit u64";
    assert_eq!(said("period_ms", (-1).into()), error(negative));
    let nested = "parameter `cells` takes Vec<String>: [1]: expected string, found i32";
    assert_eq!(
        said("cells", SkVariant::List(["a".into(), 2.into()].into_iter().collect())),
        error(nested)
    );
}

#[test]
fn conversion_is_strict() {
    let mut battery = Battery::default();
    assert_eq!(battery.set("low", &12.into()), Ok(()), "an integer that fits exactly is a float");
    for (name, value) in [
        ("period_ms", SkVariant::from(20.0)),
        ("loud", 1.into()),
        ("label", 5.into()),
        ("pause", (-1).into()),
        ("period_ms", SkVariant::Null),
    ] {
        let error = battery.set(name, &value);
        assert!(matches!(error, Err(ParameterError::Type { .. })), "{name} {value}: {error:?}");
    }
    assert_eq!(battery.set("type", &SkVariant::Null), Ok(()), "an optional one can be nothing");
}

#[test]
fn an_unknown_name_is_an_error_that_lists_the_known_ones() {
    let mut battery = Battery::default();
    let error = battery.set("perod_ms", &20.into()).unwrap_err().to_string();
    assert!(
        error.starts_with("no parameter `perod_ms`; the known ones are period_ms, low, "),
        "{error}"
    );
    assert_eq!(battery.get("perod_ms"), None);
    let map = SkVariant::map([("low", 12.into()), ("perod_ms", 20.into())]);
    assert!(matches!(Battery::from_variant(&map), Err(ParameterError::Unknown { .. })));
    let none = Nothing::default().set("x", &1.into()).unwrap_err().to_string();
    assert_eq!(none, "no parameter `x`; the known ones are none");
    assert!(<()>::from_variant(&SkVariant::map([("x", 1.into())])).is_err());
}

#[test]
fn a_long_name_does_not_make_a_long_error() {
    let error = ParameterError::unknown::<Nothing>(&"\n".repeat(100_000)).to_string();
    assert!(error.len() < 400 && !error.contains('\n'), "{error}");
    let error = Battery::default()
        .set("label", &SkVariant::list(vec![1; 10_000]))
        .unwrap_err()
        .to_string();
    assert!(error.len() < 400, "{error}");
}

#[test]
fn what_a_map_lacks_has_its_default() {
    let map = SkVariant::map([("low", 12.5.into()), ("cells", vec!["x".to_owned()].into())]);
    let battery = Battery::from_variant(&map);
    let expected = Battery { low: 12.5, cells: vec!["x".into()], ..Battery::default() };
    assert_eq!(battery, Ok(expected));
    let nothing = SkVariant::map::<&str>([]);
    assert_eq!(Battery::from_variant(&nothing), Ok(Battery::default()));
    let error = Battery::from_variant(&5.into()).unwrap_err().to_string();
    assert_eq!(error, "parameters are a map of names and values, found i32");
}

#[test]
fn a_set_survives_the_way_through_json() {
    let mut battery = Battery::default();
    battery.offset = 7;
    battery.gains.insert("p".into(), 0.1);
    battery.r#type = Some(1.5);
    let json = battery.to_variant().to_json().expect("is not deep");
    let back = Battery::from_variant(&SkVariant::from_json(&json).expect("is JSON"));
    assert_eq!(back, Ok(battery));
}

#[test]
fn the_schema_knows_every_parameter_and_refuses_others() {
    let schema = Battery::schema();
    assert_eq!(schema.get("additionalProperties"), Some(&false.into()));
    let properties = schema.get("properties").and_then(SkVariant::as_map).expect("there are some");
    assert_eq!(properties.len(), Battery::describe().len());
    let json = |name: &str| properties[name].to_json().expect("is not deep");
    let low = r#"{"default":11.0,"description":"Below this the alarm rings.","maximum":13.0,"minimum":9.0,"type":"number","unit":"V"}"#;
    assert_eq!(json("low"), low);
    let offset = r#"{"default":-4,"maximum":2147483647,"minimum":-10,"type":"integer"}"#;
    assert_eq!(json("offset"), offset);
    assert_eq!(json("cells"), r#"{"default":["a"],"items":{"type":"string"},"type":"array"}"#);
    let optional = r#"{"anyOf":[{"type":"number"},{"type":"null"}],"default":null,"unit":"kg"}"#;
    assert_eq!(json("type"), optional);
}
