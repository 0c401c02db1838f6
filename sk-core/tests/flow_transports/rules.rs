//! What holds whatever the bytes travel over.

use super::network::{Kind, Network};
use super::plug::Hold;
use bytes::Bytes;
use sk_core::prelude::*;

/// Bytes that show where one is missing or out of place.
pub fn pattern(length: usize) -> Bytes {
    (0..length as u32)
        .map(|index| (index.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect()
}

fn properties() -> SkVariant {
    SkVariant::map([("format", "bytes".into())])
}

pub fn messages_small_and_large_arrive_intact(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    let lengths = [0, 1, 1023, 1024, 65_535, 65_536, 65_537, 5 << 20, 3];
    for length in lengths {
        assert!(publisher.hub.publish_bytes(network.app.cx(), "data", pattern(length)));
    }
    network.until("all messages arrive", |cx| listener.with(cx, |ear| ear.messages.len() == lengths.len()));
    listener.with(network.app.cx(), |ear| {
        for (length, (name, payload)) in lengths.into_iter().zip(&ear.messages) {
            assert_eq!(name, "robot.data");
            assert!(*payload == pattern(length), "{length} bytes became {}", payload.len());
        }
        assert_eq!((ear.ready, &ear.lost, &ear.refused), (1, &Vec::new(), &Vec::new()));
    });
}

pub fn a_light_channel_is_not_kept_waiting_by_a_heavy_one(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("heavy");
    network.join(publisher, listener, "light");
    let heavy = pattern(6 << 20);
    let cx = network.app.cx();
    assert!(publisher.hub.publish_bytes(cx, "heavy", heavy.clone()));
    assert!(publisher.hub.publish_bytes(cx, "light", &b"now"[..]));
    network.until("both arrive", |cx| listener.with(cx, |ear| ear.messages.len() == 2));
    listener.with(network.app.cx(), |ear| {
        assert_eq!(ear.messages[0], ("robot.light".into(), Bytes::from_static(b"now")));
        assert!(ear.messages[1].1 == heavy);
    });
}

pub fn an_end_at_any_moment_leaves_the_others_undisturbed(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    let others = network.connections();
    let cable = network.cable();
    let whole = network.satellite_at(&cable.address);
    whole.hub.open(network.app.cx(), "whole", properties()).expect("a name");
    whole.hub.subscribe(network.app.cx(), "robot.data").expect("a name");
    network.join(whole, listener, "whole");
    network.passes(whole, listener, "whole");
    let whole_length = cable.carried_to_hub();
    network.app.cx().destroy_later(whole.hub);
    network.until_connections(others);
    for part in 0..16 {
        cable.cut_after(whole_length * part / 16);
        let cut = network.satellite_at(&cable.address);
        cut.hub.open(network.app.cx(), "cut", properties()).expect("a name");
        cut.hub.subscribe(network.app.cx(), "robot.data").expect("a name");
        network.until("the connection is cut", |cx| cut.with(cx, |ear| !ear.lost.is_empty()));
        network.app.cx().destroy_later(cut.hub);
        network.until_connections(others);
        network.passes(publisher, listener, "data");
    }
    let names = network.server.channels(network.app.cx()).expect("it lives");
    assert_eq!(names.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["robot.data"]);
    assert_eq!(listener.with(network.app.cx(), |ear| ear.lost.len()), 0);
}

/// For transports without a cable: the satellite goes after each number of rounds.
pub fn an_end_in_any_round_leaves_the_others_undisturbed(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    let others = network.connections();
    for rounds in 0..12 {
        let short = network.satellite();
        short.hub.open(network.app.cx(), "short", properties()).expect("a name");
        short.hub.subscribe(network.app.cx(), "robot.data").expect("a name");
        for _ in 0..rounds {
            network.app.pulse();
        }
        network.app.cx().destroy_later(short.hub);
        network.until_connections(others);
        network.passes(publisher, listener, "data");
    }
}

pub fn garbage_is_killed_and_the_others_live_on(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    let others = network.connections();
    super::garbage::throw_at(&mut network);
    network.until_connections(others);
    network.passes(publisher, listener, "data");
    assert_eq!(listener.with(network.app.cx(), |ear| ear.lost.len()), 0);
}

pub fn a_peer_that_does_not_read_costs_a_bounded_amount(kind: Kind) {
    const MESSAGES: usize = 48;
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    let cable = network.cable();
    let deaf = network.satellite_at(&cable.address);
    network.until_ready(deaf);
    deaf.hub.subscribe(network.app.cx(), "robot.data").expect("a name");
    let server = network.server;
    network.until("both listen", |cx| {
        server
            .channels(cx)
            .is_ok_and(|channels| channels.iter().any(|(_, listeners)| *listeners == 2))
    });
    cable.hold(Hold::FromHub);
    let payload = pattern(1 << 20);
    for count in 1..=MESSAGES {
        assert!(publisher.hub.publish_bytes(network.app.cx(), "data", payload.clone()));
        network
            .until("the one who reads hears it", |cx| listener.with(cx, |ear| ear.messages.len() == count));
    }
    let counts = network
        .app
        .cx()
        .with(server, |server, _| server.core().totals())
        .expect("it lives");
    assert!(counts.balance(), "{counts:?}");
    assert!(counts.queued <= 32, "32 MiB may wait for one connection: {counts:?}");
    assert!(counts.dropped_in_all() > 0, "{counts:?}");
    // It hears the newest once it reads again.
    cable.hold(Hold::Nothing);
    network.until("the queue is emptied", |cx| {
        cx.with(server, |server, _| server.core().totals().queued) == Ok(0)
    });
    assert_eq!(deaf.with(network.app.cx(), |ear| ear.lost.len()), 0);
}

pub fn a_satellite_that_lost_its_hub_restores_channels_and_subscriptions(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    for times in 2..=3 {
        network.passes(publisher, listener, "data");
        network.replace_hub();
        network.until("both are back", |cx| {
            let back = [publisher, listener].iter().all(|one| one.with(cx, |ear| ear.ready == times));
            back && publisher.hub.is_listened(cx, "data")
        });
    }
    network.passes(publisher, listener, "data");
    assert_eq!(listener.with(network.app.cx(), |ear| (ear.ready, ear.messages.len())), (3, 3));
}

pub fn a_silent_peer_is_closed_and_the_others_stay(kind: Kind) {
    let mut network = Network::new(kind);
    let (publisher, listener) = network.pair("data");
    let others = network.connections();
    let cable = network.cable();
    let silent = network.satellite_at(&cable.address);
    network.until_ready(silent);
    cable.hold(Hold::Both);
    for _ in 0..4 {
        // Everybody else has time to answer a ping before the next push.
        network.clock.push(Duration::from_millis(1900));
        network.passes(publisher, listener, "data");
        for _ in 0..200 {
            network.app.pulse();
        }
    }
    network.app.cx().destroy_later(silent.hub);
    network.until_connections(others);
    assert_eq!(listener.with(network.app.cx(), |ear| ear.lost.len()), 0);
    assert_eq!(publisher.with(network.app.cx(), |ear| ear.lost.len()), 0);
}
