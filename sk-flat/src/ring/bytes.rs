//! Bytes in a ring, written and read in runs.

use super::Lost;
use super::newest::{self, NewestConsumer, NewestProducer};

/// The writing half of [`SkRingBuffer::bytes`](super::SkRingBuffer::bytes).
pub struct ByteProducer {
    ring: rtrb::Producer<u8>,
    refused: Lost,
}

/// The reading half of [`SkRingBuffer::bytes`](super::SkRingBuffer::bytes).
pub struct ByteConsumer {
    ring: rtrb::Consumer<u8>,
    refused: Lost,
}

/// The writing half of [`SkRingBuffer::newest_bytes`](super::SkRingBuffer::newest_bytes).
pub struct NewestByteProducer(NewestProducer<u8>);

/// The reading half of [`SkRingBuffer::newest_bytes`](super::SkRingBuffer::newest_bytes).
pub struct NewestByteConsumer(NewestConsumer<u8>);

pub(super) fn pair(capacity: usize) -> (ByteProducer, ByteConsumer) {
    let (producer, consumer) = rtrb::RingBuffer::new(capacity.max(1));
    let refused = Lost::default();
    (
        ByteProducer { ring: producer, refused: refused.clone() },
        ByteConsumer { ring: consumer, refused },
    )
}

pub(super) fn newest_pair(capacity: usize) -> (NewestByteProducer, NewestByteConsumer) {
    let (producer, consumer) = newest::pair(capacity);
    (NewestByteProducer(producer), NewestByteConsumer(consumer))
}

impl ByteProducer {
    /// Writes as much of the run as fits and answers how many bytes that were. The rest is not
    /// counted as refused, since the caller holds it and knows.
    pub fn write(&mut self, run: &[u8]) -> usize {
        let (written, _rest) = self.ring.push_partial_slice(run);
        written.len()
    }

    /// Writes the whole run or nothing. A run that does not fit is counted as refused, in bytes.
    pub fn write_whole(&mut self, run: &[u8]) -> bool {
        let fits = self.ring.push_entire_slice(run).is_ok();
        if !fits {
            self.refused.add(run.len());
        }
        fits
    }

    /// How many bytes fit at least now.
    pub fn room(&self) -> usize {
        self.ring.slots()
    }

    /// How many bytes the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.ring.buffer().capacity()
    }

    /// How many bytes were refused so far.
    pub fn refused(&self) -> u64 {
        self.refused.count()
    }

    /// Whether the consumer is gone.
    pub fn is_abandoned(&self) -> bool {
        self.ring.is_abandoned()
    }
}

impl ByteConsumer {
    /// Reads as many bytes as are there and fit into `into`, and answers how many that were.
    pub fn read(&mut self, into: &mut [u8]) -> usize {
        let (read, _rest) = self.ring.pop_partial_slice(into);
        read.len()
    }

    /// Fills all of `into`, or reads nothing because fewer bytes are there.
    pub fn read_whole(&mut self, into: &mut [u8]) -> bool {
        self.ring.pop_entire_slice(into).is_ok()
    }

    /// How many bytes wait at least.
    pub fn len(&self) -> usize {
        self.ring.slots()
    }

    /// Whether nothing waits now.
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    /// How many bytes the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.ring.buffer().capacity()
    }

    /// How many bytes were refused so far.
    pub fn refused(&self) -> u64 {
        self.refused.count()
    }

    /// Whether the producer is gone. What it left can still be read.
    pub fn is_abandoned(&self) -> bool {
        self.ring.is_abandoned()
    }
}

impl NewestByteProducer {
    /// Writes the whole run; the oldest bytes that do not fit any more are replaced and counted.
    pub fn write(&mut self, run: &[u8]) {
        for &byte in run {
            self.0.push(byte);
        }
    }

    /// How many bytes the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.0.capacity()
    }

    /// How many bytes were replaced so far.
    pub fn replaced(&self) -> u64 {
        self.0.replaced()
    }

    /// Whether the consumer is gone.
    pub fn is_abandoned(&self) -> bool {
        self.0.is_abandoned()
    }
}

impl NewestByteConsumer {
    /// Reads as many bytes as are there and fit into `into`, oldest first, and answers how many that
    /// were. While a producer writes, bytes between two that are read may have been replaced.
    pub fn read(&mut self, into: &mut [u8]) -> usize {
        for (count, place) in into.iter_mut().enumerate() {
            match self.0.pop() {
                Some(byte) => *place = byte,
                None => return count,
            }
        }
        into.len()
    }

    /// How many bytes wait now.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether nothing waits now.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many bytes the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.0.capacity()
    }

    /// How many bytes were replaced so far.
    pub fn replaced(&self) -> u64 {
        self.0.replaced()
    }

    /// Whether the producer is gone. What it left can still be read.
    pub fn is_abandoned(&self) -> bool {
        self.0.is_abandoned()
    }
}
