//! Databases by command: what each does, on both kinds of connection, for whom, and where it ends.

use super::*;
use crate::flow::Value;

fn binary(variant: impl Into<SkVariant>) -> Value {
    Value::new(&variant.into()).expect("small")
}

fn select(name: &str) -> Command {
    Command::DbSelect { database: name.into() }
}

fn create(name: &str) -> Command {
    Command::DbCreate { database: name.into(), durable: 0 }
}

fn set(key: &str, value: impl Into<SkVariant>) -> Command {
    Command::VarSet { key: key.into(), value: binary(value) }
}

fn get(key: &str) -> Command {
    Command::VarGet { key: key.into(), form: Form::Binary }
}

fn keys(prefix: &str) -> Command {
    Command::DbKeys { prefix: prefix.into() }
}

fn key_listed(key: &str) -> Event {
    Event::KeyListed { key: key.into() }
}

fn refused(code: RefusalCode) -> Vec<Event> {
    vec![Event::Refused { code: code.code(), text: code.to_string() }]
}

fn guest(rights: &[crate::flow::Right]) -> Origin {
    Origin::Inside { rights: rights.iter().fold(Rights::NONE, |all, right| all.with(*right)) }
}

/// What every kind of connection can do with a named database, and what it is answered.
fn works_through_all_commands(hub: &mut ServerCore, mut raw: Raw, name: &str) {
    let exists = Command::DbExists { database: name.into() };
    let has = Command::VarHas { key: "gain.p".into() };
    let delete = Command::VarDelete { key: "gain.p".into() };
    assert_eq!(raw.ask(hub, &get("gain.p")), refused(RefusalCode::NoDatabase));
    assert_eq!(raw.ask(hub, &exists), [Event::Flag { value: 0 }]);
    assert_eq!(raw.ask(hub, &select(name)), refused(RefusalCode::NoSuchDatabase));
    assert_eq!(raw.ask(hub, &create(name)), [Event::Done {}]);
    assert_eq!(raw.ask(hub, &create(name)), refused(RefusalCode::Exists));
    assert_eq!(raw.ask(hub, &exists), [Event::Flag { value: 1 }]);
    assert_eq!(raw.ask(hub, &select(name)), [Event::DatabaseSelected { database: name.into() }]);
    assert_eq!(raw.ask(hub, &has), [Event::Flag { value: 0 }]);
    assert_eq!(raw.ask(hub, &get("gain.p")), refused(RefusalCode::NoSuchVariable));
    assert_eq!(raw.ask(hub, &delete), [Event::Done {}], "deleting what is not there is no error");
    for (key, value) in [("gain.p", 1.5), ("gain.i", 0.1), ("gainless", 0.0)] {
        assert_eq!(raw.ask(hub, &set(key, value)), [Event::Done {}]);
    }
    assert_eq!(raw.ask(hub, &has), [Event::Flag { value: 1 }]);
    assert_eq!(raw.ask(hub, &get("gain.p")), [Event::Value { value: binary(1.5) }]);
    assert_eq!(
        raw.ask(hub, &keys("gain.")),
        [key_listed("gain.i"), key_listed("gain.p"), Event::ListEnd { count: 2 }]
    );
    let all = Command::DbAll { prefix: "gainl".into(), form: Form::Binary };
    let variable = Event::Variable { key: "gainless".into(), value: binary(0.0) };
    assert_eq!(raw.ask(hub, &all), [variable, Event::ListEnd { count: 1 }]);
    let list = Command::DbList { prefix: name.into() };
    let (database, bytes) = (name.to_owned(), 6 + 6 + 8 + 3 * 9);
    let listed = Event::DatabaseListed { database, durable: 0, variables: 3, bytes };
    assert_eq!(raw.ask(hub, &list), [listed, Event::ListEnd { count: 1 }]);
    assert_eq!(raw.ask(hub, &delete), [Event::Done {}]);
    assert_eq!(raw.ask(hub, &get("gain.p")), refused(RefusalCode::NoSuchVariable));
    assert_eq!(raw.ask(hub, &Command::DbSave {}), refused(RefusalCode::NotOffered), "there is no disk");
    assert_eq!(raw.ask(hub, &Command::DbLoad {}), refused(RefusalCode::NoSuchDatabase));
    raw.send(hub, 5, &Command::DbRemove { database: name.into() });
    let events = raw.read(hub);
    assert_eq!(tagged(&events, 5), [Event::Saved {}]);
    assert_eq!(tagged(&events, 0), [Event::DatabaseSelected { database: String::new() }]);
    assert_eq!(raw.ask(hub, &get("gainless")), refused(RefusalCode::NoDatabase));
}

#[test]
fn s101_every_command_works_on_synchronous_connections_and_on_flows() {
    let mut hub = hub();
    let raw = Raw::synchronous(&mut hub, OWNER);
    works_through_all_commands(&mut hub, raw, "synchronous");
    let raw = Raw::flow(&mut hub, OWNER);
    works_through_all_commands(&mut hub, raw, "of_a_flow");
}

#[test]
fn s66_json_has_the_same_effect_and_the_answer_comes_in_the_form_that_was_asked_for() {
    let mut hub = hub();
    let mut raw = Raw::flow(&mut hub, OWNER);
    raw.ask(&mut hub, &create("arm"));
    raw.ask(&mut hub, &select("arm"));
    let variant = SkVariant::map([("on", true.into()), ("p", 1.5.into())]);
    let json = Value::from_json(r#"{"p": 1.5, "on": true}"#).expect("JSON");
    let values = [("binary", binary(variant.clone())), ("json", json)];
    for (key, value) in &values {
        let set = Command::VarSet { key: (*key).into(), value: value.clone() };
        assert_eq!(raw.ask(&mut hub, &set), [Event::Done {}]);
    }
    for (key, _) in &values {
        for form in [Form::Binary, Form::Json] {
            let expected = binary(variant.clone()).in_form(form);
            let got = raw.ask(&mut hub, &Command::VarGet { key: (*key).into(), form });
            assert_eq!(got, [Event::Value { value: expected.clone() }]);
            let all = raw.ask(&mut hub, &Command::DbAll { prefix: (*key).into(), form });
            assert_eq!(all[0], Event::Variable { key: (*key).into(), value: expected.clone() });
            let watch = Command::Watch { database: "arm".into(), prefix: (*key).into(), after: 0, form };
            let watched = raw.ask(&mut hub, &watch);
            assert!(
                matches!(&watched[0], Event::Changed { value, .. } if *value == expected),
                "{watched:?} for {form:?}"
            );
            raw.ask(&mut hub, &Command::Unwatch { watch: 79 });
        }
    }
}

#[test]
fn a_value_that_is_too_long_as_json_is_refused_or_comes_as_a_variant() {
    let mut hub = hub();
    let mut raw = Raw::synchronous(&mut hub, OWNER);
    raw.ask(&mut hub, &create("arm"));
    raw.ask(&mut hub, &select("arm"));
    let long = binary("\u{1}".repeat(VALUE_BYTES_MAX / 2));
    raw.ask(&mut hub, &Command::VarSet { key: "long".into(), value: long.clone() });
    let get = |form| Command::VarGet { key: "long".into(), form };
    assert_eq!(raw.ask(&mut hub, &get(Form::Json)), refused(RefusalCode::TooLong));
    assert_eq!(raw.ask(&mut hub, &get(Form::Binary)), [Event::Value { value: long.clone() }]);
    let all = raw.ask(&mut hub, &Command::DbAll { prefix: String::new(), form: Form::Json });
    assert_eq!(all[0], Event::Variable { key: "long".into(), value: long });
}

#[test]
fn s102_each_connection_has_its_own_current_database() {
    let mut hub = hub();
    let mut first = Raw::synchronous(&mut hub, OWNER);
    let mut second = Raw::flow(&mut hub, OWNER);
    for name in ["arm", "leg"] {
        first.ask(&mut hub, &create(name));
    }
    first.ask(&mut hub, &select("arm"));
    second.ask(&mut hub, &select("leg"));
    first.ask(&mut hub, &set("x", 1_u8));
    second.ask(&mut hub, &set("x", 2_u8));
    assert_eq!(first.ask(&mut hub, &get("x")), [Event::Value { value: binary(1_u8) }]);
    first.ask(&mut hub, &select("leg"));
    assert_eq!(first.ask(&mut hub, &get("x")), [Event::Value { value: binary(2_u8) }]);
    for none in ["nothing", "No Name"] {
        first.ask(&mut hub, &select("arm"));
        first.send(&mut hub, 5, &select(none));
        first.send(&mut hub, 6, &set("x", 9_u8));
        assert_eq!(
            refusal(&first.read(&mut hub), 6),
            Some(RefusalCode::NoDatabase),
            "it must not act on `arm`"
        );
    }
}

#[test]
fn s106_a_database_removed_is_told_to_those_who_had_it_selected_and_to_nobody_else() {
    let mut hub = hub();
    let [mut one, mut other, mut third] = [(); 3].map(|()| Raw::flow(&mut hub, OWNER));
    for name in ["arm", "leg"] {
        one.ask(&mut hub, &create(name));
    }
    for (raw, name) in [(&mut one, "arm"), (&mut other, "arm"), (&mut third, "leg")] {
        raw.ask(&mut hub, &select(name));
    }
    third.ask(&mut hub, &Command::DbRemove { database: "arm".into() });
    let none = Event::DatabaseSelected { database: String::new() };
    for raw in [&mut one, &mut other] {
        assert_eq!(messages(raw.read(&mut hub)), std::slice::from_ref(&none));
    }
    assert_eq!(messages(third.read(&mut hub)), []);
    assert_eq!(other.ask(&mut hub, &set("x", 1)), refused(RefusalCode::NoDatabase));
    other.ask(&mut hub, &create("arm"));
    assert_eq!(other.ask(&mut hub, &get("x")), refused(RefusalCode::NoDatabase), "until one is selected");
}

#[test]
fn s98_a_flows_database_has_what_the_hub_knows_and_what_the_flow_adds_and_dies_with_it() {
    let mut hub = hub();
    let mut arm = Raw::flow(&mut hub, OWNER);
    let name = format!("flow:robot.flow-{}", arm.id.wire());
    assert_eq!(arm.ask(&mut hub, &select(&name)), [Event::DatabaseSelected { database: name.clone() }]);
    arm.ask(&mut hub, &set("pulse.interval_ms", 5_u8));
    let mut reader = Raw::synchronous(&mut hub, OWNER);
    reader.ask(&mut hub, &select(&name));
    for (key, value) in [
        ("hub.user", SkVariant::from("robot")),
        ("hub.peer", SkVariant::from("local user 1000")),
        ("hub.connection", SkVariant::from(arm.id.wire())),
        ("hub.channels", SkVariant::from(0_u64)),
        ("pulse.interval_ms", SkVariant::from(5_u8)),
    ] {
        assert_eq!(reader.ask(&mut hub, &get(key)), [Event::Value { value: binary(value) }], "{key}");
    }
    arm.create(&mut hub, "imu");
    assert_eq!(reader.ask(&mut hub, &get("hub.channels")), [Event::Value { value: binary(1_u64) }]);
    let listed = reader.ask(&mut hub, &keys(""));
    assert_eq!(listed.len(), 13 + 1 + 1, "{listed:?}");
    assert!(listed.is_sorted_by_key(|event| match event {
        Event::KeyListed { key } => key.clone(),
        _ => "\u{ff}".to_owned(),
    }));
    assert_eq!(arm.ask(&mut hub, &set("hub.user", "root")), refused(RefusalCode::Denied));
    hub.left(arm.id, at(0));
    reader.read(&mut hub);
    assert_eq!(reader.ask(&mut hub, &get("hub.user")), refused(RefusalCode::NoDatabase));
    assert_eq!(reader.ask(&mut hub, &select(&name)), refused(RefusalCode::NoSuchDatabase));
}

#[test]
fn s100_every_channel_has_a_database_about_its_content_and_use() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut reader = Raw::flow(&mut hub, OWNER);
    reader.ask(&mut hub, &select("chan:robot.imu"));
    reader.subscribe(&mut hub, channel);
    for (key, value) in [
        ("hub.kind", SkVariant::from("stream")),
        ("hub.owner", SkVariant::from(owner.id.wire())),
        ("hub.subscribers", SkVariant::from(1_u64)),
        ("hub.properties", no_properties().variant()),
    ] {
        assert_eq!(reader.ask(&mut hub, &get(key)), [Event::Value { value: binary(value) }], "{key}");
    }
    owner.ask(&mut hub, &select("chan:robot.imu"));
    assert_eq!(owner.ask(&mut hub, &set("mounted", "left")), [Event::Done {}]);
    assert_eq!(reader.ask(&mut hub, &get("mounted")), [Event::Value { value: binary("left") }]);
    owner.send(&mut hub, 4, &Command::RemoveChannel { channel });
    let events = reader.read(&mut hub);
    assert!(messages(events).contains(&Event::DatabaseSelected { database: String::new() }));
    owner.create(&mut hub, "imu");
    owner.ask(&mut hub, &select("chan:robot.imu"));
    assert_eq!(owner.ask(&mut hub, &get("mounted")), refused(RefusalCode::NoSuchVariable));
}

#[test]
fn s99_an_account_has_a_database_that_only_administrators_write() {
    use crate::flow::Right::{DatabaseRead, DatabaseWrite};
    let mut hub = hub();
    let mut admin = Raw::flow(&mut hub, OWNER);
    admin.ask(&mut hub, &select("user:robot"));
    assert_eq!(admin.ask(&mut hub, &set("mail", "robot@lab")), [Event::Done {}]);
    let mut guest = Raw::flow(&mut hub, guest(&[DatabaseRead, DatabaseWrite]));
    guest.ask(&mut hub, &select("user:robot"));
    assert_eq!(guest.ask(&mut hub, &get("mail")), [Event::Value { value: binary("robot@lab") }]);
    assert_eq!(guest.ask(&mut hub, &get("hub.flows")), [Event::Value { value: binary(2_u64) }]);
    assert_eq!(guest.ask(&mut hub, &set("right.publish", "*")), refused(RefusalCode::Denied));
    assert_eq!(admin.ask(&mut hub, &select("user:nobody")), refused(RefusalCode::NoSuchDatabase));
}

#[test]
fn flows_write_their_own_database_and_owners_those_of_their_channels() {
    use crate::flow::Right::{DatabaseRead, DatabaseWrite, Publish};
    let mut hub = hub();
    let [mut one, mut other] =
        [(); 2].map(|()| Raw::flow(&mut hub, guest(&[DatabaseRead, DatabaseWrite, Publish])));
    let mut reader = Raw::flow(&mut hub, guest(&[DatabaseRead]));
    one.create(&mut hub, "imu");
    other.read(&mut hub);
    let flow = format!("flow:robot.flow-{}", one.id.wire());
    for name in [flow.as_str(), "chan:robot.imu"] {
        for raw in [&mut one, &mut other] {
            raw.ask(&mut hub, &select(name));
        }
        assert_eq!(one.ask(&mut hub, &set("x", 1_u8)), [Event::Done {}], "{name}");
        assert_eq!(other.ask(&mut hub, &set("x", 2_u8)), refused(RefusalCode::Denied), "{name}");
        assert_eq!(
            other.ask(&mut hub, &Command::VarDelete { key: "x".into() }),
            refused(RefusalCode::Denied)
        );
        assert_eq!(other.ask(&mut hub, &get("x")), [Event::Value { value: binary(1_u8) }], "{name}");
    }
    one.ask(&mut hub, &create("shared"));
    for raw in [&mut one, &mut other, &mut reader] {
        raw.ask(&mut hub, &select("shared"));
    }
    assert_eq!(other.ask(&mut hub, &set("x", 2_u8)), [Event::Done {}]);
    assert_eq!(reader.ask(&mut hub, &set("x", 3_u8)), refused(RefusalCode::Denied));
    assert_eq!(
        reader.ask(&mut hub, &Command::DbRemove { database: "shared".into() }),
        refused(RefusalCode::Denied)
    );
}

#[test]
fn names_and_keys_outside_the_alphabet_are_refused() {
    let mut hub = hub();
    let mut raw = Raw::synchronous(&mut hub, OWNER);
    for name in ["Arm", "a b", "../arm", "disk:arm", "user:", &"n".repeat(255).replacen('n', ":", 1)] {
        assert_eq!(raw.ask(&mut hub, &create(name)), refused(RefusalCode::BadName), "{name}");
        assert_eq!(raw.ask(&mut hub, &select(name)), refused(RefusalCode::BadName), "{name}");
    }
    for name in ["flow:robot.x", "user:robot", "chan:robot.x"] {
        assert_eq!(raw.ask(&mut hub, &create(name)), refused(RefusalCode::BadName), "{name}");
    }
    raw.ask(&mut hub, &create("arm"));
    raw.ask(&mut hub, &select("arm"));
    for key in ["", "a\nb", "\0"] {
        assert_eq!(raw.ask(&mut hub, &set(key, 1)), refused(RefusalCode::BadKey), "{key:?}");
        assert_eq!(raw.ask(&mut hub, &get(key)), refused(RefusalCode::BadKey), "{key:?}");
    }
    assert_eq!(raw.ask(&mut hub, &set(&"k".repeat(255), 1)), [Event::Done {}]);
    assert_eq!(hub.spurious(), 0);
}

#[test]
fn an_account_has_at_most_64_databases_by_name() {
    let mut hub = hub();
    let mut raw = Raw::synchronous(&mut hub, OWNER);
    for index in 0..DATABASES_PER_ACCOUNT_MAX + 1 {
        let expected = match index < DATABASES_PER_ACCOUNT_MAX {
            true => vec![Event::Done {}],
            false => refused(RefusalCode::TooManyDatabases),
        };
        assert_eq!(raw.ask(&mut hub, &create(&format!("d{index}"))), expected, "database {index}");
    }
    raw.ask(&mut hub, &Command::DbRemove { database: "d7".into() });
    assert_eq!(raw.ask(&mut hub, &create("more")), [Event::Done {}]);
}

#[test]
fn with_the_tag_0_only_a_refusal_answers_a_set() {
    let mut hub = hub();
    let mut raw = Raw::flow(&mut hub, OWNER);
    raw.ask(&mut hub, &create("arm"));
    raw.ask(&mut hub, &select("arm"));
    raw.send(&mut hub, 0, &set("x", 1_u8));
    assert_eq!(messages(raw.read(&mut hub)), []);
    raw.send(&mut hub, 0, &set("", 1_u8));
    assert_eq!(messages(raw.read(&mut hub)), refused(RefusalCode::BadKey));
    assert_eq!(raw.ask(&mut hub, &get("x")), [Event::Value { value: binary(1_u8) }]);
}

#[test]
fn a_long_list_waits_for_its_reader_and_later_commands_wait_for_its_end() {
    let mut hub = hub();
    let mut raw = Raw::synchronous(&mut hub, OWNER);
    raw.ask(&mut hub, &create("arm"));
    raw.ask(&mut hub, &select("arm"));
    let count = 3000;
    for index in 0..count {
        raw.send(&mut hub, 0, &set(&format!("k{index:05}"), "x".repeat(1000)));
        while hub.work(at(0)) {}
    }
    raw.send(&mut hub, 5, &Command::DbAll { prefix: String::new(), form: Form::Binary });
    raw.send(&mut hub, 6, &Command::Ping {});
    hub.slices(raw.id, 8);
    assert!(!hub.wants_input(raw.id));
    let waiting: usize = hub.slices(raw.id, 1000).iter().map(|slice| slice.len()).sum();
    assert!(waiting < 2 * WIRE_BYTES_AHEAD + 2048, "{waiting} bytes are ahead of the reader");
    // What is removed while the list is told is not told.
    let mut other = Raw::synchronous(&mut hub, OWNER);
    other.ask(&mut hub, &select("arm"));
    other.ask(&mut hub, &Command::VarDelete { key: "k02999".into() });
    let mut events = messages(raw.read(&mut hub));
    while hub.work(at(0)) {}
    events.extend(messages(raw.read(&mut hub)));
    let told = count - 1;
    assert_eq!(events.len(), told + 2);
    assert_eq!(events[told..], [Event::ListEnd { count: told as u32 }, Event::Pong {}]);
}

#[test]
fn s107_anybody_with_the_right_finds_out_what_there_is() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    owner.create(&mut hub, "imu");
    owner.ask(&mut hub, &create("calibration"));
    let mut reader = Raw::synchronous(&mut hub, OWNER);
    let names: Vec<String> = reader
        .ask(&mut hub, &Command::DbList { prefix: String::new() })
        .into_iter()
        .filter_map(|event| match event {
            Event::DatabaseListed { database, .. } => Some(database),
            _ => None,
        })
        .collect();
    let flow = format!("flow:robot.flow-{}", owner.id.wire());
    assert_eq!(names, ["calibration", "chan:robot.imu", &flow, "user:robot"]);
    let channels = reader.ask(&mut hub, &Command::DbList { prefix: "chan:".into() });
    assert_eq!(channels.len(), 2);
}

#[test]
fn nothing_is_kept_of_what_somebody_had_selected_who_left_or_had_it_taken_away() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    for name in ["arm", "leg"] {
        owner.ask(&mut hub, &Command::DbCreate { database: name.into(), durable: 0 });
    }
    let mut raws = [(); 3].map(|()| Raw::synchronous(&mut hub, OWNER));
    for raw in &mut raws {
        for name in ["arm", "leg", "leg"] {
            let selected = raw.ask(&mut hub, &Command::DbSelect { database: name.into() });
            assert_eq!(selected, [Event::DatabaseSelected { database: name.into() }]);
        }
    }
    assert_eq!(hub.selected.len(), 3, "each has one");
    raws[0].ask(&mut hub, &Command::DbSelect { database: "none".into() });
    hub.left(raws[1].id, at(0));
    owner.ask(&mut hub, &Command::DbRemove { database: "arm".into() });
    for raw in raws.iter_mut().step_by(2) {
        assert_eq!(messages(raw.read(&mut hub)), [], "nobody has that any more");
    }
    owner.ask(&mut hub, &Command::DbRemove { database: "leg".into() });
    assert_eq!(messages(raws[0].read(&mut hub)), []);
    let none = Event::DatabaseSelected { database: String::new() };
    assert_eq!(messages(raws[2].read(&mut hub)), [none]);
    assert_eq!(hub.selected.len(), 0);
}
