//! What a connection has ready for its transport: frames in order, and how much of the first was taken.

use super::table::definition::Encoded;
use smallvec::SmallVec;
use std::collections::VecDeque;
use std::io::IoSlice;

/// The parts of one vectored write, on the stack.
pub type Slices<'a> = SmallVec<[IoSlice<'a>; WRITE_PARTS_MAX]>;
/// Parts of one vectored write.
pub const WRITE_PARTS_MAX: usize = 64;

/// Frames on their way into the transport. Each has a note that comes back when its last byte was taken.
#[derive(Debug)]
pub struct Wire<N> {
    frames: VecDeque<(Encoded, N)>,
    /// How much of the first frame was taken.
    taken: usize,
    bytes: usize,
}

impl<N> Default for Wire<N> {
    fn default() -> Self {
        Wire { frames: VecDeque::new(), taken: 0, bytes: 0 }
    }
}

impl<N> Wire<N> {
    /// Adds a frame at the end.
    pub fn push(&mut self, frame: Encoded, note: N) {
        self.bytes += frame.len();
        self.frames.push_back((frame, note));
    }

    /// How many bytes are left.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// The next bytes as slices for one vectored write, at most `slices_max`.
    pub fn slices(&self, slices_max: usize) -> Slices<'_> {
        let mut skip = self.taken;
        let mut slices = Slices::new();
        for (frame, _) in &self.frames {
            for part in [&frame.head, &frame.payload] {
                if slices.len() == slices_max {
                    return slices;
                }
                if part.len() > skip {
                    slices.push(IoSlice::new(&part[skip..]));
                }
                skip = skip.saturating_sub(part.len());
            }
        }
        slices
    }

    /// Notes that the transport took `count` bytes; `ended` gets the note of each frame that it took to
    /// the end. Answers how many bytes there were to take, if that is fewer.
    pub fn wrote(&mut self, count: usize, mut ended: impl FnMut(N)) -> usize {
        let count = count.min(self.bytes);
        self.bytes -= count;
        self.taken += count;
        while let Some((frame, _)) = self.frames.front()
            && frame.len() <= self.taken
        {
            self.taken -= frame.len();
            if let Some((_, note)) = self.frames.pop_front() {
                ended(note);
            }
        }
        count
    }

    /// Takes the next whole frame, for a transport inside the process. `None` also while a frame is half
    /// taken.
    pub fn take(&mut self) -> Option<(Encoded, N)> {
        if self.taken > 0 {
            return None;
        }
        let (frame, note) = self.frames.pop_front()?;
        self.bytes -= frame.len();
        Some((frame, note))
    }

    /// Drops every frame but a half-taken first one, which must be finished for what follows it to be
    /// readable.
    pub fn drop_unbegun(&mut self) {
        self.frames.truncate(usize::from(self.taken > 0));
        self.bytes = self.frames.front().map_or(0, |(frame, _)| frame.len() - self.taken);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use proptest::prelude::*;

    fn frame(head: &'static [u8], payload: &'static [u8]) -> Encoded {
        Encoded { head: Bytes::from_static(head), payload: Bytes::from_static(payload) }
    }

    #[test]
    fn a_half_taken_frame_is_kept_when_the_rest_is_dropped() {
        let mut wire = Wire::default();
        wire.push(frame(b"ab", b"cd"), 1);
        wire.push(frame(b"ef", b""), 2);
        wire.wrote(3, |_| panic!("no frame has ended"));
        wire.drop_unbegun();
        wire.push(frame(b"gh", b""), 3);
        let left: Vec<u8> = wire.slices(9).iter().flat_map(|slice| slice.to_vec()).collect();
        assert_eq!((left, wire.bytes()), (b"dgh".to_vec(), 3));
        assert!(wire.take().is_none(), "half a frame is not handed out");
    }

    proptest! {
        #[test]
        fn whatever_the_transport_takes_the_bytes_come_in_order(
            writes in prop::collection::vec((1_usize..4, 0_usize..9), 0..40),
        ) {
            let mut wire = Wire::default();
            let frames = [frame(b"abc", b"de"), frame(b"f", b""), frame(b"gh", b"ijkl")];
            for (index, one) in frames.into_iter().enumerate() {
                wire.push(one, index);
            }
            let mut out = Vec::new();
            let mut notes = Vec::new();
            for (slices_max, count) in writes {
                let ready: Vec<u8> = wire.slices(slices_max).iter().flat_map(|slice| slice.to_vec()).collect();
                let count = count.min(ready.len());
                out.extend_from_slice(&ready[..count]);
                prop_assert_eq!(wire.wrote(count, |note| notes.push(note)), count);
            }
            prop_assert!(b"abcdefghijkl".starts_with(&out[..]));
            prop_assert_eq!(wire.bytes(), 12 - out.len());
            let whole = [5, 6, 12].iter().filter(|end| **end <= out.len()).count();
            prop_assert_eq!(notes, (0..whole).collect::<Vec<_>>());
        }
    }
}
