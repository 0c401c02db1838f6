//! Messages, their ways and the books.

use super::*;
use proptest::prelude::*;

#[test]
fn a_message_reaches_all_subscribers_and_nobody_else() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let [mut first, mut second, mut stranger] = [(); 3].map(|()| Raw::flow(&mut hub, OWNER));
    first.subscribe(&mut hub, channel);
    second.subscribe(&mut hub, channel);
    owner.publish(&mut hub, channel, Bytes::from_static(b"pulse"));
    let data = Event::Data { channel, message: 1, payload: Bytes::from_static(b"pulse") };
    assert_eq!(messages(first.read(&mut hub)), std::slice::from_ref(&data));
    assert_eq!(messages(second.read(&mut hub)), [data]);
    assert_eq!(messages(stranger.read(&mut hub)), []);
    assert!(hub.totals().balance() && hub.totals().delivered == 2);
}

#[test]
fn only_the_owner_publishes_and_a_race_is_no_crime() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut other = Raw::flow(&mut hub, OWNER);
    other.publish(&mut hub, channel, Bytes::from_static(b"mine"));
    assert_eq!(refusal(&other.read(&mut hub), 9), Some(RefusalCode::NotOwner));
    let begun = Command::Publish { channel, message: 4, payload: Bytes::from_static(b"be") };
    owner.send_flagged(&mut hub, 9, Flags::FIRST, &begun);
    assert!(hub.close_channel(channel));
    let rest = Command::Publish { channel, message: 4, payload: Bytes::from_static(b"gun") };
    owner.send_flagged(&mut hub, 9, Flags::LAST, &rest);
    owner.publish(&mut hub, channel, Bytes::from_static(b"late"));
    let events = owner.read(&mut hub);
    assert_eq!(
        tagged(&events, 9).len(),
        1,
        "one refusal for the new message, none for the rest of the old"
    );
    assert_eq!(refusal(&events, 9), Some(RefusalCode::Gone));
    assert_eq!(hub.late_fragments(), 3);
    assert!(hub.connection(owner.id).is_some());
}

#[test]
fn a_subscriber_that_does_not_read_costs_its_budget_and_others_lose_nothing() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "camera");
    let mut stuck = Raw::flow(&mut hub, OWNER);
    let mut good = Raw::flow(&mut hub, OWNER);
    stuck.send(&mut hub, 1, &subscribe(channel, 1024));
    stuck.read(&mut hub);
    good.subscribe(&mut hub, channel);
    let mut received = 0;
    for _ in 0..600 {
        owner.publish(&mut hub, channel, Bytes::from(vec![0; FRAGMENT_BYTES_MAX]));
        received += good.read(&mut hub).len();
    }
    assert_eq!(received, 600);
    let counts = *hub.counts(stuck.id, channel).expect("subscribed");
    let fits = (CONNECTION_BYTES_MAX / (FRAGMENT_BYTES_MAX + ITEM_OVERHEAD_BYTES)) as u64;
    assert!(counts.balance());
    assert_eq!((counts.queued, counts.dropped[DropReason::Full as usize]), (fits, 600 - fits));
    hub.tick(at(1000));
    let told = messages(stuck.read(&mut hub)).into_iter().find_map(|event| match event {
        Event::Dropped { reason, total, .. } => Some((reason, total)),
        _ => None,
    });
    assert_eq!(told, Some((DropReason::Full as u8, 600 - fits)));
}

#[test]
fn a_heavy_stream_does_not_delay_a_light_one() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let [heavy, light] = ["heavy", "light"].map(|name| owner.create(&mut hub, name));
    let mut listener = Raw::flow_with(&mut hub, OWNER, 4096);
    listener.subscribe(&mut hub, heavy);
    listener.subscribe(&mut hub, light);
    for (flags, payload) in crate::flow::fragment::cut(Bytes::from(vec![0; 1_000_000]), FRAGMENT_BYTES_MAX) {
        owner.send_flagged(&mut hub, 1, flags, &Command::Publish { channel: heavy, message: 1, payload });
    }
    owner.publish(&mut hub, light, Bytes::from_static(b"pulse"));
    let events = messages(listener.read(&mut hub));
    let place = events
        .iter()
        .position(|event| matches!(event, Event::Data { channel, .. } if *channel == light));
    assert!(place.is_some_and(|place| place <= 1), "{place:?} of {}", events.len());
    assert_eq!(events.len(), 1_000_000_usize.div_ceil(4096) + 1, "each fragment of the owner is cut anew");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn garbage_kills_its_sender_and_nobody_else(bytes in prop::collection::vec(any::<u8>(), 6..200), depth in 0_usize..4) {
        let mut hub = hub();
        let mut witness = Raw::flow(&mut hub, OWNER);
        let raw = Raw::open(&mut hub, OWNER);
        for command in [Raw::hello(1024), Command::LoginPeer {}, set_async()].iter().take(depth) {
            raw.send(&mut hub, 1, command);
            while hub.take(raw.id).is_some() {}
        }
        hub.receive(raw.id, &bytes, at(0));
        witness.read(&mut hub);
        witness.send(&mut hub, 5, &Command::Ping {});
        let answered = messages(witness.read(&mut hub)).contains(&Event::Pong {});
        prop_assert!(answered);
    }

    #[test]
    fn the_books_of_the_hub_balance_under_random_use(steps in prop::collection::vec((0_u8..9, 0_usize..4, 0_usize..4), 0..150)) {
        let mut hub = hub();
        let mut flows: Vec<Raw> = (0..4).map(|_| Raw::flow(&mut hub, OWNER)).collect();
        let mut channels: Vec<(usize, ChannelRef)> = Vec::new();
        for (step, who, which) in steps {
            let picked = channels.get(which).copied();
            match (step, picked) {
                (0, _) if channels.len() < 4 => {
                    let name = format!("c{}", hub.next_check.as_nanos() + channels.len() as u64);
                    flows[who].send(&mut hub, 5, &Command::CreateStream { name, properties: no_properties() });
                    if let Some((channel, _)) = hub.channels().find(|(channel, _)| !channels.iter().any(|(_, known)| *known == channel.reference)) {
                        channels.push((who, channel.reference));
                    }
                }
                (1, Some((_, channel))) => flows[who].send(&mut hub, 6, &subscribe(channel, 2)),
                (2, Some((_, channel))) => flows[who].send(&mut hub, 7, &Command::Unsubscribe { channel }),
                (3, Some((_, channel))) => {
                    hub.close_channel(channel);
                    channels.remove(which);
                }
                (4..=6, Some((owner, channel))) => flows[owner].publish(&mut hub, channel, Bytes::from(vec![1; 3000])),
                (7, _) => drop(flows[who].read(&mut hub)),
                (8, _) => {
                    let taken = hub.slices(flows[who].id, 4).iter().map(|slice| slice.len()).sum::<usize>();
                    // A transport that takes whole frames in `read` must not find half of one.
                    hub.wrote(flows[who].id, taken, at(0));
                    flows[who].inbound = flow_inbound();
                }
                _ => {}
            }
            let totals = hub.totals();
            prop_assert!(totals.balance(), "{totals:?}");
        }
        for flow in &flows {
            hub.left(flow.id, at(0));
        }
        let totals = hub.totals();
        prop_assert!(totals.balance() && totals.queued == 0);
        prop_assert_eq!((hub.channels().count(), hub.connections()), (0, 0));
    }
}

fn flow_inbound() -> Inbound<Event> {
    let mut inbound = Inbound::new();
    State::ALL.iter().for_each(|_| inbound.advance());
    inbound
}

#[test]
fn two_satellites_talk_through_the_hub() {
    let mut hub = hub();
    let token = Credentials::Token(OwnerToken::new([7; 32]));
    let address = Origin::Network([127, 0, 0, 1].into());
    let mut talker = SatelliteCore::flow(token.clone(), [3; 32], at(0));
    let mut hearer = SatelliteCore::flow(token, [4; 32], at(0));
    let ids = [[5; 32], [6; 32]].map(|nonce| hub.open(address, nonce, at(0)).expect("a place"));
    let mut settle = |talker: &mut SatelliteCore, hearer: &mut SatelliteCore| {
        for _ in 0..6 {
            for (satellite, id) in [(&mut *talker, ids[0]), (&mut *hearer, ids[1])] {
                while let Some(frame) = satellite.take() {
                    hub.receive(id, &frame.to_vec(), at(0));
                }
                while let Some(frame) = hub.take(id) {
                    satellite.receive(&frame.to_vec(), at(0)).expect("the hub is honest");
                }
            }
        }
    };
    settle(&mut talker, &mut hearer);
    assert!(talker.is_ready() && hearer.is_ready());
    hearer.subscribe("robot.imu", 0).expect("a flow");
    let tag = talker
        .create("imu", &SkVariant::map([("unit", "m/s2".into())]))
        .expect("a flow");
    settle(&mut talker, &mut hearer);
    let created = std::iter::from_fn(|| talker.next_event()).find_map(|event| match event {
        SatelliteEvent::Created { tag: answered, channel, .. } if answered == tag => Some(channel),
        _ => None,
    });
    let channel = created.expect("created");
    assert!(talker.is_listened(channel), "the subscription waited for the channel");
    let message = Bytes::from((0..200_000).map(|index| index as u8).collect::<Vec<_>>());
    assert_eq!(talker.publish(channel, message.clone()), Ok(true));
    settle(&mut talker, &mut hearer);
    let heard = std::iter::from_fn(|| hearer.next_event()).find_map(|event| match event {
        SatelliteEvent::Message { payload, .. } => Some(payload),
        _ => None,
    });
    assert_eq!(heard, Some(message));
    assert_eq!(hearer.channel("robot.imu").map(|info| info.channel), Some(channel));
    hearer.unsubscribe("robot.imu").expect("a flow");
    settle(&mut talker, &mut hearer);
    assert_eq!(talker.publish(channel, Bytes::from_static(b"x")), Ok(false), "nobody listens");
}

#[test]
fn when_unfinished_messages_hold_too_much_in_all_those_give_way_who_hold_most() {
    let mut hub = hub();
    let piece = Bytes::from(vec![7; FRAGMENT_BYTES_MAX]);
    let send = |hub: &mut ServerCore, raw: &Raw, channel, flags| {
        let publish = Command::Publish { channel, message: 1, payload: piece.clone() };
        hub.accept(raw.id, publish.encode(9, flags), hub.now);
        while hub.work(hub.now) {}
    };
    let mut honest = Raw::flow(&mut hub, OWNER);
    let light = honest.create(&mut hub, "light");
    let mut listener = Raw::flow(&mut hub, OWNER);
    listener.subscribe(&mut hub, light);
    send(&mut hub, &honest, light, Flags::FIRST);
    let many = MESSAGE_BYTES_MAX / FRAGMENT_BYTES_MAX - 8;
    let mut hoarders: Vec<Raw> = (0..UNFINISHED_BYTES_MAX_IN_ALL / UNFINISHED_BYTES_MAX + 1)
        .map(|index| {
            let mut raw = Raw::flow(&mut hub, OWNER);
            for half in ["left", "right"] {
                let channel = raw.create(&mut hub, &format!("heavy{index}.{half}"));
                send(&mut hub, &raw, channel, Flags::FIRST);
                (1..many).for_each(|_| send(&mut hub, &raw, channel, Flags::NONE));
                assert!(hub.unfinished.used() <= UNFINISHED_BYTES_MAX_IN_ALL);
            }
            raw
        })
        .collect();
    let mut full = |raw: &mut Raw| refusal(&raw.read(&mut hub), 0) == Some(RefusalCode::Full);
    let gave_way = hoarders.iter_mut().map(&mut full).filter(|full| *full).count();
    assert_eq!(gave_way, 1, "one was enough");
    send(&mut hub, &honest, light, Flags::LAST);
    let heard = listener.heard(&mut hub, light);
    assert_eq!(heard.len(), 1, "who ends his messages is heard");
    for raw in &hoarders {
        hub.left(raw.id, at(0));
    }
    assert_eq!((hub.unfinished.used(), hub.spurious()), (0, 0));
}
