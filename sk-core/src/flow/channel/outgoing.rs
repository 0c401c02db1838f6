//! A whole message on its way to subscribers.

use super::super::codec::ChannelRef;
use super::super::definition::{Encoded, TAG_BYTES};
use super::super::fragment::Pieces;
use super::super::frame::{Flags, HEADER_BYTES};
use super::super::limits::{ITEM_OVERHEAD_BYTES, SHARED_PAYLOAD_BYTES_MIN};
use super::super::wire::budget::{Budget, Charge};
use super::super::{Event, Message as _};
use bytes::{Bytes, BytesMut};
use smallvec::{SmallVec, smallvec};
use std::sync::Arc;

/// The bytes before the payload in a `data` frame.
pub(super) const DATA_HEAD_BYTES: usize = HEADER_BYTES + TAG_BYTES + 8;

/// A whole message on its way to the subscribers of a channel, encoded once for all of them. A clone
/// shares everything; the budget is charged until the last one goes.
///
/// ```
/// use bytes::Bytes;
/// use sk_core::flow::ChannelRef;
/// use sk_core::flow::delivery::{Budget, Outgoing};
///
/// let budget = Budget::default();
/// let pieces = [Bytes::from_static(b"pulse")].into_iter().collect();
/// let message = Outgoing::new(ChannelRef { id: 2000, epoch: 1 }, 1, pieces, &budget);
/// let second_queue = message.clone();
/// drop(message);
/// assert_eq!(budget.used(), second_queue.charge());
/// drop(second_queue);
/// assert_eq!(budget.used(), 0);
/// ```
#[derive(Clone, Debug)]
pub struct Outgoing(Arc<Whole>);

#[derive(Debug)]
struct Whole {
    channel: ChannelRef,
    message: u32,
    charge: usize,
    /// It goes before what waits of other channels.
    is_tick: bool,
    fragments: SmallVec<[Fragment; 1]>,
    charged: Charge,
    /// The message that this one repeats on another channel: its payloads are the same bytes.
    _source: Option<Outgoing>,
}

#[derive(Debug)]
pub(super) struct Fragment {
    pub(super) payload: Bytes,
    pub(super) frame: Encoded,
}

impl Outgoing {
    /// Encodes a message as `data` frames and charges it to a budget.
    pub fn new(channel: ChannelRef, message: u32, pieces: Pieces, budget: &Budget) -> Outgoing {
        let charge = charge_of(pieces.iter().map(Bytes::len).sum(), pieces.len());
        Outgoing::build(channel, message, pieces.into_iter(), charge, budget.charge(charge), None)
    }

    /// Encodes a tick of a sync channel and charges it to a budget.
    pub fn tick(channel: ChannelRef, sequence: u64, budget: &Budget) -> Outgoing {
        let frame = Event::Tick { channel, sequence }.encode(0, Flags::NONE);
        let fragments = smallvec![Fragment { payload: Bytes::new(), frame }];
        let charge = ITEM_OVERHEAD_BYTES;
        let charged = budget.charge(charge);
        let (message, is_tick, _source) = (0, true, None);
        Outgoing(Arc::new(Whole { channel, message, charge, is_tick, fragments, charged, _source }))
    }

    /// Whether it goes before what waits of other channels: a tick is small, and late it is worth nothing.
    pub fn is_tick(&self) -> bool {
        self.0.is_tick
    }

    /// The same message on a replicating channel. The payloads are shared, and not charged again.
    pub fn repeated_on(&self, channel: ChannelRef) -> Outgoing {
        let count = self.0.fragments.len();
        let charged = self.0.charged.budget().charge(ITEM_OVERHEAD_BYTES * count);
        let payloads = self.0.fragments.iter().map(|fragment| fragment.payload.clone());
        Outgoing::build(channel, self.0.message, payloads, self.0.charge, charged, Some(self.clone()))
    }

    /// The same bytes as another message of the channel.
    pub(super) fn renumbered(&self, message: u32) -> Outgoing {
        let payloads = self.0.fragments.iter().map(|fragment| fragment.payload.clone());
        let charged = self.0.charged.budget().charge(0);
        Outgoing::build(self.0.channel, message, payloads, self.0.charge, charged, Some(self.clone()))
    }

    fn build(
        channel: ChannelRef,
        message: u32,
        pieces: impl ExactSizeIterator<Item = Bytes>,
        charge: usize,
        charged: Charge,
        source: Option<Outgoing>,
    ) -> Outgoing {
        let count = pieces.len();
        let fragment = |(index, payload)| {
            Fragment::new(channel, message, Flags::of(index == 0, index + 1 == count), payload)
        };
        let fragments = pieces.enumerate().map(fragment).collect();
        let is_tick = false;
        Outgoing(Arc::new(Whole { channel, message, charge, is_tick, fragments, charged, _source: source }))
    }

    /// What it is charged to a connection while it waits: its payload and a little for each fragment.
    pub fn charge(&self) -> usize {
        self.0.charge
    }

    /// How long it is, all its fragments together.
    pub fn length(&self) -> usize {
        self.0.charge - ITEM_OVERHEAD_BYTES * self.0.fragments.len()
    }

    /// The message's id.
    pub fn message(&self) -> u32 {
        self.0.message
    }

    /// The channel it is on.
    pub fn channel(&self) -> ChannelRef {
        self.0.channel
    }

    pub(super) fn fragments(&self) -> &[Fragment] {
        &self.0.fragments
    }
}

/// What a message of so many bytes in so many fragments is charged.
pub fn charge_of(bytes: usize, fragments: usize) -> usize {
    bytes + ITEM_OVERHEAD_BYTES * fragments
}

impl Fragment {
    fn new(channel: ChannelRef, message: u32, flags: Flags, payload: Bytes) -> Fragment {
        let frame = data(channel, message, flags, payload.clone());
        if payload.len() >= SHARED_PAYLOAD_BYTES_MIN {
            return Fragment { payload, frame };
        }
        // A small payload joins its head: one slice to write instead of two, and no receive buffer kept.
        let mut joined = BytesMut::with_capacity(frame.len());
        joined.extend_from_slice(&frame.head);
        joined.extend_from_slice(&payload);
        let head = joined.freeze();
        Fragment { payload: head.slice(DATA_HEAD_BYTES..), frame: Encoded { head, payload: Bytes::new() } }
    }
}

pub(super) fn data(channel: ChannelRef, message: u32, flags: Flags, payload: Bytes) -> Encoded {
    Event::Data { channel, message, payload }.encode(0, flags)
}

/// A message that is being sent, a piece at a time, to one who may take shorter fragments than it came in.
#[derive(Debug)]
pub(in super::super) struct Begun {
    pub(in super::super) message: Outgoing,
    fragment: usize,
    offset: usize,
}

impl Begun {
    pub(in super::super) fn new(message: Outgoing) -> Begun {
        Begun { message, fragment: 0, offset: 0 }
    }

    /// The next piece of at most `payload_max` with its flags; the frame is given if it exists as it is.
    pub(in super::super) fn next_piece(&mut self, payload_max: usize) -> (Flags, Bytes, Option<Encoded>) {
        let fragments = self.message.fragments();
        let fragment = &fragments[self.fragment];
        let left = fragment.payload.len() - self.offset;
        let first = self.fragment == 0 && self.offset == 0;
        if left > payload_max {
            let piece = fragment.payload.slice(self.offset..self.offset + payload_max);
            self.offset += payload_max;
            return (Flags::of(first, false), piece, None);
        }
        let flags = Flags::of(first, self.fragment + 1 == fragments.len());
        let whole = (self.offset == 0).then(|| fragment.frame.clone());
        let piece = fragment.payload.slice(self.offset..);
        self.fragment += 1;
        self.offset = 0;
        (flags, piece, whole)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: ChannelRef = ChannelRef { id: 2000, epoch: 1 };
    const B: ChannelRef = ChannelRef { id: 2001, epoch: 3 };

    #[test]
    fn a_repeated_message_is_the_same_bytes_and_ischarged_once() {
        let budget = Budget::default();
        let payload = Bytes::from(vec![7; 5000]);
        let message = Outgoing::new(A, 4, [payload.clone()].into_iter().collect(), &budget);
        let repeated = message.repeated_on(B);
        assert_eq!((repeated.channel(), repeated.message()), (B, 4));
        assert_eq!(repeated.charge(), message.charge());
        assert_eq!(budget.used(), message.charge() + ITEM_OVERHEAD_BYTES);
        drop(message);
        assert_eq!(budget.used(), repeated.charge() + ITEM_OVERHEAD_BYTES, "the payload is held still");
        assert_eq!(repeated.fragments()[0].frame.payload.as_ptr(), payload.as_ptr());
        drop(repeated);
        assert_eq!(budget.used(), 0);
    }
}
