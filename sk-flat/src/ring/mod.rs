//! Ring buffers between one producer and one consumer.

mod bounded;
mod bytes;
mod newest;

pub use self::bounded::{RingConsumer, RingProducer};
pub use self::bytes::{ByteConsumer, ByteProducer, NewestByteConsumer, NewestByteProducer};
pub use self::newest::{NewestConsumer, NewestProducer};

use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

#[cfg(test)]
mod tests;

/// Where ring buffers are made: of items or of bytes, and in one of two forms.
///
/// | | full means | use it for |
/// |---|---|---|
/// | [`bounded`](SkRingBuffer::bounded), [`bytes`](SkRingBuffer::bytes) | the new is refused and counted | what must be complete |
/// | [`newest`](SkRingBuffer::newest), [`newest_bytes`](SkRingBuffer::newest_bytes) | the oldest is replaced and counted | what is sampled |
///
/// Each constructor answers the two halves. They may live on different threads, neither can be
/// cloned, and neither ever waits, locks or allocates after the start. Both halves read the count of
/// what was lost, and each sees whether the other is gone.
///
/// ```
/// use sk_flat::SkRingBuffer;
///
/// let (mut producer, mut consumer) = SkRingBuffer::bounded(2);
/// assert_eq!(producer.push('a'), Ok(()));
/// assert_eq!(producer.push('b'), Ok(()));
/// assert_eq!(producer.push('c'), Err('c'));
/// assert_eq!(consumer.pop(), Some('a'));
///
/// let (mut producer, mut consumer) = SkRingBuffer::newest(2);
/// for letter in ['a', 'b', 'c'] {
///     producer.push(letter);
/// }
/// assert_eq!((consumer.pop(), consumer.replaced()), (Some('b'), 1));
/// ```
pub struct SkRingBuffer<T>(PhantomData<T>);

impl<T> SkRingBuffer<T> {
    /// A ring of `capacity` items (at least one) that refuses what does not fit.
    pub fn bounded(capacity: usize) -> (RingProducer<T>, RingConsumer<T>) {
        bounded::pair(capacity)
    }

    /// A ring of `capacity` items (at least one) that replaces its oldest item by the newest.
    pub fn newest(capacity: usize) -> (NewestProducer<T>, NewestConsumer<T>) {
        newest::pair(capacity)
    }
}

impl SkRingBuffer<u8> {
    /// A ring of `capacity` bytes (at least one) that takes as much of a write as fits.
    pub fn bytes(capacity: usize) -> (ByteProducer, ByteConsumer) {
        bytes::pair(capacity)
    }

    /// A ring of `capacity` bytes (at least one) that replaces its oldest bytes by the newest. Bytes
    /// are replaced one by one; whole messages are sampled by `SkRingBuffer::<Bytes>::newest`.
    pub fn newest_bytes(capacity: usize) -> (NewestByteProducer, NewestByteConsumer) {
        bytes::newest_pair(capacity)
    }
}

// Each half may move to the thread that uses it.
const fn moves_between_threads<T: Send>() {}
const _: () = {
    moves_between_threads::<(RingProducer<u8>, RingConsumer<u8>)>();
    moves_between_threads::<(NewestProducer<u8>, NewestConsumer<u8>)>();
    moves_between_threads::<(ByteProducer, ByteConsumer)>();
    moves_between_threads::<(NewestByteProducer, NewestByteConsumer)>();
};

/// A count that only the producer raises and both halves read.
#[derive(Clone, Default)]
struct Lost(Arc<AtomicU64>);

impl Lost {
    fn add(&self, count: usize) {
        // The number orders nothing else: it is only ever looked at.
        self.0.fetch_add(count as u64, Ordering::Relaxed);
    }

    fn count(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}
