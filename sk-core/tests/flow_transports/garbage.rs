//! What no honest peer sends, of each transport's own kind.

use super::network::{Kind, Network};
use super::socket::Socket;
use std::io::Write;

/// Throws all of it at the hub and waits until each connection was ended.
pub fn throw_at(network: &mut Network) {
    let raw: [&[u8]; 5] = [
        &[0; 64],
        &[0xff; 64],
        b"\x01\x00\xff\xff\xff\xff",
        b"\x16\x03\x01\x00\x05hello there, this is no handshake",
        b"SpecialK SpecialK SpecialK SpecialK",
    ];
    for bytes in raw {
        throw(network, bytes);
    }
    match network.kind {
        #[cfg(feature = "websocket")]
        Kind::WebSocket => throw_messages(network),
        // Above TLS nothing of this is ever seen.
        Kind::Tcp | Kind::Unix => assert_eq!(spurious(network), raw.len() as u64),
        _ => {}
    }
}

fn throw(network: &mut Network, bytes: &[u8]) {
    let address = network.address.clone().expect("a place to throw at");
    let mut socket = Socket::connect(&address).expect("the hub listens");
    socket.write_all(bytes).expect("the kernel has room");
    socket.never_wait();
    network.until("garbage is ended", |_| socket.is_over());
}

fn spurious(network: &mut Network) -> u64 {
    let server = network.server;
    network
        .app
        .cx()
        .with(server, |server, _| server.core().spurious())
        .expect("it lives")
}

/// Good upgrades, and then frames that may not be.
#[cfg(feature = "websocket")]
fn throw_messages(network: &mut Network) {
    let frames: [&[u8]; 8] = [
        b"\x82\x02hi",                                       // no mask
        b"\x81\x82\0\0\0\0hi",                               // text
        b"\xc2\x82\0\0\0\0hi",                               // a reserved bit, as of compression
        b"\x82\xff\xff\xff\xff\xff\xff\xff\xff\xff\0\0\0\0", // the length has its top bit
        b"\x82\xff\0\0\0\0\x40\0\0\0\0\0\0\0",               // a gigabyte is announced
        b"\x89\xfe\0\x7e\0\0\0\0",                           // a ping of 126 bytes
        b"\x80\x82\0\0\0\0hi",                               // goes on with nothing
        b"\x83\x82\0\0\0\0hi",                               // an opcode that is none
    ];
    for frame in frames {
        throw(network, &[UPGRADE.as_bytes(), frame].concat());
    }
    assert_eq!(spurious(network), 0);
    let flow = [UPGRADE.as_bytes(), b"\x82\x8a\0\0\0\0\x01\x00\xff\xff\xff\xffxxxx"].concat();
    throw(network, &flow);
    assert_eq!(spurious(network), 1, "what is no flow is killed as such");
}

#[cfg(feature = "websocket")]
const UPGRADE: &str = "GET /flow HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: keep-alive, Upgrade\r\n\
    Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n";
