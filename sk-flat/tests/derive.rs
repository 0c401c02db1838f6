//! `derive(SkVariant)` as users write it.

use sk_flat::{FromVariant, IntoVariant, SkVariant};
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::time::Duration;

#[derive(SkVariant, Clone, Debug, PartialEq, Default)]
struct Pose {
    x: f64,
    y: f64,
    #[variant(rename = "heading", default)]
    theta: f32,
    #[variant(skip)]
    cached: Option<u32>,
    note: Option<String>,
}

#[derive(SkVariant, Clone, Debug, PartialEq)]
struct Volts(f64);

#[derive(SkVariant, Clone, Debug, PartialEq)]
struct Span(u8, i64);

#[derive(SkVariant, Clone, Debug, PartialEq)]
struct Nothing;

#[derive(SkVariant, Clone, Debug, PartialEq)]
struct Brackets();

#[derive(SkVariant, Clone, Debug, PartialEq)]
struct Braces {}

#[derive(SkVariant, Clone, Debug, PartialEq)]
enum Order {
    Stop,
    #[variant(rename = "goto")]
    GoTo(Pose),
    Turn(f32, bool),
    Say {
        r#type: String,
        times: Vec<u8>,
    },
    Empty(),
}

#[derive(SkVariant, Clone, Debug, PartialEq)]
struct Reading<T, const N: usize>
where
    T: Clone,
{
    samples: [T; N],
    by_name: BTreeMap<String, T>,
    after: Duration,
}

#[derive(SkVariant, Debug, PartialEq)]
#[variant(ignore_unknown, crate = "sk_flat")]
struct Tolerant {
    n: i32,
}

#[derive(SkVariant, Debug)]
enum Never {}

fn both_ways<T>(value: T, shown: &str)
where
    T: IntoVariant + FromVariant + Clone + Debug + PartialEq,
{
    let variant = value.clone().into_variant();
    assert_eq!(variant.to_string(), shown);
    assert_eq!(T::from_variant(&variant), Ok(value));
}

fn problem<T: FromVariant + Debug>(json: &str) -> String {
    T::from_variant(&SkVariant::from_json(json).expect("the test's JSON is right"))
        .unwrap_err()
        .to_string()
}

fn pose() -> Pose {
    Pose { x: 1.0, y: 2.0, theta: 0.5, cached: None, note: None }
}

#[test]
fn each_shape_of_type_has_its_shape_of_variant() {
    both_ways(pose(), r#"{"heading":0.5,"note":null,"x":1.0,"y":2.0}"#);
    both_ways(Volts(1.5), "1.5");
    both_ways(Span(1, -2), "[1,-2]");
    both_ways(Nothing, "null");
    both_ways(Brackets(), "null");
    both_ways(Braces {}, "{}");
    both_ways(Order::Stop, r#""Stop""#);
    both_ways(Order::GoTo(pose()), r#"{"goto":{"heading":0.5,"note":null,"x":1.0,"y":2.0}}"#);
    both_ways(Order::Turn(1.0, true), r#"{"Turn":[1.0,true]}"#);
    both_ways(Order::Empty(), r#"{"Empty":null}"#);
    both_ways(
        Order::Say { r#type: "hello".into(), times: vec![1, 2] },
        r#"{"Say":{"times":<2 bytes: 01 02>,"type":"hello"}}"#,
    );
    both_ways(
        Reading { samples: [1i16, 2], by_name: BTreeMap::new(), after: Duration::from_millis(1500) },
        r#"{"after":1.5,"by_name":{},"samples":[1,2]}"#,
    );
}

#[test]
fn from_and_try_from_come_with_it() {
    let variant = SkVariant::from(pose());
    assert_eq!(Pose::try_from(&variant), Ok(pose()));
    assert_eq!(Pose::try_from(variant), Ok(pose()));
    let list = SkVariant::from(vec![Volts(1.0), Volts(2.0)]);
    assert_eq!(Vec::<Volts>::try_from(list), Ok(vec![Volts(1.0), Volts(2.0)]));
}

#[test]
fn defaults_options_and_skipped_fields_may_be_missing() {
    let read = Pose::try_from(SkVariant::from_json(r#"{"x": 1, "y": 2}"#).unwrap());
    assert_eq!(read, Ok(Pose { theta: 0.0, ..pose() }));
    let cached = Pose { cached: Some(9), ..pose() };
    assert_eq!(Pose::try_from(SkVariant::from(cached)), Ok(pose()));
}

#[test]
fn errors_name_the_path() {
    assert_eq!(problem::<Pose>(r#"{"x": "far", "y": 2}"#), "x: expected f64, found string");
    assert_eq!(problem::<Pose>(r#"{"x": 1}"#), "y: the field is missing");
    assert_eq!(
        problem::<Pose>(r#"{"x": 1, "y": 2, "z": 3}"#),
        "z: no such field; the known ones are x, y, heading, note"
    );
    assert_eq!(
        problem::<Pose>(r#"{"x": 1, "y": 2, "cached": 3}"#).split(';').next(),
        Some("cached: no such field")
    );
    assert_eq!(problem::<Pose>("[1, 2]"), "expected map, found list");
    assert_eq!(problem::<Span>("[1]"), "expected a list of 2 items, found 1");
    assert_eq!(problem::<Span>("[300, 1]"), "[0]: 300 does not fit u8");
    assert_eq!(problem::<Order>(r#"{"goto": {"x": 1, "y": null}}"#), "goto.y: expected f64, found null");
    assert_eq!(
        problem::<Vec<Order>>(r#"["Stop", {"Turn": [1, 2]}]"#),
        "[1].Turn[1]: expected bool, found i64"
    );
}

#[test]
fn a_case_that_is_not_there_or_is_misused_is_refused() {
    assert_eq!(
        problem::<Order>(r#""Stopp""#),
        r#"no such case "Stopp"; the known ones are Stop, goto, Turn, Say, Empty"#
    );
    assert!(
        problem::<Order>(r#""GoTo""#).contains("no such case"),
        "a renamed case has its new name only"
    );
    assert_eq!(problem::<Order>(r#""goto""#), "goto: this case carries data, and none came");
    assert_eq!(
        problem::<Order>(r#"{"Stop": null}"#),
        "Stop: this case carries no data: expected its name as a string"
    );
    assert!(problem::<Order>(r#"{"Stop": 1, "goto": 2}"#).contains("found 2 entries"));
    assert!(problem::<Order>("7").ends_with("found i64"));
    assert!(problem::<Never>(r#""x""#).ends_with("the known ones are none"));
}

#[test]
fn a_tolerant_type_passes_over_what_it_does_not_know() {
    let json = r#"{"n": 1, "since the next version": true}"#;
    assert_eq!(Tolerant::try_from(SkVariant::from_json(json).unwrap()), Ok(Tolerant { n: 1 }));
}
