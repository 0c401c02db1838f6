//! Channels that repeat others.

use super::*;
use proptest::prelude::*;

fn attach(hub: &mut ServerCore, owner: &mut Raw, replica: ChannelRef, source: ChannelRef) -> Vec<Event> {
    owner.send(hub, 41, &Command::Attach { replica, source });
    tagged(&owner.read(hub), 41)
}

fn refused(
    hub: &mut ServerCore,
    owner: &mut Raw,
    replica: ChannelRef,
    source: ChannelRef,
) -> Option<RefusalCode> {
    match attach(hub, owner, replica, source).as_slice() {
        [Event::Refused { code, .. }] => RefusalCode::from_code(*code),
        _ => None,
    }
}

#[test]
fn s131_listeners_of_a_replica_hear_the_source_while_it_is_attached() {
    let mut hub = hub();
    let [mut owner, mut repeater, mut listener] = [(); 3].map(|()| Raw::flow(&mut hub, OWNER));
    let source = owner.create(&mut hub, "camera");
    let replica = repeater.create(&mut hub, "view");
    listener.subscribe(&mut hub, replica);
    assert!(messages(repeater.read(&mut hub)).contains(&Event::StartPublishing { channel: replica }));
    owner.read(&mut hub);
    assert_eq!(attach(&mut hub, &mut repeater, replica, source), [Event::Attached { replica, source }]);
    assert_eq!(messages(owner.read(&mut hub)), [Event::StartPublishing { channel: source }]);
    let long = Bytes::from((0..200_000).map(|index| index as u8).collect::<Vec<_>>());
    owner.hand(&mut hub, source, &long);
    owner.publish(&mut hub, source, Bytes::from_static(b"short"));
    assert_eq!(listener.heard(&mut hub, replica), [long.to_vec(), b"short".to_vec()]);
    repeater.read(&mut hub);
    repeater.publish(&mut hub, replica, Bytes::from_static(b"mine"));
    assert_eq!(refusal(&repeater.read(&mut hub), 9), Some(RefusalCode::Attached));
    repeater.send(&mut hub, 42, &Command::Detach { replica });
    let events = repeater.read(&mut hub);
    assert_eq!(tagged(&events, 42), [Event::Detached { replica, source }]);
    assert!(
        messages(events).contains(&Event::StartPublishing { channel: replica }),
        "it publishes again"
    );
    assert_eq!(messages(owner.read(&mut hub)), [Event::StopPublishing { channel: source }]);
    owner.publish(&mut hub, source, Bytes::from_static(b"unheard"));
    repeater.publish(&mut hub, replica, Bytes::from_static(b"mine"));
    assert_eq!(listener.heard(&mut hub, replica), [b"mine"]);
    assert!(hub.totals().balance() && hub.bytes_waiting() == 0);
}

#[test]
fn a_source_counts_a_replica_only_while_somebody_hears_it() {
    let mut hub = hub();
    let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let chain = ["a", "b", "c"].map(|name| owner.create(&mut hub, name));
    attach(&mut hub, &mut owner, chain[1], chain[0]);
    attach(&mut hub, &mut owner, chain[2], chain[1]);
    assert!(owner.read(&mut hub).is_empty(), "nobody hears any");
    let poller = Raw::synchronous(&mut hub, OWNER);
    poller.send(&mut hub, 1, &Command::PollRegister { channel: chain[2] });
    assert_eq!(messages(owner.read(&mut hub)), [Event::StartPublishing { channel: chain[0] }], "it alone");
    listener.subscribe(&mut hub, chain[2]);
    listener.subscribe(&mut hub, chain[1]);
    poller.send(&mut hub, 2, &Command::PollDeregister { channel: chain[2] });
    listener.send(&mut hub, 3, &Command::Unsubscribe { channel: chain[2] });
    assert!(owner.read(&mut hub).is_empty());
    hub.left(listener.id, at(0));
    assert_eq!(messages(owner.read(&mut hub)), [Event::StopPublishing { channel: chain[0] }]);
}

#[test]
fn who_may_attach_what() {
    let mut hub = hub();
    let [mut owner, mut other] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let [a, b, c] = ["a", "b", "c"].map(|name| owner.create(&mut hub, name));
    let reliable = owner.create_with(&mut hub, "log", with_properties([("delivery", "reliable".into())]));
    other.read(&mut hub);
    assert_eq!(refused(&mut hub, &mut other, a, b), Some(RefusalCode::NotOwner));
    assert_eq!(refused(&mut hub, &mut owner, a, a), Some(RefusalCode::Cycle));
    assert_eq!(refused(&mut hub, &mut owner, reliable, a), Some(RefusalCode::WrongKind));
    let gone = ChannelRef { id: a.id, epoch: a.epoch + 1 };
    assert_eq!(refused(&mut hub, &mut owner, gone, a), Some(RefusalCode::Gone));
    assert_eq!(refused(&mut hub, &mut owner, a, gone), Some(RefusalCode::Gone));
    assert_eq!(refused(&mut hub, &mut owner, b, a), None);
    assert_eq!(refused(&mut hub, &mut owner, b, c), Some(RefusalCode::Attached), "one source at a time");
    assert_eq!(refused(&mut hub, &mut owner, c, b), None);
    assert_eq!(refused(&mut hub, &mut owner, a, c), Some(RefusalCode::Cycle));
    owner.send(&mut hub, 5, &Command::Detach { replica: a });
    let nothing = ChannelRef { id: 0, epoch: 0 };
    assert_eq!(tagged(&owner.read(&mut hub), 5), [Event::Detached { replica: a, source: nothing }]);
}

#[test]
fn eight_levels_repeat_and_a_ninth_is_refused() {
    for joined_in_the_middle in [false, true] {
        let mut hub = hub();
        let mut owner = Raw::flow(&mut hub, OWNER);
        let chain: Vec<ChannelRef> = (0..=REPLICA_LEVELS_MAX + 1)
            .map(|index| owner.create(&mut hub, &format!("c{index}")))
            .collect();
        let mut links: Vec<usize> = (1..=REPLICA_LEVELS_MAX).collect();
        if joined_in_the_middle {
            links.retain(|link| *link != 4);
            links.push(4);
        }
        for link in links {
            assert_eq!(refused(&mut hub, &mut owner, chain[link], chain[link - 1]), None, "level {link}");
        }
        let ninth = refused(&mut hub, &mut owner, chain[REPLICA_LEVELS_MAX + 1], chain[REPLICA_LEVELS_MAX]);
        assert_eq!(ninth, Some(RefusalCode::Cycle));
        let mut listener = Raw::flow(&mut hub, OWNER);
        listener.subscribe(&mut hub, chain[REPLICA_LEVELS_MAX]);
        owner.publish(&mut hub, chain[0], Bytes::from_static(b"far"));
        assert_eq!(listener.heard(&mut hub, chain[REPLICA_LEVELS_MAX]), [b"far"]);
    }
}

#[test]
fn when_the_source_goes_the_replicas_owner_is_told_and_publishes_again() {
    let mut hub = hub();
    let [mut owner, mut repeater, mut listener] = [(); 3].map(|()| Raw::flow(&mut hub, OWNER));
    let source = owner.create(&mut hub, "camera");
    let replica = repeater.create(&mut hub, "view");
    attach(&mut hub, &mut repeater, replica, source);
    listener.subscribe(&mut hub, replica);
    repeater.read(&mut hub);
    hub.left(owner.id, at(0));
    let events = repeater.read(&mut hub);
    assert!(tagged(&events, 0).contains(&Event::Detached { replica, source }));
    assert!(tagged(&events, 0).contains(&Event::StartPublishing { channel: replica }));
    listener.read(&mut hub);
    repeater.publish(&mut hub, replica, Bytes::from_static(b"mine"));
    assert_eq!(listener.heard(&mut hub, replica), [b"mine"]);
}

#[test]
fn a_late_joiner_of_a_replica_hears_what_the_source_keeps() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let source = owner.create_with(&mut hub, "map", with_properties([("latch", true.into())]));
    let replica = owner.create(&mut hub, "view");
    attach(&mut hub, &mut owner, replica, source);
    owner.publish(&mut hub, source, Bytes::from_static(b"map"));
    let mut late = Raw::flow(&mut hub, OWNER);
    late.send(&mut hub, 1, &subscribe(replica, 0));
    assert_eq!(late.heard(&mut hub, replica), [b"map"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is created, attached, heard, published, dropped and ended: the books balance, a source counts
    /// exactly those replicas that somebody hears, and in the end nothing waits and nothing is kept.
    #[test]
    fn replicas_polls_latches_and_books_agree_under_random_use(
        steps in prop::collection::vec((0_u8..14, 0_usize..3, 0_usize..5, 0_usize..5), 0..160),
    ) {
        let mut hub = hub();
        let mut flows: Vec<Raw> = (0..3).map(|_| Raw::flow(&mut hub, OWNER)).collect();
        let pollers: Vec<Raw> = (0..2).map(|_| Raw::synchronous(&mut hub, OWNER)).collect();
        let mut channels: Vec<(usize, ChannelRef)> = Vec::new();
        let mut created = 0;
        for (step, who, which, other) in steps {
            let one = channels.get(which).copied();
            let two = channels.get(other).copied();
            match (step, one, two) {
                (0, _, _) if channels.len() < 5 => {
                    created += 1;
                    let properties = match other {
                        0 => with_properties([("latch", true.into())]),
                        1 => with_properties([("delivery", "reliable".into())]),
                        _ => no_properties(),
                    };
                    let channel = flows[who].create_with(&mut hub, &format!("c{created}"), properties);
                    channels.push((who, channel));
                }
                (1 | 2, Some((_, channel)), _) => {
                    let policy = if other == 0 { Policy::All } else { Policy::Latest };
                    let depth = 1 + other as u16;
                    flows[who].send(&mut hub, 6, &Command::Subscribe { channel, policy, depth, divisor: 1 });
                }
                (3, Some((_, channel)), _) => flows[who].send(&mut hub, 7, &Command::Unsubscribe { channel }),
                (4 | 5, Some((owner, replica)), Some((_, source))) => {
                    flows[owner].send(&mut hub, 8, &Command::Attach { replica, source });
                }
                (6, Some((owner, replica)), _) => flows[owner].send(&mut hub, 8, &Command::Detach { replica }),
                (7, Some((_, channel)), _) => {
                    pollers[who % 2].send(&mut hub, 9, &Command::PollRegister { channel });
                }
                (8, Some((_, channel)), _) => {
                    let end = if other < 3 { Command::PollDeregister { channel } } else { Command::Poll { channel } };
                    pollers[who % 2].send(&mut hub, 9, &end);
                    while hub.take(pollers[who % 2].id).is_some() {}
                }
                (9 | 10, Some((owner, channel)), _) => {
                    flows[owner].publish(&mut hub, channel, Bytes::from(vec![1; 400_000 * (other / 3) + 30]));
                }
                (11, Some((_, channel)), _) => {
                    hub.close_channel(channel);
                    channels.remove(which);
                }
                (12, _, _) => while hub.take(flows[who].id).is_some() {},
                (13, _, _) if other == 0 => {
                    hub.left(flows[who].id, at(0));
                    channels.retain(|(owner, _)| *owner != who);
                    flows[who] = Raw::flow(&mut hub, OWNER);
                }
                _ => {}
            }
            for (index, flow) in flows.iter_mut().enumerate() {
                if hub.connections.get(flow.id).is_none_or(|known| known.closing.is_some()) {
                    hub.left(flow.id, at(0));
                    channels.retain(|(owner, _)| *owner != index);
                    *flow = Raw::flow(&mut hub, OWNER);
                }
            }
            let totals = hub.totals();
            prop_assert!(totals.balance(), "{totals:?}");
            for (known, beside) in hub.channels.iter() {
                for replica in beside.replicas() {
                    let (_, of_replica) = hub.channels.get(replica.channel).expect("a replica exists");
                    prop_assert_eq!(of_replica.source(), Some(known.reference));
                    prop_assert_eq!(replica.heard, of_replica.is_heard());
                }
            }
        }
        for flow in flows.iter().chain(&pollers) {
            hub.left(flow.id, at(0));
        }
        let totals = hub.totals();
        prop_assert!(totals.balance() && totals.queued == 0);
        prop_assert_eq!((hub.bytes_waiting(), hub.kept, hub.connections()), (0, 0, 0));
    }
}
