//! Calls, requests and answers, and what becomes of those whose other side has gone.

use super::*;
use proptest::prelude::*;

fn reply(more: u8, payload: &'static [u8]) -> Event {
    Event::Reply { more, payload: Bytes::from_static(payload) }
}

/// A hub, the owner of a service, somebody who asks, and the service.
fn parties() -> (ServerCore, Raw, Raw, ChannelRef) {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let service = owner.serve(&mut hub, "gripper");
    let asker = Raw::flow(&mut hub, OWNER);
    (hub, owner, asker, service)
}

#[test]
fn s109_a_request_goes_to_the_owner_alone_and_its_answer_to_the_asker_alone() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    let mut other = Raw::flow(&mut hub, OWNER);
    asker.call(&mut hub, 5, channel, b"open");
    let events = owner.read(&mut hub);
    let Some(Event::Request { request, asker: from, payload, .. }) = messages(events).pop() else {
        panic!("no request")
    };
    assert_eq!((from, payload.as_ref()), (asker.id.wire(), b"open".as_slice()));
    owner.answer(&mut hub, request, 0, b"done");
    let events = asker.read(&mut hub);
    assert_eq!(tagged(&events, 5), [reply(0, b"done")]);
    assert!(other.read(&mut hub).is_empty());
    assert_eq!((hub.open_requests(), hub.unmatched_answers()), (0, 0));
}

#[test]
fn s139_any_bytes_pass_in_both_directions_in_fragments_of_each_side() {
    let mut hub = hub();
    let mut owner = Raw::flow_with(&mut hub, OWNER, 1024);
    let channel = owner.serve(&mut hub, "mirror");
    let mut asker = Raw::flow_with(&mut hub, OWNER, 4096);
    let question: Bytes = (0..50_000_u32).map(|n| (n * 7) as u8).collect();
    for (flags, payload) in crate::flow::fragment::cut(question.clone(), 4096) {
        asker.send_flagged(&mut hub, 5, flags, &Command::Call { channel, deadline_ms: 0, payload });
    }
    let (mut got, mut id) = (Vec::new(), 0);
    for event in messages(owner.read(&mut hub)) {
        if let Event::Request { request, payload, .. } = event {
            assert!(payload.len() <= 1024);
            got.extend_from_slice(&payload);
            id = request;
        }
    }
    assert_eq!(got, question);
    for (flags, payload) in crate::flow::fragment::cut(question.clone(), 1000) {
        owner.send_flagged(&mut hub, 0, flags, &Command::Answer { request: id, more: 0, payload });
    }
    let events = asker.read(&mut hub);
    let back: Vec<u8> = tagged(&events, 5)
        .into_iter()
        .flat_map(|event| match event {
            Event::Reply { payload, .. } => payload.to_vec(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(back, question);
}

#[test]
fn no_payload_byte_is_copied_between_parties_inside_the_process() {
    let (mut hub, owner, asker, channel) = parties();
    let question = Bytes::from(vec![1; SHARED_PAYLOAD_BYTES_MIN]);
    let call = Command::Call { channel, deadline_ms: 0, payload: question.clone() };
    hub.accept(asker.id, call.encode(5, Flags::WHOLE), at(0));
    let taken = std::iter::from_fn(|| hub.take(owner.id)).last().expect("a request");
    assert_eq!(taken.payload.as_ptr(), question.as_ptr());
}

#[test]
fn s138_a_service_streams_to_one_asker_until_the_last_answer() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    asker.call(&mut hub, 5, channel, b"scan");
    let request = owner.request(&mut hub);
    for second in 1..=9 {
        // Each answer gives the next one five seconds more.
        hub.tick(at(second * 4000));
        asker.send(&mut hub, 6, &Command::Ping {});
        owner.answer(&mut hub, request, 1, b"line");
    }
    owner.answer(&mut hub, request, 0, b"end");
    owner.answer(&mut hub, request, 0, b"too late");
    let mut wanted = vec![reply(1, b"line"); 9];
    wanted.push(reply(0, b"end"));
    let events = asker.read(&mut hub);
    assert_eq!(tagged(&events, 5), wanted);
    assert_eq!(hub.unmatched_answers(), 1);
}

#[test]
fn no_such_service_owner_gone_and_no_answer_are_different() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    asker.call(&mut hub, 1, ChannelRef { id: channel.id, epoch: channel.epoch + 1 }, b"x");
    assert_eq!(refusal(&asker.read(&mut hub), 1), Some(RefusalCode::NoSuchService));
    let stream = owner.create(&mut hub, "imu");
    asker.call(&mut hub, 2, stream, b"x");
    assert_eq!(refusal(&asker.read(&mut hub), 2), Some(RefusalCode::WrongKind));

    asker.call(&mut hub, 3, channel, b"x");
    let declined = owner.request(&mut hub);
    owner.send(&mut hub, 0, &Command::Decline { request: declined, text: "not now".into() });
    let events = asker.read(&mut hub);
    let code = RefusalCode::Declined.code();
    assert_eq!(tagged(&events, 3), [Event::Refused { code, text: "not now".into() }]);
    assert_eq!(messages(owner.read(&mut hub)), []);

    asker.call(&mut hub, 4, channel, b"x");
    asker.call(&mut hub, 5, channel, b"x");
    assert_eq!(owner.requests(&mut hub).len(), 2);
    hub.left(owner.id, at(0));
    let events = asker.read(&mut hub);
    for tag in [4, 5] {
        assert_eq!(refusal(&events, tag), Some(RefusalCode::OwnerGone), "both in the same turn");
    }
    assert_eq!(hub.open_requests(), 0);
}

#[test]
fn s133_silence_is_answered_by_the_hub_at_the_deadline_and_a_late_answer_is_dropped() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    let call = |deadline_ms| Command::Call { channel, deadline_ms, payload: Bytes::new() };
    asker.send_flagged(&mut hub, 101, Flags::WHOLE, &call(30));
    asker.send_flagged(&mut hub, 102, Flags::WHOLE, &call(0));
    let requests = owner.requests(&mut hub);
    assert_eq!(hub.next_deadline(), at(30));
    hub.tick(at(29));
    assert!(asker.read(&mut hub).is_empty());
    hub.tick(at(30));
    assert_eq!(refusal(&asker.read(&mut hub), 101), Some(RefusalCode::NoAnswer));
    assert_eq!(messages(owner.read(&mut hub)), [Event::RequestOver { request: requests[0] }]);
    owner.answer(&mut hub, requests[0], 0, b"late");
    assert_eq!(hub.unmatched_answers(), 1);
    assert!(hub.connection(owner.id).is_some(), "it raced with the deadline, which is no crime");
    hub.tick(at(4999));
    assert!(tagged(&asker.read(&mut hub), 102).is_empty());
    hub.tick(at(5000));
    assert_eq!(
        refusal(&asker.read(&mut hub), 102),
        Some(RefusalCode::NoAnswer),
        "five seconds by default"
    );
}

#[test]
fn an_asker_that_vanishes_or_cancels_is_waited_for_no_more() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    let mut gone = Raw::flow(&mut hub, OWNER);
    gone.read(&mut hub);
    gone.call(&mut hub, 9, channel, b"x");
    asker.call(&mut hub, 9, channel, b"x");
    let requests = owner.requests(&mut hub);
    hub.left(gone.id, at(0));
    assert_eq!(messages(owner.read(&mut hub)), [Event::RequestOver { request: requests[0] }]);
    asker.send(&mut hub, 10, &Command::Cancel { call: 9 });
    asker.send(&mut hub, 11, &Command::Cancel { call: 9 });
    assert_eq!(messages(owner.read(&mut hub)), [Event::RequestOver { request: requests[1] }]);
    owner.answer(&mut hub, requests[1], 0, b"for nobody");
    assert!(asker.read(&mut hub).is_empty());
    asker.call(&mut hub, 9, channel, b"again");
    assert_eq!(owner.requests(&mut hub).len(), 1);
}

#[test]
fn answers_that_wait_for_an_asker_go_no_more_once_it_has_cancelled() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    asker.call(&mut hub, 5, channel, b"x");
    let request = owner.request(&mut hub);
    owner.answer(&mut hub, request, 1, b"one");
    owner.answer(&mut hub, request, 0, b"two");
    asker.send(&mut hub, 6, &Command::Cancel { call: 5 });
    assert!(asker.read(&mut hub).is_empty());
    assert!(messages(owner.read(&mut hub)).is_empty(), "it had answered before");
}

#[test]
fn an_answer_whose_request_ends_in_the_middle_of_it_leaves_nothing_behind() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    asker.call(&mut hub, 100, channel, b"x");
    let request = owner.request(&mut hub);
    let piece = |bytes| Command::Answer { request, more: 0, payload: Bytes::from(vec![1; bytes]) };
    owner.send_flagged(&mut hub, 0, Flags::FIRST, &piece(5000));
    let held = |hub: &ServerCore| hub.connections.get(owner.id).expect("alive").gathering.bytes();
    assert!(held(&hub) > 5000);
    hub.tick(at(5000));
    assert_eq!(held(&hub), 0);
    owner.send_flagged(&mut hub, 0, Flags::NONE, &piece(5000));
    owner.send_flagged(&mut hub, 0, Flags::LAST, &piece(5000));
    assert_eq!((held(&hub), hub.unmatched_answers()), (0, 1));
    assert_eq!(refusal(&asker.read(&mut hub), 100), Some(RefusalCode::NoAnswer));
}

#[test]
fn an_owner_that_has_not_heard_of_a_request_is_not_told_of_its_end() {
    let (mut hub, mut owner, asker, channel) = parties();
    asker.call(&mut hub, 5, channel, b"x");
    asker.send(&mut hub, 6, &Command::Cancel { call: 5 });
    assert!(owner.read(&mut hub).is_empty());
}

#[test]
fn s135_a_call_blocks_the_later_commands_of_a_synchronous_connection_and_no_other() {
    let (mut hub, mut owner, mut other, channel) = parties();
    let mut temporary = Raw::open(&mut hub, OWNER);
    for command in [Raw::hello(1024), Command::LoginPeer {}] {
        temporary.send(&mut hub, 1, &command);
    }
    temporary.read(&mut hub);
    let payload = Bytes::from(vec![7; 3000]);
    for (flags, payload) in crate::flow::fragment::cut(payload, 1024) {
        temporary.send_flagged(&mut hub, 5, flags, &Command::Call { channel, deadline_ms: 0, payload });
    }
    temporary.send(&mut hub, 6, &Command::Ping {});
    other.send(&mut hub, 7, &Command::Ping {});
    assert!(temporary.read(&mut hub).is_empty());
    assert!(hub.wants_input(temporary.id), "its end would be seen");
    assert!(tagged(&other.read(&mut hub), 7).contains(&Event::Pong {}));
    let request = owner.requests(&mut hub)[0];
    // More than lies ready for the transport at once.
    for (flags, payload) in crate::flow::fragment::cut(Bytes::from(vec![8; 200 * 1024]), 1024) {
        owner.send_flagged(&mut hub, 0, flags, &Command::Answer { request, more: 0, payload });
    }
    let mut events = Vec::new();
    while let Some(frame) = hub.take(temporary.id) {
        temporary.inbound.feed(&frame.to_vec());
        events.extend(temporary.inbound.next().expect("the hub is honest"));
        while hub.work(at(0)) {}
    }
    let tags: Vec<u32> = events.iter().map(|event| event.tag).collect();
    assert_eq!((tags.len(), tags.last()), (201, Some(&6)), "the answers come in order");
}

#[test]
fn a_refused_call_lets_a_synchronous_connection_go_on() {
    let (mut hub, owner, _, channel) = parties();
    let mut temporary = Raw::open(&mut hub, OWNER);
    for command in [Raw::hello(1024), Command::LoginPeer {}] {
        temporary.send(&mut hub, 1, &command);
    }
    temporary.read(&mut hub);
    temporary.call(&mut hub, 5, channel, b"x");
    temporary.send(&mut hub, 6, &Command::Ping {});
    hub.left(owner.id, at(0));
    while hub.work(at(0)) {}
    let events = temporary.read(&mut hub);
    assert_eq!(refusal(&events, 5), Some(RefusalCode::OwnerGone));
    assert_eq!(tagged(&events, 6), [Event::Pong {}]);
}

#[test]
fn the_end_of_a_stream_of_answers_does_not_overtake_it() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    asker.call(&mut hub, 5, channel, b"x");
    let request = owner.request(&mut hub);
    for payload in [b"one".as_slice(), b"two"] {
        owner.answer(&mut hub, request, 1, payload);
    }
    hub.left(owner.id, at(0));
    let events = asker.read(&mut hub);
    let code = RefusalCode::OwnerGone.code();
    let refused = Event::Refused { code, text: RefusalCode::OwnerGone.to_string() };
    assert_eq!(tagged(&events, 5), [reply(1, b"one"), reply(1, b"two"), refused]);
}

#[test]
fn a_heavy_request_does_not_delay_a_light_one_nor_a_stream() {
    let (mut hub, mut owner, asker, channel) = parties();
    let publisher = &mut Raw::flow(&mut hub, OWNER);
    let stream = publisher.create(&mut hub, "imu");
    owner.subscribe(&mut hub, stream);
    let heavy = Bytes::from(vec![0; 1_000_000]);
    for (flags, payload) in crate::flow::fragment::cut(heavy, FRAGMENT_BYTES_MAX) {
        asker.send_flagged(&mut hub, 1, flags, &Command::Call { channel, deadline_ms: 0, payload });
    }
    publisher.publish(&mut hub, stream, Bytes::from_static(b"pulse"));
    asker.call(&mut hub, 2, channel, b"light");
    let events = messages(owner.read(&mut hub));
    let light = events
        .iter()
        .position(|event| matches!(event, Event::Request { payload, .. } if payload.as_ref() == b"light"));
    let data = events.iter().position(|event| matches!(event, Event::Data { .. }));
    assert!(
        light.is_some_and(|place| place < 5) && data.is_some_and(|place| place < 5),
        "{light:?} {data:?}"
    );
}

#[test]
fn the_hub_itself_owns_a_service() {
    let mut hub = hub();
    let channel = hub
        .open_service("hub.modules".parse().expect("a name"), no_properties())
        .expect("free");
    let mut asker = Raw::flow(&mut hub, OWNER);
    for (tag, payload) in [(1, b"list".as_slice()), (2, b"stop"), (3, b"other")] {
        asker.call(&mut hub, tag, channel, payload);
    }
    let asked: Vec<(RequestId, Bytes)> = std::iter::from_fn(|| hub.next_notice())
        .filter_map(|notice| match notice {
            Notice::Request { request, payload, .. } => Some((request, payload)),
            _ => None,
        })
        .collect();
    assert_eq!(asked[0].1, b"list"[..]);
    assert_eq!(hub.answer_own(asked[0].0, Bytes::from_static(b"host"), false), Ok(true));
    assert_eq!(hub.answer_own(asked[0].0, Bytes::new(), false), Ok(false), "it is over");
    assert!(hub.decline_own(asked[1].0, &"ä".repeat(200)));
    assert!(hub.close_channel(channel));
    let events = asker.read(&mut hub);
    assert_eq!(tagged(&events, 1), [reply(0, b"host")]);
    let text = "ä".repeat(127);
    assert_eq!(tagged(&events, 2), [Event::Refused { code: RefusalCode::Declined.code(), text }]);
    assert_eq!(refusal(&events, 3), Some(RefusalCode::OwnerGone));
    let over = std::iter::from_fn(|| hub.next_notice())
        .filter(|notice| matches!(notice, Notice::RequestOver { .. }))
        .count();
    assert_eq!((over, hub.open_requests()), (1, 0));
}

#[test]
fn nobody_answers_for_another() {
    let (mut hub, mut owner, mut asker, channel) = parties();
    let thief = Raw::flow(&mut hub, OWNER);
    asker.call(&mut hub, 5, channel, b"x");
    let request = owner.request(&mut hub);
    thief.answer(&mut hub, request, 0, b"false");
    thief.send(&mut hub, 0, &Command::Decline { request, text: String::new() });
    assert!(tagged(&asker.read(&mut hub), 5).is_empty());
    assert_eq!(hub.unmatched_answers(), 2);
    owner.answer(&mut hub, request, 0, b"true");
    let events = asker.read(&mut hub);
    assert_eq!(tagged(&events, 5), [reply(0, b"true")]);
}

#[test]
fn without_the_right_to_call_or_serve_nothing_comes_of_it() {
    let (mut hub, mut owner, _, channel) = parties();
    let mut guest = Raw::flow(&mut hub, Origin::Inside { rights: Rights::NONE });
    for (flags, payload) in crate::flow::fragment::cut(Bytes::from(vec![0; 20]), 10) {
        guest.send_flagged(&mut hub, 5, flags, &Command::Call { channel, deadline_ms: 0, payload });
    }
    guest.send(&mut hub, 6, &Command::CreateService { name: "x".into(), properties: no_properties() });
    let events = guest.read(&mut hub);
    assert_eq!(refusal(&events, 5), Some(RefusalCode::Denied));
    assert_eq!(tagged(&events, 5).len(), 1, "one refusal for all its fragments");
    assert_eq!(refusal(&events, 6), Some(RefusalCode::Denied));
    assert!(owner.read(&mut hub).is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn every_call_has_exactly_one_end_whatever_happens(
        steps in prop::collection::vec((0_u8..12, 0_usize..3, any::<prop::sample::Index>()), 0..200),
    ) {
        let mut hub = hub();
        let mut flows: Vec<Raw> = (0..3).map(|_| Raw::flow(&mut hub, OWNER)).collect();
        let mut services: Vec<(usize, ChannelRef)> = Vec::new();
        let mut requests: Vec<(usize, u64)> = Vec::new();
        // The ends that each call had, by connection and tag; a cancelled one or one of a vanished asker has none.
        let mut calls: std::collections::BTreeMap<(ConnectionId, u32), u32> = Default::default();
        let (mut tag, mut now, mut serial) = (100, 0, 0);
        let read = |hub: &mut ServerCore, who: usize, flow: &mut Raw, requests: &mut Vec<(usize, u64)>,
                        calls: &mut std::collections::BTreeMap<(ConnectionId, u32), u32>| {
            for Tagged { tag, flags, message } in flow.read(hub) {
                let last = match message {
                    Event::Request { request, .. } => {
                        requests.push((who, request));
                        false
                    }
                    Event::Reply { more, .. } => {
                        assert!(calls.get(&(flow.id, tag)).is_none_or(|ends| *ends == 0), "nothing follows the end");
                        more == 0 && flags.has(Flags::LAST)
                    }
                    Event::Refused { .. } => true,
                    _ => false,
                };
                if last && let Some(ends) = calls.get_mut(&(flow.id, tag)) {
                    *ends += 1;
                }
            }
        };
        for (step, who, pick) in steps {
            match step {
                0 if services.len() < 4 => {
                    serial += 1;
                    let create = Command::CreateService { name: format!("s{serial}"), properties: no_properties() };
                    flows[who].send(&mut hub, 1, &create);
                    if let Some((channel, _)) = hub.channels().find(|(channel, _)| services.iter().all(|(_, known)| *known != channel.reference)) {
                        services.push((who, channel.reference));
                    }
                }
                1..=4 if !services.is_empty() => {
                    let (_, channel) = services[pick.index(services.len())];
                    tag += 1;
                    calls.insert((flows[who].id, tag), 0);
                    let deadline_ms = [0, 1, 20, 300][pick.index(4)];
                    let payload = Bytes::from(vec![3; [0, 10, 2000, 100_000][pick.index(4)]]);
                    for (flags, payload) in crate::flow::fragment::cut(payload, FRAGMENT_BYTES_MAX) {
                        flows[who].send_flagged(&mut hub, tag, flags, &Command::Call { channel, deadline_ms, payload });
                    }
                }
                5..=7 if !requests.is_empty() => {
                    let (owner, request) = requests[pick.index(requests.len())];
                    let more = u8::from(step == 7);
                    if step == 6 && pick.index(2) == 0 {
                        flows[owner].send(&mut hub, 0, &Command::Decline { request, text: String::new() });
                    } else {
                        flows[owner].answer(&mut hub, request, more, b"answer");
                    }
                }
                8 if !calls.is_empty() => {
                    let (asker, tag) = *calls.keys().nth(pick.index(calls.len())).expect("one");
                    if asker == flows[who].id && calls[&(asker, tag)] == 0 {
                        flows[who].send(&mut hub, 2, &Command::Cancel { call: tag });
                        calls.remove(&(asker, tag));
                    }
                }
                9 => read(&mut hub, who, &mut flows[who], &mut requests, &mut calls),
                10 => {
                    now += 7;
                    hub.tick(at(now));
                }
                11 if pick.index(4) == 0 => {
                    let old = flows[who].id;
                    hub.left(old, at(now));
                    calls.retain(|(asker, _), _| *asker != old);
                    services.retain(|(owner, _)| *owner != who);
                    requests.retain(|(owner, _)| *owner != who);
                    flows[who] = Raw::flow(&mut hub, OWNER);
                }
                11 if !services.is_empty() => {
                    let (_, channel) = services.swap_remove(pick.index(services.len()));
                    hub.close_channel(channel);
                }
                _ => {}
            }
        }
        // Within the longest deadline everything has come to its end. Everybody is alive until then.
        for second in 0..4 {
            now += 1500;
            for (who, flow) in flows.iter_mut().enumerate() {
                flow.send(&mut hub, 3, &Command::Ping {});
                read(&mut hub, who, flow, &mut requests, &mut calls);
            }
            hub.tick(at(now + second));
        }
        for (who, flow) in flows.iter_mut().enumerate() {
            read(&mut hub, who, flow, &mut requests, &mut calls);
        }
        prop_assert!(calls.values().all(|ends| *ends == 1), "{calls:?}");
        prop_assert_eq!(hub.open_requests(), 0);
        for flow in &flows {
            let connection = hub.connections.get(flow.id).expect("alive");
            prop_assert!(connection.calls.is_empty() && connection.serving.is_empty());
            prop_assert!(connection.gathering.bytes() == 0 && !connection.output.has_talks());
        }
    }
}

#[test]
fn nothing_follows_the_closing_of_one_who_has_a_long_answer_before_him() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let service = owner.serve(&mut hub, "maps");
    let mut asker = Raw::flow(&mut hub, OWNER);
    asker.call(&mut hub, 5, service, b"all of it");
    let request = owner.request(&mut hub);
    let payload = Bytes::from(vec![7; FRAGMENT_BYTES_MAX]);
    for flags in [Flags::FIRST, Flags::NONE, Flags::NONE, Flags::NONE, Flags::LAST] {
        let answer = Command::Answer { request, more: 0, payload: payload.clone() };
        owner.send_flagged(&mut hub, 0, flags, &answer);
    }
    assert_eq!(asker.read_one(&mut hub).len(), 1, "the answer has begun");
    hub.shut_down(at(0));
    let events = messages(asker.read(&mut hub));
    assert!(matches!(events.last(), Some(Event::Closing { .. })), "{} events", events.len());
    assert!(hub.connection(asker.id).is_none(), "and that is the end");
}
