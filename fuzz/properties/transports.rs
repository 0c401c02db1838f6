//! What must hold for whatever comes from a network or a line before anybody has logged in. The fuzz targets and
//! the tests over the committed seeds include this file.
#![allow(dead_code, reason = "each fuzz target uses its own part")]

use sk_core::flow::transport::datagram::{DATAGRAM_BYTES_MAX, DatagramKey, DatagramReader, session_of};
use sk_core::flow::transport::tty::{Envelope, Line, Role, SlipReader, slip_encode};
use sk_core::net::http::{HEAD_BYTES_MAX, Request};
use sk_flat::Instant;
use std::time::Duration;

/// A request is read from its head alone, at the first byte that makes it whole, and from no shorter part of it.
pub fn http_request(data: &[u8]) {
    let whole = Request::read(data);
    if data.len() >= HEAD_BYTES_MAX {
        assert_ne!(whole, Ok(None), "a head that is too long is not waited for");
    }
    if let Ok(Some((request, length))) = &whole {
        assert!(*length <= HEAD_BYTES_MAX && request.path().starts_with('/'));
        assert!(!request.path().bytes().any(|byte| byte.is_ascii_control() || byte == b' '));
        let (head, rest) = data.split_at(*length);
        assert_eq!(Request::read(head), whole, "what follows a head does not change it");
        assert_eq!(Request::read(&head[..length - 1]), Ok(None));
        drop(Request::read(rest));
    }
}

/// Whatever a line brings, in raw bytes or in envelopes with good checksums, both sides stand, answer little, and
/// find each other again.
pub fn serial_line(data: &[u8]) {
    let Some((mode, data)) = data.split_first() else { return };
    let mut now = Instant::ZERO;
    let (mut caller, mut listener) =
        (Line::new(Role::Caller, 1, 115_200, now), Line::new(Role::Listener, 2, 115_200, now));
    find_each_other(&mut caller, &mut listener, &mut now);
    let stream = caller.open();
    exchange(&mut caller, &mut listener, &mut now);
    let noise = if mode % 2 == 0 { data.to_vec() } else { with_checksums(data) };
    for line in [&mut listener, &mut caller] {
        line.receive(&noise, now);
        assert!(line.output(now).len() <= 8 * 1024, "what comes does not make much go");
        let mut room = [0; 64];
        if let Some(stream) = stream {
            let _ = line.read(stream, &mut room);
        }
        while line.next_event().is_some() {}
    }
    find_each_other(&mut caller, &mut listener, &mut now);
}

/// Cuts data into envelopes: a length, then kind with stream, number, acknowledgement and payload.
fn with_checksums(mut data: &[u8]) -> Vec<u8> {
    let mut line = Vec::new();
    while let Some((length, rest)) = data.split_first() {
        let (packet, rest) = rest.split_at(rest.len().min(usize::from(*length)));
        let mut packet = packet.to_vec();
        packet.extend(crc32(&packet).to_le_bytes());
        slip_encode(&packet, &mut line);
        data = rest;
    }
    line
}

/// CRC-32 as in zlib, bit by bit: written anew here, so that the two are checked against each other.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(
            crc ^ u32::from(*byte),
            |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 },
        )
    })
}

fn exchange(caller: &mut Line, listener: &mut Line, now: &mut Instant) {
    for _ in 0..8 {
        *now += Duration::from_millis(100);
        for calls in [true, false] {
            let (from, to) =
                if calls { (&mut *caller, &mut *listener) } else { (&mut *listener, &mut *caller) };
            from.tick(*now);
            let ready = from.output(*now).to_vec();
            from.wrote(ready.len());
            to.receive(&ready, *now);
        }
    }
}

fn find_each_other(caller: &mut Line, listener: &mut Line, now: &mut Instant) {
    for _ in 0..20 {
        // A side that has nothing to say cannot find out that the other is in another life.
        if let Some(stream) = caller.open() {
            let _ = caller.write(stream, b"is anybody there?");
        }
        exchange(caller, listener, now);
        while caller.next_event().or_else(|| listener.next_event()).is_some() {}
        if caller.is_up() && listener.is_up() {
            return;
        }
    }
    panic!("the line does not come up again");
}

/// An envelope has one form, and SLIP gives back what it was given.
pub fn envelope(data: &[u8]) {
    let mut line = Vec::new();
    slip_encode(data, &mut line);
    let mut reader = SlipReader::new(data.len());
    let packets: Vec<Vec<u8>> =
        line.iter().filter_map(|byte| reader.push(*byte).map(<[u8]>::to_vec)).collect();
    assert_eq!(packets.concat(), data);
    let mut checked = data.to_vec();
    checked.extend(crc32(data).to_le_bytes());
    if let Some(envelope) = Envelope::decode(&checked) {
        assert_eq!(envelope.encode(), checked);
    }
}

/// Nobody without the key gets a frame in, and what was refused changes nothing for those who have it.
pub fn datagram(data: &[u8]) {
    let key = DatagramKey::new([7; 32]);
    let session = session_of(data).unwrap_or(9);
    let mut reader = DatagramReader::new(session, key.clone());
    assert!(reader.open(data).is_err(), "a proof was guessed");
    assert!(session_of(data).is_none() || data.len() <= DATAGRAM_BYTES_MAX);
    let mut writer = sk_core::flow::transport::datagram::DatagramWriter::new(session, key);
    if let Ok(sealed) = writer.seal(data) {
        assert_eq!(reader.open(&sealed), Ok(data));
        assert!(reader.open(&sealed).is_err());
    }
}
