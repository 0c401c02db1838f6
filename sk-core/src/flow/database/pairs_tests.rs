//! A database against a map that knows nothing of sequence numbers.

use super::pairs::{Contents, PairDatabase, Room};
use crate::flow::limits::{DATABASE_KEYS_MAX, VALUE_BYTES_MAX};
use crate::flow::{RefusalCode, Value};
use proptest::prelude::*;
use sk_flat::SkVariant;
use std::collections::BTreeMap;

fn value(number: u8) -> Value {
    Value::new(&SkVariant::U8(number)).expect("small")
}

fn bytes(length: usize) -> Value {
    let overhead = Value::new(&SkVariant::from("")).expect("small").encoded().len();
    Value::new(&SkVariant::from("x".repeat(length - overhead))).expect("within the limit of a value")
}

#[derive(Clone, Debug)]
enum Step {
    Set(u8, u8),
    Delete(u8),
    Replace(BTreeMap<u8, u8>),
    /// A watcher reads so many changes.
    Watch(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        6 => (0..24_u8, any::<u8>()).prop_map(|(key, value)| Step::Set(key, value)),
        4 => (0..24_u8).prop_map(Step::Delete),
        1 => prop::collection::btree_map(0..24_u8, any::<u8>(), 0..12).prop_map(Step::Replace),
        3 => (1..12_usize).prop_map(Step::Watch),
    ];
    prop::collection::vec(step, 0..120)
}

/// Someone who watches from afar: what he was told, and up to where.
#[derive(Default)]
struct Watcher {
    known: BTreeMap<String, SkVariant>,
    cursor: u64,
    anew: u32,
}

impl Watcher {
    fn read(&mut self, database: &PairDatabase, changes_max: usize) {
        if !database.knows_since(self.cursor) {
            self.anew += 1;
            self.known = database
                .iter("", None)
                .map(|(key, value)| (key.to_string(), value.variant()))
                .collect();
            self.cursor = database.sequence();
        }
        for _ in 0..changes_max {
            let Some(change) = database.change_after(self.cursor) else { return };
            assert!(change.sequence > self.cursor);
            self.cursor = change.sequence;
            match change.value {
                Some(value) => drop(self.known.insert(change.key.to_owned(), value.variant())),
                None => drop(self.known.remove(change.key)),
            }
        }
    }
}

proptest! {
    #[test]
    fn s97_a_database_is_a_sorted_map_and_a_watcher_ends_up_with_all_of_it(steps in steps(), deletions in 0..6_usize) {
        let mut database = PairDatabase::with_room(1 << 40, Room { deletions, ..Room::default() });
        let mut model: BTreeMap<String, u8> = BTreeMap::new();
        let mut watcher = Watcher { cursor: 1 << 40, ..Watcher::default() };
        for step in steps {
            let before = database.sequence();
            match step {
                Step::Set(key, number) => {
                    let key = format!("k{key}");
                    prop_assert_eq!(database.set(&key, value(number)), Ok(before + 1));
                    model.insert(key, number);
                }
                Step::Delete(key) => {
                    let key = format!("k{key}");
                    let was = model.remove(&key).is_some();
                    prop_assert_eq!(database.delete(&key), was.then_some(before + 1));
                }
                Step::Replace(new) => {
                    model = new.iter().map(|(key, number)| (format!("k{key}"), *number)).collect();
                    let contents: Contents =
                        model.iter().map(|(key, number)| (key.as_str().into(), value(*number))).collect();
                    prop_assert_eq!(database.replace(&contents), Ok(()));
                }
                Step::Watch(changes) => watcher.read(&database, changes),
            }
            let held: Vec<(String, SkVariant)> =
                database.iter("", None).map(|(key, value)| (key.to_string(), value.variant())).collect();
            let expected: Vec<(String, SkVariant)> =
                model.iter().map(|(key, number)| (key.clone(), SkVariant::U8(*number))).collect();
            prop_assert_eq!(&held, &expected);
            prop_assert_eq!(database.len(), model.len());
            let bytes: usize = model.iter().map(|(key, number)| key.len() + value(*number).encoded().len()).sum();
            prop_assert_eq!(database.bytes(), bytes);
        }
        watcher.read(&database, usize::MAX);
        let expected: BTreeMap<String, SkVariant> =
            model.into_iter().map(|(key, number)| (key, SkVariant::U8(number))).collect();
        prop_assert_eq!(watcher.known, expected);
    }
}

#[test]
fn a_prefix_and_a_place_to_go_on_from() {
    let mut database = PairDatabase::new(0);
    for key in ["a", "gain.d", "gain.i", "gain.p", "gainless", "z"] {
        database.set(key, value(1)).expect("room");
    }
    let keys = |prefix: &str, after: Option<&str>| -> Vec<String> {
        database.iter(prefix, after).map(|(key, _)| key.to_string()).collect()
    };
    assert_eq!(keys("gain.", None), ["gain.d", "gain.i", "gain.p"]);
    assert_eq!(keys("gain.", Some("gain.d")), ["gain.i", "gain.p"]);
    assert_eq!(keys("gain.", Some("gain.p")), [""; 0]);
    assert_eq!(keys("gain.", Some("a")).len(), 3, "a place before the prefix");
    assert_eq!(keys("", Some("gain.p")), ["gainless", "z"]);
}

#[test]
fn variables_and_bytes_are_limited_and_a_refusal_changes_nothing() {
    let mut database = PairDatabase::with_room(0, Room { keys: 3, bytes: 100, deletions: 8 });
    for (key, fits) in [("a", true), ("b", true), ("c", true), ("d", false)] {
        assert_eq!(database.set(key, value(1)).is_ok(), fits, "{key}");
    }
    let before = database.contents();
    assert_eq!(database.set("d", value(1)), Err(RefusalCode::DatabaseFull));
    assert_eq!(database.contents(), before);
    assert!(database.set("c", value(2)).is_ok(), "a variable that is there takes no more room");
    database.delete("a");
    assert!(database.set("d", value(1)).is_ok());
    let taken = database.bytes() - value(1).encoded().len();
    for (length, fits) in [(99, true), (100, true), (101, false)] {
        assert_eq!(database.set("d", bytes(length - taken)).is_ok(), fits, "{length} bytes");
    }
    assert_eq!(database.bytes(), 100);
}

#[test]
fn a_hundred_thousand_variables_fit_and_one_more_does_not() {
    let mut database = PairDatabase::new(0);
    for index in 0..DATABASE_KEYS_MAX + 1 {
        let fits = index < DATABASE_KEYS_MAX;
        assert_eq!(database.set(&format!("{index:06}"), value(0)).is_ok(), fits, "variable {index}");
    }
}

#[test]
fn sixty_four_megabytes_fit_and_one_byte_more_does_not() {
    let mut database = PairDatabase::new(0);
    let large = bytes(VALUE_BYTES_MAX);
    for index in 0..64 {
        // The keys take their two bytes of the last one.
        let last = index == 63;
        let value = if last { bytes(VALUE_BYTES_MAX - 128) } else { large.clone() };
        assert!(database.set(&format!("{index:02}"), value).is_ok(), "variable {index}");
    }
    assert_eq!(database.bytes(), 64 << 20);
    let one_more = database.set("63", bytes(VALUE_BYTES_MAX - 127));
    assert_eq!(one_more, Err(RefusalCode::DatabaseFull));
    assert!(database.set("63", bytes(VALUE_BYTES_MAX - 129)).is_ok());
}

#[test]
fn forgotten_deletions_are_no_longer_known() {
    let mut database = PairDatabase::with_room(0, Room { deletions: 2, ..Room::default() });
    for key in ["a", "b", "c"] {
        database.set(key, value(1)).expect("room");
    }
    let seen = database.sequence();
    database.delete("a");
    database.delete("b");
    assert!(database.knows_since(seen));
    database.delete("c");
    assert!(!database.knows_since(seen), "that `a` is gone is forgotten");
    assert!(database.knows_since(seen + 1));
    assert!(!database.knows_since(database.sequence() + 1), "a number that never was");
}
