//! The publishing part of the rules over real UDP sockets. What the kernel loses is published again: a rule over UDP
//! says what arrives, not that all does.

use super::network::{Kind, Network, Station};
use super::rules::pattern;
use bytes::Bytes;
use sk_core::flow::server::DatagramCounts;
use std::net::{SocketAddr, UdpSocket};

/// Opens the hub's UDP port; answers where.
fn open_door(network: &mut Network) -> SocketAddr {
    let at = "udp:127.0.0.1:0".parse().expect("an address");
    let server = network.server;
    let at = server.listen(network.app.cx(), &at).expect("a port is free");
    at.to_string()["udp:".len()..].parse().expect("an address")
}

fn counts(network: &mut Network) -> DatagramCounts {
    let server = network.server;
    network
        .app
        .cx()
        .with(server, |server, _| server.core().datagram_counts())
        .expect("it lives")
}

/// A publisher by datagrams with a listener to it.
fn pair(network: &mut Network) -> (Station, Station) {
    let (publisher, listener) = network.pair("data");
    publisher.hub.publish_by_udp(network.app.cx(), "data").expect("it is open");
    network.until("there is a session", |cx| publisher.hub.is_udp_open(cx));
    (publisher, listener)
}

/// Publishes a message until it arrives.
fn carries(network: &mut Network, (publisher, listener): (Station, Station), length: usize) {
    let heard = listener.with(network.app.cx(), |ear| ear.messages.len());
    let mut turns = 0;
    network.until("the message arrives", |cx| {
        if turns % 500 == 0 {
            assert!(publisher.hub.publish_bytes(cx, "data", pattern(length)));
        }
        turns += 1;
        listener.with(cx, |ear| ear.messages[heard..].iter().any(|(_, payload)| payload.len() == length))
    });
    listener.with(network.app.cx(), |ear| {
        // One of before that was published twice may have come late.
        let is_good = |payload: &Bytes| *payload == pattern(payload.len());
        assert!(
            ear.messages[heard..]
                .iter()
                .all(|(name, payload)| name == "robot.data" && is_good(payload))
        );
    });
}

pub fn messages_small_and_large_arrive_intact(kind: Kind) {
    let mut network = Network::new(kind);
    open_door(&mut network);
    let stations = pair(&mut network);
    for length in [0, 1, 1023, 1150, 1151, 65_535, 100_000, 3] {
        carries(&mut network, stations, length);
    }
    let counts = counts(&mut network);
    assert!(counts.taken >= 151, "they came by datagram: {counts:?}");
    assert_eq!(counts, DatagramCounts { taken: counts.taken, ..DatagramCounts::default() });
}

pub fn a_satellite_that_lost_its_hub_publishes_by_datagram_again(kind: Kind) {
    let mut network = Network::new(kind);
    open_door(&mut network);
    let (publisher, listener) = pair(&mut network);
    carries(&mut network, (publisher, listener), 10);
    network.replace_hub();
    open_door(&mut network);
    network.until("both are back", |cx| {
        let back = [publisher, listener].iter().all(|one| one.with(cx, |ear| ear.ready == 2));
        back && publisher.hub.is_listened(cx, "data") && publisher.hub.is_udp_open(cx)
    });
    carries(&mut network, (publisher, listener), 3000);
    assert!(counts(&mut network).taken >= 3);
}

/// T15: whatever a stranger sends, nothing is sent to him, and nobody is disturbed.
pub fn strangers_get_no_byte(kind: Kind) {
    let mut network = Network::new(kind);
    let at = open_door(&mut network);
    let stations = pair(&mut network);
    let stranger = UdpSocket::bind("127.0.0.1:0").expect("a port is free");
    stranger.set_nonblocking(true).expect("sockets can do that");
    let server = network.server;
    for length in [0, 1, 16, 32, 33, 100, 1200, 1201, 9000] {
        let before = counts(&mut network).unknown;
        let mut turns = 0;
        network.until("the hub counts it", |cx| {
            if turns % 500 == 0 {
                stranger.send_to(&pattern(length), at).expect("it leaves");
            }
            turns += 1;
            cx.with(server, |server, _| server.core().datagram_counts().unknown > before) == Ok(true)
        });
    }
    carries(&mut network, stations, 3000);
    let answer = stranger.recv_from(&mut [0; 64]);
    assert_eq!(answer.map_err(|error| error.kind()).err(), Some(std::io::ErrorKind::WouldBlock));
    assert_eq!(stations.0.with(network.app.cx(), |ear| ear.lost.len()), 0);
}
