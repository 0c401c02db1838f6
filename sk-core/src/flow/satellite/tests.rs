//! The rules of a satellite, against a hub that a test plays.

use super::super::error::ClosingReason;
use super::super::login::NO_PROOF;
use super::super::{Flags, Message};
use super::*;
use crate::flow::{ChannelKind, Path, Properties};
use sk_flat::SkVariant;
use std::time::Duration;

fn at(ms: u64) -> Instant {
    Instant::ZERO + Duration::from_millis(ms)
}

fn tell(core: &mut SatelliteCore, event: Event) -> Result<(), ProtocolError> {
    core.receive(&event.encode(0, Flags::NONE).to_vec(), at(0))
}

fn welcome() -> Event {
    Event::Welcome { magic: MAGIC, version: 1, fragment_bytes: 1024, message_bytes: 4096, nonce: [9; 32] }
}

fn ready() -> SatelliteCore {
    let mut core = SatelliteCore::flow(Credentials::Peer, [1; 32], at(0));
    tell(&mut core, welcome()).expect("agreed");
    tell(&mut core, Event::LoggedIn { connection: 4, user: "robot".into(), proof: NO_PROOF })
        .expect("logged in");
    tell(
        &mut core,
        Event::FlowBegun { channels: 0, name: "robot.x".into(), session: [0; 16], resumed: 0 },
    )
    .expect("a flow");
    while core.take().is_some() || core.next_event().is_some() {}
    core
}

fn added(name: &str, id: i16, owner: u64) -> Event {
    let properties = Properties::new(&SkVariant::map([] as [(&str, SkVariant); 0])).expect("an empty map");
    Event::ChannelAdded {
        kind: ChannelKind::Stream,
        channel: ChannelRef { id, epoch: 1 },
        hash: 0,
        owner,
        name: name.into(),
        properties,
    }
}

#[test]
fn a_hub_that_does_not_know_the_token_is_left() {
    let token = OwnerToken::new([7; 32]);
    let mut core = SatelliteCore::flow(Credentials::Token(token.clone()), [1; 32], at(0));
    tell(&mut core, welcome()).expect("agreed");
    let reflected = token.client_proof(&[1; 32], &[9; 32]);
    let told = tell(&mut core, Event::LoggedIn { connection: 4, user: "robot".into(), proof: reflected });
    assert_eq!(told, Err(ProtocolError::FalseHub));
    assert!(!core.is_ready());
}

#[test]
fn a_hub_that_raises_the_agreed_limits_or_sends_out_of_state_is_left() {
    let mut core = SatelliteCore::flow(Credentials::Peer, [1; 32], at(0));
    let (version, nonce) = (1, [9; 32]);
    let greedy =
        Event::Welcome { magic: MAGIC, version, fragment_bytes: 1 << 20, message_bytes: 1 << 24, nonce };
    assert!(matches!(tell(&mut core, greedy), Err(ProtocolError::BadValue { .. })));
    let mut core = SatelliteCore::flow(Credentials::Peer, [1; 32], at(0));
    assert!(matches!(tell(&mut core, Event::Ping {}), Err(ProtocolError::WrongState { .. })));
}

#[test]
fn a_wanted_name_is_subscribed_to_whenever_a_channel_has_it() {
    let mut core = ready();
    core.subscribe("robot.imu", 3).expect("a flow");
    assert!(!core.has_output(), "there is no such channel yet");
    for id in [2000, 2001] {
        tell(&mut core, added("robot.imu", id, 5)).expect("honest");
        let channel = ChannelRef { id, epoch: 1 };
        let sent = core.take().map(|frame| frame.to_vec());
        let tag = core.next_tag;
        assert_eq!(sent, Some(hear(channel, Policy::Latest, 3).encode(tag, Flags::NONE).to_vec()));
        tell(&mut core, Event::ChannelRemoved { channel }).expect("honest");
        assert!(core.channel("robot.imu").is_none());
    }
}

#[test]
fn nothing_is_sent_for_nobody_and_too_much_is_refused() {
    let mut core = ready();
    let channel = ChannelRef { id: 2000, epoch: 1 };
    assert_eq!(core.publish(channel, Bytes::new()), Err(SatelliteError::NotOwn(channel)));
    let tag = core.create("imu", &SkVariant::map([("unit", "m".into())])).expect("a flow");
    core.receive(&added("robot.imu", 2000, 4).encode(tag, Flags::NONE).to_vec(), at(0))
        .expect("honest");
    while core.take().is_some() {}
    assert_eq!(core.publish(channel, Bytes::from_static(b"x")), Ok(false));
    tell(&mut core, Event::StartPublishing { channel }).expect("honest");
    assert_eq!(core.publish(channel, Bytes::from_static(b"x")), Ok(true));
    let too_long = core.publish(channel, Bytes::from(vec![0; 4097]));
    assert_eq!(too_long, Err(SatelliteError::TooLong { length: 4097, max: 4096 }));
    tell(&mut core, Event::StopPublishing { channel }).expect("honest");
    assert_eq!(core.lost(), 1, "what had not begun is not sent any more");
}

#[test]
fn a_silent_hub_is_asked_and_then_given_up() {
    let mut core = ready();
    assert_eq!(core.tick(at(1900)), Ok(()));
    assert!(!core.has_output());
    assert_eq!(core.tick(at(2000)), Ok(()));
    assert!(core.take().is_some_and(|frame| frame.head[0] == 0x04));
    assert_eq!(core.tick(at(6000)), Err(SatelliteError::Silent));
    let mut early = SatelliteCore::flow(Credentials::Peer, [1; 32], at(0));
    assert_eq!(early.tick(at(2000)), Err(SatelliteError::Silent));
}

#[test]
fn a_ping_is_answered_with_its_tag_and_closing_is_told() {
    let mut core = ready();
    core.receive(&Event::Ping {}.encode(42, Flags::NONE).to_vec(), at(0))
        .expect("honest");
    assert_eq!(
        core.take().map(|frame| frame.to_vec()),
        Some(Command::Pong {}.encode(42, Flags::NONE).to_vec())
    );
    let reason = ClosingReason::Shutdown.code();
    tell(&mut core, Event::Closing { reason, text: "bye".into() }).expect("honest");
    assert_eq!(core.next_event(), Some(SatelliteEvent::Closing { reason, text: "bye".into() }));
    assert_eq!(core.subscribe("robot.imu", 0), Err(SatelliteError::State("subscribe")));
}

// ---- services and sync channels ----

fn next(core: &mut SatelliteCore) -> Option<SatelliteEvent> {
    core.next_event()
}

fn tell_tagged(core: &mut SatelliteCore, tag: u32, flags: Flags, event: &Event) {
    core.receive(&event.encode(tag, flags).to_vec(), at(0)).expect("honest");
}

fn sent(core: &mut SatelliteCore) -> Vec<(u8, u8)> {
    std::iter::from_fn(|| core.take())
        .map(|frame| (frame.head[0], frame.head[1]))
        .collect()
}

#[test]
fn a_call_that_was_given_up_has_no_answer_though_one_is_on_its_way() {
    let mut core = ready();
    let channel = ChannelRef { id: 2000, epoch: 1 };
    let tag = core.call(channel, Duration::ZERO, Bytes::from(vec![1; 3000])).expect("a flow");
    assert!(core.take().is_some(), "the first of its three fragments");
    let piece = |more| Event::Reply { more, payload: Bytes::from_static(b"x") };
    tell_tagged(&mut core, tag, Flags::FIRST, &piece(0));
    core.cancel(tag).expect("room");
    tell_tagged(&mut core, tag, Flags::NONE, &piece(0));
    tell_tagged(&mut core, tag, Flags::LAST, &piece(0));
    assert_eq!(next(&mut core), None);
    assert!(!core.is_calling(tag));
    let kinds: Vec<u8> = sent(&mut core).into_iter().map(|(kind, _)| kind).collect();
    assert_eq!(kinds.first(), Some(&0x21), "a fragment was on the wire's side already");
    assert_eq!(kinds.last(), Some(&0x24));
    core.cancel(tag).expect("once more");
    assert!(sent(&mut core).is_empty(), "it is over");
}

#[test]
fn an_answer_reaches_only_a_request_that_waits_and_its_rest_is_not_sent_when_that_is_over() {
    let mut core = ready();
    let channel = ChannelRef { id: 2000, epoch: 1 };
    let request = |request| Event::Request { channel, request, asker: 9, payload: Bytes::from_static(b"?") };
    tell_tagged(&mut core, 0, Flags::WHOLE, &request(5));
    assert!(matches!(next(&mut core), Some(SatelliteEvent::Request { request: 5, asker: 9, .. })));
    assert_eq!(core.answer(6, Bytes::new(), false), Err(SatelliteError::NoRequest(6)));
    let long = Bytes::from(vec![0; 4097]);
    assert_eq!(core.answer(5, long, false), Err(SatelliteError::TooLong { length: 4097, max: 4096 }));
    core.answer(5, Bytes::from(vec![0; 4096]), true).expect("it stays open");
    assert_eq!(core.take().map(|frame| frame.head[1]), Some(Flags::FIRST.bits()));
    tell_tagged(&mut core, 0, Flags::NONE, &Event::RequestOver { request: 5 });
    assert_eq!(next(&mut core), Some(SatelliteEvent::RequestOver { request: 5 }));
    assert_eq!(core.answer(5, Bytes::new(), false), Err(SatelliteError::NoRequest(5)));
    tell_tagged(&mut core, 0, Flags::NONE, &Event::RequestOver { request: 5 });
    assert_eq!(next(&mut core), None, "told once");
}

#[test]
fn a_refusal_ends_a_call_and_what_is_left_of_it_is_not_sent() {
    let mut core = ready();
    core.outbox.fragment_bytes_max = 1;
    let channel = ChannelRef { id: 2000, epoch: 1 };
    let most = crate::flow::limits::WIRE_BYTES_AHEAD;
    let long = Bytes::from(vec![1; 4096]);
    let tags: Vec<u32> = (0..most / 4096 + 2)
        .map(|_| core.call(channel, Duration::from_millis(1), long.clone()).expect("room"))
        .collect();
    assert!(core.take().is_some());
    let refused = Event::Refused { code: 13, text: "no".into() };
    for tag in &tags {
        tell_tagged(&mut core, *tag, Flags::NONE, &refused);
        assert!(matches!(next(&mut core), Some(SatelliteEvent::Refused { code: 13, .. })));
        assert!(!core.is_calling(*tag));
    }
    let left = sent(&mut core).len();
    assert!(left * 18 <= most + 18, "only what was on the wire's side: {left} frames");
}

#[test]
fn a_sync_channel_is_followed_whenever_there_is_one_of_its_name() {
    let mut core = ready();
    core.follow("robot.clock", Divisor::Second).expect("a flow");
    assert!(!core.has_output(), "there is no such channel yet");
    tell(&mut core, added("robot.clock", 2000, 5)).expect("honest");
    assert!(!core.has_output(), "a stream of that name is no clock");
    let Event::ChannelAdded { hash, owner, name, properties, .. } = added("robot.clock", 2001, 5) else {
        panic!("it adds a channel")
    };
    let channel = ChannelRef { id: 2001, epoch: 1 };
    let sync = Event::ChannelAdded { channel, kind: ChannelKind::Sync, hash, owner, name, properties };
    tell(&mut core, sync).expect("honest");
    let wanted = Command::Subscribe { channel, policy: Policy::Latest, depth: 1, divisor: 2 };
    let tag = core.next_tag;
    assert_eq!(core.take().map(|frame| frame.to_vec()), Some(wanted.encode(tag, Flags::NONE).to_vec()));
}

#[test]
fn an_upload_that_begins_anew_does_not_overtake_the_pieces_of_the_one_before() {
    let mut core = ready();
    let channel = ChannelRef { id: 2000, epoch: 1 };
    let path = || Path("map".to_owned());
    core.blob_write(channel, "map", 0, Bytes::from(vec![1; 2000])).expect("room");
    for command in [
        Command::BlobAbort { channel, path: path() },
        Command::BlobBegin { channel, path: path(), bytes: 1, checksum: 2 },
        Command::BlobStat { channel, path: path() },
    ] {
        core.blob(&command).expect("room");
    }
    let kinds: Vec<u8> = std::iter::from_fn(|| core.take()).map(|frame| frame.head[0]).collect();
    let pieces = kinds.iter().filter(|kind| **kind == 0x32).count();
    assert_eq!(kinds[0], 0x39, "a question may");
    assert_eq!(kinds[1..], [vec![0x32; pieces], vec![0x34, 0x31]].concat());
}
