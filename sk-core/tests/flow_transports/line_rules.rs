//! What holds of a serial line alone: everybody shares it.

use super::network::{Kind, Network};
use super::rules::pattern;
use sk_core::prelude::*;

#[test]
fn t24_messages_pass_intact_over_a_line_that_spoils_bytes() {
    let mut network = Network::new(Kind::Tty);
    let (publisher, listener) = network.pair("data");
    network.wire().spoil_every(5_000);
    for length in [1, 1000, 100_000, 7] {
        assert!(publisher.hub.publish_bytes(network.app.cx(), "data", pattern(length)));
    }
    network.until("all messages arrive", |cx| {
        assert_eq!(publisher.with(cx, |ear| ear.lost.clone()), Vec::<String>::new());
        listener.with(cx, |ear| ear.messages.len() == 4)
    });
    listener.with(network.app.cx(), |ear| {
        for (length, (_, payload)) in [1, 1000, 100_000, 7].into_iter().zip(&ear.messages) {
            assert!(*payload == pattern(length), "{length} bytes became {}", payload.len());
        }
        assert!(ear.lost.is_empty(), "{:?}", ear.lost);
    });
    assert!(network.wire().spoilt() > 20, "the noise was there");
}

#[test]
fn t23_a_line_finds_its_feet_after_garbage() {
    let mut network = Network::new(Kind::Tty);
    let (publisher, listener) = network.pair("data");
    let end = [0xc0];
    let garbage: [&[u8]; 4] = [&[0; 300], &[0xff; 3000], b"\xc0\xdb\xdb\xc0login: ", &pattern(3000)];
    for bytes in garbage {
        network.wire().noise(bytes);
        network.passes(publisher, listener, "data");
        network.wire().noise(&end);
        network.passes(publisher, listener, "data");
    }
    assert_eq!(listener.with(network.app.cx(), |ear| (ear.ready, ear.lost.len())), (1, 0));
}

#[test]
fn a_line_that_was_cut_is_given_up_and_found_again_by_all_who_share_it() {
    let mut network = Network::new(Kind::Tty);
    let (publisher, listener) = network.pair("data");
    network.passes(publisher, listener, "data");
    network.wire().hold(true);
    publisher.hub.publish_bytes(network.app.cx(), "data", &b"into nowhere"[..]);
    for _ in 0..4 {
        for _ in 0..50 {
            network.app.pulse();
        }
        network.clock.push(Duration::from_millis(1100));
    }
    network.until("both have lost the hub", |cx| {
        [publisher, listener].iter().all(|one| one.with(cx, |ear| !ear.lost.is_empty()))
    });
    network.wire().hold(false);
    network.until("both are back", |cx| {
        let back = [publisher, listener].iter().all(|one| one.with(cx, |ear| ear.ready == 2));
        back && publisher.hub.is_listened(cx, "data")
    });
    network.passes(publisher, listener, "data");
}

#[test]
fn sixteen_share_a_line_and_one_more_waits_for_a_place() {
    let mut network = Network::new(Kind::Tty);
    let stations: Vec<_> = (0..16).map(|_| network.satellite()).collect();
    for station in &stations {
        network.until_ready(*station);
    }
    let late = network.satellite();
    for _ in 0..200 {
        network.app.pulse();
    }
    assert_eq!(late.with(network.app.cx(), |ear| ear.ready), 0);
    network.app.cx().destroy_later(stations[3].hub);
    network.until_ready(late);
}
