//! The strict rules between variants and Rust values, at their edges.

use bytes::{Bytes, BytesMut};
use sk_flat::{FromVariant, Instant, IntoVariant, Kind, Name, SkList, SkMap, SkVariant, VariantError};
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::fmt::Debug;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

fn problem<T: FromVariant + Debug>(value: impl IntoVariant) -> String {
    T::from_variant(&value.into_variant()).unwrap_err().to_string()
}

#[test]
fn each_primitive_has_a_kind_of_its_own() {
    let kinds = [
        ((), Kind::Null).1,
        true.into_variant().kind(),
        1i8.into_variant().kind(),
        1i16.into_variant().kind(),
        1i32.into_variant().kind(),
        1i64.into_variant().kind(),
        1u8.into_variant().kind(),
        1u16.into_variant().kind(),
        1u32.into_variant().kind(),
        1u64.into_variant().kind(),
        1f32.into_variant().kind(),
        1f64.into_variant().kind(),
        "".into_variant().kind(),
        Bytes::new().into_variant().kind(),
        Vec::<i32>::new().into_variant().kind(),
        SkMap::new().into_variant().kind(),
    ];
    assert_eq!(kinds, Kind::ALL);
    assert_eq!(().into_variant().kind(), Kind::Null);
    assert_eq!((1usize.into_variant(), 1isize.into_variant()), (SkVariant::U64(1), SkVariant::I64(1)));
}

#[test]
fn numbers_keep_their_value_or_are_refused() {
    assert_eq!(problem::<u8>(256), "256 does not fit u8");
    assert_eq!(problem::<u64>(-1), "-1 does not fit u64");
    assert_eq!(problem::<i64>(u64::MAX), "18446744073709551615 does not fit i64");
    assert_eq!(problem::<i64>(1.0), "expected i64, found f64");
    assert_eq!(problem::<f64>(u64::MAX), "18446744073709551615 does not fit f64");
    assert_eq!(problem::<f32>(16_777_217), "16777217 does not fit f32");
    assert_eq!(f32::from_variant(&SkVariant::I32(16_777_216)), Ok(16_777_216.0));
    assert_eq!(problem::<bool>(1), "expected bool, found i32");
    assert_eq!(problem::<f64>("1.0"), "expected f64, found string");
    assert_eq!(problem::<String>(1), "expected string, found i32");
}

#[test]
fn a_wide_float_becomes_the_nearest_narrow_one_unless_it_overflows() {
    assert_eq!(f32::from_variant(&SkVariant::F64(0.1)), Ok(0.1));
    assert_eq!(f32::from_variant(&SkVariant::F64(f64::INFINITY)), Ok(f32::INFINITY));
    assert!(f32::from_variant(&SkVariant::F64(f64::NAN)).unwrap().is_nan());
    assert!(matches!(f32::from_variant(&SkVariant::F64(1e39)), Err(VariantError::OutOfRange { .. })));
    assert_eq!(f64::from_variant(&SkVariant::F32(0.5)), Ok(0.5));
}

#[test]
fn accessors_follow_the_same_rules() {
    let value = SkVariant::list([SkVariant::U8(7), 1.5.into(), "x".into(), vec![1u8].into(), true.into()]);
    let at = |index| value.at(index).unwrap();
    assert_eq!((at(0).as_i64(), at(0).as_u64(), at(0).as_f64()), (Some(7), Some(7), Some(7.0)));
    assert_eq!((at(1).as_i64(), at(1).as_f64()), (None, Some(1.5)));
    assert_eq!((at(2).as_str(), at(2).as_bytes()), (Some("x"), None));
    assert_eq!(at(3).as_bytes().map(|bytes| &bytes[..]), Some(&[1u8][..]));
    assert_eq!((at(4).as_bool(), at(4).as_i64(), at(4).is_null()), (Some(true), None, false));
    assert_eq!((value.at(5), value.get("x"), at(0).at(0)), (None, None, None));
    assert_eq!(SkVariant::I64(-1).as_u64(), None);
}

#[test]
fn every_sequence_of_u8_is_bytes() {
    let bytes = SkVariant::from(Bytes::from_static(&[1, 2]));
    assert_eq!(SkVariant::from(vec![1u8, 2]), bytes);
    assert_eq!(SkVariant::from([1u8, 2]), bytes);
    assert_eq!(SkVariant::from(&[1u8, 2][..]), bytes);
    assert_eq!(SkVariant::from(BytesMut::from(&[1u8, 2][..])), bytes);
    assert_eq!(<[u8; 2]>::from_variant(&bytes), Ok([1, 2]));
    assert_eq!(
        Vec::<u8>::from_variant(&SkVariant::list([1, 2])),
        Ok(vec![1, 2]),
        "a list of numbers will do"
    );
    assert_eq!(problem::<Vec<u8>>(vec![1, 300]), "[1]: 300 does not fit u8");
    assert_eq!(problem::<Bytes>(vec![1, 2]), "expected bytes, found list");
    assert_eq!(problem::<[u8; 3]>(vec![1u8]), "expected a list of 3 items, found 1");
}

#[test]
fn bytes_go_in_and_out_without_a_copy() {
    let payload = Bytes::from(vec![7u8; 100]);
    let value = SkVariant::from(payload.clone()).clone();
    let out = Bytes::try_from(&value).unwrap();
    assert_eq!(out.as_ptr(), payload.as_ptr());
}

#[test]
fn options_pointers_and_tuples() {
    assert_eq!(SkVariant::from(Some(1)), SkVariant::I32(1));
    assert_eq!(SkVariant::from(None::<i32>), SkVariant::Null);
    assert_eq!(Option::<u8>::from_variant(&SkVariant::Null), Ok(None));
    assert_eq!(problem::<Option<u8>>("x"), "expected u8, found string");
    assert_eq!(Box::new(1).into_variant(), SkVariant::I32(1));
    assert_eq!(Arc::new(1).into_variant(), Rc::new(1).into_variant());
    assert_eq!(Rc::<i32>::from_variant(&SkVariant::I8(1)), Ok(Rc::new(1)));
    assert_eq!(<(u8, String)>::from_variant(&SkVariant::from((1, "x"))), Ok((1, "x".to_owned())));
    assert_eq!(problem::<(u8, u8)>((1, "x")), "[1]: expected u8, found string");
    assert_eq!(problem::<(u8, u8)>((1, 2, 3)), "expected a list of 2 items, found 3");
}

#[test]
fn texts_and_characters() {
    for value in
        ["ß".into_variant(), 'ß'.into_variant(), Cow::Borrowed("ß").into_variant(), (&"ß").into_variant()]
    {
        assert_eq!(value, SkVariant::from(String::from("ß")));
        assert_eq!(char::from_variant(&value), Ok('ß'));
        assert_eq!(Box::<str>::from_variant(&value), Ok("ß".into()));
    }
    assert_eq!(problem::<char>("ab"), "expected a string of one character, found one of 2");
    assert_eq!(problem::<char>(""), "expected a string of one character, found one of 0");
    assert!(problem::<Name>("A b").contains("character 'A'"));
    assert_eq!(Name::from_variant(&"a-b".into()).map(|name| name.into_variant()), Ok("a-b".into()));
}

#[test]
fn times_are_numbers() {
    assert_eq!(Duration::from_millis(250).into_variant(), SkVariant::F64(0.25));
    assert_eq!(Duration::from_variant(&SkVariant::I32(2)), Ok(Duration::from_secs(2)));
    for wrong in [-1.0, f64::NAN, f64::INFINITY, 1e30] {
        assert!(problem::<Duration>(wrong).contains("does not fit a duration in seconds"));
    }
    assert_eq!(Instant::from_variant(&Instant::FAR.into_variant()), Ok(Instant::FAR));
}

#[test]
fn hashed_containers_do_not_show_their_order() {
    let map: HashMap<String, u32> = (0..100).map(|n| (format!("k{n:02}"), n)).collect();
    let keys: Vec<String> = SkVariant::from(map).as_map().unwrap().keys().cloned().collect();
    assert!(keys.is_sorted());
    let set: HashSet<u32> = (0..100).collect();
    assert_eq!(SkVariant::from(set), SkVariant::from((0..100u32).collect::<Vec<_>>()));
}

#[test]
fn lists_and_maps_are_reached_through_their_own_types() {
    let mut map = SkMap::try_from(SkVariant::map([("a", 1.into())])).unwrap();
    map.insert("b".into(), 2.into());
    assert_eq!(SkVariant::from(map).get("b"), Some(&2.into()));
    assert_eq!(SkList::from_variant(&SkVariant::list([1])).map(|list| list.len()), Ok(1));
    assert_eq!(problem::<SkMap>(1), "expected map, found i32");
    assert_eq!(problem::<SkList>(1), "expected list, found i32");
    assert_eq!(
        problem::<HashMap<String, u8>>(HashMap::from([("k".to_owned(), -1)])),
        "k: -1 does not fit u8"
    );
}
