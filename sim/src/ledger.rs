//! What everybody in a box has seen, and what is wrong with it.
//!
//! A run is one thread, and so is its ledger: actors on any loop of the run write into the same one.

use crate::archive::{Archive, OnDisk, Place};
use crate::channels::is_latched;
use crate::files::Files;
use crate::identity::Identity;
use crate::latest::Latest;
use crate::rule::{Complaint, Rule};
use crate::stamp::{Origin, Stamp, channel_name};
use sk_core::flow::{ChannelRef, RefusalCode};
use sk_flat::Instant;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// How late a message of the undisturbed pair may be.
const BYSTANDER_LATENESS_MAX: Duration = Duration::from_millis(5);

/// What a receiver has of one subscription.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Received {
    pub(crate) count: u64,
    /// The subscription was given up and made again: two books share the count.
    pub(crate) muddled: bool,
}

/// A call: whose, on which of its connections, and its tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CallKey {
    pub(crate) node: u16,
    pub(crate) life: u16,
    pub(crate) link: u32,
    pub(crate) tag: u32,
}

/// What became of a call.
#[derive(Clone, Copy, Debug)]
struct CallState {
    check: u32,
    ended: bool,
    cancelled: bool,
}

/// The record of one run.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    pub(crate) complaint: Option<Complaint>,
    trace: u64,
    /// The next sequence of each origin.
    published: BTreeMap<Origin, u64>,
    /// The last sequence that each life of a node heard of each origin, by its own channel or by one that repeats it.
    heard: BTreeMap<((u16, u16), String, Origin), u64>,
    /// By hub, connection and channel.
    pub(crate) received: BTreeMap<(u16, u64, ChannelRef), Received>,
    /// Which hub each life of a node called.
    hubs: BTreeMap<(u16, u16), u16>,
    pub(crate) may_not_hear: BTreeSet<u16>,
    pub(crate) may_not_publish: BTreeSet<u16>,
    /// Names of channels that repeated another one at some time, each with that one's.
    pub(crate) repeats: BTreeSet<(String, String)>,
    /// Those of them that keep their last message.
    pub(crate) latched_replicas: BTreeSet<String>,
    /// Names of channels that were published by datagrams at some time.
    pub(crate) by_udp: BTreeSet<String>,
    /// Subscriptions of nodes by the channels' names: whether they must not miss any message, and never were otherwise.
    pub(crate) hears_all: BTreeMap<(u16, String), bool>,
    /// The undisturbed pair: who listens and who speaks; nobody once the hub itself was disturbed.
    pub(crate) pair: Option<(u16, u16)>,
    /// There are fewer identifiers than channels that are wanted.
    pub(crate) narrow: bool,
    /// Nodes that got none for a channel of theirs.
    pub(crate) without_identifier: BTreeSet<u16>,
    /// How many connections sent what may be called spurious.
    pub(crate) wild_sent: u64,
    calls: BTreeMap<CallKey, CallState>,
    /// The newest messages that were heard.
    pub(crate) latest: Latest,
    /// What is in the databases.
    pub(crate) archive: Archive,
    /// What is in blob channels.
    pub(crate) files: Files,
    pub(crate) messages_published: u64,
    pub(crate) messages_heard: u64,
    pub(crate) now: Instant,
}

thread_local! {
    static LEDGER: RefCell<Ledger> = RefCell::default();
}

/// Begins a new record.
pub(crate) fn begin() {
    LEDGER.set(Ledger::default());
}

/// Writes into the record, or reads it.
pub(crate) fn with<R>(work: impl FnOnce(&mut Ledger) -> R) -> R {
    LEDGER.with_borrow_mut(work)
}

impl Ledger {
    pub(crate) fn complain(&mut self, rule: Rule, text: String) {
        let at = self.now;
        self.complaint.get_or_insert(Complaint { rule, text, at });
    }

    /// Folds something that was seen into the trace.
    pub(crate) fn note(&mut self, parts: &[u64]) {
        for part in parts {
            self.trace = (self.trace ^ part).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
        }
    }

    pub(crate) fn trace(&self) -> u64 {
        self.trace
    }

    /// The stamp of the next message of an origin.
    pub(crate) fn next_stamp(&self, origin: Origin, reference: ChannelRef) -> Stamp {
        let sequence = self.published.get(&origin).copied().unwrap_or(0);
        Stamp { origin, reference, sequence, at_ns: self.now.as_nanos() }
    }

    /// The message with that stamp was accepted: for sending, or to be kept until there is a hub.
    pub(crate) fn was_published(&mut self, stamp: &Stamp, sent: bool) {
        self.published.insert(stamp.origin, stamp.sequence + 1);
        self.messages_published += 1;
        if sent && self.may_not_publish.contains(&stamp.origin.node) {
            let text = format!("n{} published without the right to", stamp.origin.node);
            self.complain(Rule::Rights, text);
        }
    }

    /// How many messages of a node's channel were published in that life.
    pub(crate) fn published_by(&self, origin: Origin) -> u64 {
        self.published.get(&origin).copied().unwrap_or(0)
    }

    /// The hub refused a node something.
    pub(crate) fn was_refused(&mut self, node: u16, why: &str) {
        self.note(&[6, node.into(), why.len() as u64, self.now.as_nanos()]);
        if self.narrow && RefusalCode::NoFreeChannel.to_string() == why {
            self.without_identifier.insert(node);
        }
    }

    /// A life of a node begins.
    pub(crate) fn begins(&mut self, who: Identity) {
        self.hubs.insert((who.node, who.life), who.hub);
    }

    /// A connection was let in. A hub that was started anew gives out the ids of its predecessor again.
    pub(crate) fn was_let_in(&mut self, who: Identity, connection: u64) {
        self.note(&[4, who.node.into(), connection, self.now.as_nanos()]);
        self.received
            .retain(|(hub, known, _), _| (*hub, *known) != (who.hub, connection));
        if !who.invited {
            let text = format!("n{} was let in by a hub whose token it does not have", who.node);
            self.complain(Rule::Rights, text);
        }
    }

    /// A subscription was given up: the next one of the same connection has a book of its own.
    pub(crate) fn gave_up(&mut self, who: Identity, connection: u64, reference: ChannelRef) {
        let book = (who.hub, connection, reference);
        self.received.entry(book).or_default().muddled = true;
    }

    /// A hub ends: the next one numbers its connections anew.
    pub(crate) fn hub_ends(&mut self, hub: u16) {
        self.received.retain(|(of, ..), _| *of != hub);
        self.latest.hub_ends(hub);
    }

    /// A hub begins and has opened its store.
    pub(crate) fn hub_found(&mut self, on_disk: &OnDisk, damage: Option<&str>) {
        for text in self.archive.hub_found(on_disk, damage) {
            self.complain(Rule::Kept, text);
        }
    }

    /// A variable was read from a running hub, or a watch told it.
    pub(crate) fn was_read(&mut self, place: &Place, text: &str) {
        if let Some(text) = Archive::wrong_value(place, text) {
            self.complain(Rule::Kept, text);
        }
    }

    /// A call was made.
    pub(crate) fn was_called(&mut self, key: CallKey, check: u32) {
        self.calls.insert(key, CallState { check, ended: false, cancelled: false });
    }

    /// Its asker gave it up: it may have ended before, and does not end afterwards more than that once.
    pub(crate) fn was_cancelled(&mut self, key: CallKey) {
        if let Some(call) = self.calls.get_mut(&key) {
            call.cancelled = true;
        }
    }

    /// It was answered, with a payload of that checksum, or refused. Refusals of other commands are none of its.
    pub(crate) fn was_ended(&mut self, key: CallKey, check: Option<u32>, code: u16) {
        self.note(&[11, key.node.into(), key.tag.into(), code.into()]);
        let Some(call) = self.calls.get_mut(&key) else {
            if check.is_some() {
                self.complain(Rule::Services, format!("an answer came for {key:?}, which nobody made"));
            }
            return;
        };
        let twice = std::mem::replace(&mut call.ended, true);
        let other = check.is_some_and(|check| check != call.check);
        if twice || other {
            let what = if twice { "a second end" } else { "the answer of another" };
            self.complain(Rule::Services, format!("{key:?} has got {what}"));
        }
    }

    /// The connection is gone, and with it its calls.
    pub(crate) fn forget_calls(&mut self, node: u16) {
        self.calls.retain(|key, _| key.node != node);
    }

    /// A call that has no end, though every deadline is over.
    pub(crate) fn endless_call(&self) -> Option<CallKey> {
        let endless = |call: &CallState| !call.ended && !call.cancelled;
        self.calls.iter().find(|(_, call)| endless(call)).map(|(key, _)| *key)
    }

    /// A message arrived.
    pub(crate) fn was_heard(
        &mut self,
        who: Identity,
        connection: u64,
        (name, reference): (&str, ChannelRef),
        payload: &[u8],
    ) {
        let Identity { node, life, hub, .. } = who;
        self.messages_heard += 1;
        self.received.entry((hub, connection, reference)).or_default().count += 1;
        self.note(&[3, node.into(), reference.id as u64, payload.len() as u64, self.now.as_nanos()]);
        if self.may_not_hear.contains(&node) {
            self.complain(Rule::Rights, format!("n{node} heard {name} without the right to"));
        }
        let stamp = match self.stamp_of(who, (name, reference), payload) {
            Ok(stamp) => stamp,
            Err(text) => return self.complain(Rule::Delivery, text),
        };
        let origin = stamp.origin;
        let before = self.heard.insert(((node, life), name.to_owned(), origin), stamp.sequence);
        // What is kept for those who come later is told to whoever begins to listen, or when its owner comes back.
        let again = is_latched(origin.node, origin.channel);
        if let Some(last) = before
            && (stamp.sequence < last || stamp.sequence == last && !again)
            && !self.kept_on_the_way(name, origin)
        {
            let text = format!("n{node} heard message {} of {name} after message {last}", stamp.sequence);
            self.complain(Rule::Order, text);
        }
        if channel_name(origin.node, origin.channel) == name {
            self.latest.was_heard(hub, reference, &stamp);
        }
        if self.pair == Some((node, origin.node)) {
            self.check_pair(&stamp, before);
        }
    }

    /// The stamp of something that came from a hub as a message of that channel.
    ///
    /// # Errors
    /// What is wrong with it.
    fn stamp_of(
        &self,
        Identity { node, hub, .. }: Identity,
        (name, reference): (&str, ChannelRef),
        payload: &[u8],
    ) -> Result<Stamp, String> {
        let stamp = Stamp::of(payload);
        let stamp = stamp.ok_or_else(|| {
            format!("n{node} heard {} bytes on {name} that nobody published so", payload.len())
        })?;
        let origin = stamp.origin;
        if self.hubs.get(&(origin.node, origin.life)) != Some(&hub) {
            return Err(format!("n{node} heard from hub {hub} what n{} told another one", origin.node));
        }
        let published_as = channel_name(origin.node, origin.channel);
        let direct = published_as == name;
        // The last message for those who come later may be older than the channel that it comes from now.
        let other = stamp.reference != reference && !is_latched(origin.node, origin.channel);
        if direct && other || !direct && !self.may_repeat(name, &published_as) {
            return Err(format!("n{node} heard on {name} {reference} what was published as {stamp:?}"));
        }
        if stamp.sequence >= self.published_by(origin) {
            let text = format!("n{node} heard message {} of {name}, which was not published", stamp.sequence);
            return Err(text);
        }
        Ok(stamp)
    }

    /// Somebody asked for the newest message of a channel, and this came: nothing older than `floor`.
    pub(crate) fn was_polled(
        &mut self,
        who: Identity,
        channel: (&str, ChannelRef),
        payload: &[u8],
        floor: Option<(Origin, u64)>,
    ) -> Option<(Origin, u64)> {
        self.messages_heard += 1;
        self.note(&[15, who.node.into(), payload.len() as u64, self.now.as_nanos()]);
        let stamp = match self.stamp_of(who, channel, payload) {
            Ok(stamp) => stamp,
            Err(text) => {
                self.complain(Rule::Latest, text);
                return None;
            }
        };
        if let Some((origin, sequence)) = floor
            && origin == stamp.origin
            && stamp.sequence < sequence
        {
            let (node, name) = (who.node, channel.0);
            let text = format!(
                "n{node} was told message {} of {name}, after message {sequence} was out",
                stamp.sequence
            );
            self.complain(Rule::Latest, text);
        }
        Some((stamp.origin, stamp.sequence))
    }

    /// Whether a channel repeated that other one at some time, or one that repeated it.
    /// Whether a message may have been kept by a channel between its own and the one on which it was heard: when that
    /// one is repeated from then on, what it has kept is told, whatever came by other ways meanwhile.
    fn kept_on_the_way(&self, name: &str, origin: Origin) -> bool {
        let published_as = channel_name(origin.node, origin.channel);
        self.latched_replicas.iter().any(|kept| {
            *kept != published_as && self.may_repeat(name, kept) && self.may_repeat(kept, &published_as)
        })
    }

    fn may_repeat(&self, name: &str, source: &str) -> bool {
        let (mut reached, mut at) = (vec![name.to_owned()], 0);
        while let Some(replica) = reached.get(at).cloned() {
            at += 1;
            for (_, next) in self.repeats.iter().filter(|(known, _)| *known == replica) {
                if !reached.contains(next) {
                    reached.push(next.clone());
                }
            }
        }
        reached.iter().any(|name| name == source)
    }

    fn check_pair(&mut self, stamp: &Stamp, before: Option<u64>) {
        if before.is_some_and(|last| stamp.sequence != last + 1) {
            let text = format!("message {} came after {before:?}", stamp.sequence);
            self.complain(Rule::Bystander, text);
        }
        let late = Duration::from_nanos(self.now.as_nanos() - stamp.at_ns);
        if late > BYSTANDER_LATENESS_MAX {
            let text = format!("message {} was {late:?} under way", stamp.sequence);
            self.complain(Rule::Bystander, text);
        }
    }

    /// The life of a node that began last.
    pub(crate) fn life_of(&self, node: u16) -> u16 {
        let lives = self.hubs.range((node, 0)..=(node, u16::MAX));
        lives.last().map_or(0, |((_, life), _)| *life)
    }

    /// The last message of an origin that a node's life heard.
    pub(crate) fn last_heard(&self, listener: (u16, u16), origin: Origin) -> Option<u64> {
        let name = channel_name(origin.node, origin.channel);
        self.heard.get(&(listener, name, origin)).copied()
    }
}
