//! The limits of services, and what is dishonest about a call or an answer.

use super::*;

fn cut(length: usize) -> Vec<(Flags, Bytes)> {
    crate::flow::fragment::cut(Bytes::from(vec![0; length]), FRAGMENT_BYTES_MAX).collect()
}

#[test]
fn t7_an_asker_has_so_many_open_requests_and_no_more() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.serve(&mut hub, "gripper");
    let mut asker = Raw::flow(&mut hub, OWNER);
    let most = REQUESTS_PER_ASKER_MAX as u32;
    for tag in 1..=most + 1 {
        if tag == 7 {
            // One that is still being sent counts too.
            let begun = Command::Call { channel, deadline_ms: 0, payload: Bytes::from_static(b"x") };
            asker.send_flagged(&mut hub, tag, Flags::FIRST, &begun);
        } else {
            asker.call(&mut hub, tag, channel, b"x");
        }
        let refused = (tag > most).then_some(RefusalCode::TooManyRequests);
        assert_eq!(refusal(&asker.read(&mut hub), tag), refused, "call {tag}");
    }
    let request = owner.requests(&mut hub)[0];
    owner.answer(&mut hub, request, 0, b"y");
    asker.call(&mut hub, 1000, channel, b"x");
    assert_eq!(refusal(&asker.read(&mut hub), 1000), None, "there is room again");
    asker.send_flagged(
        &mut hub,
        7,
        Flags::ABORT,
        &Command::Call { channel, deadline_ms: 0, payload: Bytes::new() },
    );
    asker.call(&mut hub, 1001, channel, b"x");
    assert_eq!(refusal(&asker.read(&mut hub), 1001), None, "an aborted call counts no more");
}

#[test]
fn t7_an_owner_has_so_many_open_requests_and_no_more() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let services = ["left", "right"].map(|name| owner.serve(&mut hub, name));
    let per_asker = REQUESTS_PER_ASKER_MAX as u32;
    let askers: Vec<Raw> = (0..=REQUESTS_PER_OWNER_MAX / REQUESTS_PER_ASKER_MAX)
        .map(|_| Raw::flow(&mut hub, OWNER))
        .collect();
    let (last, full) = askers.split_last().expect("some");
    for asker in full {
        (1..=per_asker).for_each(|tag| asker.call(&mut hub, tag, services[(tag % 2) as usize], b"x"));
    }
    assert_eq!(hub.open_requests(), REQUESTS_PER_OWNER_MAX);
    let mut last = Raw { id: last.id, inbound: Inbound::new() };
    State::ALL.iter().for_each(|_| last.inbound.advance());
    last.call(&mut hub, 1, services[0], b"x");
    assert_eq!(refusal(&last.read(&mut hub), 1), Some(RefusalCode::TooManyRequests));
    let request = owner.requests(&mut hub)[0];
    owner.answer(&mut hub, request, 0, b"y");
    last.call(&mut hub, 2, services[0], b"x");
    assert_eq!(refusal(&last.read(&mut hub), 2), None);
}

#[test]
fn a_deadline_may_be_an_hour_and_no_longer() {
    let most = DEADLINE_MAX.as_millis() as u32;
    for (deadline_ms, fits) in [(most - 1, true), (most, true), (most + 1, false)] {
        let mut hub = hub();
        let mut owner = Raw::flow(&mut hub, OWNER);
        let channel = owner.serve(&mut hub, "gripper");
        let asker = Raw::flow(&mut hub, OWNER);
        let call = Command::Call { channel, deadline_ms, payload: Bytes::new() };
        asker.send_flagged(&mut hub, 1, Flags::WHOLE, &call);
        assert_eq!(hub.open_requests(), usize::from(fits));
        let ended = ending(&mut hub, asker.id);
        assert_eq!(matches!(ended, Some(Ending::Spurious(ProtocolError::BadValue { .. }))), !fits);
    }
}

#[test]
fn a_tag_is_not_used_twice_at_once_and_more_is_yes_or_no() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.serve(&mut hub, "gripper");
    let asker = Raw::flow(&mut hub, OWNER);
    asker.call(&mut hub, 1, channel, b"x");
    let request = owner.request(&mut hub);
    asker.call(&mut hub, 1, channel, b"x");
    assert!(matches!(ending(&mut hub, asker.id), Some(Ending::Spurious(_))));
    assert_eq!(messages(owner.read(&mut hub)), [Event::RequestOver { request }]);
    owner.answer(&mut hub, request, 2, b"y");
    assert!(matches!(ending(&mut hub, owner.id), Some(Ending::Spurious(_))));
}

#[test]
fn the_rest_of_a_call_that_was_refused_is_dropped_and_counted() {
    let mut hub = hub();
    let mut asker = Raw::flow(&mut hub, OWNER);
    let channel = ChannelRef { id: 2000, epoch: 1 };
    for (flags, payload) in cut(3 * FRAGMENT_BYTES_MAX) {
        asker.send_flagged(&mut hub, 1, flags, &Command::Call { channel, deadline_ms: 0, payload });
    }
    let events = asker.read(&mut hub);
    assert_eq!(tagged(&events, 1).len(), 1);
    assert_eq!(refusal(&events, 1), Some(RefusalCode::NoSuchService));
    assert_eq!(hub.late_fragments(), 3);
}

#[test]
fn a_service_that_goes_while_a_call_to_it_is_sent_is_told_as_such() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.serve(&mut hub, "gripper");
    let mut asker = Raw::flow(&mut hub, OWNER);
    let [(first, a), (last, b)] = <[_; 2]>::try_from(cut(2 * FRAGMENT_BYTES_MAX)).expect("two pieces");
    asker.send_flagged(&mut hub, 1, first, &Command::Call { channel, deadline_ms: 0, payload: a });
    hub.left(owner.id, at(0));
    asker.send_flagged(&mut hub, 1, last, &Command::Call { channel, deadline_ms: 0, payload: b });
    assert_eq!(refusal(&asker.read(&mut hub), 1), Some(RefusalCode::OwnerGone));
}

#[test]
fn an_asker_that_does_not_read_loses_its_call_and_hears_why() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.serve(&mut hub, "camera");
    let mut asker = Raw::flow(&mut hub, OWNER);
    asker.call(&mut hub, 1, channel, b"all of them");
    let request = owner.request(&mut hub);
    let fits = CONNECTION_BYTES_MAX / (FRAGMENT_BYTES_MAX + ITEM_OVERHEAD_BYTES);
    let payload = Bytes::from(vec![0; FRAGMENT_BYTES_MAX]);
    for _ in 0..=fits {
        assert!(messages(owner.read(&mut hub)).is_empty());
        let answer = Command::Answer { request, more: 1, payload: payload.clone() };
        owner.send_flagged(&mut hub, 0, Flags::WHOLE, &answer);
    }
    assert_eq!(messages(owner.read(&mut hub)), [Event::RequestOver { request }]);
    let events = asker.read(&mut hub);
    assert_eq!(tagged(&events, 1).len(), fits + 1);
    assert_eq!(refusal(&events, 1), Some(RefusalCode::Full), "after all that was queued for it");
    asker.call(&mut hub, 2, channel, b"one");
    let request = owner.request(&mut hub);
    let answer = Command::Answer { request, more: 0, payload: payload.clone() };
    owner.send_flagged(&mut hub, 0, Flags::WHOLE, &answer);
    let events = asker.read(&mut hub);
    let reply = Event::Reply { more: 0, payload };
    assert_eq!(tagged(&events, 2), [reply], "what was taken makes room");
}

#[test]
fn an_owner_that_does_not_read_takes_no_more_requests() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.serve(&mut hub, "camera");
    let mut asker = Raw::flow(&mut hub, OWNER);
    let message = MESSAGE_BYTES_MAX / 2;
    let mut refused = Vec::new();
    for tag in 1..=5 {
        for (flags, payload) in cut(message) {
            asker.send_flagged(&mut hub, tag, flags, &Command::Call { channel, deadline_ms: 0, payload });
            while hub.work(at(0)) {}
        }
        refused.extend(refusal(&asker.read(&mut hub), tag));
    }
    assert_eq!(refused, [RefusalCode::TooManyRequests; 2], "three of 8 MiB fit into 32");
}

#[test]
fn a_message_longer_than_its_receiver_takes_is_refused() {
    let mut hub = hub();
    let mut small = Raw::open(&mut hub, OWNER);
    let mut hello = Raw::hello(1024);
    if let Command::Hello { message_bytes, .. } = &mut hello {
        *message_bytes = 2000;
    }
    for command in [hello, Command::LoginPeer {}, set_async()] {
        small.send(&mut hub, 1, &command);
    }
    small.read(&mut hub);
    let channel = small.serve(&mut hub, "small");
    let mut large = Raw::flow(&mut hub, OWNER);
    let reverse = large.serve(&mut hub, "large");
    for (length, fits) in [(1999, true), (2000, true), (2001, false)] {
        let payload = Bytes::from(vec![0; length]);
        large.send_flagged(&mut hub, 5, Flags::WHOLE, &Command::Call { channel, deadline_ms: 0, payload });
        let refused = refusal(&large.read(&mut hub), 5);
        assert_eq!(refused, (!fits).then_some(RefusalCode::TooLong), "{length} bytes");
        large.send(&mut hub, 6, &Command::Cancel { call: 5 });
        small.read(&mut hub);

        small.call(&mut hub, 8, reverse, b"x");
        let request = large.request(&mut hub);
        let payload = Bytes::from(vec![0; length]);
        large.send_flagged(&mut hub, 0, Flags::WHOLE, &Command::Answer { request, more: 0, payload });
        let refused = refusal(&small.read(&mut hub), 8);
        assert_eq!(refused, (!fits).then_some(RefusalCode::TooLong), "{length} bytes");
        large.read(&mut hub);
    }
}

#[test]
fn t9_an_id_that_was_used_before_answers_nobody() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.serve(&mut hub, "gripper");
    let mut asker = Raw::flow(&mut hub, OWNER);
    asker.call(&mut hub, 1, channel, b"x");
    let stale = owner.request(&mut hub);
    owner.answer(&mut hub, stale, 0, b"first");
    asker.call(&mut hub, 2, channel, b"x");
    let fresh = owner.request(&mut hub);
    assert_eq!((stale as u32, stale != fresh), (fresh as u32, true), "the same place, another generation");
    owner.answer(&mut hub, stale, 0, b"stale");
    assert!(tagged(&asker.read(&mut hub), 2).is_empty());
    assert_eq!(hub.unmatched_answers(), 1);
}
