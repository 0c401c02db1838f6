//! Messages for one receiver: requests on their way to an owner, replies on their way to an asker.

use crate::flow::definition::Encoded;
use crate::flow::delivery::{Budget, Charge};
use crate::flow::fragment::{Pieces, owned_if_small};
use crate::flow::limits::ITEM_OVERHEAD_BYTES;
use crate::flow::{ChannelRef, Event, Flags, Message as _};
use bytes::Bytes;
use rustc_hash::FxHashMap;
use std::collections::VecDeque;

/// What keeps its order: a request, or all replies to one call.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in super::super) enum TalkKey {
    /// The request of this id, to its owner.
    Request(u64),
    /// The replies to the call of this tag, to its asker.
    Reply(u32),
    /// The download of this tag, to its reader.
    Blob(u32),
}

/// What a message is, without its bytes.
#[derive(Clone, Copy, Debug)]
pub(in super::super) enum Kind {
    Request {
        channel: ChannelRef,
        request: u64,
        asker: u64,
    },
    Reply {
        tag: u32,
        more: bool,
    },
    /// A piece of a download: its first, its last, or one between.
    Blob {
        tag: u32,
        first: bool,
        last: bool,
    },
}

/// A whole message for one receiver. Its bytes are those that its sender's fragments came in.
#[derive(Debug)]
pub(in super::super) struct Talk {
    kind: Kind,
    pieces: Pieces,
    charge: Charge,
    /// The piece and the place in it where the next fragment begins.
    next: (usize, usize),
}

impl Talk {
    pub(in super::super) fn new(kind: Kind, pieces: Pieces, budget: &Budget) -> Talk {
        // A small message must not keep the large buffer alive that it came in.
        let pieces: Pieces = pieces.into_iter().map(owned_if_small).collect();
        let bytes = pieces.iter().map(|piece| piece.len() + ITEM_OVERHEAD_BYTES).sum();
        let charge = budget.charge(bytes);
        Talk { kind, pieces, charge, next: (0, 0) }
    }

    /// Whether it is a request or a reply, and the hub holds more for all than it may.
    pub(super) fn is_too_much(&self) -> bool {
        // A download is read from the disk as there is room for it.
        !matches!(self.kind, Kind::Blob { .. }) && self.charge.budget().is_over()
    }

    /// What it is charged to its receiver while it waits.
    pub(in super::super) fn charge(&self) -> usize {
        self.charge.bytes()
    }

    pub(in super::super) fn key(&self) -> TalkKey {
        match self.kind {
            Kind::Request { request, .. } => TalkKey::Request(request),
            Kind::Reply { tag, .. } => TalkKey::Reply(tag),
            Kind::Blob { tag, .. } => TalkKey::Blob(tag),
        }
    }

    fn is_begun(&self) -> bool {
        self.next != (0, 0)
    }

    /// The next fragment of at most `payload_max`, and whether it is the last.
    fn next_frame(&mut self, payload_max: usize) -> (Encoded, bool) {
        let first = !self.is_begun();
        let (index, offset) = self.next;
        let piece = self.pieces.get(index).cloned().unwrap_or_default();
        let end = piece.len().min(offset + payload_max);
        let ends_piece = end == piece.len();
        let last = ends_piece && index + 1 >= self.pieces.len();
        self.next = if ends_piece { (index + 1, 0) } else { (index, end) };
        (self.frame(Flags::of(first, last), piece.slice(offset..end)), last)
    }

    fn frame(&self, flags: Flags, payload: Bytes) -> Encoded {
        match self.kind {
            Kind::Request { channel, request, asker } => {
                Event::Request { channel, request, asker, payload }.encode(0, flags)
            }
            Kind::Blob { tag, first, last } => {
                let flags = Flags::of(first && flags.has(Flags::FIRST), last && flags.has(Flags::LAST));
                Event::BlobData { payload }.encode(tag, flags)
            }
            Kind::Reply { tag, more } => Event::Reply { more: u8::from(more), payload }.encode(tag, flags),
        }
    }
}

#[derive(Debug)]
enum Item {
    Message(Talk),
    /// A frame that comes after the messages before it.
    Frame(Encoded),
}

/// What became of a queue that was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) struct Ended {
    /// What its messages were charged.
    pub(in super::super) charge: usize,
    /// Whether a fragment of its first message went out.
    pub(super) was_begun: bool,
}

/// All that waits of requests and replies for one connection.
#[derive(Debug, Default)]
pub(super) struct Talks {
    queues: FxHashMap<TalkKey, VecDeque<Item>>,
}

impl Talks {
    /// Adds a message; answers whether its queue was empty, so that it is to get a turn.
    pub(in super::super) fn push(&mut self, talk: Talk) -> bool {
        let queue = self.queues.entry(talk.key()).or_default();
        queue.push_back(Item::Message(talk));
        queue.len() == 1
    }

    /// Adds the frame that ends a queue; gives it back if there is no queue for it to wait in.
    pub(in super::super) fn close(&mut self, key: TalkKey, frame: Encoded) -> Result<(), Encoded> {
        match self.queues.get_mut(&key) {
            Some(queue) => {
                queue.push_back(Item::Frame(frame));
                Ok(())
            }
            None => Err(frame),
        }
    }

    /// The next frame of a queue, and the charge of the message that it ends.
    pub(super) fn next_frame(
        &mut self,
        key: TalkKey,
        payload_max: usize,
    ) -> Option<(Encoded, Option<Charge>)> {
        let queue = self.queues.get_mut(&key)?;
        let (frame, done) = match queue.front_mut()? {
            Item::Message(talk) => talk.next_frame(payload_max),
            Item::Frame(frame) => (frame.clone(), true),
        };
        let charge = match if done { queue.pop_front() } else { None } {
            Some(Item::Message(talk)) => Some(talk.charge),
            Some(Item::Frame(_)) | None => None,
        };
        if queue.is_empty() {
            self.queues.remove(&key);
        }
        Some((frame, charge))
    }

    /// Whether a queue has something to send.
    pub(super) fn is_ready(&self, key: TalkKey) -> bool {
        self.queues.contains_key(&key)
    }

    /// How many messages wait in a queue.
    pub(in super::super) fn waiting(&self, key: TalkKey) -> usize {
        self.queues.get(&key).map_or(0, VecDeque::len)
    }

    pub(in super::super) fn is_empty(&self) -> bool {
        self.queues.is_empty()
    }

    /// Drops a queue; `None` if all of it has gone out.
    pub(in super::super) fn end(&mut self, key: TalkKey) -> Option<Ended> {
        let queue = self.queues.remove(&key)?;
        let mut ended = Ended { charge: 0, was_begun: false };
        for item in &queue {
            if let Item::Message(talk) = item {
                ended.charge += talk.charge();
                ended.was_begun |= talk.is_begun();
            }
        }
        Some(ended)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::frame::Header;

    const REQUEST: TalkKey = TalkKey::Request(5);

    fn request(pieces: &[usize]) -> Talk {
        let channel = ChannelRef { id: 2000, epoch: 1 };
        let pieces = pieces.iter().map(|length| Bytes::from(vec![7; *length])).collect();
        Talk::new(Kind::Request { channel, request: 5, asker: 9 }, pieces, &Budget::default())
    }

    fn payloads(talks: &mut Talks, payload_max: usize) -> Vec<(u8, usize)> {
        std::iter::from_fn(|| talks.next_frame(REQUEST, payload_max))
            .map(|(frame, _)| {
                let header = Header::parse(&frame.head).expect("a header");
                (header.flags, frame.payload.len())
            })
            .collect()
    }

    #[test]
    fn a_message_is_cut_for_its_receiver() {
        let mut talks = Talks::default();
        assert!(talks.push(request(&[500, 300])));
        assert_eq!(payloads(&mut talks, 256), [(1, 256), (0, 244), (0, 256), (2, 44)]);
        assert!(talks.is_empty());
        assert!(talks.push(request(&[0])));
        assert_eq!(payloads(&mut talks, 256), [(3, 0)], "an empty message is one empty fragment");
    }

    #[test]
    fn a_queue_that_is_given_up_says_what_went_out_and_what_was_charged() {
        for (frames, was_begun) in [(0, false), (1, true)] {
            let mut talks = Talks::default();
            let talk = request(&[500]);
            let charge = talk.charge();
            talks.push(talk);
            (0..frames).for_each(|_| drop(talks.next_frame(REQUEST, 256)));
            assert_eq!(talks.end(REQUEST), Some(Ended { charge, was_begun }));
            assert_eq!(talks.end(REQUEST), None);
        }
    }
}
