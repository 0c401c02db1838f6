//! Items in a bounded ring: when it is full, the new item comes back.

use super::Lost;

/// The writing half of [`SkRingBuffer::bounded`](super::SkRingBuffer::bounded).
pub struct RingProducer<T> {
    ring: rtrb::Producer<T>,
    refused: Lost,
}

/// The reading half of [`SkRingBuffer::bounded`](super::SkRingBuffer::bounded).
pub struct RingConsumer<T> {
    ring: rtrb::Consumer<T>,
    refused: Lost,
}

pub(super) fn pair<T>(capacity: usize) -> (RingProducer<T>, RingConsumer<T>) {
    let (producer, consumer) = rtrb::RingBuffer::new(capacity.max(1));
    let refused = Lost::default();
    (
        RingProducer { ring: producer, refused: refused.clone() },
        RingConsumer { ring: consumer, refused },
    )
}

impl<T> RingProducer<T> {
    /// Puts an item at the end.
    ///
    /// # Errors
    /// The ring is full: the item comes back and is counted as refused.
    pub fn push(&mut self, item: T) -> Result<(), T> {
        self.ring.push(item).map_err(|rtrb::PushError::Full(item)| {
            self.refused.add(1);
            item
        })
    }

    /// How many items fit at least now; the consumer may make more room at any time.
    pub fn room(&self) -> usize {
        self.ring.slots()
    }

    /// How many items the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.ring.buffer().capacity()
    }

    /// How many items were refused so far.
    pub fn refused(&self) -> u64 {
        self.refused.count()
    }

    /// Whether the consumer is gone, so that nobody will read what is pushed.
    pub fn is_abandoned(&self) -> bool {
        self.ring.is_abandoned()
    }
}

impl<T> RingConsumer<T> {
    /// Takes the oldest item, if there is one.
    pub fn pop(&mut self) -> Option<T> {
        self.ring.pop().ok()
    }

    /// Looks at the oldest item, if there is one.
    pub fn peek(&self) -> Option<&T> {
        self.ring.peek().ok()
    }

    /// How many items wait at least; the producer may add more at any time.
    pub fn len(&self) -> usize {
        self.ring.slots()
    }

    /// Whether nothing waits now.
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    /// How many items the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.ring.buffer().capacity()
    }

    /// How many items were refused so far.
    pub fn refused(&self) -> u64 {
        self.refused.count()
    }

    /// Whether the producer is gone. What it left can still be taken.
    pub fn is_abandoned(&self) -> bool {
        self.ring.is_abandoned()
    }
}
