//! Credit: the owner of a reliable channel waits for its slowest subscriber.

use super::*;
use crate::flow::delivery::charge_of;
use crate::flow::satellite::SatelliteError;

fn reliable() -> Properties {
    with_properties([("delivery", "reliable".into())])
}

fn credits(events: Vec<Tagged<Event>>) -> Vec<u64> {
    let credit = |event: Tagged<Event>| match event.message {
        Event::Credit { bytes, .. } => Some(bytes),
        _ => None,
    };
    events.into_iter().filter_map(credit).collect()
}

#[test]
fn the_slowest_subscriber_governs_and_what_goes_beyond_the_credit_is_dropped() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    owner.send(&mut hub, 1, &Command::CreateStream { name: "log".into(), properties: reliable() });
    assert_eq!(credits(owner.read(&mut hub)), [CREDIT_BYTES], "told with the channel");
    let channel = hub.channels().next().map(|(known, _)| known.reference).expect("created");
    let [mut slow, mut fast] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    slow.subscribe_as(&mut hub, channel, Policy::All, 1);
    fast.subscribe(&mut hub, channel);
    let message = Bytes::from(vec![0; 8192 - ITEM_OVERHEAD_BYTES]);
    let fits = CREDIT_BYTES / 8192;
    for _ in 0..fits {
        owner.hand(&mut hub, channel, &message);
        assert_eq!(fast.heard(&mut hub, channel).len(), 1);
    }
    assert_eq!(credits(owner.read(&mut hub)), [0; 0], "the slow one has taken nothing");
    assert_eq!(hub.counts(slow.id, channel).map(|counts| counts.queued), Some(fits), "whatever its depth");
    owner.hand(&mut hub, channel, &message);
    assert!(fast.heard(&mut hub, channel).is_empty());
    assert_eq!(hub.totals().dropped[DropReason::Credit as usize], 2, "at both");
    assert!(hub.connection(slow.id).is_some(), "it is not the subscriber's fault");
    assert_eq!(slow.heard(&mut hub, channel).len() as u64, fits);
    let granted = credits(owner.read(&mut hub)).into_iter().max().expect("it has caught up");
    assert!(
        (3 * CREDIT_BYTES / 2..=2 * CREDIT_BYTES).contains(&granted),
        "what was dropped cost nothing"
    );
    assert!(hub.totals().balance());
}

#[test]
fn a_message_longer_than_all_credit_gets_through() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create_with(&mut hub, "log", reliable());
    let mut listener = Raw::flow(&mut hub, OWNER);
    listener.subscribe_as(&mut hub, channel, Policy::All, 1);
    let message = Bytes::from(vec![0; MESSAGE_BYTES_MAX]);
    for _ in 0..3 {
        owner.hand(&mut hub, channel, &message);
        assert_eq!(listener.heard(&mut hub, channel).len(), 1);
    }
    let cost = charge_of(MESSAGE_BYTES_MAX, MESSAGE_BYTES_MAX / FRAGMENT_BYTES_MAX) as u64;
    assert_eq!(credits(owner.read(&mut hub)).last(), Some(&(3 * cost + CREDIT_BYTES)));
}

#[test]
fn a_slow_subscriber_that_goes_frees_the_owner() {
    let mut hub = hub();
    let mut owner = Raw::flow(&mut hub, OWNER);
    let channel = owner.create_with(&mut hub, "log", reliable());
    let [mut slow, mut other] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    slow.subscribe(&mut hub, channel);
    other.subscribe(&mut hub, channel);
    owner.hand(&mut hub, channel, &Bytes::from(vec![0; 2 << 20]));
    other.heard(&mut hub, channel);
    assert_eq!(credits(owner.read(&mut hub)), [0; 0]);
    hub.left(slow.id, at(0));
    assert_eq!(credits(owner.read(&mut hub)).len(), 1);
}

#[test]
fn a_satellite_turns_messages_away_and_says_when_to_go_on() {
    let mut hub = hub();
    let mut publisher = SatelliteCore::flow(Credentials::Peer, [3; 32], at(0));
    let id = hub.open(OWNER, [5; 32], at(0)).expect("a place");
    let settle = |hub: &mut ServerCore, publisher: &mut SatelliteCore| {
        let mut events = Vec::new();
        for _ in 0..4 {
            while let Some(frame) = publisher.take() {
                hub.accept(id, frame, at(0));
                while hub.work(at(0)) {}
            }
            while let Some(frame) = hub.take(id) {
                publisher.accept(frame, at(0)).expect("the hub is honest");
            }
            events.extend(std::iter::from_fn(|| publisher.next_event()));
        }
        events
    };
    settle(&mut hub, &mut publisher);
    publisher.create("log", &reliable().variant()).expect("a flow");
    settle(&mut hub, &mut publisher);
    let channel = publisher.channel("robot.log").expect("created").channel;
    let mut slow = Raw::flow(&mut hub, OWNER);
    slow.subscribe_as(&mut hub, channel, Policy::All, 1);
    settle(&mut hub, &mut publisher);
    let message = Bytes::from(vec![0; 100_000]);
    let mut sent = 0;
    // Many times the credit, and with interruptions in which nobody listens.
    for round in 0..40 {
        while publisher.publish(channel, message.clone()) == Ok(true) {
            sent += 1;
        }
        assert_eq!(publisher.publish(channel, message.clone()), Err(SatelliteError::Full));
        settle(&mut hub, &mut publisher);
        let heard = slow.heard(&mut hub, channel).len();
        assert!(heard > 0, "round {round}");
        let events = settle(&mut hub, &mut publisher);
        assert!(events.contains(&SatelliteEvent::Room(channel)), "round {round}: {events:?}");
        slow.send(&mut hub, 1, &Command::Unsubscribe { channel });
        assert_eq!(publisher.publish(channel, message.clone()), Ok(true), "it does not know yet");
        settle(&mut hub, &mut publisher);
        slow.read(&mut hub);
        slow.subscribe_as(&mut hub, channel, Policy::All, 1);
        settle(&mut hub, &mut publisher);
    }
    assert!(sent >= 40 * 10);
    let totals = hub.totals();
    assert_eq!((totals.delivered, totals.dropped_in_all()), (sent, 0), "no message was lost");
}
