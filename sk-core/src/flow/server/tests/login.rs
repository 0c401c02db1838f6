//! Greeting, login, states and rights.

use super::*;
use crate::flow::{Definition, table::samples};

#[test]
fn an_async_command_before_the_switch_kills_the_client() {
    let mut hub = hub();
    let mut other = Raw::flow(&mut hub, OWNER);
    let raw = Raw::open(&mut hub, OWNER);
    raw.send(&mut hub, 1, &Raw::hello(1024));
    raw.send(&mut hub, 2, &Command::LoginPeer {});
    raw.send(&mut hub, 3, &Command::CreateStream { name: "x".into(), properties: no_properties() });
    let found = ending(&mut hub, raw.id);
    assert!(matches!(found, Some(Ending::Spurious(ProtocolError::WrongState { .. }))), "{found:?}");
    assert_eq!(hub.spurious(), 1);
    other.send(&mut hub, 5, &Command::Ping {});
    assert_eq!(messages(other.read(&mut hub)), [Event::Pong {}], "nobody else is touched");
}

#[test]
fn the_switch_without_login_kills_the_client() {
    let mut hub = hub();
    let raw = Raw::open(&mut hub, OWNER);
    raw.send(&mut hub, 1, &Raw::hello(1024));
    raw.send(&mut hub, 2, &set_async());
    assert!(matches!(ending(&mut hub, raw.id), Some(Ending::Spurious(_))));
}

#[test]
fn every_command_is_killed_in_every_state_that_the_table_does_not_list() {
    for line in Command::TABLE {
        for state in State::ALL {
            let mut hub = hub();
            let raw = Raw::open(&mut hub, OWNER);
            for command in [Raw::hello(1024), Command::LoginPeer {}, set_async()]
                .iter()
                .take(state as usize)
            {
                raw.send(&mut hub, 1, command);
                while hub.take(raw.id).is_some() {}
            }
            assert_eq!(hub.connection(raw.id).map(|(state, _)| state), Some(state));
            let command = sample(line);
            let flags = if line.fragment { Flags::WHOLE } else { Flags::NONE };
            raw.send_flagged(&mut hub, 2, flags, &command);
            let killed = matches!(ending(&mut hub, raw.id), Some(Ending::Spurious(_)));
            assert_eq!(killed, !line.states.has(state), "{} in {state}", line.name);
        }
    }
}

fn sample(line: &Definition) -> Command {
    let samples = samples::commands([0; 32]).expect("small");
    samples
        .into_iter()
        .find(|sample| sample.definition() == line)
        .expect("one of each")
}

#[test]
fn every_command_that_needs_a_right_is_refused_without_it() {
    for line in Command::TABLE.iter().filter(|line| line.right != crate::flow::Right::Nothing) {
        let mut hub = hub();
        let origin = Origin::Inside { rights: Rights::NONE };
        let mut raw = if line.states.has(State::Flow) {
            Raw::flow(&mut hub, origin)
        } else {
            let mut raw = Raw::open(&mut hub, origin);
            raw.send(&mut hub, 1, &Raw::hello(1024));
            raw.send(&mut hub, 1, &Command::LoginPeer {});
            raw.read(&mut hub);
            raw
        };
        let flags = if line.fragment { Flags::WHOLE } else { Flags::NONE };
        raw.send_flagged(&mut hub, 5, flags, &sample(line));
        assert_eq!(refusal(&raw.read(&mut hub), 5), Some(RefusalCode::Denied), "{}", line.name);
    }
}

#[test]
fn a_true_token_logs_in_and_a_false_one_is_closed_without_being_spurious() {
    for (secret, good) in [(7, true), (8, false)] {
        let mut hub = hub();
        let raw = &mut Raw::open(&mut hub, Origin::Network([127, 0, 0, 1].into()));
        raw.send(&mut hub, 1, &Raw::hello(1024));
        raw.read(&mut hub);
        let token = OwnerToken::new([secret; 32]);
        raw.send(&mut hub, 2, &Command::LoginToken { proof: token.client_proof(&[2; 32], &[1; 32]) });
        let events = messages(raw.read(&mut hub));
        match &events[0] {
            Event::LoggedIn { user, proof, .. } => {
                assert!(good && user == "robot" && token.hub_is_true(&[2; 32], &[1; 32], proof));
            }
            Event::Closing { reason, .. } => {
                assert!(!good && *reason == ClosingReason::LoginFailed.code());
                assert_eq!(ending(&mut hub, raw.id), Some(Ending::Closed(ClosingReason::LoginFailed)));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn peer_credentials_open_the_door_to_the_owner_alone() {
    let cases = [
        (OWNER, true),
        (Origin::Unix { uid: 1001 }, false),
        (Origin::Unix { uid: 0 }, false),
        (Origin::Network([127, 0, 0, 1].into()), false),
    ];
    for (origin, good) in cases {
        let mut hub = hub();
        let raw = Raw::open(&mut hub, origin);
        raw.send(&mut hub, 1, &Raw::hello(1024));
        raw.send(&mut hub, 2, &Command::LoginPeer {});
        while hub.take(raw.id).is_some() {}
        assert_eq!(hub.connection(raw.id).is_some(), good, "{origin}");
    }
}

#[test]
fn versions_without_overlap_are_closed_and_newer_clients_agree_on_ours() {
    for (version, version_oldest, good) in [(1, 1, true), (9, 1, true), (9, 2, false), (0, 0, false)] {
        let mut hub = hub();
        let mut raw = Raw::open(&mut hub, OWNER);
        let limits = (1024, 4096, [0; 32]);
        let (fragment_bytes, message_bytes, nonce) = limits;
        let hello =
            Command::Hello { magic: MAGIC, version, version_oldest, fragment_bytes, message_bytes, nonce };
        raw.send(&mut hub, 1, &hello);
        match &messages(raw.read(&mut hub))[..] {
            [Event::Welcome { version: 1, fragment_bytes: 1024, message_bytes: 4096, .. }] => assert!(good),
            [Event::Closing { reason, .. }] => assert!(!good && *reason == ClosingReason::Version.code()),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn before_login_a_length_beyond_the_cap_is_killed_from_its_header() {
    let mut hub = hub();
    let raw = Raw::open(&mut hub, OWNER);
    hub.receive(raw.id, &Header { kind: 0x01, flags: 0, length: 1 << 30 }.to_bytes(), at(0));
    assert!(matches!(ending(&mut hub, raw.id), Some(Ending::Spurious(ProtocolError::TooLong { .. }))));
}
