//! What one connection is to be sent: control frames, and messages of its subscriptions in turn.

use super::talk::{Talk, TalkKey, Talks};
use crate::flow::definition::Encoded;
use crate::flow::delivery::{Book, Budget, Charge, Counts, DropReason, Offered, Outgoing};
use crate::flow::limits::{
    CONNECTION_BYTES_MAX, CONTROL_BYTES_MAX, FRAGMENT_BYTES_MAX, ITEM_OVERHEAD_BYTES, MESSAGE_BYTES_MAX,
    WIRE_BYTES_AHEAD,
};
use crate::flow::wire::Wire;
use crate::flow::{ChannelRef, Policy};
use rustc_hash::FxHashMap;
use slab::Slab;
use std::collections::VecDeque;

/// What is to be noted when the transport has taken a frame.
#[derive(Debug)]
pub(in super::super) enum Note {
    Nothing,
    /// The frame ended a message of this subscription.
    EndsMessage {
        slot: usize,
        serial: u64,
    },
    /// The frame ended a message of a service's, which was charged this.
    EndsTalk {
        charge: Charge,
    },
}

/// Who sends the next fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    Subscription(usize),
    Talk(TalkKey),
}

/// How a subscription deals with messages that it cannot take at once.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Keep {
    pub(in super::super) policy: Policy,
    pub(in super::super) depth: usize,
    pub(in super::super) reliable: bool,
}

#[derive(Debug)]
pub(in super::super) struct Subscription {
    channel: ChannelRef,
    /// Tells two bearers of one slot apart.
    serial: u64,
    book: Book,
    in_turn: bool,
    /// Its channel's owner waits for it: what it takes is to be noted.
    reliable: bool,
    /// The drop counts that the subscriber was told.
    told: [u64; DropReason::ALL.len()],
}

/// The sending half of a connection.
#[derive(Debug)]
pub(in super::super) struct Output {
    wire: Wire<Note>,
    control: VecDeque<Encoded>,
    control_bytes: usize,
    subscriptions: Slab<Subscription>,
    slots: FxHashMap<ChannelRef, usize>,
    serial: u64,
    /// Requests and replies for this connection.
    talks: Talks,
    /// Subscriptions, requests and replies with something to send, in turn: one fragment each.
    turns: VecDeque<Turn>,
    /// What all subscriptions, requests and replies together are charged.
    bytes: usize,
    /// What is kept for it, or of it for late joiners, is charged too.
    pub(in super::super) kept: usize,
    /// Reliable channels of which it took something.
    pub(in super::super) credit_due: Vec<ChannelRef>,
    pub(in super::super) fragment_bytes_max: usize,
    /// The longest message that the peer takes.
    pub(in super::super) message_bytes_max: usize,
    /// Messages wait until the connection is a flow for its peer too.
    pub(in super::super) paused: bool,
    /// Whether messages were dropped that the subscriber was not told of.
    pub(in super::super) has_losses: bool,
}

impl Default for Output {
    fn default() -> Self {
        Output {
            wire: Wire::default(),
            control: VecDeque::new(),
            control_bytes: 0,
            subscriptions: Slab::new(),
            slots: FxHashMap::default(),
            serial: 0,
            talks: Talks::default(),
            turns: VecDeque::new(),
            bytes: 0,
            kept: 0,
            credit_due: Vec::new(),
            fragment_bytes_max: FRAGMENT_BYTES_MAX,
            message_bytes_max: MESSAGE_BYTES_MAX,
            paused: false,
            has_losses: false,
        }
    }
}

impl Output {
    /// Queues a control frame. Answers `false` if the queue is over its limit: the peer reads too slowly.
    pub(in super::super) fn control(&mut self, frame: Encoded) -> bool {
        self.control_bytes += frame.len();
        self.control.push_back(frame);
        self.control_bytes <= CONTROL_BYTES_MAX
    }

    /// Whether more answers should wait until some were read.
    pub(super) fn answers_pile_up(&self) -> bool {
        self.control_bytes > CONTROL_BYTES_MAX / 2
    }

    /// Whether a list being told may add a line now.
    pub(in super::super) fn has_room_for_list(&self) -> bool {
        self.control_bytes < WIRE_BYTES_AHEAD
    }

    /// Adds a subscription, or changes how it deals with what it cannot keep up with. Answers its slot, and
    /// whether it is new.
    pub(in super::super) fn subscribe(&mut self, channel: ChannelRef, wish: Keep) -> (usize, bool) {
        let Keep { policy, depth, reliable } = wish;
        if let Some(slot) = self.slots.get(&channel) {
            self.subscriptions[*slot].book.set_policy(policy, depth);
            return (*slot, false);
        }
        self.serial += 1;
        let subscription = Subscription {
            channel,
            serial: self.serial,
            book: Book::new(policy, depth),
            in_turn: false,
            reliable,
            told: [0; DropReason::ALL.len()],
        };
        let slot = self.subscriptions.insert(subscription);
        self.slots.insert(channel, slot);
        (slot, true)
    }

    /// Gives all subscriptions to another connection. What no transport took whole is to be sent anew.
    pub(in super::super) fn give_away(&mut self) -> Vec<Subscription> {
        self.slots.clear();
        self.turns.retain(|turn| !matches!(turn, Turn::Subscription(_)));
        let given: Vec<Subscription> = self.subscriptions.drain().collect();
        self.bytes -= given.iter().map(|subscription| subscription.book.bytes()).sum::<usize>();
        given
    }

    /// Takes a subscription of another connection over; answers its channel and its slot.
    pub(in super::super) fn take_over(&mut self, mut given: Subscription) -> (ChannelRef, usize) {
        given.book.restart();
        self.serial += 1;
        given.serial = self.serial;
        given.in_turn = given.book.is_ready();
        self.bytes += given.book.bytes();
        let (channel, ready) = (given.channel, given.in_turn);
        let slot = self.subscriptions.insert(given);
        self.slots.insert(channel, slot);
        if ready {
            self.turns.push_back(Turn::Subscription(slot));
        }
        (channel, slot)
    }

    pub(in super::super) fn is_subscribed(&self, channel: ChannelRef) -> bool {
        self.slots.contains_key(&channel)
    }

    /// Every subscription with its counts.
    pub(in super::super) fn books(&self) -> impl Iterator<Item = (ChannelRef, &Counts)> {
        self.subscriptions
            .iter()
            .map(|(_, subscription)| (subscription.channel, subscription.book.counts()))
    }

    pub(in super::super) fn subscriptions(&self) -> usize {
        self.subscriptions.len()
    }

    /// The subscribed channels, in the order of their slots.
    pub(in super::super) fn channels(&self) -> Vec<ChannelRef> {
        self.subscriptions
            .iter()
            .map(|(_, subscription)| subscription.channel)
            .collect()
    }

    /// Ends a subscription: frames of it that were not begun do not go any more.
    pub(in super::super) fn unsubscribe(
        &mut self,
        channel: ChannelRef,
        reason: DropReason,
    ) -> Option<Counts> {
        let slot = self.slots.remove(&channel)?;
        let subscription = self.subscriptions.try_remove(slot)?;
        if subscription.in_turn {
            self.turns.retain(|turn| *turn != Turn::Subscription(slot));
        }
        self.bytes -= subscription.book.bytes();
        Some(subscription.book.close(reason))
    }

    /// The counts of a subscription.
    pub(in super::super) fn counts(&self, channel: ChannelRef) -> Option<&Counts> {
        Some(self.subscriptions[*self.slots.get(&channel)?].book.counts())
    }

    /// Adds the counts of all subscriptions.
    pub(in super::super) fn add_counts(&self, sum: &mut Counts) {
        self.subscriptions
            .iter()
            .for_each(|(_, subscription)| sum.add(subscription.book.counts()));
    }

    /// What may wait or be kept beyond all that does.
    pub(in super::super) fn room(&self) -> usize {
        CONNECTION_BYTES_MAX.saturating_sub(self.bytes + self.kept)
    }

    /// What waits.
    pub(in super::super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Offers a message to a subscription. Answers `false` if it must not miss any and found no room. One that is
    /// longer than the peer takes never finds any.
    pub(in super::super) fn offer(&mut self, slot: usize, message: &Outgoing) -> bool {
        if message.length() > self.message_bytes_max {
            return self.missed(slot, DropReason::Full);
        }
        let room = self.room();
        let Some(subscription) = self.subscriptions.get_mut(slot) else { return true };
        let book = &mut subscription.book;
        let (held, dropped) = (book.bytes(), book.counts().dropped_in_all());
        let offered = book.offer(message, room);
        self.bytes = self.bytes - held + book.bytes();
        self.has_losses |= book.counts().dropped_in_all() != dropped;
        if book.is_ready() && !subscription.in_turn {
            subscription.in_turn = true;
            if message.is_tick() {
                self.turns.push_front(Turn::Subscription(slot));
            } else {
                self.turns.push_back(Turn::Subscription(slot));
            }
        }
        offered != Offered::Broken
    }

    /// Queues a request or a reply; `false` if the connection, or the hub for all, has as many bytes waiting as it may.
    pub(in super::super) fn talk(&mut self, talk: Talk) -> bool {
        if talk.charge() > self.room() || talk.is_too_much() {
            return false;
        }
        self.bytes += talk.charge();
        let key = talk.key();
        if self.talks.push(talk) {
            self.turns.push_back(Turn::Talk(key));
        }
        true
    }

    /// Queues a control frame that must not overtake the replies before it.
    pub(in super::super) fn control_after(&mut self, key: TalkKey, frame: Encoded) -> bool {
        match self.talks.close(key, frame) {
            Ok(()) => true,
            Err(frame) => self.control(frame),
        }
    }

    /// Gives up what waits of a request or of the replies to a call. Answers whether the peer heard of it.
    pub(in super::super) fn end_talk(&mut self, key: TalkKey) -> bool {
        let Some(ended) = self.talks.end(key) else { return true };
        self.turns.retain(|turn| *turn != Turn::Talk(key));
        self.bytes -= ended.charge;
        ended.was_begun
    }

    /// Whether a message of this length would find room now.
    pub(in super::super) fn has_room_for(&self, bytes: usize) -> bool {
        self.bytes + bytes + ITEM_OVERHEAD_BYTES <= CONNECTION_BYTES_MAX
    }

    /// How many messages of this kind and tag wait.
    pub(in super::super) fn talks_waiting(&self, key: TalkKey) -> usize {
        self.talks.waiting(key)
    }

    /// Whether requests or replies wait.
    pub(in super::super) fn has_talks(&self) -> bool {
        !self.talks.is_empty()
    }

    /// Tells a subscription's book of a message that was dropped before it came here. Answers `false` if it
    /// must not miss any.
    pub(in super::super) fn missed(&mut self, slot: usize, reason: DropReason) -> bool {
        let Some(subscription) = self.subscriptions.get_mut(slot) else { return true };
        self.has_losses = true;
        subscription.book.missed(reason) != Offered::Broken
    }

    /// Drops what waits, the oldest of each subscription first, until the budget is down to `target`. Answers
    /// whether something that must not be missed is left.
    pub(in super::super) fn shed(&mut self, budget: &Budget, target: usize) -> bool {
        let mut stays = false;
        for (slot, subscription) in &mut self.subscriptions {
            let book = &mut subscription.book;
            while budget.used() > target
                && let Some(freed) = book.shed()
            {
                self.bytes -= freed;
                self.has_losses = true;
            }
            if subscription.in_turn && !book.is_ready() {
                subscription.in_turn = false;
                self.turns.retain(|turn| *turn != Turn::Subscription(slot));
            }
            stays |= book.policy().0 == Policy::All && book.bytes() > 0;
        }
        stays
    }

    /// The book of a subscription.
    pub(in super::super) fn book(&self, slot: usize) -> Option<&Book> {
        self.subscriptions.get(slot).map(|subscription| &subscription.book)
    }

    /// What waits of a subscription.
    pub(in super::super) fn queued(&self, slot: usize) -> usize {
        self.subscriptions.get(slot).map_or(0, |subscription| subscription.book.bytes())
    }

    /// What was dropped since it was last asked: channel, reason and total, for each that changed.
    pub(super) fn take_losses(&mut self) -> Vec<(ChannelRef, DropReason, u64)> {
        self.has_losses = false;
        let mut losses = Vec::new();
        for (_, subscription) in &mut self.subscriptions {
            let dropped = subscription.book.counts().dropped;
            for (reason, ..) in DropReason::ALL {
                let total = dropped[reason as usize];
                if total != subscription.told[reason as usize] {
                    losses.push((subscription.channel, reason, total));
                }
            }
            subscription.told = dropped;
        }
        losses
    }

    /// Moves frames to the wire: control frames first, then one fragment of each subscription, request and
    /// reply in turn.
    pub(in super::super) fn fill(&mut self) {
        while self.wire.bytes() < WIRE_BYTES_AHEAD {
            if let Some(frame) = self.control.pop_front() {
                self.control_bytes -= frame.len();
                self.wire.push(frame, Note::Nothing);
                continue;
            }
            if self.paused {
                return;
            }
            let slot = match self.turns.pop_front() {
                None => return,
                Some(Turn::Talk(key)) => {
                    self.fill_from_talk(key);
                    continue;
                }
                Some(Turn::Subscription(slot)) => slot,
            };
            let Some(subscription) = self.subscriptions.get_mut(slot) else { continue };
            if let Some((frame, ends)) = subscription.book.next_frame(self.fragment_bytes_max) {
                let serial = subscription.serial;
                self.wire
                    .push(frame, if ends { Note::EndsMessage { slot, serial } } else { Note::Nothing });
            }
            subscription.in_turn = subscription.book.is_ready();
            if subscription.in_turn {
                self.turns.push_back(Turn::Subscription(slot));
            }
        }
    }

    fn fill_from_talk(&mut self, key: TalkKey) {
        let Some((frame, ended)) = self.talks.next_frame(key, self.fragment_bytes_max) else { return };
        self.wire
            .push(frame, ended.map_or(Note::Nothing, |charge| Note::EndsTalk { charge }));
        if self.talks.is_ready(key) {
            self.turns.push_back(Turn::Talk(key));
        }
    }

    /// What is on the wire's side, after [`fill`](Output::fill).
    pub(in super::super) fn wire(&self) -> &Wire<Note> {
        &self.wire
    }

    /// Whether anything is left to send.
    pub(in super::super) fn is_empty(&self) -> bool {
        self.wire.is_empty() && self.control.is_empty() && self.turns.is_empty()
    }

    /// Notes that the transport took `count` bytes.
    pub(in super::super) fn wrote(&mut self, count: usize) {
        let Output { wire, subscriptions, bytes, credit_due, .. } = self;
        wire.wrote(count, |note| ended(subscriptions, bytes, credit_due, note));
    }

    /// Takes a whole frame, for a transport inside the process.
    pub(in super::super) fn take(&mut self) -> Option<Encoded> {
        let (frame, note) = self.wire.take()?;
        ended(&mut self.subscriptions, &mut self.bytes, &mut self.credit_due, note);
        Some(frame)
    }

    /// Leaves nothing to send but the rest of a frame that is half written, and `last`.
    pub(in super::super) fn end_with(&mut self, last: Encoded) {
        self.control.clear();
        self.control_bytes = 0;
        self.talks = Talks::default();
        self.turns.clear();
        self.wire.drop_unbegun();
        self.wire.push(last, Note::Nothing);
    }
}

/// A message is delivered when the transport took its last byte, unless its subscription has ended.
fn ended(
    subscriptions: &mut Slab<Subscription>,
    bytes: &mut usize,
    credit_due: &mut Vec<ChannelRef>,
    note: Note,
) {
    if let Note::EndsTalk { charge } = &note {
        *bytes -= charge.bytes();
    }
    if let Note::EndsMessage { slot, serial } = note
        && let Some(subscription) = subscriptions.get_mut(slot)
        && subscription.serial == serial
    {
        *bytes -= subscription.book.delivered();
        if subscription.reliable && !credit_due.contains(&subscription.channel) {
            credit_due.push(subscription.channel);
        }
    }
}
