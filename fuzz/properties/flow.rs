//! What must hold for whatever a peer of the flow protocol sends. The fuzz target and the test over the
//! committed seeds include this file.

use bytes::Bytes;
use sk_core::flow::frame::FrameBuffer;
use sk_core::flow::limits::{MAGIC, VERSION, VERSION_OLDEST};
use sk_core::flow::satellite::{Credentials, SatelliteCore};
use sk_core::flow::scram::{ClientExchange, Password, ServerExchange};
use sk_core::flow::server::{Notice, Origin, ServerCore, Settings};
use sk_core::flow::{Command, Event, Flags, Form, Message, State};
use sk_flat::Instant;

const UID: u32 = 1000;

/// The first byte says how far the connection has come; the rest is what the peer sends then.
pub fn frames(data: &[u8]) {
    let Some((far, bytes)) = data.split_first() else { return };
    every_frame_has_one_form::<Command>(bytes);
    every_frame_has_one_form::<Event>(bytes);
    a_hub_stands(usize::from(far % 4), bytes);
    a_satellite_stands(bytes);
    a_login_by_password_stands(bytes);
}

/// Every text that a peer may send in a login is refused or answered, and a guessed proof is never true.
fn a_login_by_password_stands(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let (first, last) = text.split_once('\n').unwrap_or((&text, ""));
    for first in [first, "n,,n=ada,r=x"] {
        let hub = ServerExchange::begin(first, &[2; 32], &[3; 32], &|_| None);
        assert!(hub.is_err() || hub.is_ok_and(|hub| hub.finish(last).is_err()));
    }
    let mut client = ClientExchange::new("ada", &[1; 32]);
    if let Ok(derivation) = client.challenged(first, Password::new("pencil")) {
        assert!(!client.hub_is_true(&[0; 32]), "nothing was proved to it: {derivation:?}");
    }
}

fn every_frame_has_one_form<M: Message>(bytes: &[u8]) {
    let mut buffer = FrameBuffer::default();
    buffer.feed(bytes);
    while let Ok(Some(frame)) = buffer.next(|_| Ok(())) {
        let Ok(read) = M::decode(frame.header, frame.body.clone(), Bytes::new()) else { continue };
        let written = read.message.encode(read.tag, read.flags).to_vec();
        assert_eq!(written[6..], frame.body[..], "{read:?} has another form");
    }
}

fn a_hub_stands(far: usize, bytes: &[u8]) {
    let user = "robot".parse().expect("a name");
    let mut hub = ServerCore::new(Settings { user, token: None, owner_uid: Some(UID) }, Instant::ZERO);
    let (fragment_bytes, message_bytes, nonce) = (1024, 1 << 20, [0; 32]);
    let (version, version_oldest) = (VERSION, VERSION_OLDEST);
    let hello =
        Command::Hello { magic: MAGIC, version, version_oldest, fragment_bytes, message_bytes, nonce };
    let way = [
        hello,
        Command::LoginPeer {},
        Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Binary },
    ];
    let [witness, peer] = [way.len(), far].map(|steps| {
        let id = hub.open(Origin::Unix { uid: UID }, [1; 32], Instant::ZERO).expect("a place");
        for command in &way[..steps] {
            hub.receive(id, &command.encode(1, Flags::NONE).to_vec(), Instant::ZERO);
            while hub.take(id).is_some() {}
        }
        id
    });
    let cut = bytes.len() / 2;
    for part in [&bytes[..cut], &bytes[cut..]] {
        hub.receive(peer, part, Instant::ZERO);
        while hub.work(Instant::ZERO) {}
        while hub.take(peer).is_some() {}
    }
    assert!(hub.totals().balance());
    assert_eq!(
        hub.connection(witness).map(|(state, _)| state),
        Some(State::Flow),
        "nobody else is touched"
    );
    hub.left(peer, Instant::ZERO);
    assert_eq!(hub.channels().count(), 0, "what was its own is gone with it");
    let ends = std::iter::from_fn(|| hub.next_notice())
        .filter(|notice| matches!(notice, Notice::Ended { .. }))
        .count();
    assert_eq!(ends, 1);
}

fn a_satellite_stands(bytes: &[u8]) {
    let mut core = SatelliteCore::flow(Credentials::Peer, [1; 32], Instant::ZERO);
    let _ = core.receive(bytes, Instant::ZERO);
    while core.next_event().is_some() {}
    while core.take().is_some() {}
}
