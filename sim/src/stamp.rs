//! What a message carries so that its receiver can tell whether it is the right one, whole and in order.

use bytes::{BufMut, Bytes, BytesMut};
use sk_core::flow::ChannelRef;

/// Where a message comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Origin {
    /// Which node.
    pub node: u16,
    /// Which of its lives: processes are started again.
    pub life: u16,
    /// Which of its channels.
    pub channel: u8,
}

/// The stamp of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Where it comes from.
    pub origin: Origin,
    /// The reference that its publisher knew the channel by: identifier and epoch.
    pub reference: ChannelRef,
    /// Its number in the order of publishing, for each origin.
    pub sequence: u64,
    /// When it was published, in nanoseconds of virtual time.
    pub at_ns: u64,
}

const STAMP_BYTES: usize = 2 + 2 + 1 + 2 + 2 + 8 + 8;
const CHECK_BYTES: usize = 4;

/// The shortest message.
pub const BYTES_MIN: usize = STAMP_BYTES + CHECK_BYTES;

impl Stamp {
    /// A message with this stamp, of that length or the shortest.
    pub fn message(&self, bytes: usize) -> Bytes {
        let bytes = bytes.max(BYTES_MIN);
        let mut message = BytesMut::with_capacity(bytes);
        message.put_u16_le(self.origin.node);
        message.put_u16_le(self.origin.life);
        message.put_u8(self.origin.channel);
        message.put_i16_le(self.reference.id);
        message.put_u16_le(self.reference.epoch);
        message.put_u64_le(self.sequence);
        message.put_u64_le(self.at_ns);
        let fill = self.sequence as u8 ^ self.origin.node as u8;
        message.resize(bytes - CHECK_BYTES, fill);
        let check = crc32fast::hash(&message);
        message.put_u32_le(check);
        message.freeze()
    }

    /// The stamp of a message; `None` if one of its bytes is not as it was published.
    pub fn of(message: &[u8]) -> Option<Stamp> {
        let (body, check) = message.split_last_chunk::<CHECK_BYTES>()?;
        if body.len() < STAMP_BYTES || crc32fast::hash(body) != u32::from_le_bytes(*check) {
            return None;
        }
        let two = |at: usize| u16::from_le_bytes([body[at], body[at + 1]]);
        let eight =
            |at: usize| body[at..at + 8].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
        Some(Stamp {
            origin: Origin { node: two(0), life: two(2), channel: body[4] },
            reference: ChannelRef { id: two(5) as i16, epoch: two(7) },
            sequence: eight(9),
            at_ns: eight(17),
        })
    }
}

/// The full name of a node's channel.
pub fn channel_name(node: u16, channel: u8) -> String {
    format!("{USER}.{}", own_name(node, channel))
}

/// The same without the account.
pub fn own_name(node: u16, channel: u8) -> String {
    format!("n{node}.c{channel}")
}

/// What a node's sync channel is called, without the account.
pub fn clock_name(node: u16) -> String {
    format!("n{node}.t")
}

/// What a node's blob channel is called, without the account.
pub fn files_name(node: u16) -> String {
    format!("n{node}.f")
}

/// The account of every hub in a box.
pub const USER: &str = "robot";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_comes_back_and_no_changed_byte_passes() {
        let stamp = Stamp {
            origin: Origin { node: 3, life: 2, channel: 1 },
            reference: ChannelRef { id: 1024, epoch: 7 },
            sequence: 1 << 40,
            at_ns: 12_345_678_901,
        };
        let message = stamp.message(200);
        assert_eq!((message.len(), Stamp::of(&message)), (200, Some(stamp)));
        assert_eq!(stamp.message(0).len(), BYTES_MIN);
        for at in 0..message.len() {
            let mut changed = message.to_vec();
            changed[at] ^= 1;
            assert_eq!(Stamp::of(&changed), None);
        }
        assert_eq!(Stamp::of(&message[..100]), None);
    }
}
