//! The book of one subscription: which messages wait, which go, which were dropped and why.

use super::super::Policy;
use super::super::definition::Encoded;
use super::super::frame::Flags;
use super::outgoing::{Begun, data};
pub use super::outgoing::{Outgoing, charge_of};
pub use crate::flow::wire::budget::{Budget, Charge};
use crate::testing::{Bug, is_planted};
use std::collections::VecDeque;

/// Why a message did not reach a subscriber.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum DropReason {
    /// The connection had as many bytes waiting as it may, or the message is longer than it takes.
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
        (
            DropReason::Full,
            "Full",
            "The connection had as many bytes waiting as it may, or the message is longer than it takes.",
        ),
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

/// What became of a message that was offered to a book.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offered {
    /// It waits; others may have made room for it.
    Taken,
    /// It found no room and was dropped.
    Dropped,
    /// It found no room and was dropped, and this subscriber must not miss any: its connection is to end.
    Broken,
}

/// One subscription's queue with its policy and its counts.
///
/// `Latest` keeps the newest messages and drops older ones that have not begun; a begun one is finished. `All`
/// keeps every message; one that finds no room breaks the subscription.
///
/// ```
/// use bytes::Bytes;
/// use sk_core::flow::{ChannelRef, Policy};
/// use sk_core::flow::delivery::{Book, Budget, DropReason, Outgoing};
///
/// let channel = ChannelRef { id: 2000, epoch: 1 };
/// let budget = Budget::default();
/// let mut book = Book::new(Policy::Latest, 1);
/// for message in 0..3 {
///     let pieces = [Bytes::from_static(b"pulse")].into_iter().collect();
///     book.offer(&Outgoing::new(channel, message, pieces, &budget), usize::MAX);
/// }
/// assert_eq!(book.counts().dropped[DropReason::NewestWins as usize], 2);
/// let (frame, ends) = book.next_frame(65_536).expect("the newest waits");
/// assert!(ends && frame.to_vec().ends_with(b"pulse"));
/// book.delivered();
/// assert!(book.counts().balance() && budget.used() == 0);
/// ```
#[derive(Debug)]
pub struct Book {
    policy: Policy,
    depth: usize,
    waiting: VecDeque<Outgoing>,
    begun: Option<Begun>,
    /// Messages whose frames are all handed out and not yet taken by the transport.
    handed: VecDeque<Outgoing>,
    counts: Counts,
    bytes: usize,
}

impl Book {
    /// An empty book that keeps at most `depth` messages waiting, at least one.
    pub fn new(policy: Policy, depth: usize) -> Book {
        Book {
            policy,
            depth: depth.max(1),
            waiting: VecDeque::new(),
            begun: None,
            handed: VecDeque::new(),
            counts: Counts::default(),
            bytes: 0,
        }
    }

    /// Changes the policy, and how many messages wait at most. It acts with the next offer.
    pub fn set_policy(&mut self, policy: Policy, depth: usize) {
        self.policy = policy;
        self.depth = depth.max(1);
    }

    /// The policy, and how many messages wait at most.
    pub fn policy(&self) -> (Policy, usize) {
        (self.policy, self.depth)
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

    /// Takes a message in. Of `Latest`, older ones that have not begun make room: beyond the depth as
    /// `NewestWins`, beyond `room` bytes as `Full`; if that is not enough, the message itself is dropped as
    /// `Full`. Of `All`, what finds no room is dropped as `Full`, which breaks the subscription.
    /// `room` is what the connection may queue beyond all that it queues now, in this book and others.
    pub fn offer(&mut self, message: &Outgoing, room: usize) -> Offered {
        self.counts.offered += 1;
        let mut room = room;
        if self.policy == Policy::All && (message.charge() > room || self.waiting.len() >= self.depth) {
            self.counts.dropped[DropReason::Full as usize] += 1;
            return Offered::Broken;
        }
        while message.charge() > room {
            let Some(freed) = self.drop_oldest(DropReason::Full) else {
                self.counts.dropped[DropReason::Full as usize] += 1;
                return Offered::Dropped;
            };
            room += freed;
        }
        while self.waiting.len() >= self.depth && self.drop_oldest(DropReason::NewestWins).is_some() {}
        self.bytes += message.charge();
        self.counts.queued += 1;
        self.waiting.push_back(message.clone());
        Offered::Taken
    }

    /// Notes a message that was meant for this subscriber and was dropped before it came here.
    pub fn missed(&mut self, reason: DropReason) -> Offered {
        self.counts.offered += 1;
        let unbooked = reason == DropReason::Aborted && is_planted(Bug::AbortUnbooked);
        self.counts.dropped[reason as usize] += u64::from(!unbooked);
        if self.policy == Policy::All && reason == DropReason::Full {
            Offered::Broken
        } else {
            Offered::Dropped
        }
    }

    /// Drops the oldest message that has not begun; answers its charge. A book of `All` keeps it.
    pub fn shed(&mut self) -> Option<usize> {
        if self.policy == Policy::All { None } else { self.drop_oldest(DropReason::Full) }
    }

    fn next_waiting(&mut self) -> Option<Outgoing> {
        if is_planted(Bug::NewestFirst) {
            return self.waiting.pop_back();
        }
        let message = self.waiting.pop_front()?;
        if is_planted(Bug::SentTwice) && message.message() % 8 == 7 {
            self.offer(&message.renumbered(message.message() + 1), usize::MAX);
        }
        Some(message)
    }

    /// The next `data` frame with a payload of at most `payload_max`, and whether it ends its message.
    /// Fragments that are longer than this subscriber takes are cut again.
    pub fn next_frame(&mut self, payload_max: usize) -> Option<(Encoded, bool)> {
        let mut begun = match self.begun.take() {
            Some(begun) => begun,
            None => Begun::new(self.next_waiting()?),
        };
        let (flags, piece, whole) = begun.next_piece(payload_max);
        let (channel, message) = (begun.message.channel(), begun.message.message());
        let frame = whole.unwrap_or_else(|| data(channel, message, flags, piece));
        let ends = flags.has(Flags::LAST);
        if ends {
            self.handed.push_back(begun.message);
        } else {
            self.begun = Some(begun);
        }
        Some((frame, ends))
    }

    /// Notes that the transport took the last byte of the oldest message whose frames were all handed
    /// out, and answers its charge.
    pub fn delivered(&mut self) -> usize {
        let Some(message) = self.handed.pop_front() else { return 0 };
        self.bytes -= message.charge();
        self.counts.queued -= 1;
        self.counts.delivered += 1;
        message.charge()
    }

    /// Begins anew what no transport has taken whole: for a peer that comes back over another connection and
    /// knows nothing of what was half-sent over this one.
    pub fn restart(&mut self) {
        if let Some(begun) = self.begun.take() {
            self.waiting.push_front(begun.message);
        }
        while let Some(message) = self.handed.pop_back() {
            self.waiting.push_front(message);
        }
    }

    /// Ends the book: what is queued is dropped for `reason`, what is half-written too.
    pub fn close(mut self, reason: DropReason) -> Counts {
        self.counts.dropped[reason as usize] += self.counts.queued;
        self.counts.queued = 0;
        self.counts
    }

    fn drop_oldest(&mut self, reason: DropReason) -> Option<usize> {
        let old = self.waiting.pop_front()?;
        self.bytes -= old.charge();
        self.counts.queued -= 1;
        self.counts.dropped[reason as usize] += 1;
        Some(old.charge())
    }
}

#[cfg(test)]
mod tests {
    use super::super::outgoing::DATA_HEAD_BYTES;
    use super::*;
    use crate::flow::codec::ChannelRef;
    use crate::flow::frame::{HEADER_BYTES, Header};
    use crate::flow::limits::SHARED_PAYLOAD_BYTES_MIN;
    use bytes::Bytes;
    use proptest::prelude::*;

    const CHANNEL: ChannelRef = ChannelRef { id: 2000, epoch: 1 };

    fn message(id: u32, pieces: &[usize]) -> Outgoing {
        let pieces = pieces.iter().map(|length| Bytes::from(vec![id as u8; *length])).collect();
        Outgoing::new(CHANNEL, id, pieces, &Budget::default())
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
        let mut book = Book::new(Policy::Latest, 2);
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
        let mut book = Book::new(Policy::Latest, 9);
        book.offer(&message(1, &[1000]), 1064);
        book.offer(&message(2, &[1000]), 0);
        assert_eq!(book.counts().dropped[DropReason::Full as usize], 1);
        book.offer(&message(3, &[5000]), 0);
        assert_eq!(book.counts().dropped[DropReason::Full as usize], 3, "message 2 went for nothing");
        assert!(!book.is_ready() && book.bytes() == 0 && book.counts().balance());
    }

    #[test]
    fn a_subscriber_with_smaller_fragments_gets_the_same_bytes() {
        let mut book = Book::new(Policy::Latest, 9);
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
        let mut book = Book::new(Policy::Latest, 9);
        let pieces = [large.clone()].into_iter().collect();
        book.offer(&Outgoing::new(CHANNEL, 1, pieces, &Budget::default()), usize::MAX);
        book.offer(&message(2, &[SHARED_PAYLOAD_BYTES_MIN - 1]), usize::MAX);
        let (frame, _) = book.next_frame(65_536).expect("the large one");
        assert_eq!(frame.payload.as_ptr(), large.as_ptr());
        let (frame, _) = book.next_frame(65_536).expect("the small one");
        assert!(frame.payload.is_empty());
    }

    #[test]
    fn who_must_not_miss_any_breaks_at_one_more_than_its_depth() {
        for (count, breaks) in [(2, false), (3, false), (4, true)] {
            let mut book = Book::new(Policy::All, 3);
            let last = (0..count).map(|id| book.offer(&message(id, &[10]), usize::MAX)).last();
            assert_eq!(last == Some(Offered::Broken), breaks, "{count} messages");
            assert!(book.counts().balance());
            assert_eq!(book.counts().queued, u64::from(count.min(3)), "what was taken stays");
        }
        let charge = message(1, &[10]).charge();
        for (room, taken) in [(charge - 1, false), (charge, true), (charge + 1, true)] {
            let mut book = Book::new(Policy::All, 3);
            assert_eq!(book.offer(&message(1, &[10]), room) == Offered::Taken, taken, "{room} bytes");
        }
        let mut book = Book::new(Policy::All, 1);
        book.offer(&message(1, &[10]), usize::MAX);
        book.set_policy(Policy::Latest, 1);
        assert_eq!(
            book.offer(&message(2, &[10]), usize::MAX),
            Offered::Taken,
            "it may miss some from now on"
        );
    }

    #[test]
    fn a_book_that_begins_anew_sends_again_what_was_not_taken_whole() {
        let mut book = Book::new(Policy::All, 9);
        for id in 1..5 {
            book.offer(&message(id, &[600]), usize::MAX);
        }
        (0..2).for_each(|_| drop(book.next_frame(65_536)));
        book.next_frame(300);
        book.delivered();
        book.restart();
        assert_eq!(ids(&mut book), [2, 3, 4], "message 1 was delivered");
        assert!(book.counts().balance() && book.counts().queued == 3);
    }

    proptest! {
        #[test]
        fn the_books_balance_whatever_happens(
            depth in 1_usize..6,
            steps in prop::collection::vec((0_u8..10, prop::collection::vec(1_usize..600, 1..4)), 0..100),
            reason in 0_usize..DropReason::ALL.len(),
        ) {
            let budget = Budget::default();
            let mut book = Book::new(Policy::Latest, depth);
            let mut handed = 0;
            for (step, pieces) in steps {
                match step {
                    0..=2 => {
                        let pieces = pieces.iter().map(|length| Bytes::from(vec![1; *length])).collect();
                        let room = 2000_usize.saturating_sub(book.bytes());
                        book.offer(&Outgoing::new(CHANNEL, 1, pieces, &budget), room);
                    }
                    3 => {
                        book.missed(DropReason::Aborted);
                    }
                    4 => handed += u32::from(book.next_frame(300).is_some_and(|(_, ends)| ends)),
                    5 => {
                        book.shed();
                    }
                    6 => book.set_policy(Policy::All, depth),
                    7 => book.set_policy(Policy::Latest, pieces.len()),
                    8 => {
                        book.restart();
                        handed = 0;
                    }
                    _ => {
                        let taken = book.delivered() > 0;
                        prop_assert_eq!(taken, handed > 0);
                        handed -= u32::from(taken);
                    }
                }
                prop_assert!(book.counts().balance(), "{:?}", book.counts());
                prop_assert!(book.bytes() <= 2000 && (book.bytes() == 0) == (book.counts().queued == 0));
                prop_assert_eq!(budget.used(), book.bytes(), "one queue holds them all");
            }
            let end = book.close(DropReason::ALL[reason].0);
            prop_assert!(end.balance() && end.queued == 0);
            prop_assert_eq!(budget.used(), 0);
        }
    }
}
