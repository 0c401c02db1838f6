//! The registry: what accounts may have, and what goes with what.

use super::*;
use crate::flow::{RefusalCode, Value};

fn name(text: &str) -> DatabaseName {
    DatabaseName::parse(text).expect("a name")
}

fn value(bytes: usize) -> Value {
    let overhead = Value::new(&"".into()).expect("small").encoded().len();
    Value::new(&"x".repeat(bytes - overhead).into()).expect("small")
}

#[test]
fn all_databases_of_an_account_share_its_variables_and_bytes() {
    let room = AccountRoom { databases: 2, keys: 4, bytes: 100 };
    let mut databases = Databases::with_room(room);
    let [left, right, chan] = ["flow:robot.left", "flow:robot.right", "chan:robot.imu"].map(name);
    for (number, flow) in [(1, &left), (2, &right), (3, &chan)] {
        databases.add_entity(flow.clone(), Entity::Flow(number));
    }
    for (database, key, fits) in
        [(&left, "a", true), (&right, "a", true), (&chan, "a", true), (&left, "b", true), (&chan, "b", false)]
    {
        let expected = if fits { None } else { Some(RefusalCode::DatabaseFull) };
        assert_eq!(databases.set(database, key, value(10)).err(), expected, "{key} of {database}");
    }
    assert_eq!(databases.usage("robot"), Usage { databases: 0, keys: 4, bytes: 44 });
    for (bytes, fits) in [(65, true), (66, true), (67, false)] {
        assert_eq!(databases.set(&left, "b", value(bytes)).is_ok(), fits, "{bytes} bytes more");
    }
    assert_eq!(databases.usage("robot").bytes, 100);
    databases.remove_entity(&left, Entity::Flow(1));
    assert_eq!(databases.usage("robot"), Usage { databases: 0, keys: 2, bytes: 22 });
    databases.delete(&right, "a").expect("it is there");
    assert!(databases.set(&chan, "b", value(10)).is_ok());
    let other = name("flow:other.arm");
    databases.add_entity(other.clone(), Entity::Flow(9));
    assert!(databases.set(&other, "a", value(90)).is_ok(), "another account has its own");
}

#[test]
fn an_entity_that_took_the_name_of_another_keeps_its_database() {
    let mut databases = Databases::default();
    let arm = name("flow:robot.arm");
    databases.add_entity(arm.clone(), Entity::Flow(1));
    databases.add_entity(arm.clone(), Entity::Flow(2));
    databases.set(&arm, "x", value(10)).expect("room");
    assert_eq!(databases.remove_entity(&arm, Entity::Flow(1)), None);
    assert!(databases.open(&arm).is_some());
    assert_eq!(databases.remove_entity(&arm, Entity::Flow(2)), Some(Vec::new()));
    assert!(!databases.exists(&arm));
}

#[test]
fn databases_that_come_from_the_disk_count_and_contents_nobody_waits_for_are_dropped() {
    let mut databases = Databases::with_room(AccountRoom { databases: 2, ..AccountRoom::default() });
    let saved = Saved { account: "robot".into(), durable: true, keys: 1, bytes: 11 };
    for text in ["arm", "flow:robot.arm", "user:robot"] {
        databases.found(name(text), saved.clone());
    }
    assert_eq!(databases.usage("robot").databases, 2);
    assert_eq!(databases.create(&name("leg"), "robot", false), Err(RefusalCode::TooManyDatabases));
    assert_eq!(databases.reach(&name("flow:robot.arm")), Reach::Nowhere, "there is no such flow");
    assert_eq!(databases.reach(&name("arm")), Reach::OnDisk);
    databases.expect(&name("arm"), 5);
    databases.remove(&name("arm")).expect("it was there");
    assert_eq!(databases.create(&name("arm"), "robot", false), Ok(()));
    databases.arrived(&name("arm"), 5, Some(&vec![("x".into(), value(10))]));
    assert!(
        databases.open(&name("arm")).is_some_and(|open| open.pairs.is_empty()),
        "the new one is another one"
    );
}

#[test]
fn sequence_numbers_of_different_runs_and_databases_lie_far_apart() {
    let mut numbers = std::collections::BTreeSet::new();
    for run in 0..50_u8 {
        let mut databases = Databases::default();
        databases.stir(&[run; 32]);
        for text in ["arm", "leg", "head"] {
            databases.create(&name(text), "robot", false).expect("room");
            let open = databases.open(&name(text)).expect("just made");
            assert!(numbers.insert(open.pairs.sequence() >> 40), "{text} of run {run}");
        }
    }
}
