//! What a hub holds for all connections together, and what it refuses beyond: unfinished messages, requests and
//! answers.

mod lines;

use bytes::Bytes;
use lines::{Line, hub};
use sk_core::SkVariant;
use sk_core::flow::satellite::SatelliteEvent;
use sk_core::flow::server::{Notice, ServerCore};
use sk_core::flow::{ChannelRef, Properties, RefusalCode};
use std::time::Duration;

const KIB: usize = 1024;
/// What the hubs of these tests may hold; half of it of unfinished messages.
const BYTES_MAX: usize = 1024 * KIB;
/// What a request or answer of this length is charged: in five fragments of 64 KiB and a little for each.
const LONG: usize = 300 * KIB;
const LONG_CHARGE: usize = LONG + 5 * 64;
const MINUTE: Duration = Duration::from_secs(60);

fn narrow_hub() -> ServerCore {
    let mut hub = hub();
    hub.narrow_bytes(BYTES_MAX);
    hub
}

fn long() -> Bytes {
    Bytes::from(vec![7; LONG])
}

/// A flow with a channel that is worth publishing on while nobody listens.
fn publisher(hub: &mut ServerCore, number: u8) -> (Line, ChannelRef) {
    let mut line = Line::new(hub, number, |core| core);
    let properties = SkVariant::map([("latch", true.into())]);
    line.core.create(&format!("map{number}"), &properties).expect("a flow");
    line.exchange(hub);
    let channel = line.core.channel(&format!("robot.map{number}")).expect("it was made").channel;
    line.events();
    (line, channel)
}

fn refusals(line: &mut Line) -> Vec<RefusalCode> {
    let code = |event| match event {
        SatelliteEvent::Refused { code, .. } => RefusalCode::from_code(code),
        _ => None,
    };
    line.events().into_iter().filter_map(code).collect()
}

#[test]
fn t5_unfinished_messages_of_all_connections_share_half_of_what_a_hub_may_hold() {
    let mut hub = narrow_hub();
    let (mut first, one) = publisher(&mut hub, 1);
    let (mut second, two) = publisher(&mut hub, 2);
    assert_eq!(first.core.publish(one, long()), Ok(true));
    assert_eq!(second.core.publish(two, long()), Ok(true));
    // All but the last fragments.
    first.send(&mut hub, 4);
    let held = 4 * (64 * KIB + 64);
    assert_eq!(hub.bytes_waiting(), held);
    second.send(&mut hub, 3);
    assert_eq!(hub.bytes_waiting(), held + 3 * (64 * KIB + 64), "two do not know of each other");
    second.send(&mut hub, 1);
    second.read(&mut hub);
    assert_eq!(refusals(&mut second), [RefusalCode::Full], "512 KiB are full");
    assert_eq!(hub.bytes_waiting(), held, "what cannot become whole is not kept");
    // The rest of it is passed over, the other one becomes whole, and then there is room again.
    second.exchange(&mut hub);
    first.exchange(&mut hub);
    assert_eq!(hub.bytes_waiting(), LONG_CHARGE, "the latch of the first");
    assert_eq!(second.core.publish(two, long()), Ok(true));
    second.exchange(&mut hub);
    assert_eq!((refusals(&mut second), hub.bytes_waiting()), (vec![], 2 * LONG_CHARGE));
    // Who goes leaves nothing.
    assert_eq!(first.core.publish(one, long()), Ok(true));
    first.send(&mut hub, 2);
    for line in [&first, &second] {
        hub.left(line.at_hub, sk_flat::Instant::ZERO);
    }
    assert_eq!(hub.bytes_waiting(), 0);
}

/// A flow that serves `robot.eye`, and three that may ask it.
fn service(hub: &mut ServerCore) -> (Line, [Line; 3], ChannelRef) {
    let mut owner = Line::new(hub, 1, |core| core);
    owner
        .core
        .create_service("eye", &SkVariant::map([("doc", "sees".into())]))
        .expect("a flow");
    owner.exchange(hub);
    let channel = owner.core.channel("robot.eye").expect("it was made").channel;
    owner.events();
    let askers = [2, 3, 4].map(|number| Line::new(hub, number, |core| core));
    (owner, askers, channel)
}

#[test]
fn t5_t7_requests_and_answers_that_wait_count_among_all_and_are_refused_beyond() {
    let mut hub = narrow_hub();
    let (mut owner, mut askers, eye) = service(&mut hub);
    // The owner does not read. Three requests fit, of one asker or of several.
    let ask = |asker: &mut Line, hub: &mut ServerCore| {
        asker.core.call(eye, MINUTE, long()).expect("a flow");
        asker.exchange(hub);
        refusals(asker)
    };
    for (count, asker) in askers.iter_mut().enumerate() {
        asker.events();
        assert_eq!(ask(asker, &mut hub), []);
        assert_eq!(hub.bytes_waiting(), (count + 1) * LONG_CHARGE);
    }
    let refused = ask(&mut askers[0], &mut hub);
    assert!(matches!(refused[..], [RefusalCode::Full | RefusalCode::TooManyRequests]), "{refused:?}");
    assert_eq!(hub.bytes_waiting(), 3 * LONG_CHARGE, "what was refused is not held");
    owner.read(&mut hub);
    assert_eq!(hub.bytes_waiting(), 0);

    // The askers do not read: of the answers three fit too, and who gets none is told.
    let requests: Vec<u64> = owner
        .events()
        .into_iter()
        .filter_map(|event| match event {
            SatelliteEvent::Request { request, .. } => Some(request),
            _ => None,
        })
        .collect();
    assert_eq!(requests.len(), 3);
    for request in &requests {
        owner.core.answer(*request, long(), true).expect("it is open");
        owner.send(&mut hub, usize::MAX);
    }
    assert_eq!(hub.bytes_waiting(), 3 * LONG_CHARGE);
    owner.core.answer(requests[2], long(), false).expect("it is open");
    owner.send(&mut hub, usize::MAX);
    for (asker, ends) in askers.iter_mut().zip([vec![], vec![], vec![RefusalCode::Full]]) {
        asker.read(&mut hub);
        let events = asker.events();
        let replies = events
            .iter()
            .filter(|event| matches!(event, SatelliteEvent::Reply { .. }))
            .count();
        let refused: Vec<_> = events
            .into_iter()
            .filter_map(|event| match event {
                SatelliteEvent::Refused { code, .. } => RefusalCode::from_code(code),
                _ => None,
            })
            .collect();
        assert_eq!((replies, refused), (1, ends));
    }
    assert_eq!(hub.bytes_waiting(), 0);
}

#[test]
fn t5_t7_what_the_hub_itself_is_asked_is_held_until_it_has_answered() {
    let mut hub = narrow_hub();
    let none = Properties::new(&SkVariant::map::<&str>([])).expect("they are none");
    let channel = hub
        .open_service("robot.self".parse().expect("a name"), none)
        .expect("it is free");
    let mut asker = Line::new(&mut hub, 1, |core| core);
    asker.events();
    for _ in 0..4 {
        asker.core.call(channel, MINUTE, long()).expect("a flow");
        asker.exchange(&mut hub);
    }
    assert_eq!(refusals(&mut asker).len(), 1, "the fourth");
    let asked: Vec<_> = std::iter::from_fn(|| hub.next_notice())
        .filter_map(|notice| match notice {
            Notice::Request { request, .. } => Some(request),
            _ => None,
        })
        .collect();
    assert_eq!(asked.len(), 3);
    let held = hub.bytes_waiting();
    assert!(held >= 3 * LONG, "{held}");
    for (answered, request) in (1..).zip(asked) {
        hub.answer_own(request, Bytes::new(), false).expect("short");
        asker.exchange(&mut hub);
        assert_eq!(hub.bytes_waiting(), held / 3 * (3 - answered));
    }
}
