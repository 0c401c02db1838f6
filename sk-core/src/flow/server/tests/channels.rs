//! Channels, lists, owners and their rights.

use super::*;

#[test]
fn start_goes_to_the_owner_at_the_first_subscriber_and_stop_at_the_last() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let [mut first, mut second] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    first.subscribe(&mut hub, channel);
    assert_eq!(messages(owner.read(&mut hub)), [Event::StartPublishing { channel }]);
    second.subscribe(&mut hub, channel);
    second.subscribe(&mut hub, channel);
    first.send(&mut hub, 1, &Command::Unsubscribe { channel });
    assert_eq!(messages(owner.read(&mut hub)), []);
    hub.left(second.id, at(0));
    assert_eq!(messages(owner.read(&mut hub)), [Event::StopPublishing { channel }]);
}

#[test]
fn channels_are_named_after_their_user_and_taken_names_are_refused() {
    let mut hub = hub();
    let mut first = Raw::flow(&mut hub, OWNER);
    let mut second = Raw::flow(&mut hub, OWNER);
    first.create(&mut hub, "imu.left");
    assert_eq!(hub.channels().next().map(|(channel, _)| channel.name.as_str()), Some("robot.imu.left"));
    second.read(&mut hub);
    let mut refused = |name: &str, properties: Properties| {
        second.send(&mut hub, 4, &Command::CreateStream { name: name.to_owned(), properties });
        refusal(&second.read(&mut hub), 4)
    };
    assert_eq!(refused("imu.left", no_properties()), Some(RefusalCode::Exists));
    assert_eq!(refused("IMU", no_properties()), Some(RefusalCode::BadName));
    assert_eq!(refused("", no_properties()), Some(RefusalCode::BadName));
    assert_eq!(refused(&"n".repeat(250), no_properties()), Some(RefusalCode::BadName));
    let number = Properties::new(&SkVariant::from(7)).expect("a number");
    assert_eq!(refused("x", number), Some(RefusalCode::BadProperties));
}

#[test]
fn a_flow_has_at_most_256_channels_and_1024_subscriptions() {
    let mut hub = hub();
    let mut flows: Vec<Raw> = (0..5).map(|_| Raw::flow(&mut hub, OWNER)).collect();
    let mut channels = Vec::new();
    for (index, flow) in flows.iter_mut().enumerate() {
        channels.extend(
            (0..CHANNELS_PER_FLOW_MAX).map(|channel| flow.create(&mut hub, &format!("{index}.{channel}"))),
        );
    }
    let flow = &mut flows[0];
    flow.send(&mut hub, 5, &Command::CreateStream { name: "more".into(), properties: no_properties() });
    assert_eq!(refusal(&flow.read(&mut hub), 5), Some(RefusalCode::TooManyChannels));
    for (index, channel) in channels.iter().enumerate().take(SUBSCRIPTIONS_PER_FLOW_MAX + 1) {
        flow.send(&mut hub, 6, &subscribe(*channel, 0));
        let refused = refusal(&flow.read(&mut hub), 6);
        let expected = (index == SUBSCRIPTIONS_PER_FLOW_MAX).then_some(RefusalCode::TooManySubscriptions);
        assert_eq!(refused, expected, "subscription {index}");
    }
}

#[test]
fn when_a_flow_ends_its_channels_and_relations_go_and_everyone_is_told() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut subscriber = Raw::flow(&mut hub, OWNER);
    let mut bystander = Raw::flow(&mut hub, OWNER);
    subscriber.subscribe(&mut hub, channel);
    owner.publish(&mut hub, channel, Bytes::from_static(b"pulse"));
    hub.receive(owner.id, &[0xff; 6], at(0));
    assert!(matches!(ending(&mut hub, owner.id), Some(Ending::Spurious(_))));
    assert_eq!(hub.channels().count(), 0);
    assert_eq!(
        messages(subscriber.read(&mut hub)),
        [Event::ChannelRemoved { channel }],
        "and no data after it"
    );
    assert_eq!(messages(bystander.read(&mut hub)), [Event::ChannelRemoved { channel }]);
    let totals = hub.totals();
    assert!(totals.balance() && totals.dropped[DropReason::Gone as usize] == 1);
}

#[test]
fn administrators_remove_any_channel_and_others_only_their_own() {
    let mut hub = hub();
    let rights = Rights::NONE.with(crate::flow::Right::Publish);
    let mut guest = Raw::flow(&mut hub, Origin::Inside { rights });
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = hub
        .open_channel("hub.pulse".parse().expect("a name"), no_properties())
        .expect("room");
    guest.send(&mut hub, 5, &Command::RemoveChannel { channel });
    assert_eq!(refusal(&guest.read(&mut hub), 5), Some(RefusalCode::NotOwner));
    owner.send(&mut hub, 6, &Command::RemoveChannel { channel });
    assert_eq!(tagged(&owner.read(&mut hub), 6), [Event::ChannelRemoved { channel }]);
    owner.send(&mut hub, 7, &Command::RemoveChannel { channel });
    assert_eq!(refusal(&owner.read(&mut hub), 7), Some(RefusalCode::Gone));
}

#[test]
fn the_hubs_own_channels_outlive_flows_and_tell_the_hub_of_listeners() {
    let mut hub = hub();
    let channel = hub
        .open_channel("hub.pulse".parse().expect("a name"), no_properties())
        .expect("room");
    assert!((channel.id as usize) < CHANNELS_RESERVED_FOR_HUB);
    assert_eq!(hub.publish_own(channel, Bytes::from_static(b"x")), Ok(false));
    let mut listener = Raw::flow(&mut hub, OWNER);
    listener.subscribe(&mut hub, channel);
    assert_eq!(hub.publish_own(channel, Bytes::from(vec![0; 100_000])), Ok(true));
    assert_eq!(listener.read(&mut hub).len(), 2, "two fragments");
    hub.left(listener.id, at(0));
    let notices: Vec<_> = std::iter::from_fn(|| hub.next_notice()).collect();
    assert!(notices.contains(&Notice::StartPublishing { channel }));
    assert!(notices.contains(&Notice::StopPublishing { channel }));
    assert_eq!(hub.channels().count(), 1);
}

#[test]
fn a_list_tells_every_channel_and_later_commands_wait_for_its_end() {
    let mut hub = hub();
    for index in 0..CHANNELS_RESERVED_FOR_HUB {
        let properties = Properties::new(&SkVariant::map([("pad", "x".repeat(2000).into())])).expect("small");
        hub.open_channel(format!("hub.{index}").parse().expect("a name"), properties)
            .expect("room");
    }
    let mut raw = Raw::open(&mut hub, OWNER);
    for command in [
        Raw::hello(1024),
        Command::LoginPeer {},
        Command::ListChannels { form: Form::Binary },
        Command::Ping {},
    ] {
        raw.send(&mut hub, 3, &command);
    }
    assert!(!hub.wants_input(raw.id));
    let mut events = messages(raw.read(&mut hub));
    while hub.work(at(0)) {}
    events.extend(messages(raw.read(&mut hub)));
    let listed = events
        .iter()
        .filter(|event| matches!(event, Event::ChannelListed { .. }))
        .count();
    assert_eq!(listed, CHANNELS_RESERVED_FOR_HUB);
    assert_eq!(events[events.len() - 2..], [Event::ListEnd { count: 1024 }, Event::Pong {}]);
}

#[test]
fn a_flow_that_begins_hears_of_every_channel_exactly_once() {
    let mut hub = hub();
    let open = |hub: &mut ServerCore, name: String| {
        let properties = Properties::new(&SkVariant::map([("pad", "x".repeat(4000).into())])).expect("small");
        hub.open_channel(name.parse().expect("a name"), properties).expect("room")
    };
    let channels: Vec<_> = (0..500).map(|index| open(&mut hub, format!("hub.{index}"))).collect();
    let mut raw = Raw::open(&mut hub, OWNER);
    for command in [Raw::hello(1024), Command::LoginPeer {}, set_async()] {
        raw.send(&mut hub, 3, &command);
    }
    hub.slices(raw.id, 8);
    // While it is being told: one it knows goes, one it does not know goes, one comes.
    assert!(hub.close_channel(channels[0]) && hub.close_channel(channels[499]));
    let late = open(&mut hub, "hub.late".into());
    let mut known = std::collections::BTreeSet::new();
    for event in messages(raw.read(&mut hub)) {
        match event {
            Event::ChannelAdded { channel, .. } => assert!(known.insert(channel), "told twice: {channel}"),
            Event::ChannelRemoved { channel } => assert!(known.remove(&channel), "never told: {channel}"),
            _ => {}
        }
    }
    let mut expected: std::collections::BTreeSet<_> = channels[1..499].iter().copied().collect();
    expected.insert(late);
    assert_eq!(known, expected);
}

#[test]
fn a_connections_id_is_never_reused() {
    let mut hub = hub();
    let first = Raw::open(&mut hub, OWNER);
    hub.left(first.id, at(0));
    let second = Raw::open(&mut hub, OWNER);
    assert_ne!(first.id.wire(), second.id.wire());
    assert!(hub.connection(first.id).is_none());
    hub.receive(first.id, b"late bytes", at(0));
    assert_eq!(hub.spurious(), 0);
}

#[test]
fn whoever_announces_much_waits_and_nobody_loses_his_connection_by_it() {
    let mut hub = hub();
    let mut json = Raw::synchronous(&mut hub, OWNER);
    json.send(
        &mut hub,
        1,
        &Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Json },
    );
    json.read(&mut hub);
    let mut loud = Raw::flow(&mut hub, OWNER);
    let channel = loud.create(&mut hub, "imu");
    // As JSON it is six times as long.
    let text = "\u{1}".repeat(16_000);
    let properties = with_properties([("doc", text.as_str().into())]);
    for _ in 0..100 {
        loud.send(&mut hub, 5, &Command::ChangeHeader { channel, properties: properties.clone() });
    }
    while hub.work(at(0)) {}
    assert!(!hub.wants_input(loud.id), "it waits");
    let mut told = 0;
    for check in 1..=100 {
        let events = messages(json.read(&mut hub));
        assert!(
            !events.iter().any(|event| matches!(event, Event::Closing { .. })),
            "it reads at its leisure"
        );
        told += events
            .iter()
            .filter(|event| matches!(event, Event::HeaderChanged { .. }))
            .count();
        assert!(told <= check * (ANNOUNCED_BYTES_MAX / 96_000 + 1), "so much at a time");
        if told == 100 {
            break;
        }
        hub.tick(at(250 * check as u64));
        while hub.work(at(250 * check as u64)) {}
    }
    assert_eq!(told, 100);
    assert_eq!(tagged(&loud.read(&mut hub), 5).len(), 100, "and is answered");
    assert!(hub.wants_input(loud.id));
}
