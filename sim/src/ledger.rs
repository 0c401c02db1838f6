//! What everybody in a box has seen, and what is wrong with it.
//!
//! A run is one thread, and so is its ledger: actors on any loop of the run write into the same one.

use crate::archive::Archive;
use crate::stamp::{Origin, Stamp, channel_name};
use sk_core::flow::{ChannelRef, RefusalCode};
use sk_flat::Instant;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::time::Duration;

/// How late a message of the undisturbed pair may be.
const BYSTANDER_LATENESS_MAX: Duration = Duration::from_millis(5);

/// What must hold, whatever happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// Offered = delivered + dropped + queued, and what was delivered was received.
    Books,
    /// What arrives was published on that very channel, whole.
    Delivery,
    /// It arrives in the order of publishing, and once.
    Order,
    /// The undisturbed pair loses nothing and waits for nobody.
    Bystander,
    /// Whoever has gone leaves nothing behind.
    Reaped,
    /// Whoever is honest finds his channels and subscriptions again.
    Restored,
    /// Nobody does what he has no right to.
    Rights,
    /// An honest client is never killed as spurious, and an honest hub is understood.
    Honest,
    /// Of what the hub said to be kept nothing is lost, and nothing is found that was not written so.
    Kept,
    /// Who watches a database knows what is in it.
    Watched,
    /// What is reliable is not dropped, and who must not miss any misses none.
    Policies,
    /// Every call has exactly one end, and the answer of its own request.
    Services,
    /// Nothing panics.
    Panic,
    /// No loop goes round and round while time stands still.
    Livelock,
    /// A hub that is asked to end ends.
    Ended,
}

/// A rule that was broken: the first of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Complaint {
    /// Which.
    pub rule: Rule,
    /// How.
    pub text: String,
    /// When, in virtual time.
    pub at: Instant,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} at {:.3} ms: {}", self.rule, self.at.as_nanos() as f64 / 1e6, self.text)
    }
}

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
    /// By connection and channel.
    pub(crate) received: BTreeMap<(u64, ChannelRef), Received>,
    pub(crate) may_not_hear: BTreeSet<u16>,
    pub(crate) may_not_publish: BTreeSet<u16>,
    /// Names of channels that repeated another one at some time, each with that one's.
    pub(crate) repeats: BTreeSet<(String, String)>,
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
    /// What is in the databases.
    pub(crate) archive: Archive,
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

    /// The message with that stamp was accepted for sending.
    pub(crate) fn was_published(&mut self, stamp: &Stamp) {
        self.published.insert(stamp.origin, stamp.sequence + 1);
        self.messages_published += 1;
        if self.may_not_publish.contains(&stamp.origin.node) {
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

    /// A connection was let in. A hub that was started anew gives out the ids of its predecessor again.
    pub(crate) fn was_let_in(&mut self, connection: u64) {
        self.received.retain(|(known, _), _| *known != connection);
    }

    /// A subscription was given up: the next one of the same connection has a book of its own.
    pub(crate) fn gave_up(&mut self, connection: u64, reference: ChannelRef) {
        self.received.entry((connection, reference)).or_default().muddled = true;
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
        (node, life): (u16, u16),
        connection: u64,
        (name, reference): (&str, ChannelRef),
        payload: &[u8],
    ) {
        self.messages_heard += 1;
        self.received.entry((connection, reference)).or_default().count += 1;
        self.note(&[3, node.into(), reference.id as u64, payload.len() as u64, self.now.as_nanos()]);
        if self.may_not_hear.contains(&node) {
            self.complain(Rule::Rights, format!("n{node} heard {name} without the right to"));
        }
        let Some(stamp) = Stamp::of(payload) else {
            let text = format!("n{node} heard {} bytes on {name} that nobody published so", payload.len());
            return self.complain(Rule::Delivery, text);
        };
        let origin = stamp.origin;
        let published_as = channel_name(origin.node, origin.channel);
        let direct = published_as == name;
        if direct && stamp.reference != reference || !direct && !self.may_repeat(name, &published_as) {
            let text = format!("n{node} heard on {name} {reference} what was published as {stamp:?}");
            return self.complain(Rule::Delivery, text);
        }
        if stamp.sequence >= self.published_by(origin) {
            let text = format!("n{node} heard message {} of {name}, which was not published", stamp.sequence);
            return self.complain(Rule::Delivery, text);
        }
        let before = self.heard.insert(((node, life), name.to_owned(), origin), stamp.sequence);
        if let Some(last) = before
            && stamp.sequence <= last
        {
            let text = format!("n{node} heard message {} of {name} after message {last}", stamp.sequence);
            self.complain(Rule::Order, text);
        }
        if self.pair == Some((node, origin.node)) {
            self.check_pair(&stamp, before);
        }
    }

    /// Whether a channel repeated that other one at some time, or one that repeated it.
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

    /// The last message of an origin that a node's life heard.
    pub(crate) fn last_heard(&self, listener: (u16, u16), origin: Origin) -> Option<u64> {
        let name = channel_name(origin.node, origin.channel);
        self.heard.get(&(listener, name, origin)).copied()
    }
}
