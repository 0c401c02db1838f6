//! Names of flows, and satellites that come back.

use super::*;

fn named(name: &str, session: Session) -> Command {
    Command::SetAsync { name: name.into(), session, form: Form::Binary }
}

/// A flow, and what it was told when it began.
fn begin(hub: &mut ServerCore, nonce: u8, name: &str, session: Session) -> (Raw, Vec<Tagged<Event>>) {
    begin_from(OWNER, hub, nonce, name, session)
}

fn begin_from(
    origin: Origin,
    hub: &mut ServerCore,
    nonce: u8,
    name: &str,
    session: Session,
) -> (Raw, Vec<Tagged<Event>>) {
    // Other than those of all other tests' connections: a session is made of the nonce.
    let id = hub.open(origin, [100 + nonce; 32], hub.now).expect("a place");
    let mut raw = Raw { id, inbound: Inbound::new() };
    for command in [Raw::hello(FRAGMENT_BYTES_MAX as u32), Command::LoginPeer {}, named(name, session)] {
        raw.send(hub, 1, &command);
    }
    let events = raw.read(hub);
    (raw, events)
}

fn begun(events: &[Tagged<Event>]) -> (String, Session, bool) {
    let found = events.iter().find_map(|event| match &event.message {
        Event::FlowBegun { name, session, resumed, .. } => Some((name.clone(), *session, *resumed == 1)),
        _ => None,
    });
    found.unwrap_or_else(|| panic!("no flow, but {events:?}"))
}

#[test]
fn a_name_is_given_to_one_flow_at_a_time_and_who_is_refused_stays_synchronous() {
    let mut hub = hub();
    let (first, events) = begin(&mut hub, 1, "arm", [0; 16]);
    assert_eq!(begun(&events).0, "robot.arm");
    let (mut second, events) = begin(&mut hub, 2, "arm", [0; 16]);
    assert_eq!(refusal(&events, 1), Some(RefusalCode::Exists));
    assert_eq!(second.inbound.state(), State::Synchronous);
    second.send(&mut hub, 2, &named("Arm!", [0; 16]));
    assert_eq!(refusal(&second.read(&mut hub), 2), Some(RefusalCode::BadName));
    second.send(&mut hub, 3, &Command::ListChannels { form: Form::Binary });
    assert_eq!(tagged(&second.read(&mut hub), 3), [Event::ListEnd { count: 0 }]);
    hub.left(first.id, at(0));
    second.send(&mut hub, 4, &named("arm", [0; 16]));
    assert_eq!(begun(&second.read(&mut hub)).0, "robot.arm", "it is free again");
}

#[test]
fn who_is_inside_and_cannot_come_back_gets_a_name_beside_one_that_is_taken() {
    let mut hub = hub();
    let inside = Origin::Inside { rights: Rights::ALL };
    let (first, events) = begin_from(inside, &mut hub, 1, "modules.arm", [0; 16]);
    assert_eq!(begun(&events).0, "robot.modules.arm");
    let (second, events) = begin_from(inside, &mut hub, 2, "modules.arm", [0; 16]);
    assert_eq!(begun(&events).0, format!("robot.modules.arm-{}", second.id.wire()));
    hub.left(first.id, at(0));
    let (_, events) = begin_from(inside, &mut hub, 3, "modules.arm", [0; 16]);
    assert_eq!(begun(&events).0, "robot.modules.arm", "it is free again");
}

#[test]
fn sessions_differ_and_one_that_is_over_or_invented_gives_nothing() {
    let mut hub = hub();
    let (first, events) = begin(&mut hub, 1, "arm", [0; 16]);
    let (_, one, resumed) = begun(&events);
    let (second, events) = begin(&mut hub, 2, "leg", [7; 16]);
    let (_, two, second_resumed) = begun(&events);
    assert!(one != two && one != [0; 16] && !resumed && !second_resumed);
    hub.left(first.id, at(0));
    let (_, events) = begin(&mut hub, 3, "arm", one);
    assert!(!begun(&events).2, "a session ends with its connection");
    assert!(hub.connection(second.id).is_some());
}

#[test]
fn who_proves_the_session_takes_the_place_of_a_half_open_flow_and_nothing_waiting_is_lost() {
    let mut hub = hub();
    let mut other = Raw::flow(&mut hub, OWNER);
    let theirs = other.create(&mut hub, "camera");
    let (mut old, events) = begin(&mut hub, 1, "arm", [0; 16]);
    let (_, session, _) = begun(&events);
    let [mine, latched] = [("joints", no_properties()), ("map", with_properties([("latch", true.into())]))]
        .map(|(name, properties)| old.create_with(&mut hub, name, properties));
    old.subscribe_as(&mut hub, theirs, Policy::All, 9);
    other.subscribe(&mut hub, mine);
    old.publish(&mut hub, latched, Bytes::from_static(b"map"));
    old.read(&mut hub);
    other.read(&mut hub);
    for number in 0..4 {
        other.publish(&mut hub, theirs, Bytes::from(vec![number; 2000]));
    }
    // The first message is taken whole, the second in part, the third was not begun.
    let frame = hub.take(old.id).map(|frame| frame.len()).expect("the first");
    hub.slices(old.id, 9);
    hub.wrote(old.id, frame / 2, at(0));
    other.read(&mut hub);

    let (new, events) = begin(&mut hub, 2, "another", session);
    let (name, next, resumed) = begun(&events);
    assert!(resumed && name == "robot.arm" && next != session);
    let owners: Vec<u64> = events
        .iter()
        .filter_map(|event| match &event.message {
            Event::ChannelAdded { owner, channel, .. } if *channel != theirs => Some(*owner),
            _ => None,
        })
        .collect();
    assert_eq!(owners, [new.id.wire(); 2], "its channels are its own");
    let after = events.iter().position(|event| matches!(event.message, Event::FlowBegun { .. }));
    let place = |wanted: &Event| events.iter().position(|event| event.message == *wanted);
    assert!(place(&Event::StartPublishing { channel: mine }) > after, "it learns who listens");
    let numbers: Vec<u8> = events
        .iter()
        .filter_map(|event| match &event.message {
            Event::Data { payload, .. } => payload.first().copied(),
            _ => None,
        })
        .collect();
    assert_eq!(numbers, [1, 2, 3], "what was not taken whole comes anew");
    let told: Vec<Event> = other.read(&mut hub).into_iter().map(|event| event.message).collect();
    let owner = new.id.wire();
    assert_eq!(
        told,
        [mine, latched].map(|channel| Event::OwnerChanged { channel, owner }),
        "nobody else hears of more than whose its channels are"
    );
    let mut closing = old.read_rest(&mut hub, frame / 2);
    assert!(
        matches!(closing.pop(), Some(Event::Closing { reason, .. }) if reason == ClosingReason::Replaced.code())
    );
    new.publish(&mut hub, mine, Bytes::from_static(b"moved"));
    assert_eq!(other.heard(&mut hub, mine), [b"moved"]);
    assert_eq!(hub.bytes_waiting(), 3 + ITEM_OVERHEAD_BYTES, "only what is latched");
    let counts = *hub.counts(new.id, theirs).expect("it listens");
    assert!(counts.balance() && counts.delivered == 4);
    let (_, events) = begin(&mut hub, 3, "thief", session);
    assert!(!begun(&events).2, "a session proves its holder once");
    hub.left(new.id, at(0));
    assert_eq!((hub.bytes_waiting(), hub.kept, hub.channels().count()), (0, 0, 1));
    assert!(hub.totals().balance());
}

impl Raw {
    /// What comes after the transport took part of a frame: the rest of that, and whole ones.
    fn read_rest(&mut self, hub: &mut ServerCore, taken: usize) -> Vec<Event> {
        let bytes: Vec<u8> = hub.slices(self.id, 9).iter().flat_map(|slice| slice.to_vec()).collect();
        hub.wrote(self.id, bytes.len(), at(0));
        let mut inbound = Inbound::new();
        State::ALL.iter().for_each(|_| inbound.advance());
        let rest = HEADER_AND_MORE - taken;
        inbound.feed(&bytes[rest..]);
        let mut events = Vec::new();
        while let Some(event) = inbound.next().expect("the hub is honest") {
            events.push(event.message);
        }
        events
    }
}

/// The length of the frame that the test above cuts: header, tag, channel, message and payload.
const HEADER_AND_MORE: usize = 6 + 4 + 4 + 4 + 2000;

#[test]
fn a_flow_of_another_account_or_one_that_closes_cannot_be_replaced() {
    let mut hub = hub();
    let (first, events) = begin(&mut hub, 1, "arm", [0; 16]);
    let (_, session, _) = begun(&events);
    hub.connections.get_mut(first.id).expect("open").user = Some("ada".parse().expect("a name"));
    let (_, events) = begin(&mut hub, 2, "leg", session);
    assert!(!begun(&events).2);
}

#[test]
fn reliable_channels_and_replicas_go_on_with_the_successor() {
    let mut hub = hub();
    let mut other = Raw::flow(&mut hub, OWNER);
    let theirs = other.create(&mut hub, "camera");
    let (mut old, events) = begin(&mut hub, 1, "arm", [0; 16]);
    let (_, session, _) = begun(&events);
    let log = old.create_with(&mut hub, "log", with_properties([("delivery", "reliable".into())]));
    let view = old.create(&mut hub, "view");
    old.send(&mut hub, 5, &Command::Attach { replica: view, source: theirs });
    other.subscribe(&mut hub, log);
    other.subscribe(&mut hub, view);
    old.hand(&mut hub, log, &Bytes::from(vec![0; 600_000]));
    let (_, events) = begin(&mut hub, 2, "arm", session);
    let told = messages(events);
    assert!(told.contains(&Event::Attached { replica: view, source: theirs }));
    let waiting =
        crate::flow::delivery::charge_of(600_000, 600_000_usize.div_ceil(FRAGMENT_BYTES_MAX)) as u64;
    assert!(told.contains(&Event::Credit { channel: log, bytes: CREDIT_BYTES - waiting }), "{told:?}");
    other.publish(&mut hub, theirs, Bytes::from_static(b"seen"));
    assert_eq!(other.heard(&mut hub, view), [b"seen"]);
}

#[test]
fn the_flows_database_and_the_one_it_selected_go_on_with_the_successor() {
    let mut hub = hub();
    let (mut old, events) = begin(&mut hub, 1, "arm", [0; 16]);
    let (_, session, _) = begun(&events);
    let mut watcher = Raw::flow(&mut hub, OWNER);
    let database = "flow:robot.arm".to_owned();
    old.send(&mut hub, 5, &Command::DbSelect { database: database.clone() });
    let value = crate::flow::Value::new(&7.into()).expect("small");
    old.send(&mut hub, 6, &Command::VarSet { key: "gain".into(), value: value.clone() });
    assert_eq!(tagged(&old.read(&mut hub), 6), [Event::Done {}]);
    watcher.send(&mut hub, 5, &Command::DbSelect { database: database.clone() });
    watcher.read(&mut hub);
    let (mut new, events) = begin(&mut hub, 2, "arm", session);
    assert!(messages(events).contains(&Event::DatabaseSelected { database }));
    assert_eq!(messages(watcher.read(&mut hub)), [], "it was never gone");
    new.send(&mut hub, 7, &Command::VarGet { key: "gain".into(), form: Form::Binary });
    assert_eq!(tagged(&new.read(&mut hub), 7), [Event::Value { value }]);
    hub.left(new.id, at(0));
    let told = messages(watcher.read(&mut hub));
    assert!(told.contains(&Event::DatabaseSelected { database: String::new() }), "now it is: {told:?}");
}
