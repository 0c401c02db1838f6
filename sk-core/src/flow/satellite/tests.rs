//! The rules of a satellite, against a hub that a test plays.

use super::super::error::ClosingReason;
use super::super::login::NO_PROOF;
use super::super::{Flags, Message};
use super::*;
use crate::flow::ChannelKind;
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
