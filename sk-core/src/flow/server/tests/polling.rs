//! Polling: the newest message on request, without a subscription.

use super::*;

#[test]
fn s129_s130_a_registered_connection_polls_the_newest_message() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut poller = Raw::synchronous(&mut hub, OWNER);
    poller.send(&mut hub, 1, &Command::Poll { channel });
    assert_eq!(refusal(&poller.read(&mut hub), 1), Some(RefusalCode::NotRegistered));
    for tag in [2, 3] {
        poller.send(&mut hub, tag, &Command::PollRegister { channel });
        assert_eq!(tagged(&poller.read(&mut hub), tag), [Event::Done {}]);
    }
    assert_eq!(messages(owner.read(&mut hub)), [Event::StartPublishing { channel }], "once");
    poller.send(&mut hub, 4, &Command::Poll { channel });
    assert_eq!(refusal(&poller.read(&mut hub), 4), Some(RefusalCode::NothingYet));
    owner.publish(&mut hub, channel, Bytes::from_static(b"old"));
    owner.publish(&mut hub, channel, Bytes::from_static(b"new"));
    assert_eq!(hub.bytes_waiting(), 3 + ITEM_OVERHEAD_BYTES);
    assert!(poller.read(&mut hub).is_empty(), "it hears nothing unless it asks");
    for tag in [5, 6] {
        poller.send(&mut hub, tag, &Command::Poll { channel });
        let latest = Event::Latest { channel, message: 1, payload: Bytes::from_static(b"new") };
        assert_eq!(tagged(&poller.read(&mut hub), tag), [latest], "as often as it asks");
    }
    poller.send(&mut hub, 7, &Command::PollDeregister { channel });
    assert_eq!(tagged(&poller.read(&mut hub), 7), [Event::Done {}]);
    assert_eq!(messages(owner.read(&mut hub)), [Event::StopPublishing { channel }]);
    assert_eq!(hub.bytes_waiting(), 0);
    poller.send(&mut hub, 8, &Command::Poll { channel });
    assert_eq!(refusal(&poller.read(&mut hub), 8), Some(RefusalCode::NotRegistered));
}

#[test]
fn a_long_answer_comes_in_pieces_and_later_commands_wait_for_its_end() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "camera");
    let mut poller = Raw::synchronous(&mut hub, OWNER);
    poller.send(&mut hub, 1, &Command::PollRegister { channel });
    poller.read(&mut hub);
    owner.hand(&mut hub, channel, &Bytes::from(vec![7; MESSAGE_BYTES_MAX]));
    poller.send(&mut hub, 2, &Command::Poll { channel });
    poller.send(&mut hub, 3, &Command::Ping {});
    let mut bytes = 0;
    for event in poller.read(&mut hub) {
        assert_eq!(event.tag, 2, "the answer to the later one is not among them");
        if let Event::Latest { payload, .. } = &event.message {
            bytes += payload.len();
        }
    }
    assert_eq!(bytes, MESSAGE_BYTES_MAX);
    while hub.work(at(0)) {}
    assert_eq!(tagged(&poller.read(&mut hub), 3), [Event::Pong {}]);
}

#[test]
fn a_connection_that_ends_polls_no_more_and_a_channel_that_goes_is_gone() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut poller = Raw::synchronous(&mut hub, OWNER);
    let mut leaver = Raw::synchronous(&mut hub, OWNER);
    for raw in [&poller, &leaver] {
        raw.send(&mut hub, 1, &Command::PollRegister { channel });
    }
    owner.publish(&mut hub, channel, Bytes::from_static(b"new"));
    leaver.read(&mut hub);
    hub.left(leaver.id, at(0));
    assert!(!messages(owner.read(&mut hub)).contains(&Event::StopPublishing { channel }));
    hub.close_channel(channel);
    assert_eq!((hub.bytes_waiting(), hub.kept), (0, 0));
    poller.send(&mut hub, 2, &Command::Poll { channel });
    assert_eq!(refusal(&poller.read(&mut hub), 2), Some(RefusalCode::Gone));
    poller.send(&mut hub, 3, &Command::PollRegister { channel });
    assert_eq!(refusal(&poller.read(&mut hub), 3), Some(RefusalCode::Gone));
}

#[test]
fn a_connection_that_becomes_a_flow_polls_no_more_and_its_place_can_be_taken() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create(&mut hub, "imu");
    let mut session = [0; 16];
    for nonce in [101, 102, 103] {
        let id = hub.open(OWNER, [nonce; 32], at(0)).expect("a place");
        let mut poller = Raw { id, inbound: Inbound::new() };
        for command in
            [Raw::hello(FRAGMENT_BYTES_MAX as u32), Command::LoginPeer {}, Command::PollRegister { channel }]
        {
            poller.send(&mut hub, 1, &command);
        }
        poller.read(&mut hub);
        owner.publish(&mut hub, channel, Bytes::from_static(b"new"));
        owner.read(&mut hub);
        assert!(hub.kept > 0, "the newest is kept for it");
        let begins = Command::SetAsync { name: "arm".into(), session, form: Form::Binary };
        poller.send(&mut hub, 2, &begins);
        let begun = tagged(&poller.read(&mut hub), 2);
        let Some(Event::FlowBegun { session: own, .. }) = begun.last() else { panic!("{begun:?}") };
        session = *own;
        assert_eq!(messages(owner.read(&mut hub)), [Event::StopPublishing { channel }]);
        assert_eq!(hub.kept, 0, "nobody can ask for it any more");
    }
    hub.close_channel(channel);
    hub.tick(at(2000));
    assert_eq!((hub.kept, hub.bytes_waiting()), (0, 0));
}
