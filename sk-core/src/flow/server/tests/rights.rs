//! Rights by name: what each opens, that they follow the account's database, and what ends when they are revoked.

use super::accounts::{flow_of, log_in, name, verifier};
use super::*;
use crate::flow::Value;
use crate::flow::report::ChannelReport;
use sk_flat::FromVariant as _;

/// A hub with the owner's flow, and accounts without rights.
pub(super) fn hub_with(users: &[&str]) -> (ServerCore, Raw) {
    let mut hub = hub();
    for user in users {
        hub.add_account(name(user), verifier());
    }
    let owner = Raw::flow(&mut hub, OWNER);
    (hub, owner)
}

/// The owner writes a right of an account.
pub(super) fn grant(hub: &mut ServerCore, owner: &mut Raw, user: &str, right: &str, patterns: &[&str]) {
    owner.ask(hub, &Command::DbSelect { database: format!("user:{user}") });
    let value = Value::new(&SkVariant::list(patterns.iter().copied())).expect("small");
    let set = Command::VarSet { key: format!("right.{right}"), value };
    assert_eq!(owner.ask(hub, &set), [Event::Done {}]);
}

fn create_stream(name: &str) -> Command {
    Command::CreateStream { name: name.into(), properties: no_properties() }
}

fn create_service(name: &str) -> Command {
    Command::CreateService { name: name.into(), properties: no_properties() }
}

fn denied() -> Vec<Event> {
    vec![Event::Refused { code: RefusalCode::Denied.code(), text: RefusalCode::Denied.to_string() }]
}

fn unsubscribed(channel: ChannelRef) -> Event {
    Event::Unsubscribed { channel }
}

/// The names of the channels that these events say are there.
fn added(events: &[Tagged<Event>]) -> Vec<String> {
    let name = |event: &Tagged<Event>| match &event.message {
        Event::ChannelAdded { name, .. } => Some(name.clone()),
        _ => None,
    };
    events.iter().filter_map(name).collect()
}

#[test]
fn s92_what_an_account_may_do_follows_its_database_at_once() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let mut ada = flow_of(&mut hub, "ada");
    assert_eq!(ada.ask(&mut hub, &create_stream("imu")), denied(), "a new account has no rights");
    grant(&mut hub, &mut owner, "ada", "publish", &["ada.im*", "bob.*"]);
    assert!(matches!(ada.ask(&mut hub, &create_stream("imu"))[..], [Event::ChannelAdded { .. }]));
    assert_eq!(ada.ask(&mut hub, &create_stream("gps")), denied(), "the name is not meant");
    grant(&mut hub, &mut owner, "ada", "publish", &["ada.*"]);
    assert!(matches!(ada.ask(&mut hub, &create_stream("gps"))[..], [Event::ChannelAdded { .. }]));
    owner.ask(&mut hub, &Command::VarDelete { key: "right.publish".into() });
    ada.read(&mut hub);
    assert_eq!(ada.ask(&mut hub, &create_stream("imu")), denied());
    assert_eq!(hub.widened_rights(), [""; 0]);
}

#[test]
fn an_account_cannot_write_its_own_rights() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    for right in ["database_read", "database_write", "list"] {
        grant(&mut hub, &mut owner, "ada", right, &["*"]);
    }
    let mut ada = flow_of(&mut hub, "ada");
    let own = "user:ada".to_owned();
    assert_eq!(
        ada.ask(&mut hub, &Command::DbSelect { database: own.clone() }),
        [Event::DatabaseSelected { database: own }]
    );
    let value = Value::new(&SkVariant::list(["*"])).expect("small");
    let set = Command::VarSet { key: "right.administer".into(), value };
    let delete = Command::VarDelete { key: "right.list".into() };
    for command in [set, delete, Command::DbSave {}, Command::DbLoad {}] {
        assert_eq!(ada.ask(&mut hub, &command), denied(), "{command:?}");
    }
    let other = Command::DbSelect { database: "user:robot".into() };
    assert_eq!(ada.ask(&mut hub, &other), denied(), "and sees no other account's");
}

#[test]
fn a_right_that_cannot_be_read_grants_nothing_and_is_told_in_the_accounts_database() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let mut ada = flow_of(&mut hub, "ada");
    grant(&mut hub, &mut owner, "ada", "publish", &["*"]);
    let value = Value::new(&"*".into()).expect("small");
    owner.ask(&mut hub, &Command::VarSet { key: "right.publish".into(), value });
    assert_eq!(ada.ask(&mut hub, &create_stream("imu")), denied());
    let told =
        owner.ask(&mut hub, &Command::VarGet { key: "hub.unreadable_rights".into(), form: Form::Binary });
    let [Event::Value { value }] = &told[..] else { panic!("{told:?}") };
    assert!(value.variant().get("right.publish").is_some(), "{value:?}");
}

#[test]
fn s93_only_owners_and_administrators_of_a_name_remove_its_channel() {
    let (mut hub, mut owner) = hub_with(&["ada", "bob"]);
    let mut bob = flow_of(&mut hub, "bob");
    grant(&mut hub, &mut owner, "bob", "publish", &["*"]);
    let channel = bob.create(&mut hub, "imu");
    let mut ada = flow_of(&mut hub, "ada");
    let remove = Command::RemoveChannel { channel };
    let not_owner = RefusalCode::NotOwner;
    for right in ["publish", "subscribe", "list"] {
        grant(&mut hub, &mut owner, "ada", right, &["*"]);
    }
    grant(&mut hub, &mut owner, "ada", "administer", &["robot.*"]);
    ada.read(&mut hub);
    let text = not_owner.to_string();
    assert_eq!(ada.ask(&mut hub, &remove), [Event::Refused { code: not_owner.code(), text }]);
    grant(&mut hub, &mut owner, "ada", "administer", &["bob.*"]);
    assert_eq!(ada.ask(&mut hub, &remove), [Event::ChannelRemoved { channel }]);
    // Whoever may change accounts may give itself everything, so a part of the names is not enough for that.
    assert_eq!(ada.ask(&mut hub, &Command::UserList {}), denied());
    let own = Command::DbSelect { database: "user:bob".into() };
    assert_eq!(ada.ask(&mut hub, &own), denied());
}

#[test]
fn an_administrator_of_a_channel_who_has_no_other_right_hears_of_it_and_of_its_end() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let (imu, gps) = (owner.create(&mut hub, "imu"), owner.create(&mut hub, "gps"));
    let mut ada = flow_of(&mut hub, "ada");
    grant(&mut hub, &mut owner, "ada", "administer", &["robot.imu"]);
    assert_eq!(added(&ada.read(&mut hub)), ["robot.imu"]);
    let removed = ada.ask(&mut hub, &Command::RemoveChannel { channel: imu });
    assert_eq!(removed, [Event::ChannelRemoved { channel: imu }], "whoever asks is answered");
    owner.ask(&mut hub, &Command::RemoveChannel { channel: gps });
    assert_eq!(messages(ada.read(&mut hub)), [], "others are none of its business");
}

#[test]
fn who_may_administer_some_names_may_not_administer_all() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let ada = flow_of(&mut hub, "ada");
    grant(&mut hub, &mut owner, "ada", "administer", &["ada.*"]);
    let may = |hub: &ServerCore, name| hub.has_right(ada.id.wire(), Right::Administer, name);
    assert!(may(&hub, "ada.imu") && !may(&hub, "robot.modules"));
    grant(&mut hub, &mut owner, "ada", "administer", &["robot.modules"]);
    assert!(may(&hub, "robot.modules") && !may(&hub, "robot.imu"));
    hub.left(ada.id, at(0));
    assert!(!may(&hub, "robot.modules"), "a former connection may nothing");
}

#[test]
fn s94_a_service_is_open_to_those_who_may_call_it_alone() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let (arm, head) = (owner.serve(&mut hub, "arm"), owner.serve(&mut hub, "head"));
    let mut ada = flow_of(&mut hub, "ada");
    grant(&mut hub, &mut owner, "ada", "call", &["robot.arm"]);
    assert_eq!(added(&ada.read(&mut hub)), ["robot.arm"], "and hears of no other");
    ada.call(&mut hub, 5, head, b"nod");
    assert_eq!(refusal(&ada.read(&mut hub), 5), Some(RefusalCode::Denied));
    ada.call(&mut hub, 6, arm, b"lift");
    let request = owner.request(&mut hub);
    assert_eq!(hub.widened_rights(), [""; 0]);
    grant(&mut hub, &mut owner, "ada", "call", &["robot.head"]);
    assert_eq!(refusal(&ada.read(&mut hub), 6), Some(RefusalCode::Denied), "an open call ends too");
    assert_eq!(hub.open_requests(), 0);
    owner.answer(&mut hub, request, 0, b"too late");
    assert_eq!(tagged(&ada.read(&mut hub), 6), []);
}

#[test]
fn a_call_that_is_still_being_sent_is_refused_when_the_right_goes() {
    for (patterns, ends_at_once) in [(&[][..], true), (&["robot.head"][..], false)] {
        let (mut hub, mut owner) = hub_with(&["ada"]);
        let arm = owner.serve(&mut hub, "arm");
        grant(&mut hub, &mut owner, "ada", "call", &["*"]);
        let mut ada = flow_of(&mut hub, "ada");
        let piece = Command::Call { channel: arm, deadline_ms: 0, payload: Bytes::from_static(b"li") };
        ada.send_flagged(&mut hub, 5, Flags::FIRST, &piece);
        grant(&mut hub, &mut owner, "ada", "call", patterns);
        let early = refusal(&ada.read(&mut hub), 5);
        assert_eq!(early, ends_at_once.then_some(RefusalCode::Denied));
        ada.send_flagged(&mut hub, 5, Flags::LAST, &piece);
        let late = refusal(&ada.read(&mut hub), 5);
        assert_eq!(late, (!ends_at_once).then_some(RefusalCode::Denied), "one end, and only one");
        assert_eq!(owner.requests(&mut hub), [0_u64; 0]);
    }
}

#[test]
fn a_revoked_subscription_ends_with_what_waits_and_the_books_balance() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    grant(&mut hub, &mut owner, "ada", "subscribe", &["robot.*"]);
    grant(&mut hub, &mut owner, "ada", "list", &["*"]);
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = source.create(&mut hub, "imu");
    let mut ada = flow_of(&mut hub, "ada");
    ada.subscribe(&mut hub, channel);
    source.read(&mut hub);
    for _ in 0..3 {
        source.publish(&mut hub, channel, Bytes::from_static(b"pulse"));
    }
    grant(&mut hub, &mut owner, "ada", "subscribe", &["robot.gps"]);
    let events = ada.read(&mut hub);
    let dropped = Event::Dropped { channel, reason: DropReason::Rights as u8, total: 3 };
    assert_eq!(tagged(&events, 0), [dropped, unsubscribed(channel)]);
    assert!(messages(source.read(&mut hub)).contains(&Event::StopPublishing { channel }));
    assert_eq!(ada.ask(&mut hub, &subscribe(channel, 0)), denied());
    let totals = hub.totals();
    assert!(totals.balance() && totals.dropped[DropReason::Rights as usize] == 3, "{totals:?}");
    assert_eq!(hub.widened_rights(), [""; 0]);
}

#[test]
fn a_revoked_right_to_own_takes_the_channels_of_those_names() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    for right in ["publish", "serve"] {
        grant(&mut hub, &mut owner, "ada", right, &["ada.*"]);
    }
    let mut ada = flow_of(&mut hub, "ada");
    let (imu, gps) = (ada.create(&mut hub, "imu"), ada.create(&mut hub, "gps"));
    let arm = ada.serve(&mut hub, "arm");
    owner.subscribe(&mut hub, imu);
    ada.read(&mut hub);
    grant(&mut hub, &mut owner, "ada", "publish", &["ada.gps"]);
    assert_eq!(messages(ada.read(&mut hub)), [Event::ChannelRemoved { channel: imu }]);
    ada.publish(&mut hub, imu, Bytes::from_static(b"late"));
    assert_eq!(refusal(&ada.read(&mut hub), 9), Some(RefusalCode::Gone));
    grant(&mut hub, &mut owner, "ada", "serve", &[]);
    assert_eq!(messages(ada.read(&mut hub)), [Event::ChannelRemoved { channel: arm }]);
    assert_eq!(ada.ask(&mut hub, &create_service("arm")), denied());
    let left: Vec<ChannelRef> = hub.channels().map(|(known, _)| known.reference).collect();
    assert_eq!(left, [gps]);
}

#[test]
fn a_revoked_right_ends_repeating_polling_and_watching() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    for right in ["publish", "subscribe", "database_read"] {
        grant(&mut hub, &mut owner, "ada", right, &["*"]);
    }
    let source = owner.create(&mut hub, "imu");
    owner.ask(&mut hub, &Command::DbCreate { database: "arm".into(), durable: 0 });
    let mut ada = flow_of(&mut hub, "ada");
    let replica = ada.create(&mut hub, "imu");
    assert_eq!(
        ada.ask(&mut hub, &Command::Attach { replica, source }),
        [Event::Attached { replica, source }]
    );
    let watch =
        Command::Watch { database: "arm".into(), prefix: String::new(), after: 0, form: Form::Binary };
    ada.send(&mut hub, 8, &watch);
    ada.read(&mut hub);
    let mut poller = log_in(&mut hub, "ada");
    assert_eq!(poller.ask(&mut hub, &Command::PollRegister { channel: source }), [Event::Done {}]);
    grant(&mut hub, &mut owner, "ada", "subscribe", &["ada.*"]);
    assert!(tagged(&ada.read(&mut hub), 0).contains(&Event::Detached { replica, source }));
    assert_eq!(ada.ask(&mut hub, &Command::Attach { replica, source }), denied());
    let code = RefusalCode::NotRegistered;
    let not_registered = Event::Refused { code: code.code(), text: code.to_string() };
    assert_eq!(poller.ask(&mut hub, &Command::Poll { channel: source }), [not_registered]);
    assert_eq!(poller.ask(&mut hub, &Command::PollRegister { channel: source }), denied());
    grant(&mut hub, &mut owner, "ada", "database_read", &["leg"]);
    assert_eq!(tagged(&ada.read(&mut hub), 8), [Event::WatchOver {}]);
    assert_eq!(hub.widened_rights(), [""; 0]);
}

#[test]
fn a_flow_hears_of_the_channels_that_it_may_list_or_use_and_of_no_others() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let imu = owner.create(&mut hub, "imu");
    owner.serve(&mut hub, "arm");
    grant(&mut hub, &mut owner, "ada", "subscribe", &["robot.imu"]);
    let mut ada = log_in(&mut hub, "ada");
    assert_eq!(ada.ask(&mut hub, &Command::ListChannels { form: Form::Binary }), denied());
    ada.send(&mut hub, 1, &set_async());
    let events = ada.read(&mut hub);
    assert_eq!(added(&events), ["robot.imu"]);
    assert!(matches!(messages(events).last(), Some(Event::FlowBegun { channels: 1, .. })));
    let gps = owner.create(&mut hub, "gps");
    assert_eq!(messages(ada.read(&mut hub)), []);
    grant(&mut hub, &mut owner, "ada", "list", &["robot.*"]);
    assert_eq!(added(&ada.read(&mut hub)), ["robot.arm", "robot.gps"]);
    grant(&mut hub, &mut owner, "ada", "list", &["robot.arm"]);
    assert_eq!(messages(ada.read(&mut hub)), [Event::ChannelRemoved { channel: gps }]);
    let listed = ada.ask(&mut hub, &Command::ListChannels { form: Form::Binary });
    assert!(matches!(listed[..], [.., Event::ListEnd { count: 2 }]), "{listed:?}");
    owner.send(&mut hub, 5, &Command::RemoveChannel { channel: gps });
    assert_eq!(messages(ada.read(&mut hub)), [], "it was gone already");
    owner.send(&mut hub, 5, &Command::RemoveChannel { channel: imu });
    assert_eq!(messages(ada.read(&mut hub)), [Event::ChannelRemoved { channel: imu }]);
}

#[test]
fn databases_are_open_by_name_and_a_flows_own_by_the_right_for_any() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    for database in ["arm", "leg"] {
        owner.ask(&mut hub, &Command::DbCreate { database: database.into(), durable: 0 });
    }
    let mut ada = flow_of(&mut hub, "ada");
    let select = |database: &str| Command::DbSelect { database: database.into() };
    let value = || Value::new(&1.into()).expect("small");
    assert_eq!(ada.ask(&mut hub, &select("arm")), denied());
    grant(&mut hub, &mut owner, "ada", "database_read", &["arm"]);
    assert_eq!(ada.ask(&mut hub, &select("leg")), denied());
    assert_eq!(ada.ask(&mut hub, &select("arm")).len(), 1);
    let set = Command::VarSet { key: "x".into(), value: value() };
    assert_eq!(ada.ask(&mut hub, &set), denied(), "reading is not writing");
    grant(&mut hub, &mut owner, "ada", "database_write", &["arm"]);
    assert_eq!(ada.ask(&mut hub, &set), [Event::Done {}]);
    let create = |database: &str| Command::DbCreate { database: database.into(), durable: 0 };
    assert_eq!(ada.ask(&mut hub, &create("hand")), denied());
    let listed =
        |hub: &mut ServerCore, ada: &mut Raw| ada.ask(hub, &Command::DbList { prefix: String::new() });
    assert_eq!(listed(&mut hub, &mut ada), denied());
    grant(&mut hub, &mut owner, "ada", "list", &["leg"]);
    let own = format!("flow:ada.flow-{}", ada.id.wire());
    let names: Vec<String> = listed(&mut hub, &mut ada)
        .into_iter()
        .filter_map(|event| match event {
            Event::DatabaseListed { database, .. } => Some(database),
            _ => None,
        })
        .collect();
    assert_eq!(names, ["arm", own.as_str(), "leg", "user:ada"]);
    assert_eq!(ada.ask(&mut hub, &select(&own)).len(), 1);
    assert_eq!(ada.ask(&mut hub, &set), [Event::Done {}], "its own");
}

#[test]
fn the_hub_tells_of_itself_what_the_asker_may_list() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    for channel in ["imu", "gps"] {
        owner.create(&mut hub, channel);
    }
    let mut ada = log_in(&mut hub, "ada");
    let inspect = |subject: &str| Command::Inspect { subject: subject.into(), form: Form::Binary };
    assert_eq!(ada.ask(&mut hub, &inspect("hub")), denied());
    grant(&mut hub, &mut owner, "ada", "list", &["robot.imu"]);
    for (subject, told) in [
        ("hub", true),
        ("graph", true),
        ("channel robot.imu", true),
        ("channel robot.gps", false),
        ("why robot.imu robot.imu", true),
        ("why robot.imu robot.gps", false),
        ("flows", false),
    ] {
        let answer = ada.ask(&mut hub, &inspect(subject));
        assert_eq!(answer != denied(), told, "{subject}: {answer:?}");
    }
    let graph = ada.ask(&mut hub, &inspect("graph"));
    let [Event::Value { value }] = &graph[..] else { panic!("{graph:?}") };
    let text = value.variant().to_json().expect("short");
    assert!(text.contains("robot.imu") && !text.contains("robot.gps"), "{text}");
    grant(&mut hub, &mut owner, "ada", "list", &["*"]);
    assert_ne!(ada.ask(&mut hub, &inspect("flows")), denied());
}

#[test]
fn of_those_around_a_channel_the_hub_tells_what_the_asker_may_list() {
    let (mut hub, mut owner) = hub_with(&["ada"]);
    let [imu, copy] = ["imu", "copy"].map(|name| owner.create(&mut hub, name));
    owner.ask(&mut hub, &Command::Attach { replica: copy, source: imu });
    Raw::flow(&mut hub, OWNER).subscribe(&mut hub, imu);
    let mut ada = log_in(&mut hub, "ada");
    for (patterns, around) in [(&["robot.imu"][..], false), (&["robot.*"][..], true)] {
        grant(&mut hub, &mut owner, "ada", "list", patterns);
        let subject = "channel robot.imu".to_owned();
        let told = ada.ask(&mut hub, &Command::Inspect { subject, form: Form::Binary });
        let [Event::Value { value }] = &told[..] else { panic!("{told:?}") };
        let told = ChannelReport::from_variant(&value.variant()).expect("it is what the type reads");
        let some = usize::from(around);
        assert_eq!((told.repeated_by.len(), told.subscribers.len()), (some, some), "{patterns:?}");
        assert_eq!(told.left_out, u32::from(!around));
    }
}
