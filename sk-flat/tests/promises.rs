//! What the papers promise of variants, by its number.

use bytes::Bytes;
use sk_flat::SkVariant;

fn one_of_each_kind() -> Vec<SkVariant> {
    vec![
        SkVariant::Null,
        SkVariant::Bool(true),
        SkVariant::I8(i8::MIN),
        SkVariant::I16(i16::MIN),
        SkVariant::I32(i32::MIN),
        SkVariant::I64(i64::MIN),
        SkVariant::U8(u8::MAX),
        SkVariant::U16(u16::MAX),
        SkVariant::U32(u32::MAX),
        SkVariant::U64(u64::MAX),
        SkVariant::F32(f32::MIN_POSITIVE),
        SkVariant::F64(-0.0),
        SkVariant::F64(f64::NAN),
        SkVariant::from("naïve \u{0} \u{1f916}"),
        SkVariant::from(Bytes::from_static(&[0, 255, 128])),
    ]
}

fn nested() -> SkVariant {
    let kinds = one_of_each_kind();
    SkVariant::map([
        ("all", SkVariant::list(kinds.clone())),
        (
            "again",
            SkVariant::map(kinds.into_iter().enumerate().map(|(i, kind)| (format!("k{i}"), kind))),
        ),
    ])
}

#[test]
fn s64_every_kind_of_variant_survives_a_round_trip() {
    for value in one_of_each_kind().into_iter().chain([nested()]) {
        let bytes = value.encode().unwrap();
        assert_eq!(SkVariant::decode(&bytes).unwrap(), value, "binary");
        let exact = value.to_json_exact().unwrap();
        assert_eq!(SkVariant::from_json(&exact).unwrap(), value, "exact JSON: {exact}");
    }
}

#[test]
fn s65_json_is_lossless_where_json_can() {
    // What JSON has, there and back, text for text.
    let text = r#"{"a":[1,-2,2.5,true,null,"x"],"b":{"c":9007199254740993,"d":18446744073709551615}}"#;
    assert_eq!(SkVariant::from_json(text).unwrap().to_json().unwrap(), text);
    // What it has not is written by rule, and read back as what it was.
    let bytes = SkVariant::from(Bytes::from_static(b"\x01\x02"));
    let not_a_number = SkVariant::F64(f64::NAN);
    for value in [bytes, not_a_number, SkVariant::F64(f64::INFINITY)] {
        let json = value.to_json().unwrap();
        assert!(json.contains('$'), "a reserved key says what it is: {json}");
        assert_eq!(SkVariant::from_json(&json).unwrap(), value);
    }
    // A map that really has such a key is not taken for one.
    let honest = SkVariant::map([("$bytes", "not base64 at all".into())]);
    assert_eq!(SkVariant::from_json(&honest.to_json().unwrap()).unwrap(), honest);
}
