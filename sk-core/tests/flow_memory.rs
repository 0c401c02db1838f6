//! What connections cost that say nothing, counted by the allocator.

use sk_core::flow::server::{Origin, ServerCore, Settings};
use sk_core::flow::{Command, Flags, Message, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::CountingAllocator;
use std::net::TcpStream;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// What a peer without a login may cost.
const BYTES_MAX: i64 = 8 * 1024;

fn settings() -> Settings {
    Settings { user: "robot".parse().unwrap(), token: None, owner_uid: None }
}

#[test]
fn a_peer_without_login_costs_at_most_8_kib_whatever_it_has_sent() {
    // The longest beginning of a frame that is admitted before the login.
    let (magic, nonce) = (*b"SpecialK", [1; 32]);
    let hello = Command::Hello {
        magic,
        version: 1,
        version_oldest: 1,
        fragment_bytes: 65_536,
        message_bytes: 1 << 24,
        nonce,
    };
    let hello = hello.encode(1, Flags::NONE).to_vec();
    let mut login = vec![0x08, 0, 5, 1, 0, 0];
    login.extend_from_slice(&[b'x'; 260]);
    for drip in [&[][..], &hello[..hello.len() - 1], &hello, &[&hello[..], &login].concat()] {
        let mut hub = ServerCore::new(settings(), Instant::ZERO);
        let before = CountingAllocator::held_bytes();
        for _ in 0..1000 {
            let origin = Origin::Network([10, 0, 0, 1].into());
            let id = hub.open(origin, [2; 32], Instant::ZERO).unwrap();
            hub.receive(id, drip, Instant::ZERO);
            hub.slices(id, 64);
        }
        assert_eq!(hub.connections(), 1000);
        let each = (CountingAllocator::held_bytes() - before) / 1000;
        assert!(each <= BYTES_MAX, "{each} bytes after {} bytes sent", drip.len());
    }
}

#[test]
fn a_silent_peer_costs_at_most_8_kib_with_its_socket() {
    const PEERS: usize = 300;
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_millis(2))
        .build()
        .unwrap();
    let server = SkFlowServer::start(app.cx(), settings());
    let address = server
        .listen(app.cx(), &"tcp:127.0.0.1:0".parse().unwrap())
        .unwrap()
        .to_string();
    let address = address.trim_start_matches("tcp:");
    let mut peers = Vec::with_capacity(PEERS);
    let connections =
        |app: &mut SkApp| app.cx().with(server, |server, _| server.core().connections()).unwrap();
    app.pulse();
    let before = CountingAllocator::held_bytes();
    for count in 1..=PEERS {
        peers.push(TcpStream::connect(address).unwrap());
        while connections(&mut app) < count {
            app.pulse();
        }
    }
    let each = (CountingAllocator::held_bytes() - before) / PEERS as i64;
    assert!(each <= BYTES_MAX, "{each} bytes");
}
