//! Items in a sampling ring: when it is full, the oldest makes room for the newest.

use super::Lost;
use crossbeam_queue::ArrayQueue;
use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};

/// The writing half of [`SkRingBuffer::newest`](super::SkRingBuffer::newest).
pub struct NewestProducer<T> {
    ring: Arc<ArrayQueue<T>>,
    replaced: Lost,
}

/// The reading half of [`SkRingBuffer::newest`](super::SkRingBuffer::newest).
pub struct NewestConsumer<T> {
    ring: Arc<ArrayQueue<T>>,
    replaced: Lost,
}

pub(super) fn pair<T>(capacity: usize) -> (NewestProducer<T>, NewestConsumer<T>) {
    let ring = Arc::new(ArrayQueue::new(capacity.max(1)));
    let replaced = Lost::default();
    let producer = NewestProducer { ring: Arc::clone(&ring), replaced: replaced.clone() };
    (producer, NewestConsumer { ring, replaced })
}

fn is_last<T>(ring: &Arc<ArrayQueue<T>>) -> bool {
    let last = Arc::strong_count(ring) == 1;
    // With the release of the other half's drop: whoever sees that it is gone sees all it did.
    fence(Ordering::Acquire);
    last
}

impl<T> NewestProducer<T> {
    /// Puts an item at the end. If the ring is full, its oldest item is taken out, counted as
    /// replaced and answered.
    pub fn push(&mut self, item: T) -> Option<T> {
        let oldest = self.ring.force_push(item);
        if oldest.is_some() {
            self.replaced.add(1);
        }
        oldest
    }

    /// How many items the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.ring.capacity()
    }

    /// How many items were replaced so far.
    pub fn replaced(&self) -> u64 {
        self.replaced.count()
    }

    /// Whether the consumer is gone, so that nobody will read what is pushed.
    pub fn is_abandoned(&self) -> bool {
        is_last(&self.ring)
    }
}

impl<T> NewestConsumer<T> {
    /// Takes the oldest item that is still there, if any.
    pub fn pop(&mut self) -> Option<T> {
        self.ring.pop()
    }

    /// Takes the newest item and drops those before it: what a sampler wants. It looks at no more
    /// items than wait when it begins, so a quick producer cannot keep it busy.
    pub fn pop_newest(&mut self) -> Option<T> {
        let waiting = self.ring.len();
        let mut newest = None;
        for _ in 0..waiting {
            match self.ring.pop() {
                Some(item) => newest = Some(item),
                None => break,
            }
        }
        newest
    }

    /// How many items wait now.
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Whether nothing waits now.
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    /// How many items the ring holds when full.
    pub fn capacity(&self) -> usize {
        self.ring.capacity()
    }

    /// How many items were replaced so far, that is: pushed but never to be seen here.
    pub fn replaced(&self) -> u64 {
        self.replaced.count()
    }

    /// Whether the producer is gone. What it left can still be taken.
    pub fn is_abandoned(&self) -> bool {
        is_last(&self.ring)
    }
}
