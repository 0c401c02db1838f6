//! The book of one subscription: which messages wait, which go, which were dropped and why.

use super::codec::ChannelRef;
use super::definition::{Encoded, TAG_BYTES};
use super::fragment::Pieces;
use super::frame::{Flags, HEADER_BYTES};
use super::limits::{ITEM_OVERHEAD_BYTES, SHARED_PAYLOAD_BYTES_MIN};
use super::{Event, Message as _};
use crate::testing::{Bug, is_planted};
use bytes::{Bytes, BytesMut};
use std::collections::VecDeque;
use std::sync::Arc;

/// The bytes before the payload in a `data` frame.
const DATA_HEAD_BYTES: usize = HEADER_BYTES + TAG_BYTES + 8;

/// A whole message on its way to the subscribers of a channel, encoded once for all of them. A clone
/// shares everything.
#[derive(Clone, Debug)]
pub struct Outgoing {
    channel: ChannelRef,
    message: u32,
    charge: usize,
    /// It goes before what waits of other channels.
    is_tick: bool,
    fragments: Arc<[Fragment]>,
}

#[derive(Debug)]
struct Fragment {
    payload: Bytes,
    frame: Encoded,
}

impl Outgoing {
    /// Encodes a message as `data` frames.
    pub fn new(channel: ChannelRef, message: u32, pieces: Pieces) -> Outgoing {
        let count = pieces.len();
        let charge = pieces.iter().map(Bytes::len).sum::<usize>() + ITEM_OVERHEAD_BYTES * count;
        let fragment = |(index, payload)| {
            Fragment::new(channel, message, Flags::of(index == 0, index + 1 == count), payload)
        };
        let fragments = pieces.into_iter().enumerate().map(fragment).collect();
        Outgoing { channel, message, charge, is_tick: false, fragments }
    }

    /// Encodes a tick of a sync channel.
    pub fn tick(channel: ChannelRef, sequence: u64) -> Outgoing {
        let frame = Event::Tick { channel, sequence }.encode(0, Flags::NONE);
        let fragments = Arc::new([Fragment { payload: Bytes::new(), frame }]);
        Outgoing { channel, message: 0, charge: ITEM_OVERHEAD_BYTES, is_tick: true, fragments }
    }

    /// Whether it goes before what waits of other channels: a tick is small, and late it is worth nothing.
    pub fn is_tick(&self) -> bool {
        self.is_tick
    }

    /// What it is charged to a connection while it waits: its payload and a little for each fragment.
    pub fn charge(&self) -> usize {
        self.charge
    }
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

fn data(channel: ChannelRef, message: u32, flags: Flags, payload: Bytes) -> Encoded {
    Event::Data { channel, message, payload }.encode(0, flags)
}

/// Why a message did not reach a subscriber.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum DropReason {
    /// The connection had as many bytes waiting as it may.
    Full = 0,
    /// A newer message took its place.
    NewestWins = 1,
    /// The subscription, its channel or its connection ended.
    Gone = 2,
    /// The publisher gave the message up.
    Aborted = 3,
    /// The hub ended.
    Shutdown = 4,
    /// The subscriber's right to the channel was revoked.
    Rights = 5,
    /// The publisher went beyond its credit.
    Credit = 6,
}

impl DropReason {
    /// All of them, in the order of their numbers, with what they mean.
    pub const ALL: [(DropReason, &'static str, &'static str); 7] = [
        (DropReason::Full, "Full", "The connection had as many bytes waiting as it may."),
        (DropReason::NewestWins, "NewestWins", "A newer message took its place."),
        (DropReason::Gone, "Gone", "The subscription, its channel or its connection ended."),
        (DropReason::Aborted, "Aborted", "The publisher gave the message up."),
        (DropReason::Shutdown, "Shutdown", "The hub ended."),
        (DropReason::Rights, "Rights", "The subscriber's right to the channel was revoked."),
        (DropReason::Credit, "Credit", "The publisher went beyond its credit."),
    ];

    /// The meaning of a number on the wire, if this build knows it.
    pub fn from_wire(code: u8) -> Option<DropReason> {
        Self::ALL.get(usize::from(code)).map(|(reason, ..)| *reason)
    }
}

impl std::fmt::Display for DropReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            DropReason::Full => "full",
            DropReason::NewestWins => "newest-wins",
            DropReason::Gone => "gone",
            DropReason::Aborted => "aborted",
            DropReason::Shutdown => "shutdown",
            DropReason::Rights => "rights",
            DropReason::Credit => "credit",
        })
    }
}

/// The counts of a subscription. They balance: offered = delivered + dropped + queued.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Messages that were meant for it.
    pub offered: u64,
    /// Messages whose last byte the transport took.
    pub delivered: u64,
    /// Messages that were dropped, by [`DropReason`].
    pub dropped: [u64; DropReason::ALL.len()],
    /// Messages that wait or are being sent.
    pub queued: u64,
}

impl Counts {
    /// Dropped for all reasons.
    pub fn dropped_in_all(&self) -> u64 {
        self.dropped.iter().sum()
    }

    /// Whether nothing was lost from the books.
    pub fn balance(&self) -> bool {
        self.offered == self.delivered + self.dropped_in_all() + self.queued
    }

    /// Adds another's counts: the sum over subscriptions.
    pub fn add(&mut self, other: &Counts) {
        self.offered += other.offered;
        self.delivered += other.delivered;
        self.queued += other.queued;
        for (sum, more) in self.dropped.iter_mut().zip(other.dropped) {
            *sum += more;
        }
    }
}

/// One subscription's queue with the policy `Latest(depth)` and its counts.
///
/// The policy acts on whole messages that have not begun; a begun one is finished.
///
/// ```
/// use bytes::Bytes;
/// use sk_core::flow::ChannelRef;
/// use sk_core::flow::delivery::{Book, DropReason, Outgoing};
///
/// let channel = ChannelRef { id: 2000, epoch: 1 };
/// let mut book = Book::new(1);
/// for message in 0..3 {
///     let pieces = [Bytes::from_static(b"pulse")].into_iter().collect();
///     book.offer(&Outgoing::new(channel, message, pieces), usize::MAX);
/// }
/// assert_eq!(book.counts().dropped[DropReason::NewestWins as usize], 2);
/// let (frame, ends) = book.next_frame(65_536).expect("the newest waits");
/// assert!(ends && frame.to_vec().ends_with(b"pulse"));
/// book.delivered();
/// assert!(book.counts().balance());
/// ```
#[derive(Debug)]
pub struct Book {
    depth: usize,
    waiting: VecDeque<Outgoing>,
    begun: Option<Begun>,
    /// Charges of messages whose frames are all handed out and not yet taken by the transport.
    handed: VecDeque<usize>,
    counts: Counts,
    bytes: usize,
}

#[derive(Debug)]
struct Begun {
    message: Outgoing,
    fragment: usize,
    offset: usize,
}

impl Book {
    /// An empty book that keeps at most `depth` messages waiting, at least one.
    pub fn new(depth: usize) -> Book {
        Book {
            depth: depth.max(1),
            waiting: VecDeque::new(),
            begun: None,
            handed: VecDeque::new(),
            counts: Counts::default(),
            bytes: 0,
        }
    }

    /// Changes how many messages wait at most; what is too many now goes with the next offer.
    pub fn set_depth(&mut self, depth: usize) {
        self.depth = depth.max(1);
    }

    /// The counts.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What its queued messages are charged.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Whether a frame could be handed out.
    pub fn is_ready(&self) -> bool {
        self.begun.is_some() || !self.waiting.is_empty()
    }

    /// Takes a message in. Older ones that have not begun make room: beyond the depth as `NewestWins`,
    /// beyond `room` bytes as `Full`; if that is not enough, the message itself is dropped as `Full`.
    /// `room` is what the connection may queue beyond all that it queues now, in this book and others.
    pub fn offer(&mut self, message: &Outgoing, room: usize) {
        self.counts.offered += 1;
        let mut room = room;
        while message.charge() > room {
            let Some(old) = self.waiting.pop_front() else {
                self.counts.dropped[DropReason::Full as usize] += 1;
                return;
            };
            room += old.charge();
            self.drop_waiting(&old, DropReason::Full);
        }
        while self.waiting.len() >= self.depth {
            let Some(old) = self.waiting.pop_front() else { break };
            self.drop_waiting(&old, DropReason::NewestWins);
        }
        self.bytes += message.charge();
        self.counts.queued += 1;
        self.waiting.push_back(message.clone());
    }

    /// Notes a message that its publisher gave up before it was whole.
    pub fn aborted(&mut self) {
        self.counts.offered += 1;
        self.counts.dropped[DropReason::Aborted as usize] += u64::from(!is_planted(Bug::AbortUnbooked));
    }

    fn next_waiting(&mut self) -> Option<Outgoing> {
        if is_planted(Bug::NewestFirst) {
            return self.waiting.pop_back();
        }
        let message = self.waiting.pop_front()?;
        if is_planted(Bug::SentTwice) && message.message % 8 == 7 {
            self.offer(&Outgoing { message: message.message + 1, ..message.clone() }, usize::MAX);
        }
        Some(message)
    }

    /// The next `data` frame with a payload of at most `payload_max`, and whether it ends its message.
    /// Fragments that are longer than this subscriber takes are cut again.
    pub fn next_frame(&mut self, payload_max: usize) -> Option<(Encoded, bool)> {
        let mut begun = match self.begun.take() {
            Some(begun) => begun,
            None => Begun { message: self.next_waiting()?, fragment: 0, offset: 0 },
        };
        let Outgoing { channel, message, charge, ref fragments, .. } = begun.message;
        let fragment = &fragments[begun.fragment];
        let left = fragment.payload.len() - begun.offset;
        let ends_fragment = left <= payload_max;
        let ends = ends_fragment && begun.fragment + 1 == fragments.len();
        let frame = if ends_fragment && begun.offset == 0 {
            fragment.frame.clone()
        } else {
            let piece = fragment.payload.slice(begun.offset..begun.offset + left.min(payload_max));
            let first = begun.fragment == 0 && begun.offset == 0;
            data(channel, message, Flags::of(first, ends), piece)
        };
        if ends {
            self.handed.push_back(charge);
        } else {
            if ends_fragment {
                begun.fragment += 1;
                begun.offset = 0;
            } else {
                begun.offset += payload_max;
            }
            self.begun = Some(begun);
        }
        Some((frame, ends))
    }

    /// Notes that the transport took the last byte of the oldest message whose frames were all handed
    /// out, and answers its charge.
    pub fn delivered(&mut self) -> usize {
        let Some(charge) = self.handed.pop_front() else { return 0 };
        self.bytes -= charge;
        self.counts.queued -= 1;
        self.counts.delivered += 1;
        charge
    }

    /// Ends the book: what is queued is dropped for `reason`, what is half-written too.
    pub fn close(mut self, reason: DropReason) -> Counts {
        self.counts.dropped[reason as usize] += self.counts.queued;
        self.counts.queued = 0;
        self.counts
    }

    fn drop_waiting(&mut self, old: &Outgoing, reason: DropReason) {
        self.bytes -= old.charge();
        self.counts.queued -= 1;
        self.counts.dropped[reason as usize] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::Header;
    use super::*;
    use proptest::prelude::*;

    const CHANNEL: ChannelRef = ChannelRef { id: 2000, epoch: 1 };

    fn message(id: u32, pieces: &[usize]) -> Outgoing {
        let pieces = pieces.iter().map(|length| Bytes::from(vec![id as u8; *length])).collect();
        Outgoing::new(CHANNEL, id, pieces)
    }

    fn ids(book: &mut Book) -> Vec<u32> {
        std::iter::from_fn(|| book.next_frame(65_536))
            .map(|(frame, _)| {
                let bytes = frame.to_vec();
                u32::from_le_bytes([bytes[14], bytes[15], bytes[16], bytes[17]])
            })
            .collect()
    }

    #[test]
    fn the_newest_messages_win_and_a_begun_one_is_finished() {
        let mut book = Book::new(2);
        book.offer(&message(1, &[10, 10]), usize::MAX);
        book.next_frame(65_536).expect("message 1 begins");
        for id in 2..6 {
            book.offer(&message(id, &[10]), usize::MAX);
        }
        assert_eq!(ids(&mut book), [1, 4, 5]);
        assert_eq!(book.counts().dropped[DropReason::NewestWins as usize], 2);
        assert_eq!(book.counts().queued, 3, "handed out is not yet delivered");
        (0..3).for_each(|_| assert!(book.delivered() > 0));
        assert_eq!(book.bytes(), 0);
        assert!(book.counts().balance());
    }

    #[test]
    fn without_room_old_messages_go_and_then_the_new_one() {
        let mut book = Book::new(9);
        book.offer(&message(1, &[1000]), 1064);
        book.offer(&message(2, &[1000]), 0);
        assert_eq!(book.counts().dropped[DropReason::Full as usize], 1);
        book.offer(&message(3, &[5000]), 0);
        assert_eq!(book.counts().dropped[DropReason::Full as usize], 3, "message 2 went for nothing");
        assert!(!book.is_ready() && book.bytes() == 0 && book.counts().balance());
    }

    #[test]
    fn a_subscriber_with_smaller_fragments_gets_the_same_bytes() {
        let mut book = Book::new(9);
        book.offer(&message(1, &[700, 300, 2000]), usize::MAX);
        let mut payload = Vec::new();
        let mut flags = Vec::new();
        while let Some((frame, ends)) = book.next_frame(256) {
            let bytes = frame.to_vec();
            let header = Header::parse(&bytes).expect("a header");
            assert_eq!(header.length as usize, bytes.len() - HEADER_BYTES);
            assert!(bytes.len() - DATA_HEAD_BYTES <= 256);
            assert_eq!(ends, header.flags & Flags::LAST.bits() != 0);
            flags.push(header.flags);
            payload.extend_from_slice(&bytes[DATA_HEAD_BYTES..]);
        }
        assert_eq!(payload, vec![1; 3000]);
        assert_eq!((flags.first(), flags.last()), (Some(&1), Some(&2)));
        assert!(flags[1..flags.len() - 1].iter().all(|bits| *bits == 0));
    }

    #[test]
    fn a_large_payload_is_shared_and_a_small_one_joins_its_head() {
        let large = Bytes::from(vec![0; SHARED_PAYLOAD_BYTES_MIN]);
        let mut book = Book::new(9);
        book.offer(&Outgoing::new(CHANNEL, 1, [large.clone()].into_iter().collect()), usize::MAX);
        book.offer(&message(2, &[SHARED_PAYLOAD_BYTES_MIN - 1]), usize::MAX);
        let (frame, _) = book.next_frame(65_536).expect("the large one");
        assert_eq!(frame.payload.as_ptr(), large.as_ptr());
        let (frame, _) = book.next_frame(65_536).expect("the small one");
        assert!(frame.payload.is_empty());
    }

    proptest! {
        #[test]
        fn the_books_balance_whatever_happens(
            depth in 1_usize..6,
            steps in prop::collection::vec((0_u8..6, prop::collection::vec(1_usize..600, 1..4)), 0..100),
            reason in 0_usize..5,
        ) {
            let mut book = Book::new(depth);
            let mut handed = 0;
            for (step, pieces) in steps {
                match step {
                    0..=2 => book.offer(&message(1, &pieces), 2000_usize.saturating_sub(book.bytes())),
                    3 => book.aborted(),
                    4 => handed += u32::from(book.next_frame(300).is_some_and(|(_, ends)| ends)),
                    _ => {
                        let taken = book.delivered() > 0;
                        prop_assert_eq!(taken, handed > 0);
                        handed -= u32::from(taken);
                    }
                }
                prop_assert!(book.counts().balance(), "{:?}", book.counts());
                prop_assert!(book.bytes() <= 2000 && (book.bytes() == 0) == (book.counts().queued == 0));
            }
            let end = book.close(DropReason::ALL[reason].0);
            prop_assert!(end.balance() && end.queued == 0);
        }
    }
}
