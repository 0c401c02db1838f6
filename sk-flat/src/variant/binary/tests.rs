use crate::{SkVariant, VariantError};
use bytes::Bytes;

#[test]
fn every_kind_has_its_documented_bytes() {
    let vectors: [(SkVariant, &[u8]); 16] = [
        (SkVariant::Null, &[0]),
        (SkVariant::Bool(true), &[1, 1]),
        (SkVariant::I8(-2), &[2, 0xfe]),
        (SkVariant::I16(-2), &[3, 0xfe, 0xff]),
        (SkVariant::I32(1), &[4, 1, 0, 0, 0]),
        (SkVariant::I64(-1), &[5, 255, 255, 255, 255, 255, 255, 255, 255]),
        (SkVariant::U8(7), &[6, 7]),
        (SkVariant::U16(0x0102), &[7, 2, 1]),
        (SkVariant::U32(0x0102_0304), &[8, 4, 3, 2, 1]),
        (SkVariant::U64(1), &[9, 1, 0, 0, 0, 0, 0, 0, 0]),
        (SkVariant::F32(1.0), &[10, 0, 0, 0x80, 0x3f]),
        (SkVariant::F64(-0.0), &[11, 0, 0, 0, 0, 0, 0, 0, 0x80]),
        (SkVariant::from("ü"), &[12, 2, 0, 0, 0, 0xc3, 0xbc]),
        (SkVariant::from(Bytes::from_static(&[9])), &[13, 1, 0, 0, 0, 9]),
        (SkVariant::list([SkVariant::Null]), &[14, 1, 0, 0, 0, 0]),
        (
            SkVariant::map([("b", SkVariant::Null), ("a", SkVariant::Bool(false))]),
            &[15, 2, 0, 0, 0, 1, 0, 0, 0, b'a', 1, 0, 1, 0, 0, 0, b'b', 0],
        ),
    ];
    for (value, form) in vectors {
        assert_eq!(value.encode().as_deref(), Ok(form), "{value:?}");
        assert_eq!(value.encoded_len(), Ok(form.len()));
        assert_eq!(SkVariant::decode(form), Ok(value));
    }
}

fn refused(form: &[u8]) -> VariantError {
    match SkVariant::decode(form) {
        Ok(value) => panic!("{form:?} was read as {value:?}"),
        Err(error) => error,
    }
}

#[test]
fn a_form_that_the_encoder_does_not_write_is_refused() {
    let malformed = |at, what| VariantError::Malformed { at, what };
    assert_eq!(refused(&[1, 2]), malformed(1, "a bool is 0 or 1"));
    assert_eq!(refused(&[16]), malformed(0, "unknown kind"));
    assert_eq!(refused(&[0, 0]), malformed(1, "bytes follow the value"));
    assert_eq!(refused(&[12, 2, 0, 0, 0, b'a', 0xff]), malformed(6, "a text is not UTF-8"));
    let map = |first: u8, second: u8| [15, 2, 0, 0, 0, 1, 0, 0, 0, first, 0, 1, 0, 0, 0, second, 0];
    assert!(SkVariant::decode(&map(b'a', b'b')).is_ok());
    assert_eq!(refused(&map(b'a', b'a')), malformed(11, "a key is repeated or out of order"));
    assert_eq!(refused(&map(b'b', b'a')), malformed(11, "a key is repeated or out of order"));
}

#[test]
fn every_cut_of_a_form_is_truncated() {
    let value = SkVariant::map([
        ("list", SkVariant::list([1.5, 2.5])),
        ("text", "hello".into()),
        ("raw", Bytes::from_static(b"abc").into()),
    ]);
    let form = value.encode().unwrap();
    for cut in 0..form.len() {
        assert!(matches!(refused(&form[..cut]), VariantError::Truncated { .. }), "cut at {cut}");
    }
}

#[test]
fn an_announced_length_is_not_believed() {
    for kind in [12, 13, 14, 15] {
        let error = refused(&[kind, 255, 255, 255, 255]);
        assert!(matches!(error, VariantError::Truncated { at: 5, left: 0, .. }), "{error}");
    }
}

fn nested(depth: usize) -> SkVariant {
    (0..depth).fold(SkVariant::Null, |below, _| SkVariant::list([below]))
}

#[test]
fn lists_nest_64_deep_and_no_deeper() {
    let form = nested(64).encode().unwrap();
    assert_eq!(SkVariant::decode(&form), Ok(nested(64)));
    let too_deep = VariantError::Limit { what: "the nesting depth", max: 64 };
    assert_eq!(nested(65).encode(), Err(too_deep.clone()));
    assert_eq!(nested(100_000).encode(), Err(too_deep.clone()));
    let mut deeper = vec![14, 1, 0, 0, 0];
    deeper.extend_from_slice(&form);
    assert_eq!(refused(&deeper), too_deep);
}

#[test]
fn nodes_and_bytes_are_counted_before_they_cost() {
    let many = SkVariant::list(vec![SkVariant::Null; 262_144]);
    let too_many = VariantError::Limit { what: "the number of values", max: 262_144 };
    assert_eq!(many.encode(), Err(too_many.clone()));
    let mut form = vec![14];
    form.extend_from_slice(&262_144u32.to_le_bytes());
    form.resize(5 + 262_144, 0);
    assert_eq!(refused(&form), too_many);
    form.pop();
    form[1..5].copy_from_slice(&262_143u32.to_le_bytes());
    assert!(SkVariant::decode(&form).is_ok());

    let large = SkVariant::from(vec![0u8; 16 * 1024 * 1024 - 5]);
    assert!(large.encoded_len().is_ok());
    let larger = SkVariant::from(vec![0u8; 16 * 1024 * 1024 - 4]);
    assert!(matches!(larger.encode(), Err(VariantError::Limit { .. })));
}

#[test]
fn a_value_that_is_refused_leaves_the_output_as_it_was() {
    let mut out = vec![1, 2, 3];
    assert!(nested(65).encode_into(&mut out).is_err());
    assert_eq!(out, [1, 2, 3]);
}

#[test]
fn decoded_bytes_share_the_memory_of_the_form() {
    let form = Bytes::from(SkVariant::list([Bytes::from_static(b"payload")]).encode().unwrap());
    let value = SkVariant::decode_from(&form).unwrap();
    let payload = value.at(0).and_then(SkVariant::as_bytes).unwrap();
    assert!(form.as_ptr_range().contains(&payload.as_ptr()));
    assert_eq!(&payload[..], b"payload");
}
