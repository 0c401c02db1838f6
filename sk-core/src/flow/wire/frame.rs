//! Frames: the header, the check for a whole frame, and the buffer that bytes gather in.
//!
//! A frame is `kind u8, flags u8, length u32` and `length` bytes of body. Whether a frame may come at all,
//! and how long it may be, is decided from its six bytes of header; the buffer grows only with bytes that
//! have arrived, never from the announced length.

use super::error::ProtocolError;
use bytes::{Bytes, BytesMut};

/// The length of a frame's header.
pub const HEADER_BYTES: usize = 6;

/// The flags of a fragment. Kinds that are not fragments have none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Flags(u8);

impl Flags {
    /// No flag.
    pub const NONE: Flags = Flags(0);
    /// The fragment begins its message.
    pub const FIRST: Flags = Flags(1);
    /// The fragment ends its message.
    pub const LAST: Flags = Flags(2);
    /// The message ends here without being whole; what came of it is void.
    pub const ABORT: Flags = Flags(4);
    /// The only fragment of its message.
    pub const WHOLE: Flags = Flags(1 | 2);

    /// The flags as they stand on the wire.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The flags of a fragment, if they do not contradict each other.
    pub const fn from_bits(bits: u8) -> Option<Flags> {
        if bits <= 4 { Some(Flags(bits)) } else { None }
    }

    /// Whether all of `other` are set.
    pub const fn has(self, other: Flags) -> bool {
        self.0 & other.0 == other.0
    }

    /// The flags of a fragment that is the first or not, the last or not.
    pub const fn of(first: bool, last: bool) -> Flags {
        Flags(first as u8 | (last as u8) << 1)
    }
}

/// The first six bytes of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Which command or event.
    pub kind: u8,
    /// Flags as sent.
    pub flags: u8,
    /// Bytes of body that follow.
    pub length: u32,
}

impl Header {
    /// Reads the header at the beginning of `bytes`, if it is all there.
    pub fn parse(bytes: &[u8]) -> Option<Header> {
        let bytes: &[u8; HEADER_BYTES] = bytes.first_chunk()?;
        let [kind, flags, a, b, c, d] = *bytes;
        Some(Header { kind, flags, length: u32::from_le_bytes([a, b, c, d]) })
    }

    /// The header's bytes.
    pub fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let [a, b, c, d] = self.length.to_le_bytes();
        [self.kind, self.flags, a, b, c, d]
    }
}

/// A whole frame. The body shares the buffer that it was received in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Its header.
    pub header: Header,
    /// Its body.
    pub body: Bytes,
}

/// Whether `bytes` begin with a whole frame: its header if so, `None` if more bytes are needed.
///
/// `admit` sees the header as soon as it is there and refuses what may not come, so that nothing is
/// waited for that would be refused anyway.
///
/// # Errors
/// Those of `admit`.
pub fn check(
    bytes: &[u8],
    admit: impl FnOnce(Header) -> Result<(), ProtocolError>,
) -> Result<Option<Header>, ProtocolError> {
    let Some(header) = Header::parse(bytes) else { return Ok(None) };
    admit(header)?;
    let whole = u64::from(header.length) + HEADER_BYTES as u64;
    Ok((bytes.len() as u64 >= whole).then_some(header))
}

/// The bytes of one connection that are not yet a whole frame.
///
/// ```
/// use sk_core::flow::frame::{FrameBuffer, Header};
///
/// let mut buffer = FrameBuffer::default();
/// buffer.feed(&[4, 0, 2, 0, 0, 0, b'h']);
/// assert!(buffer.next(|_| Ok(()))?.is_none(), "one byte of the body is missing");
/// buffer.feed(b"i");
/// let frame = buffer.next(|_| Ok(()))?.expect("now the frame is whole");
/// assert_eq!((frame.header.kind, &frame.body[..]), (4, &b"hi"[..]));
/// # Ok::<(), sk_core::flow::ProtocolError>(())
/// ```
#[derive(Debug, Default)]
pub struct FrameBuffer {
    bytes: BytesMut,
    /// Whether a frame was taken out of the storage that `bytes` is in.
    shared: bool,
}

/// A shorter beginning of a frame is copied out of the storage that it shares with the frames before it,
/// so that a peer which sends a little and waits does not keep a large buffer alive.
const COPIED_REST_BYTES_MAX: usize = 4096;

impl FrameBuffer {
    /// Adds received bytes.
    pub fn feed(&mut self, received: &[u8]) {
        self.bytes.extend_from_slice(received);
    }

    /// Takes the next whole frame; see [`check`] for `admit`.
    ///
    /// # Errors
    /// Those of `admit`. The connection is then of no more use.
    pub fn next(
        &mut self,
        admit: impl FnOnce(Header) -> Result<(), ProtocolError>,
    ) -> Result<Option<Frame>, ProtocolError> {
        let Some(header) = check(&self.bytes, admit)? else {
            if self.shared && self.bytes.len() <= COPIED_REST_BYTES_MAX {
                self.bytes = BytesMut::from(&self.bytes[..]);
                self.shared = false;
            }
            return Ok(None);
        };
        let mut frame = self.bytes.split_to(HEADER_BYTES + header.length as usize).freeze();
        self.shared = !self.bytes.is_empty();
        if self.bytes.is_empty() {
            // An idle connection keeps no buffer, and the frame's bytes are free when its reader is done.
            self.bytes = BytesMut::new();
        }
        Ok(Some(Frame { header, body: frame.split_off(HEADER_BYTES) }))
    }

    /// How many bytes wait for the rest of their frame.
    pub fn pending(&self) -> usize {
        self.bytes.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(kind: u8, flags: u8, body: &[u8]) -> Vec<u8> {
        let mut bytes = Header { kind, flags, length: body.len() as u32 }.to_bytes().to_vec();
        bytes.extend_from_slice(body);
        bytes
    }

    fn all(buffer: &mut FrameBuffer) -> Vec<Frame> {
        std::iter::from_fn(|| buffer.next(|_| Ok(())).expect("everything is admitted")).collect()
    }

    #[test]
    fn a_frame_is_refused_from_its_header_alone() {
        let refuse = |header: Header| match header.length {
            0..=512 => Ok(()),
            length => Err(ProtocolError::TooLong { kind: "any", length, max: 512 }),
        };
        for (length, fits) in [(511_u32, true), (512, true), (513, false), (u32::MAX, false)] {
            let header = Header { kind: 1, flags: 0, length }.to_bytes();
            assert_eq!(check(&header[..5], refuse), Ok(None));
            assert_eq!(check(&header, refuse).is_ok(), fits, "{length}");
        }
    }

    #[test]
    fn contradicting_flags_are_no_flags() {
        let legal: Vec<u8> = (0..=255).filter(|bits| Flags::from_bits(*bits).is_some()).collect();
        assert_eq!(legal, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn a_body_shares_the_receive_buffer() {
        let mut buffer = FrameBuffer::default();
        buffer.feed(&frame(1, 0, b"first"));
        buffer.feed(&frame(2, 0, b"second"));
        let start = buffer.bytes.as_ptr() as usize;
        let frames = all(&mut buffer);
        assert_eq!(frames[0].body.as_ptr() as usize, start + HEADER_BYTES);
        assert_eq!(frames[1].body.as_ptr() as usize, start + 2 * HEADER_BYTES + 5);
    }

    #[test]
    fn the_small_beginning_of_a_frame_does_not_keep_the_buffer_of_those_before_it() {
        let mut buffer = FrameBuffer::default();
        buffer.feed(&[frame(1, 0, &[0; 60_000]), vec![2, 0, 9]].concat());
        assert_eq!(all(&mut buffer).len(), 1);
        assert_eq!(buffer.pending(), 3);
        assert!(buffer.bytes.capacity() < 100, "{} bytes", buffer.bytes.capacity());
    }

    proptest! {
        #[test]
        fn byte_by_byte_equals_at_once(
            frames in prop::collection::vec((any::<u8>(), 0_u8..5, prop::collection::vec(any::<u8>(), 0..40)), 0..10),
            cut in 0_usize..60,
        ) {
            let mut bytes: Vec<u8> = frames.iter().flat_map(|(kind, flags, body)| frame(*kind, *flags, body)).collect();
            bytes.truncate(bytes.len().saturating_sub(cut));
            let mut at_once = FrameBuffer::default();
            at_once.feed(&bytes);
            let expected = all(&mut at_once);
            let mut one_by_one = FrameBuffer::default();
            let mut found = Vec::new();
            for byte in &bytes {
                one_by_one.feed(std::slice::from_ref(byte));
                found.extend(all(&mut one_by_one));
            }
            prop_assert_eq!(found, expected);
            prop_assert_eq!(one_by_one.pending(), at_once.pending());
        }
    }
}
