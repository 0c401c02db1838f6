//! Whom a satellite believes to be its hub, over TLS.

use super::network::{Kind, Network, Secrets};
use super::socket::Socket;
use sk_core::flow::TlsTrust;
use sk_core::prelude::*;
use std::io::Write;

/// Tries to reach the hub with that trust; it must not be let in, nor be known to the hub.
fn is_kept_out(trust: TlsTrust) {
    let mut network = Network::new(Kind::Tls);
    let address = network.address.clone().expect("it listens");
    let doubter = network.secured(&address, trust);
    network.until("it goes away again", |cx| doubter.with(cx, |ear| !ear.lost.is_empty()));
    assert_eq!(doubter.with(network.app.cx(), |ear| ear.ready), 0);
}

#[test]
fn s96_a_hub_with_another_certificate_is_not_talked_to() {
    let other = Secrets::new();
    is_kept_out(TlsTrust::pinned(&other.identity.fingerprint()).expect("a fingerprint"));
    is_kept_out(TlsTrust::authority_pem(other.certificate.as_bytes()).expect("a certificate"));
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
