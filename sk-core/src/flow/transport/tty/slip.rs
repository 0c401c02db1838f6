//! SLIP (RFC 1055): where an envelope begins and ends on a line that may lose and invent bytes.

const END: u8 = 0xc0;
const ESCAPE: u8 = 0xdb;
const ESCAPED_END: u8 = 0xdc;
const ESCAPED_ESCAPE: u8 = 0xdd;

/// Adds one packet in its form on the line. The end mark stands before it too, so that noise since the last
/// packet is a packet of its own and does not spoil this one.
///
/// ```
/// use sk_core::flow::transport::tty::{SlipReader, slip_encode};
///
/// let mut line = Vec::new();
/// slip_encode(&[1, 0xc0, 2], &mut line);
/// assert_eq!(line, [0xc0, 1, 0xdb, 0xdc, 2, 0xc0]);
/// let mut reader = SlipReader::new(16);
/// let packets: Vec<Vec<u8>> = line.iter().filter_map(|byte| reader.push(*byte).map(<[u8]>::to_vec)).collect();
/// assert_eq!(packets, [[1, 0xc0, 2]]);
/// ```
pub fn slip_encode(packet: &[u8], line: &mut Vec<u8>) {
    line.push(END);
    for byte in packet {
        match *byte {
            END => line.extend([ESCAPE, ESCAPED_END]),
            ESCAPE => line.extend([ESCAPE, ESCAPED_ESCAPE]),
            other => line.push(other),
        }
    }
    line.push(END);
}

/// Takes packets out of what a line brings.
#[derive(Debug)]
pub struct SlipReader {
    packet: Vec<u8>,
    max: usize,
    escaped: bool,
    /// What has come since the last end mark cannot be a packet.
    spoilt: bool,
    /// The packet was handed out and goes with the next byte.
    finished: bool,
    /// How many packets were spoilt.
    pub(super) lost: u64,
}

impl SlipReader {
    /// A reader of packets of at most `max` bytes; longer ones are passed over.
    pub fn new(max: usize) -> SlipReader {
        SlipReader { packet: Vec::new(), max, escaped: false, spoilt: false, finished: false, lost: 0 }
    }

    /// Takes the next byte; answers the packet that it ends, if it ends one.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        if std::mem::take(&mut self.finished) {
            self.packet.clear();
        }
        if byte == END {
            let spoilt = std::mem::take(&mut self.spoilt) | std::mem::take(&mut self.escaped);
            self.lost += u64::from(spoilt);
            self.finished = true;
            return (!spoilt && !self.packet.is_empty()).then_some(&self.packet);
        }
        if self.spoilt {
            return None;
        }
        let byte = match (std::mem::take(&mut self.escaped), byte) {
            (false, ESCAPE) => {
                self.escaped = true;
                return None;
            }
            (true, ESCAPED_END) => END,
            (true, ESCAPED_ESCAPE) => ESCAPE,
            (true, _) => {
                self.spoilt = true;
                return None;
            }
            (false, other) => other,
        };
        if self.packet.len() == self.max {
            self.spoilt = true;
        } else {
            self.packet.push(byte);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(line: &[u8], max: usize) -> Vec<Vec<u8>> {
        let mut reader = SlipReader::new(max);
        line.iter().filter_map(|byte| reader.push(*byte).map(<[u8]>::to_vec)).collect()
    }

    #[test]
    fn what_is_too_long_or_wrongly_escaped_is_passed_over_to_the_next_end() {
        assert_eq!(read(&[1, 2, 3, 4, END, 5, END], 3), [[5]]);
        assert_eq!(read(&[1, ESCAPE, 9, 2, END, 5, END], 3), [[5]]);
        assert_eq!(read(&[1, ESCAPE, END, 5, END], 3), [[5]]);
    }

    proptest! {
        #[test]
        fn packets_come_out_as_they_went_in_whatever_stood_before(
            noise in prop::collection::vec(any::<u8>(), 0..40),
            packets in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..40), 0..8),
        ) {
            let mut line = noise;
            packets.iter().for_each(|packet| slip_encode(packet, &mut line));
            prop_assert!(read(&line, 64).ends_with(&packets));
        }
    }
}
