//! What travels between two end marks: a kind and a stream, two counters, a payload and a checksum.

use std::fmt;

/// How many byte streams share a line.
pub const STREAMS: u8 = 16;
/// The longest payload of one envelope.
pub const PAYLOAD_BYTES_MAX: usize = 1024;
/// Kind with stream, number, acknowledgement.
const HEAD_BYTES: usize = 3;
/// The CRC-32 of everything before it, as in zlib, in little-endian order.
const CHECK_BYTES: usize = 4;
/// The longest envelope.
pub const ENVELOPE_BYTES_MAX: usize = HEAD_BYTES + PAYLOAD_BYTES_MAX + CHECK_BYTES;

/// What an envelope is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Bytes of a stream. Numbered.
    Data = 0,
    /// The caller begins a stream. Numbered.
    Open = 1,
    /// The sender is done with a stream. Numbered.
    Close = 2,
    /// The sender has read so many bytes of a stream (a `u32`), which may be sent anew. Numbered.
    Credit = 3,
    /// Nothing but the acknowledgement.
    Ack = 4,
    /// As `Ack`, and something after it came out of turn: send again from there.
    Again = 5,
    /// The caller's number of this life of the line (a `u32`).
    Hello = 6,
    /// The listener's number and the caller's.
    Welcome = 7,
    /// The caller's number and the listener's.
    Confirm = 8,
    /// Something numbered came, and the sender knows of no life of this line.
    Reset = 9,
}

impl Kind {
    const ALL: [Kind; 10] = [
        Kind::Data,
        Kind::Open,
        Kind::Close,
        Kind::Credit,
        Kind::Ack,
        Kind::Again,
        Kind::Hello,
        Kind::Welcome,
        Kind::Confirm,
        Kind::Reset,
    ];

    /// Whether it is acknowledged, and sent again until it is.
    pub fn is_numbered(self) -> bool {
        matches!(self, Kind::Data | Kind::Open | Kind::Close | Kind::Credit)
    }
}

/// One envelope.
///
/// ```
/// use sk_core::flow::transport::tty::{Envelope, Kind};
///
/// let envelope = Envelope { kind: Kind::Data, stream: 3, number: 7, ack: 250, payload: b"hello" };
/// let mut bytes = envelope.encode();
/// assert_eq!(bytes[..3], [0x03, 7, 250]);
/// assert_eq!(Envelope::decode(&bytes), Some(envelope));
/// bytes[4] ^= 1;
/// assert_eq!(Envelope::decode(&bytes), None);
/// ```
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Envelope<'a> {
    /// What it is for.
    pub kind: Kind,
    /// The stream it belongs to, below [`STREAMS`].
    pub stream: u8,
    /// Counts the numbered ones of one direction.
    pub number: u8,
    /// The number that the sender expects next.
    pub ack: u8,
    /// At most [`PAYLOAD_BYTES_MAX`].
    pub payload: &'a [u8],
}

impl<'a> Envelope<'a> {
    /// Its bytes, before SLIP.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEAD_BYTES + self.payload.len() + CHECK_BYTES);
        bytes.extend([(self.kind as u8) << 4 | self.stream, self.number, self.ack]);
        bytes.extend_from_slice(self.payload);
        let check = crc32fast::hash(&bytes);
        bytes.extend(check.to_le_bytes());
        bytes
    }

    /// Reads one; `None` for what is damaged or none at all.
    pub fn decode(bytes: &'a [u8]) -> Option<Envelope<'a>> {
        let (checked, check) = bytes.split_last_chunk::<CHECK_BYTES>()?;
        let (head, payload) = checked.split_first_chunk::<HEAD_BYTES>()?;
        if payload.len() > PAYLOAD_BYTES_MAX || crc32fast::hash(checked) != u32::from_le_bytes(*check) {
            return None;
        }
        let kind = *Kind::ALL.get(usize::from(head[0] >> 4))?;
        Some(Envelope { kind, stream: head[0] & 0x0f, number: head[1], ack: head[2], payload })
    }
}

impl fmt::Debug for Envelope<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Envelope { kind, stream, number, ack, payload } = self;
        write!(f, "{kind:?} of {stream}, number {number}, ack {ack}, {} bytes", payload.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_as_another_implementation_computes_them() {
        // Python: b = bytes([0x12, 1, 2]) + b"pulse"; b + struct.pack("<I", zlib.crc32(b))
        let open = Envelope { kind: Kind::Open, stream: 2, number: 1, ack: 2, payload: b"pulse" };
        let hex: String = open.encode().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, "12010270756c7365477e376d");
    }

    #[test]
    fn every_flipped_bit_is_found() {
        let envelope = Envelope { kind: Kind::Close, stream: 15, number: 255, ack: 0, payload: &[7; 90] };
        let good = envelope.encode();
        for bit in 0..good.len() * 8 {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Envelope::decode(&bytes), None, "bit {bit}");
        }
        assert_eq!(Envelope::decode(&good), Some(envelope));
    }

    #[test]
    fn kinds_beyond_the_last_and_what_is_too_short_are_none() {
        let mut bytes = vec![0xa0, 0, 0];
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        assert_eq!(Envelope::decode(&bytes), None);
        assert!((0..7).all(|length| Envelope::decode(&vec![0; length]).is_none()));
    }
}
