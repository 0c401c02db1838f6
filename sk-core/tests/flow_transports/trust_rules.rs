//! Whom a satellite believes to be its hub, over TLS.

use super::network::{Kind, Network, Secrets};
use super::socket::Socket;
use sk_core::flow::TlsTrust;
use sk_core::prelude::*;
use std::io::Write;

/// Tries to reach the hub with that trust; it must not be let in, nor be known to the hub. Answers why not.
fn kept_out(trust: TlsTrust) -> String {
    let mut network = Network::new(Kind::Tls);
    let address = network.address.clone().expect("it listens");
    let doubter = network.secured(&address, trust);
    network.until("it goes away again", |cx| doubter.with(cx, |ear| !ear.lost.is_empty()));
    let cx = network.app.cx();
    assert_eq!(doubter.with(cx, |ear| ear.ready), 0);
    assert!(doubter.hub.is_unusable(cx));
    doubter.with(cx, |ear| ear.lost[0].clone())
}

#[test]
fn s96_a_hub_with_another_certificate_is_not_talked_to() {
    let other = Secrets::new();
    let why = kept_out(TlsTrust::pinned(&other.identity.fingerprint()).expect("a fingerprint"));
    assert_eq!(why, "its certificate has another fingerprint than the one that is trusted");
    let why = kept_out(TlsTrust::authority_pem(other.certificate.as_bytes()).expect("a certificate"));
    assert!(why.starts_with("its certificate is not trusted: "), "{why}");
}

/// What a satellite hears that takes a hub's address of one kind for one of another.
fn heard_at(kind: Kind, taken_for: impl FnOnce(&str) -> String) -> (String, bool) {
    let mut network = Network::new(kind);
    let there = network.address.clone().expect("it listens").to_string();
    let address = taken_for(&there).parse().expect("an address");
    let trust = TlsTrust::pinned(&network.secrets.identity.fingerprint()).expect("a fingerprint");
    let lost = network.secured(&address, trust);
    network.until("it goes away again", |cx| lost.with(cx, |ear| !ear.lost.is_empty()));
    let cx = network.app.cx();
    (lost.with(cx, |ear| ear.lost[0].clone()), lost.hub.is_unusable(cx))
}

#[test]
#[cfg(feature = "websocket")]
fn what_is_wrong_with_an_address_is_said() {
    let (why, unusable) = heard_at(Kind::WebSocket, |at| at.replace("/flow", "/elsewhere"));
    assert!(unusable && why.contains("refuses the upgrade: 404 Not Found: "), "{why}");
    let (why, unusable) = heard_at(Kind::WebSocket, |at| at.replace("ws:", "tls:").replace("/flow", ""));
    assert!(unusable && why.contains("no TLS is spoken there"), "{why}");
    let ssh = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let there = ssh.local_addr().expect("it has one");
    let stranger = std::thread::spawn(move || {
        let (mut peer, _) = ssh.accept().expect("somebody comes");
        peer.write_all(b"SSH-2.0-OpenSSH_9.2p1 Debian-2+deb12u3\r\n").expect("room");
        peer
    });
    let (why, unusable) = heard_at(Kind::WebSocket, |_| format!("tcp:{there}"));
    assert!(unusable && why.contains("what answers there is no hub"), "{why}");
    stranger.join().expect("it spoke");
    // Nobody listens there any more.
    let free = {
        let gone = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        gone.local_addr().expect("it has one")
    };
    let (why, unusable) = heard_at(Kind::WebSocket, |_| format!("tcp:{free}"));
    assert!(!unusable && why.contains("refused"), "{why}");
}

#[test]
fn an_address_with_tls_wants_a_certificate_on_either_side() {
    let mut network = Network::new(Kind::Tls);
    let address = network.address.clone().expect("it listens");
    let cx = network.app.cx();
    let error = network.server.listen(cx, &address).expect_err("it has none");
    assert!(error.to_string().contains("a certificate is needed"), "{error}");
    let plain = "tcp:127.0.0.1:0".parse().expect("an address");
    let error = network.server.listen_secured(cx, &plain, network.secrets.identity.clone());
    assert!(error.expect_err("no TLS there").to_string().contains("has no TLS"));
    let bare = network.satellite_without_trust(&address);
    network.until("it says so", |cx| bare.with(cx, |ear| !ear.lost.is_empty()));
    let why = bare.with(network.app.cx(), |ear| ear.lost[0].clone());
    assert!(why.contains("which certificate to trust"), "{why}");
}

#[test]
fn a_handshake_that_stands_still_is_ended_within_the_time_for_the_login() {
    let mut network = Network::new(Kind::Tls);
    let address = network.address.clone().expect("it listens");
    let mut socket = Socket::connect(&address).expect("it listens");
    // The beginning of a record that never comes.
    socket.write_all(b"\x16\x03\x01\x02\x00\x01").expect("the kernel has room");
    socket.never_wait();
    network.until_connections(1);
    network.clock.push(Duration::from_secs(2));
    network.until("it is closed", |_| socket.is_over());
    network.until_connections(0);
}

/// A login that both ends bind to what they derive from their handshake, and that the hub takes in no other way.
fn a_bound_login_succeeds(kind: Kind) {
    let mut network = Network::new(kind);
    let server = network.server;
    server.require_channel_binding(network.app.cx(), true).expect("it lives");
    let station = network.satellite();
    network.until_ready(station);
}

#[test]
fn t17_logins_over_tls_are_bound_to_their_connection() {
    a_bound_login_succeeds(Kind::Tls);
    #[cfg(feature = "websocket")]
    a_bound_login_succeeds(Kind::SecureWebSocket);
}
