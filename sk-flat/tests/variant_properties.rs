//! Properties of variants over generated values: every form gives the value back.

use bytes::Bytes;
use proptest::prelude::*;
use sk_flat::variant::{from_variant_serde, to_variant};
use sk_flat::{FromVariant, IntoVariant, SkVariant};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet, LinkedList, VecDeque};

fn scalar() -> impl Strategy<Value = SkVariant> {
    prop_oneof![
        Just(SkVariant::Null),
        any::<bool>().prop_map(SkVariant::Bool),
        any::<i8>().prop_map(SkVariant::I8),
        any::<i16>().prop_map(SkVariant::I16),
        any::<i32>().prop_map(SkVariant::I32),
        any::<i64>().prop_map(SkVariant::I64),
        any::<u8>().prop_map(SkVariant::U8),
        any::<u16>().prop_map(SkVariant::U16),
        any::<u32>().prop_map(SkVariant::U32),
        any::<u64>().prop_map(SkVariant::U64),
        // By their bits, so that every NaN, infinity and subnormal is met.
        any::<u32>().prop_map(|bits| SkVariant::F32(f32::from_bits(bits))),
        any::<u64>().prop_map(|bits| SkVariant::F64(f64::from_bits(bits))),
        prop::sample::select(vec![0.0, -0.0, 0.1, f32::MAX, f32::NAN, f32::INFINITY])
            .prop_map(SkVariant::F32),
        prop::sample::select(vec![0.0, -0.0, 0.1, f64::MAX, f64::NAN, f64::NEG_INFINITY])
            .prop_map(SkVariant::F64),
        any::<String>().prop_map(SkVariant::from),
        prop::collection::vec(any::<u8>(), 0..20).prop_map(SkVariant::from),
    ]
}

fn key() -> impl Strategy<Value = String> {
    let reserved = prop::sample::select(vec!["$bytes", "$map", "$f64", "$f32", "$i8", "$u64", "$", "$other"]);
    prop_oneof![any::<String>(), "[a-c]", reserved.prop_map(str::to_owned)]
}

fn variant() -> impl Strategy<Value = SkVariant> {
    scalar().prop_recursive(6, 48, 6, |below| {
        prop_oneof![
            prop::collection::vec(below.clone(), 0..6).prop_map(SkVariant::from),
            prop::collection::btree_map(key(), below, 0..4).prop_map(SkVariant::from),
        ]
    })
}

/// What the rule of the plain JSON says about the value that comes back.
fn as_plain_json_gives_it(value: &SkVariant) -> SkVariant {
    match value {
        SkVariant::F32(x) if x.is_finite() => {
            // Of two shortest texts halfway on either side, one or the other: both mean this very number.
            let read: f64 = serde_json::to_string(x).unwrap().parse().unwrap();
            assert_eq!(read as f32, *x);
            SkVariant::F64(read)
        }
        SkVariant::List(list) => SkVariant::List(list.iter().map(as_plain_json_gives_it).collect()),
        SkVariant::Map(map) => {
            SkVariant::map(map.iter().map(|(key, value)| (key.clone(), as_plain_json_gives_it(value))))
        }
        other => match (i64::from_variant(other), u64::from_variant(other)) {
            (Ok(n), _) => SkVariant::I64(n),
            (_, Ok(n)) => SkVariant::U64(n),
            _ => other.clone(),
        },
    }
}

proptest! {
    #[test]
    fn the_binary_form_gives_the_value_back(value in variant()) {
        let form = value.encode().unwrap();
        prop_assert_eq!(value.encoded_len(), Ok(form.len()));
        prop_assert_eq!(SkVariant::decode(&form), Ok(value.clone()));
        prop_assert_eq!(SkVariant::decode_from(&Bytes::from(form)), Ok(value));
    }

    #[test]
    fn damaged_bytes_are_refused_or_canonical(
        value in variant(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), 0..4u8, any::<u8>()), 1..5),
    ) {
        let mut form = value.encode().unwrap();
        for (place, how, byte) in damage {
            let at = place.index(form.len() + 1);
            match how {
                0 => form.insert(at, byte),
                1 if at < form.len() => drop(form.remove(at)),
                2 => form.truncate(at),
                _ if at < form.len() => form[at] = byte,
                _ => form.push(byte),
            }
        }
        if let Ok(read) = SkVariant::decode(&form) {
            prop_assert_eq!(read.encode(), Ok(form));
        }
    }

    #[test]
    fn the_exact_json_gives_the_value_back(value in variant()) {
        prop_assert_eq!(SkVariant::from_json(&value.to_json_exact().unwrap()), Ok(value));
    }

    #[test]
    fn the_plain_json_gives_back_what_its_rule_says(value in variant()) {
        let expected = as_plain_json_gives_it(&value);
        prop_assert_eq!(SkVariant::from_json(&value.to_json().unwrap()), Ok(expected.clone()));
        prop_assert_eq!(SkVariant::from_json(&value.to_json_pretty().unwrap()), Ok(expected));
    }

    #[test]
    fn any_text_is_refused_or_read_stably(text in "[\\[\\]{}\",:0-9.eE+\\-$a-z\\\\ ]{0,40}") {
        if let Ok(value) = SkVariant::from_json(&text) {
            prop_assert_eq!(SkVariant::from_json(&value.to_json_exact().unwrap()), Ok(value));
        }
    }

    #[test]
    fn serde_gives_the_value_back(value in variant()) {
        prop_assert_eq!(&to_variant(&value).unwrap(), &value);
        prop_assert_eq!(from_variant_serde::<SkVariant>(&value).unwrap(), value);
    }

    #[test]
    fn a_clone_is_equal_and_its_change_stays_its_own(value in variant()) {
        let mut twin = value.clone();
        prop_assert_eq!(&twin, &value);
        let form = value.encode().unwrap();
        if let Some(list) = twin.as_list_mut() {
            list.push(SkVariant::Null);
        } else if let Some(map) = twin.as_map_mut() {
            map.insert("a key that none has".into(), SkVariant::Null);
        } else {
            twin = SkVariant::list([twin]);
        }
        prop_assert_ne!(&twin, &value);
        prop_assert_eq!(value.encode().unwrap(), form);
    }

    #[test]
    fn integers_convert_exactly_or_not_at_all(n in any::<i64>(), shift in 0..64u32) {
        let n = n >> shift;
        let value = SkVariant::I64(n);
        prop_assert_eq!(i8::from_variant(&value).ok(), i8::try_from(n).ok());
        prop_assert_eq!(i32::from_variant(&value).ok(), i32::try_from(n).ok());
        prop_assert_eq!(u16::from_variant(&value).ok(), u16::try_from(n).ok());
        prop_assert_eq!(u64::from_variant(&value).ok(), u64::try_from(n).ok());
        prop_assert_eq!(usize::from_variant(&value).ok(), usize::try_from(n).ok());
        match f64::from_variant(&value) {
            Ok(x) => prop_assert_eq!(x as i128, i128::from(n)),
            Err(_) => prop_assert_ne!(n as f64 as i128, i128::from(n)),
        }
        match f32::from_variant(&value) {
            Ok(x) => prop_assert_eq!(x as i128, i128::from(n)),
            Err(_) => prop_assert_ne!(n as f32 as i128, i128::from(n)),
        }
    }

    #[test]
    fn standard_containers_come_back_unchanged(
        numbers in prop::collection::vec(any::<i32>(), 0..20),
        texts in prop::collection::btree_map(any::<String>(), any::<f64>(), 0..10),
        raw in prop::collection::vec(any::<u8>(), 0..20),
    ) {
        fn back<T: IntoVariant + FromVariant + Clone + PartialEq + std::fmt::Debug>(value: &T) {
            assert_eq!(T::from_variant(&value.clone().into_variant()).as_ref(), Ok(value));
        }
        back(&numbers);
        back(&numbers.iter().copied().collect::<VecDeque<_>>());
        back(&numbers.iter().copied().collect::<LinkedList<_>>());
        back(&numbers.iter().copied().collect::<BTreeSet<_>>());
        back(&numbers.iter().copied().collect::<HashSet<_>>());
        back(&texts);
        back(&texts.clone().into_iter().collect::<HashMap<_, _>>());
        back(&texts.keys().cloned().map(Some).chain([None]).collect::<Vec<_>>());
        back(&raw);
        back(&Bytes::from(raw.clone()));
        back(&(raw.clone(), numbers.clone(), 'ß', (), true));
        prop_assert_eq!(raw.into_variant().kind(), sk_flat::Kind::Bytes);
        let back: BTreeMap<String, f64> = SkVariant::from(texts.clone()).try_into().unwrap();
        prop_assert_eq!(back, texts);
    }
}
