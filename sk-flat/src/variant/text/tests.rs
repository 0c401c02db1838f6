use crate::{Limits, SkVariant, VariantError};
use std::collections::BTreeMap;

fn read(text: &str) -> SkVariant {
    SkVariant::from_json(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn refused(text: &str) -> String {
    match SkVariant::from_json(text) {
        Ok(value) => panic!("{text} was read as {value:?}"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn numbers_are_read_by_their_spelling() {
    let cases = [
        ("0", SkVariant::I64(0)),
        ("-0", SkVariant::F64(-0.0)),
        ("-0.0", SkVariant::F64(-0.0)),
        ("5.0", SkVariant::F64(5.0)),
        ("5e0", SkVariant::F64(5.0)),
        ("9223372036854775807", SkVariant::I64(i64::MAX)),
        ("-9223372036854775808", SkVariant::I64(i64::MIN)),
        ("9223372036854775808", SkVariant::U64(1 << 63)),
        ("18446744073709551615", SkVariant::U64(u64::MAX)),
        ("18446744073709551616", SkVariant::F64(18_446_744_073_709_551_616.0)),
        ("-9223372036854775809", SkVariant::F64(-9_223_372_036_854_775_808.0)),
        ("5e-324", SkVariant::F64(5e-324)),
        ("1e-400", SkVariant::F64(0.0)),
    ];
    for (text, value) in cases {
        assert_eq!(read(text), value, "{text}");
    }
    assert!(refused("1e400").contains("number out of range"));
    assert!(refused("-1e400").contains("number out of range"));
}

#[test]
fn what_json_has_comes_back_equal() {
    let values = [
        SkVariant::Null,
        SkVariant::Bool(true),
        SkVariant::I64(i64::MIN),
        SkVariant::U64(u64::MAX),
        SkVariant::F64(-0.0),
        SkVariant::F64(0.1 + 0.2),
        SkVariant::F64(f64::MAX),
        SkVariant::F64(5.0),
        SkVariant::from("a\u{0}\u{1f600}\"\\\u{2028}"),
        SkVariant::list([SkVariant::Null, SkVariant::list::<SkVariant>([])]),
        SkVariant::map([("", 1i64.into()), ("$bytes", 2i64.into())]),
    ];
    for value in values {
        for text in [value.to_json(), value.to_json_pretty(), value.to_json_exact()] {
            assert_eq!(read(&text.unwrap()), value);
        }
    }
}

#[test]
fn what_json_lacks_has_a_form() {
    let cases = [
        (SkVariant::from(vec![0u8, 255]), r#"{"$bytes":"AP8="}"#),
        (SkVariant::F64(f64::NAN), r#"{"$f64":"NaN"}"#),
        (SkVariant::F64(f64::from_bits(0x7ff8_0000_0000_0001)), r#"{"$f64":"0x7ff8000000000001"}"#),
        (SkVariant::F64(f64::NEG_INFINITY), r#"{"$f64":"-inf"}"#),
        (SkVariant::F32(f32::INFINITY), r#"{"$f32":"inf"}"#),
        (SkVariant::F32(f32::from_bits(0xffc0_0000)), r#"{"$f32":"0xffc00000"}"#),
        (SkVariant::map([("$bytes", "x".into())]), r#"{"$map":{"$bytes":"x"}}"#),
        (
            SkVariant::map([("$map", SkVariant::map([("$f64", SkVariant::Null)]))]),
            r#"{"$map":{"$map":{"$map":{"$f64":null}}}}"#,
        ),
        (SkVariant::map([("$else", "x".into())]), r#"{"$else":"x"}"#),
    ];
    for (value, text) in cases {
        assert_eq!(value.to_json().as_deref(), Ok(text));
        assert_eq!(read(text), value);
    }
}

#[test]
fn the_exact_text_keeps_every_kind() {
    let cases = [
        (SkVariant::I8(-1), r#"{"$i8":-1}"#),
        (SkVariant::I16(-1), r#"{"$i16":-1}"#),
        (SkVariant::I32(-1), r#"{"$i32":-1}"#),
        (SkVariant::I64(-1), "-1"),
        (SkVariant::U8(1), r#"{"$u8":1}"#),
        (SkVariant::U16(1), r#"{"$u16":1}"#),
        (SkVariant::U32(1), r#"{"$u32":1}"#),
        (SkVariant::U64(1), r#"{"$u64":1}"#),
        (SkVariant::U64(u64::MAX), "18446744073709551615"),
        (SkVariant::F32(0.1), r#"{"$f32":0.10000000149011612}"#),
        (SkVariant::F32(-0.0), r#"{"$f32":-0.0}"#),
    ];
    for (value, text) in cases {
        assert_eq!(value.to_json_exact().as_deref(), Ok(text));
        assert_eq!(read(text), value);
    }
    assert_eq!(SkVariant::F32(0.1).to_json().as_deref(), Ok("0.1"));
    assert_eq!(SkVariant::U8(1).to_json().as_deref(), Ok("1"));
}

#[test]
fn a_form_with_a_wrong_value_is_refused_with_its_place() {
    assert_eq!(refused(r#"{"a":[{"$i8":300}]}"#), "a[0].$i8: 300 does not fit i8");
    assert_eq!(refused(r#"{"$bytes":5}"#), "$bytes: expected text in base64, found i64");
    assert!(refused(r#"{"$bytes":"AP8"}"#).contains("no base64"));
    assert!(refused(r#"{"$bytes":"AP9="}"#).contains("no base64"), "bits after the end");
    assert!(refused(r#"{"$f64":"nan"}"#).starts_with("$f64: expected NaN"));
    assert!(refused(r#"{"$f64":"0x+ff800000000000"}"#).starts_with("$f64: expected NaN"));
    assert_eq!(refused(r#"{"$map":[]}"#), "$map: expected map, found list");
}

#[test]
fn what_is_no_json_is_refused_with_line_and_column() {
    let error = SkVariant::from_json("{\n \"a\": tru }");
    assert!(matches!(error, Err(VariantError::Text { line: 2, .. })), "{error:?}");
    for text in
        ["", " ", "NaN", "Infinity", "'a'", "[1,]", "{\"a\":1,}", "01", "1.", "1 2", "\"\\ud800\"", "{1:2}"]
    {
        refused(text);
    }
}

#[test]
fn a_repeated_key_is_refused() {
    assert_eq!(refused(r#"{"a":1,"b":2,"a":1}"#), r#"JSON, line 1, column 16: the key "a" stands twice"#);
    assert!(refused(r#"{"a":1,"\u0061":1}"#).contains("stands twice"));
}

#[test]
fn a_text_nests_64_deep_and_no_deeper() {
    let lists = |depth| "[".repeat(depth) + &"]".repeat(depth);
    let maps = |depth| "{\"a\":".repeat(depth) + "1" + &"}".repeat(depth);
    let deepest = read(&lists(64));
    assert_eq!(deepest.to_json(), Ok(lists(64)));
    read(&maps(64));
    for text in [lists(65), maps(65), lists(100_000), "[".repeat(500_000), maps(50_000)] {
        assert_eq!(refused(&text), "the nesting depth exceeds the limit of 64");
    }
    let wide = Limits { depth_max: usize::MAX, ..Limits::TEXT };
    assert!(
        SkVariant::from_json_with(&lists(65), &wide).is_err(),
        "64 is the end whatever is asked for"
    );
}

#[test]
fn a_form_counts_as_a_level_of_the_text_in_both_directions() {
    let nested =
        |depth: usize| (0..depth).fold(SkVariant::F64(f64::NAN), |below, _| SkVariant::list([below]));
    let text = nested(63).to_json().unwrap();
    assert_eq!(read(&text), nested(63));
    assert!(nested(64).to_json().is_err());
    let escaped =
        |depth: usize| (0..depth).fold(SkVariant::Null, |below, _| SkVariant::map([("$map", below)]));
    let text = escaped(32).to_json().unwrap();
    assert_eq!(read(&text), escaped(32));
    assert!(escaped(33).to_json().is_err());
}

#[test]
fn size_and_node_limits_hold() {
    let long = format!("\"{}\"", "x".repeat(1024 * 1024 - 2));
    assert_eq!(read(&long).as_str().map(str::len), Some(1024 * 1024 - 2));
    let longer = format!(" {long}");
    assert_eq!(refused(&longer), "size in bytes exceeds the limit of 1048576");
    let wide = Limits { bytes_max: 2 * 1024 * 1024, ..Limits::TEXT };
    assert!(SkVariant::from_json_with(&longer, &wide).is_ok());

    let items = |count: usize| format!("[{}0]", "0,".repeat(count - 1));
    assert!(SkVariant::from_json(&items(262_143)).is_ok());
    assert_eq!(refused(&items(262_144)), "the number of values exceeds the limit of 262144");
}

#[test]
fn objects_are_written_in_the_order_of_their_keys() {
    let hashed: std::collections::HashMap<String, i64> = (0..100).map(|n| (format!("k{n:02}"), n)).collect();
    let sorted: BTreeMap<String, i64> = hashed.clone().into_iter().collect();
    assert_eq!(SkVariant::from(hashed).to_json(), SkVariant::from(sorted).to_json());
}
