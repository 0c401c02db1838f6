//! What becomes of messages for those who do not keep up, and what is kept for those who come late.

use super::*;

#[test]
fn who_must_not_miss_any_is_ended_at_one_message_too_many_and_nobody_else_is() {
    for (count, stays) in [(2, true), (3, true), (4, false)] {
        let mut hub = hub();
        let mut owner = Raw::flow(&mut hub, OWNER);
        let channel = owner.create(&mut hub, "log");
        let [mut strict, mut good] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
        strict.subscribe_as(&mut hub, channel, Policy::All, 3);
        good.subscribe_as(&mut hub, channel, Policy::All, 1);
        for number in 0..count {
            owner.publish(&mut hub, channel, Bytes::from(vec![number; 10]));
            assert_eq!(good.heard(&mut hub, channel).len(), 1);
        }
        let events = messages(strict.read(&mut hub));
        let closing = matches!(events.last(), Some(Event::Closing { reason, .. }) if *reason == ClosingReason::QueueFull.code());
        assert_eq!(closing, !stays, "{count} messages");
        assert_eq!(hub.connection(strict.id).is_some(), stays);
        assert!(hub.connection(good.id).is_some() && hub.spurious() == 0);
        let totals = hub.totals();
        assert!(totals.balance());
        let expected = if stays { [0, 0] } else { [1, 3] };
        assert_eq!([DropReason::Full, DropReason::Gone].map(|why| totals.dropped[why as usize]), expected);
    }
}

#[test]
fn subscribing_again_changes_the_policy_and_keeps_what_waits() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "log");
    let mut listener = Raw::flow(&mut hub, OWNER);
    listener.subscribe_as(&mut hub, channel, Policy::All, 2);
    let publish = |hub: &mut ServerCore, number: u8| owner.publish(hub, channel, Bytes::from(vec![number]));
    publish(&mut hub, 1);
    publish(&mut hub, 2);
    let again = Command::Subscribe { channel, policy: Policy::Latest, depth: 2, divisor: 1 };
    listener.send(&mut hub, 5, &again);
    publish(&mut hub, 3);
    assert_eq!(listener.heard(&mut hub, channel), [[2], [3]], "the oldest made room");
    assert_eq!(hub.totals().dropped[DropReason::NewestWins as usize], 1);
}

#[test]
fn a_stuck_listener_that_must_not_miss_any_is_ended_at_its_budget_of_bytes() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "camera");
    let mut strict = Raw::flow(&mut hub, OWNER);
    strict.subscribe_as(&mut hub, channel, Policy::All, 1024);
    let message = Bytes::from(vec![0; FRAGMENT_BYTES_MAX]);
    let fits = CONNECTION_BYTES_MAX / (FRAGMENT_BYTES_MAX + ITEM_OVERHEAD_BYTES);
    for _ in 0..fits {
        owner.hand(&mut hub, channel, &message);
    }
    assert_eq!(hub.counts(strict.id, channel).map(|counts| counts.queued), Some(fits as u64));
    owner.hand(&mut hub, channel, &message);
    assert_eq!(hub.counts(strict.id, channel), None, "it ends");
    assert_eq!(hub.bytes_waiting(), 0, "and nothing waits for it any more");
}

/// A client that takes messages of at most 1,000 bytes, until its login.
fn small(hub: &mut ServerCore) -> Raw {
    let mut raw = Raw::open(hub, OWNER);
    let (version, version_oldest) = (VERSION, VERSION_OLDEST);
    let (fragment_bytes, message_bytes, nonce) = (256, 1000, [2; 32]);
    let hello =
        Command::Hello { magic: MAGIC, version, version_oldest, fragment_bytes, message_bytes, nonce };
    raw.send(hub, 1, &hello);
    raw.send(hub, 1, &Command::LoginPeer {});
    raw.read(hub);
    raw
}

#[test]
fn a_message_longer_than_its_receiver_takes_is_not_sent_to_it_and_counted() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "log");
    let [mut tolerant, mut strict, mut poller] = [(); 3].map(|()| small(&mut hub));
    for (raw, policy) in [(&mut tolerant, Policy::Latest), (&mut strict, Policy::All)] {
        raw.send(&mut hub, 1, &set_async());
        raw.read(&mut hub);
        raw.subscribe_as(&mut hub, channel, policy, 9);
    }
    assert_eq!(poller.ask(&mut hub, &Command::PollRegister { channel }), [Event::Done {}]);
    for (length, fits) in [(999, true), (1000, true), (1001, false)] {
        owner.publish(&mut hub, channel, Bytes::from(vec![7; length]));
        let heard = tolerant.heard(&mut hub, channel);
        assert_eq!(heard.iter().map(Vec::len).collect::<Vec<_>>(), [length][..usize::from(fits)], "{length}");
        let latest = poller.ask(&mut hub, &Command::Poll { channel });
        assert_eq!(matches!(latest.last(), Some(Event::Latest { .. })), fits, "{length}: {latest:?}");
        assert_eq!(matches!(latest[0], Event::Refused { .. }), !fits);
    }
    assert_eq!(hub.totals().dropped[DropReason::Full as usize], 2);
    let last = messages(strict.read(&mut hub)).pop();
    let queue_full = ClosingReason::QueueFull.code();
    assert!(
        matches!(last, Some(Event::Closing { reason, .. }) if reason == queue_full),
        "it may miss none"
    );
    assert!(hub.totals().balance() && hub.connection(tolerant.id).is_some());
}

/// Listeners that do not read, until the hub's budget is used up but for less than one message.
fn crowd(hub: &mut ServerCore, policy: Policy) -> (Raw, ChannelRef, Vec<Raw>, Bytes) {
    let mut owner = Raw::flow(hub, OWNER);
    let message = Bytes::from(vec![0; FRAGMENT_BYTES_MAX - ITEM_OVERHEAD_BYTES]);
    let each = CONNECTION_BYTES_MAX / FRAGMENT_BYTES_MAX;
    let stuck = (0..HUB_BYTES_MAX / CONNECTION_BYTES_MAX).map(|index| {
        let channel = owner.create(hub, &format!("camera{index}"));
        let mut listener = Raw::flow(hub, OWNER);
        listener.subscribe_as(hub, channel, policy, 1024);
        for _ in 0..each {
            owner.hand(hub, channel, &message);
        }
        listener
    });
    let stuck = stuck.collect();
    let channel = owner.create(hub, "light");
    (owner, channel, stuck, message)
}

#[test]
fn at_the_hubs_limit_those_lose_for_whom_the_most_waits() {
    let mut hub = hub();
    let (owner, channel, stuck, message) = crowd(&mut hub, Policy::Latest);
    let mut good = Raw::flow(&mut hub, OWNER);
    good.subscribe(&mut hub, channel);
    assert_eq!(hub.bytes_waiting(), HUB_BYTES_MAX, "exactly full, and nothing was dropped");
    assert_eq!(hub.totals().dropped_in_all(), 0);
    for _ in 0..100 {
        owner.hand(&mut hub, channel, &message);
        assert_eq!(good.heard(&mut hub, channel).len(), 1, "who reads loses nothing");
        assert!(hub.bytes_waiting() <= HUB_BYTES_MAX);
    }
    let totals = hub.totals();
    let room = (SHED_BYTES / FRAGMENT_BYTES_MAX) as u64 + 1;
    assert_eq!(totals.dropped[DropReason::Full as usize], room, "it was shed at once, not one at a time");
    assert!(totals.balance() && hub.connections() == stuck.len() + 2);
}

#[test]
fn at_the_hubs_limit_who_must_not_miss_any_and_does_not_read_is_ended() {
    let mut hub = hub();
    let (owner, channel, stuck, message) = crowd(&mut hub, Policy::All);
    let mut good = Raw::flow(&mut hub, OWNER);
    good.subscribe_as(&mut hub, channel, Policy::All, 1);
    owner.hand(&mut hub, channel, &message);
    assert_eq!(good.heard(&mut hub, channel).len(), 1);
    let ended = |raw: &&Raw| hub.connection(raw.id).is_none() || !hub.has_subscriptions(raw.id);
    assert_eq!(stuck.iter().filter(ended).count(), 1, "one was enough");
    assert!(hub.totals().balance());
}

impl ServerCore {
    fn has_subscriptions(&self, id: ConnectionId) -> bool {
        self.connections.get(id).is_some_and(|found| found.output.subscriptions() > 0)
    }
}

#[test]
fn a_shared_payload_is_counted_once_until_the_last_queue_lets_go() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "camera");
    let mut listeners = [(); 3].map(|()| Raw::flow(&mut hub, OWNER));
    listeners.iter_mut().for_each(|listener| listener.subscribe(&mut hub, channel));
    owner.publish(&mut hub, channel, Bytes::from(vec![0; 5000]));
    let charge = 5000 + ITEM_OVERHEAD_BYTES;
    for listener in &mut listeners {
        assert_eq!(hub.bytes_waiting(), charge);
        listener.read(&mut hub);
    }
    assert_eq!(hub.bytes_waiting(), 0);
}

#[test]
fn a_late_joiner_hears_what_is_latched_first_and_at_once() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create_with(&mut hub, "map", with_properties([("latch", true.into())]));
    owner.publish(&mut hub, channel, Bytes::from_static(b"old"));
    owner.publish(&mut hub, channel, Bytes::from_static(b"map"));
    assert_eq!(hub.bytes_waiting(), 3 + ITEM_OVERHEAD_BYTES, "it counts, and the older one does not");
    let mut late = Raw::flow(&mut hub, OWNER);
    late.send(&mut hub, 78, &subscribe(channel, 0));
    owner.publish(&mut hub, channel, Bytes::from_static(b"new"));
    assert_eq!(late.heard(&mut hub, channel), [b"map", b"new"]);
    late.subscribe(&mut hub, channel);
    assert!(late.heard(&mut hub, channel).is_empty(), "to subscribe again is not to come late");
    let change = Command::ChangeHeader { channel, properties: no_properties() };
    owner.send(&mut hub, 5, &change);
    assert_eq!(hub.bytes_waiting(), 0, "without the property nothing is kept");
    let mut later = Raw::flow(&mut hub, OWNER);
    later.send(&mut hub, 78, &subscribe(channel, 0));
    assert!(later.heard(&mut hub, channel).is_empty());
    assert!(hub.totals().balance());
}

#[test]
fn what_one_flow_lets_the_hub_keep_is_limited_and_ends_with_it() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let message = Bytes::from(vec![0; MESSAGE_BYTES_MAX / 2]);
    for index in 0..5 {
        let name = format!("map{index}");
        let channel = owner.create_with(&mut hub, &name, with_properties([("latch", true.into())]));
        owner.hand(&mut hub, channel, &message);
    }
    let each = MESSAGE_BYTES_MAX / 2 + ITEM_OVERHEAD_BYTES * (MESSAGE_BYTES_MAX / 2 / FRAGMENT_BYTES_MAX);
    assert_eq!(hub.bytes_waiting(), each * (CONNECTION_BYTES_MAX / each), "32 MiB, and none beyond");
    hub.left(owner.id, at(0));
    assert_eq!((hub.bytes_waiting(), hub.kept), (0, 0));
}

#[test]
fn s124_a_changed_header_reaches_every_flow_in_its_form() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut other = Raw::flow(&mut hub, OWNER);
    let mut json = Raw::open(&mut hub, OWNER);
    let set = Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Json };
    for command in [Raw::hello(1024), Command::LoginPeer {}, set] {
        json.send(&mut hub, 1, &command);
    }
    json.read(&mut hub);
    let properties = with_properties([("unit", "g".into())]);
    let change = Command::ChangeHeader { channel, properties: properties.clone() };
    other.send(&mut hub, 5, &change);
    assert_eq!(refusal(&other.read(&mut hub), 5), Some(RefusalCode::NotOwner));
    owner.send(&mut hub, 5, &change);
    let changed = Event::HeaderChanged { channel, properties: properties.clone() };
    assert_eq!(tagged(&owner.read(&mut hub), 5), std::slice::from_ref(&changed));
    assert_eq!(messages(other.read(&mut hub)), [changed]);
    let as_json = Event::HeaderChanged { channel, properties: properties.clone().in_form(Form::Json) };
    assert_eq!(messages(json.read(&mut hub)), [as_json]);
    assert_eq!(hub.channels().next().map(|(known, _)| known.properties.clone()), Some(properties));
    let no_map = Properties::new(&1.into()).expect("small");
    owner.send(&mut hub, 6, &Command::ChangeHeader { channel, properties: no_map });
    assert_eq!(refusal(&owner.read(&mut hub), 6), Some(RefusalCode::BadProperties));
    hub.close_channel(channel);
    owner.send(&mut hub, 7, &change);
    assert_eq!(refusal(&owner.read(&mut hub), 7), Some(RefusalCode::Gone));
}
