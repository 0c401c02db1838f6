//! Messages in pieces: cutting one into fragments, and gathering fragments of many channels at once.

use super::super::limits::{ITEM_OVERHEAD_BYTES, SHARED_PAYLOAD_BYTES_MIN, UNFINISHED_BYTES_MAX};
use super::budget::{Budget, Charge};
use super::codec::ChannelRef;
use super::error::ProtocolError;
use super::frame::Flags;
use crate::testing::{Bug, is_planted};
use bytes::{Bytes, BytesMut};
use rustc_hash::FxHashMap;
use smallvec::{SmallVec, smallvec};

/// The payloads of a message's fragments, in order. Most messages have one.
pub type Pieces = SmallVec<[Bytes; 1]>;

/// Cuts a message into fragments of at most `bytes_max`, without copying. An empty message is one empty
/// fragment.
///
/// ```
/// use bytes::Bytes;
/// use sk_core::flow::{Flags, fragment::cut};
///
/// let pieces: Vec<_> = cut(Bytes::from_static(b"abcde"), 2).collect();
/// assert_eq!(pieces[0], (Flags::FIRST, Bytes::from_static(b"ab")));
/// assert_eq!(pieces[1], (Flags::NONE, Bytes::from_static(b"cd")));
/// assert_eq!(pieces[2], (Flags::LAST, Bytes::from_static(b"e")));
/// ```
pub fn cut(message: Bytes, bytes_max: usize) -> impl Iterator<Item = (Flags, Bytes)> {
    let mut left = Some(message);
    let mut first = true;
    std::iter::from_fn(move || {
        let mut rest = left.take()?;
        let piece = rest.split_to(rest.len().min(bytes_max.max(1)));
        let flags = Flags::of(first, rest.is_empty());
        first = false;
        left = (!rest.is_empty()).then_some(rest);
        Some((flags, piece))
    })
}

/// What one fragment led to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Gathered {
    /// The message goes on.
    More,
    /// The message is whole.
    Whole(Pieces),
    /// Its sender gave it up.
    Aborted,
    /// The limit for unfinished messages was reached: this one is given up; said once for each message.
    Overfull,
    /// It belongs to a message that was given up before.
    Ignored,
}

/// The unfinished messages of one connection, at most one for each key: a channel, or the tag of a call.
///
/// Small pieces are copied out of the receive buffer, so that what is charged is what is held. It is charged to a
/// budget that others may share.
#[derive(Debug)]
pub struct Gathering<K = ChannelRef> {
    unfinished: FxHashMap<K, Unfinished>,
    bytes: usize,
    shared: Budget,
}

#[derive(Debug)]
struct Unfinished {
    message: u32,
    length: usize,
    charged: Charge,
    /// `None` once the message was given up.
    pieces: Option<Pieces>,
}

impl<K> Default for Gathering<K> {
    fn default() -> Self {
        Gathering::charged_to(Budget::default())
    }
}

impl<K> Gathering<K> {
    /// One whose bytes count into a budget with those of others.
    pub fn charged_to(shared: Budget) -> Gathering<K> {
        Gathering { unfinished: FxHashMap::default(), bytes: 0, shared }
    }
}

impl<K: Copy + Eq + std::hash::Hash> Gathering<K> {
    /// Takes the next fragment of a channel.
    ///
    /// # Errors
    /// What no honest peer sends: a message that begins inside another of its channel, a continuation of
    /// none, an empty fragment that is not the last, or a message longer than `bytes_max`.
    pub fn take(
        &mut self,
        channel: K,
        message: u32,
        flags: Flags,
        payload: Bytes,
        bytes_max: usize,
    ) -> Result<Gathered, ProtocolError> {
        let out_of_sequence = ProtocolError::FragmentSequence { message };
        if flags == Flags::ABORT {
            let known = self.unfinished.get(&channel).is_some_and(|found| found.message == message);
            return match known && payload.is_empty() {
                true if self.forget(channel) => Ok(Gathered::Aborted),
                true => Ok(Gathered::Ignored),
                false => Err(out_of_sequence),
            };
        }
        if payload.is_empty() && !flags.has(Flags::LAST) {
            return Err(out_of_sequence);
        }
        if flags.has(Flags::FIRST) {
            if self.unfinished.contains_key(&channel) {
                return Err(out_of_sequence);
            }
            if flags.has(Flags::LAST) {
                return if payload.len() > bytes_max {
                    Err(ProtocolError::MessageTooLong { max: bytes_max })
                } else {
                    Ok(Gathered::Whole(smallvec![payload]))
                };
            }
            let charged = self.shared.charge(0);
            let begun = Unfinished { message, length: 0, charged, pieces: Some(Pieces::new()) };
            self.unfinished.insert(channel, begun);
        }
        self.continue_message(channel, message, flags, payload, bytes_max)
    }

    fn continue_message(
        &mut self,
        channel: K,
        message: u32,
        flags: Flags,
        payload: Bytes,
        bytes_max: usize,
    ) -> Result<Gathered, ProtocolError> {
        let Some(found) = self.unfinished.get_mut(&channel).filter(|found| found.message == message) else {
            return Err(ProtocolError::FragmentSequence { message });
        };
        found.length += payload.len();
        if found.length > bytes_max {
            return Err(ProtocolError::MessageTooLong { max: bytes_max });
        }
        let charge = payload.len() + ITEM_OVERHEAD_BYTES;
        let mut outcome = Gathered::More;
        match &mut found.pieces {
            None => outcome = Gathered::Ignored,
            Some(_) if self.bytes + charge > UNFINISHED_BYTES_MAX || !self.shared.has_room_for(charge) => {
                self.bytes -= found.charged.bytes();
                found.charged = self.shared.charge(0);
                found.pieces = None;
                outcome = Gathered::Overfull;
            }
            Some(pieces) => {
                self.bytes += charge;
                found.charged.add(charge);
                let start = usize::from(is_planted(Bug::ByteLost) && payload.len() > 1);
                pieces.push(owned_if_small(payload.slice(start..)));
            }
        }
        if flags.has(Flags::LAST)
            && let Some(ended) = self.unfinished.remove(&channel)
        {
            self.bytes -= ended.charged.bytes();
            if let Some(pieces) = ended.pieces {
                return Ok(Gathered::Whole(pieces));
            }
        }
        Ok(outcome)
    }

    /// Forgets what is unfinished on a channel; says whether a message was held.
    pub fn forget(&mut self, channel: K) -> bool {
        self.unfinished.remove(&channel).is_some_and(|ended| {
            self.bytes -= ended.charged.bytes();
            ended.pieces.is_some()
        })
    }

    /// Gives up every message that is unfinished: nothing is held any more, and what still comes of them is ignored.
    /// Answers where they were to go, in their order.
    pub fn give_up(&mut self) -> Vec<K>
    where
        K: Ord,
    {
        let mut given_up = Vec::new();
        for (key, unfinished) in &mut self.unfinished {
            if unfinished.pieces.take().is_some() {
                self.bytes -= unfinished.charged.bytes();
                unfinished.charged = self.shared.charge(0);
                given_up.push(*key);
            }
        }
        given_up.sort_unstable();
        given_up
    }

    /// What is held and charged.
    pub fn bytes(&self) -> usize {
        self.bytes
    }
}

/// A payload that does not keep a much larger buffer alive.
pub fn owned_if_small(payload: Bytes) -> Bytes {
    if payload.len() < SHARED_PAYLOAD_BYTES_MIN { Bytes::copy_from_slice(&payload) } else { payload }
}

/// The whole message; the one piece of most messages is handed on as it is.
pub fn joined(mut pieces: Pieces) -> Bytes {
    if pieces.len() == 1 {
        return std::mem::take(&mut pieces[0]);
    }
    let mut whole = BytesMut::with_capacity(pieces.iter().map(Bytes::len).sum());
    pieces.iter().for_each(|piece| whole.extend_from_slice(piece));
    whole.freeze()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const A: ChannelRef = ChannelRef { id: 1, epoch: 1 };
    const B: ChannelRef = ChannelRef { id: 2, epoch: 1 };

    fn bytes(text: &str) -> Bytes {
        Bytes::copy_from_slice(text.as_bytes())
    }

    #[test]
    fn a_beginning_inside_a_message_and_a_continuation_of_none_are_dishonest() {
        let mut all = Gathering::default();
        assert!(all.take(A, 1, Flags::NONE, bytes("x"), 99).is_err());
        assert_eq!(all.take(A, 1, Flags::FIRST, bytes("x"), 99), Ok(Gathered::More));
        assert!(all.take(A, 2, Flags::FIRST, bytes("x"), 99).is_err());
        assert!(all.take(A, 2, Flags::NONE, bytes("x"), 99).is_err(), "another message's id");
        assert!(all.take(A, 1, Flags::NONE, bytes(""), 99).is_err(), "an empty piece in the middle");
        assert!(all.take(B, 1, Flags::ABORT, bytes(""), 99).is_err(), "nothing to abort");
    }

    #[test]
    fn an_aborted_message_leaves_nothing() {
        let mut all = Gathering::default();
        assert_eq!(all.take(A, 1, Flags::FIRST, bytes("x"), 99), Ok(Gathered::More));
        assert_eq!(all.take(A, 1, Flags::ABORT, Bytes::new(), 99), Ok(Gathered::Aborted));
        assert_eq!(all.bytes(), 0);
        assert_eq!(all.take(A, 1, Flags::FIRST, bytes("x"), 99), Ok(Gathered::More));
    }

    #[test]
    fn a_message_may_be_as_long_as_agreed_and_no_longer() {
        for (length, fits) in [(9, true), (10, true), (11, false)] {
            let mut all = Gathering::default();
            let message = Bytes::from(vec![0; length]);
            assert_eq!(all.take(A, 1, Flags::WHOLE, message.clone(), 10).is_ok(), fits);
            let outcomes: Result<Vec<_>, _> =
                cut(message, 4).map(|(flags, piece)| all.take(A, 2, flags, piece, 10)).collect();
            assert_eq!(outcomes.is_ok(), fits, "{length} bytes in pieces");
        }
    }

    #[test]
    fn beyond_the_limit_of_unfinished_bytes_a_message_is_given_up_once_and_the_rest_ignored() {
        let mut all = Gathering::default();
        let piece = Bytes::from(vec![0; 1024 * 1024]);
        let mut first_refused = None;
        for id in 0..40 {
            let channel = ChannelRef { id, epoch: 1 };
            if all.take(channel, 1, Flags::FIRST, piece.clone(), usize::MAX) == Ok(Gathered::Overfull) {
                first_refused.get_or_insert(channel);
            }
            assert!(all.bytes() <= UNFINISHED_BYTES_MAX);
        }
        let refused = first_refused.expect("40 MiB are beyond the limit");
        assert_eq!(refused.id, 31);
        assert_eq!(all.take(refused, 1, Flags::NONE, piece.clone(), usize::MAX), Ok(Gathered::Ignored));
        assert_eq!(all.take(refused, 1, Flags::LAST, piece.clone(), usize::MAX), Ok(Gathered::Ignored));
        assert!(all.forget(A), "room again");
        assert_eq!(all.take(refused, 2, Flags::FIRST, piece, usize::MAX), Ok(Gathered::More));
    }

    #[test]
    fn what_is_given_up_is_held_no_more_and_the_rest_of_it_ignored() {
        let budget = Budget::default();
        let mut all = Gathering::charged_to(budget.clone());
        for channel in [B, A] {
            assert_eq!(all.take(channel, 1, Flags::FIRST, bytes("one"), 99), Ok(Gathered::More));
        }
        assert_eq!((all.bytes(), budget.used()), (budget.used(), 2 * (3 + ITEM_OVERHEAD_BYTES)));
        assert_eq!(all.give_up(), [A, B]);
        assert_eq!((all.give_up(), all.bytes(), budget.used()), (vec![], 0, 0));
        assert_eq!(all.take(A, 1, Flags::LAST, bytes("!"), 99), Ok(Gathered::Ignored));
        assert_eq!(all.take(A, 2, Flags::WHOLE, bytes("?"), 99), Ok(Gathered::Whole(smallvec![bytes("?")])));
    }

    #[test]
    fn a_small_piece_does_not_keep_the_receive_buffer() {
        let buffer = Bytes::from(vec![1; 64 * 1024]);
        let small = owned_if_small(buffer.slice(10..20));
        assert!(!buffer.as_ptr_range().contains(&small.as_ptr()));
        let large = owned_if_small(buffer.slice(..2048));
        assert_eq!(large.as_ptr(), buffer.as_ptr());
    }

    proptest! {
        #[test]
        fn interleaved_messages_come_out_as_they_went_in(
            messages in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..50), 1..6),
            size in 1_usize..20,
            order in prop::collection::vec(any::<prop::sample::Index>(), 300),
        ) {
            let mut sources: Vec<_> = messages
                .iter()
                .enumerate()
                .map(|(index, message)| (index, cut(Bytes::from(message.clone()), size)))
                .collect();
            let mut all = Gathering::default();
            let mut whole = 0;
            for pick in order {
                if sources.is_empty() {
                    break;
                }
                let place = pick.index(sources.len());
                let (index, source) = &mut sources[place];
                let Some((flags, piece)) = source.next() else {
                    drop(sources.swap_remove(place));
                    continue;
                };
                prop_assert!(piece.len() <= size);
                let channel = ChannelRef { id: *index as i16, epoch: 1 };
                match all.take(channel, 7, flags, piece, 50) {
                    Ok(Gathered::Whole(pieces)) => {
                        prop_assert_eq!(&pieces.concat(), &messages[*index]);
                        whole += 1;
                    }
                    other => prop_assert_eq!(other, Ok(Gathered::More)),
                }
            }
            if sources.is_empty() {
                prop_assert_eq!(whole, messages.len());
                prop_assert_eq!(all.bytes(), 0);
            }
        }
    }
}
