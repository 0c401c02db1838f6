//! Time, turns and the end of connections.

use super::*;

#[test]
fn a_peer_that_lets_control_frames_pile_up_is_closed_and_is_not_spurious() {
    let mut hub = hub();
    let stuck = Raw::flow(&mut hub, OWNER);
    let mut good = Raw::flow(&mut hub, OWNER);
    let name: Name = format!("hub.{}", "x".repeat(240)).parse().expect("a name");
    for _ in 0..20_000 {
        let channel = hub.open_channel(name.clone(), no_properties()).expect("room");
        hub.close_channel(channel);
        good.read(&mut hub);
    }
    assert!(hub.connection(good.id).is_some());
    let mut closing = Raw { id: stuck.id, inbound: Inbound::new() };
    closing.inbound.advance();
    let last = messages(closing.read(&mut hub)).pop();
    assert!(
        matches!(last, Some(Event::Closing { reason, .. }) if reason == ClosingReason::ControlFull.code())
    );
    assert_eq!(ending(&mut hub, stuck.id), Some(Ending::Closed(ClosingReason::ControlFull)));
    assert_eq!(hub.spurious(), 0);
}

#[test]
fn a_connection_without_login_ends_after_two_seconds_whatever_it_drips() {
    let mut hub = hub();
    let raw = Raw::open(&mut hub, OWNER);
    for (step, byte) in Raw::hello(1024)
        .encode(1, Flags::NONE)
        .to_vec()
        .into_iter()
        .enumerate()
        .take(19)
    {
        hub.receive(raw.id, &[byte], at(100 * step as u64));
        hub.tick(at(100 * step as u64));
    }
    assert!(hub.connection(raw.id).is_some() && ending(&mut hub, raw.id).is_none());
    hub.tick(at(2200));
    while hub.take(raw.id).is_some() {}
    assert_eq!(ending(&mut hub, raw.id), Some(Ending::Closed(ClosingReason::Silent)));
}

#[test]
fn a_silent_flow_is_asked_and_given_up_and_one_that_answers_stays() {
    let mut hub = hub();
    let silent = Raw::flow(&mut hub, OWNER);
    let mut alive = Raw::flow(&mut hub, OWNER);
    let mut pings = 0;
    for ms in (0..7000).step_by(50) {
        hub.tick(at(ms));
        for event in alive.read(&mut hub) {
            if event.message == (Event::Ping {}) {
                pings += 1;
                alive.send(&mut hub, event.tag, &Command::Pong {});
            }
        }
    }
    assert_eq!(pings, 3);
    assert!(hub.connection(alive.id).is_some());
    while hub.take(silent.id).is_some() {}
    assert_eq!(ending(&mut hub, silent.id), Some(Ending::Closed(ClosingReason::Silent)));
}

#[test]
fn a_frame_once_begun_must_end_within_ten_seconds() {
    let mut hub = hub();
    let raw = Raw::flow(&mut hub, OWNER);
    let channel = ChannelRef { id: 2000, epoch: 1 };
    let frame =
        Command::Publish { channel, message: 1, payload: Bytes::from(vec![0; 5000]) }.encode(1, Flags::WHOLE);
    for (step, byte) in frame.to_vec().iter().enumerate().take(22) {
        hub.receive(raw.id, &[*byte], at(500 * step as u64));
        hub.tick(at(500 * step as u64));
        while hub.take(raw.id).is_some() {}
    }
    assert_eq!(ending(&mut hub, raw.id), Some(Ending::Closed(ClosingReason::Silent)));
}

#[test]
fn when_too_many_wait_for_their_login_the_oldest_of_the_busiest_address_goes() {
    let mut hub = hub();
    let quiet = Raw::open(&mut hub, Origin::Network([10, 0, 0, 1].into()));
    hub.now = at(1);
    let storm: Vec<_> = (1..UNAUTHENTICATED_MAX)
        .map(|_| Raw::open(&mut hub, Origin::Network([10, 0, 0, 2].into())))
        .collect();
    let mut honest = Raw::open(&mut hub, OWNER);
    while hub.take(storm[0].id).is_some() {}
    assert_eq!(ending(&mut hub, storm[0].id), Some(Ending::Closed(ClosingReason::Crowded)));
    assert!(hub.connection(quiet.id).is_some() && hub.connection(storm[1].id).is_some());
    honest.send(&mut hub, 1, &Raw::hello(1024));
    assert_eq!(honest.read(&mut hub).len(), 1);
}

#[test]
fn a_host_with_many_addresses_counts_as_one_when_somebody_has_to_go() {
    let mut hub = hub();
    let honest = Raw::open(&mut hub, Origin::Network([10, 0, 0, 1].into()));
    hub.now = at(1);
    let storm: Vec<_> = (1..UNAUTHENTICATED_MAX as u16)
        .map(|host| {
            let address = std::net::Ipv6Addr::new(0x2001, 0xdb8, 0, 1, 0, 0, 0, host);
            Raw::open(&mut hub, Origin::Network(address.into()))
        })
        .collect();
    Raw::open(&mut hub, OWNER);
    while hub.take(storm[0].id).is_some() {}
    assert_eq!(ending(&mut hub, storm[0].id), Some(Ending::Closed(ClosingReason::Crowded)));
    assert!(hub.connection(honest.id).is_some(), "who came before them stays");
}

#[test]
fn at_shutdown_everyone_is_told_and_what_waited_is_counted() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut listener = Raw::flow(&mut hub, OWNER);
    listener.subscribe(&mut hub, channel);
    owner.publish(&mut hub, channel, Bytes::from_static(b"pulse"));
    hub.shut_down(at(0));
    let last = messages(listener.read(&mut hub)).pop();
    assert!(matches!(last, Some(Event::Closing { reason, .. }) if reason == ClosingReason::Shutdown.code()));
    hub.tick(at(1500));
    assert_eq!(hub.connections(), 0, "who does not read its last frame goes after a second");
    let totals = hub.totals();
    assert!(totals.balance() && totals.dropped[DropReason::Shutdown as usize] == 1);
}

#[test]
fn one_connection_has_its_turn_and_then_others_have_theirs() {
    let mut hub = hub();
    let mut greedy = Raw::flow(&mut hub, OWNER);
    let ping = Command::Ping {}.encode(1, Flags::NONE).to_vec();
    hub.receive(greedy.id, &ping.repeat(1000), at(0));
    assert_eq!(greedy.read(&mut hub).len(), TURN_COST_MAX as usize);
    assert!(!hub.wants_input(greedy.id));
    while hub.work(at(0)) {}
    assert_eq!(greedy.read(&mut hub).len(), 1000 - TURN_COST_MAX as usize);
    assert!(hub.wants_input(greedy.id));
}

#[test]
fn a_pulse_costs_what_is_due_and_not_what_is_idle() {
    let mut hub = hub();
    let connections: Vec<Raw> = (0..500)
        .map(|_| Raw::flow(&mut hub, Origin::Inside { rights: Rights::ALL }))
        .collect();
    hub.tick(at(3000));
    assert_eq!(hub.alarms.len(), 0, "nothing is ever due of a module inside that says nothing");
    let outside = Raw::flow(&mut hub, OWNER);
    for ms in (3000..60_000).step_by(250) {
        hub.tick(at(ms));
        hub.receive(outside.id, &Command::Ping {}.encode(1, Flags::NONE).to_vec(), at(ms));
        while hub.take(outside.id).is_some() {}
        assert!(hub.alarms.len() <= 2, "what is heard sets no alarm");
    }
    assert_eq!(hub.connections(), connections.len() + 1);
}

#[test]
fn after_five_failures_of_an_address_in_a_minute_failures_are_answered_late_and_successes_are_not() {
    let mut hub = hub();
    let bad = Command::LoginToken { proof: [3; 32] };
    let address = Origin::Network([10, 0, 0, 9].into());
    let fail = |hub: &mut ServerCore, origin: Origin, command: &Command| {
        let mut raw = Raw::open(hub, origin);
        raw.send(hub, 1, &Raw::hello(1024));
        raw.read(hub);
        raw.send(hub, 2, command);
        let closed = matches!(messages(raw.read(hub)).pop(), Some(Event::Closing { .. }));
        (raw, closed)
    };
    for attempt in 1..=FAILED_LOGINS_FREE + 1 {
        // Whether there is no such way or the proof is wrong must not show.
        let command = if attempt % 2 == 0 { &bad } else { &Command::LoginPeer {} };
        let (mut raw, closed) = fail(&mut hub, address, command);
        assert_eq!(closed, attempt <= FAILED_LOGINS_FREE, "attempt {attempt}");
        if !closed {
            raw.send(&mut hub, 3, &bad);
            assert!(!hub.wants_input(raw.id), "nothing more is read meanwhile");
            hub.tick(at(900));
            assert!(raw.read(&mut hub).is_empty());
            hub.tick(at(1250));
            let last = messages(raw.read(&mut hub)).pop();
            assert!(
                matches!(last, Some(Event::Closing { reason, .. }) if reason == ClosingReason::LoginFailed.code())
            );
        }
    }
    assert!(fail(&mut hub, Origin::Network([10, 0, 0, 8].into()), &bad).1, "others are not concerned");
    let token = Credentials::Token(OwnerToken::new([7; 32]));
    let mut good = SatelliteCore::flow(token, [3; 32], hub.now);
    let id = hub.open(address, [5; 32], hub.now).expect("a place");
    for _ in 0..4 {
        while let Some(frame) = good.take() {
            hub.receive(id, &frame.to_vec(), hub.now);
        }
        while let Some(frame) = hub.take(id) {
            good.receive(&frame.to_vec(), hub.now).expect("the hub is honest");
        }
    }
    assert!(good.is_ready(), "who knows the token is let in at once");
}
