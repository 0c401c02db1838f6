//! What the hub keeps beside each channel: who hears it, and what is special about it.

use super::super::ConnectionId;
use crate::flow::delivery::{Outgoing, charge_of};
use crate::flow::limits::CREDIT_BYTES;
use crate::flow::{ChannelRef, Flags, Properties};
use crate::testing::{Bug, is_planted};
use sk_flat::Instant;

/// One subscriber of a channel: the connection and the place of its book there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) struct Subscriber {
    pub(in super::super) connection: ConnectionId,
    pub(in super::super) slot: usize,
}

/// What the hub keeps beside each channel. An ordinary channel has subscribers and nothing special.
#[derive(Debug, Default)]
pub(in super::super) struct Subscribers {
    pub(in super::super) list: Vec<Subscriber>,
    /// How many whole messages came, and when the last one did.
    pub(in super::super) published: u64,
    pub(in super::super) last: Option<Instant>,
    pub(in super::super) special: Option<Box<Special>>,
}

/// What most channels do not have.
#[derive(Debug, Default)]
pub(in super::super) struct Special {
    /// Whether the last whole message is kept for late joiners.
    pub(in super::super) latch: bool,
    pub(in super::super) latched: Option<Outgoing>,
    pub(in super::super) credit: Option<Credit>,
    pub(in super::super) pollers: Vec<Poller>,
    /// The channel that this one repeats.
    pub(in super::super) source: Option<ChannelRef>,
    /// The channels that repeat this one.
    pub(in super::super) replicas: Vec<Replica>,
}

/// A synchronous connection that may ask for the newest message.
#[derive(Debug)]
pub(in super::super) struct Poller {
    pub(in super::super) connection: ConnectionId,
    pub(in super::super) newest: Option<Outgoing>,
}

/// A channel that repeats another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) struct Replica {
    pub(in super::super) channel: ChannelRef,
    /// Whether somebody hears it.
    pub(in super::super) heard: bool,
}

/// What the owner of a reliable channel may publish: both sides count each fragment's payload and a little.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Credit {
    pub(in super::super) used: u64,
    pub(in super::super) granted: u64,
    /// What came of the message under way: nobody can have taken it yet.
    pub(in super::super) unfinished: u64,
    /// The message under way came when there was none left: all its fragments are dropped, and cost nothing.
    pub(in super::super) refusing: bool,
}

/// What becomes of a fragment on a reliable channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Admitted {
    Yes,
    /// It begins a message that is to be dropped.
    Not,
    /// It goes on with such a message.
    StillNot,
}

impl Credit {
    pub(in super::super) const NEW: Credit =
        Credit { used: 0, granted: CREDIT_BYTES, unfinished: 0, refusing: false };

    /// Whether a message may begin. The last one may go beyond the credit, so that one longer than all of it
    /// gets through.
    pub(in super::super) fn is_left(&self) -> bool {
        self.used < self.granted
    }

    /// Takes what a fragment costs. Whether its message may come is decided when it begins.
    pub(super) fn take(&mut self, flags: Flags, payload_bytes: usize) -> Admitted {
        let begins = flags.has(Flags::FIRST);
        let ends = flags.has(Flags::LAST) || flags == Flags::ABORT;
        if begins {
            let broken = is_planted(Bug::CreditBroken) && self.used % 7 == 3;
            self.refusing = broken || !self.is_left();
        }
        if self.refusing {
            self.refusing = !ends;
            return if begins { Admitted::Not } else { Admitted::StillNot };
        }
        let cost = charge_of(payload_bytes, 1) as u64;
        self.used += cost;
        self.unfinished = if ends { 0 } else { self.unfinished + cost };
        Admitted::Yes
    }

    /// Whether the owner has so much left that nothing need be told.
    pub(super) fn is_ample(&self) -> bool {
        self.granted.saturating_sub(self.used) > CREDIT_BYTES / 2
    }
}

impl Subscribers {
    /// Those of a new channel with these properties.
    pub(in super::super) fn of(properties: &Properties) -> Subscribers {
        let (latch, reliable) = (properties.is_latched(), properties.is_reliable());
        let mut new = Subscribers::default();
        if latch || reliable {
            let special = new.special_mut();
            special.latch = latch;
            special.credit = reliable.then_some(Credit::NEW);
        }
        new
    }

    /// Whether anybody hears the channel.
    pub(in super::super) fn is_heard(&self) -> bool {
        !self.list.is_empty()
            || self.special.as_ref().is_some_and(|special| {
                !special.pollers.is_empty() || special.replicas.iter().any(|replica| replica.heard)
            })
    }

    pub(in super::super) fn is_reliable(&self) -> bool {
        self.special.as_ref().is_some_and(|special| special.credit.is_some())
    }

    /// The channel that this one repeats.
    pub(in super::super) fn source(&self) -> Option<ChannelRef> {
        self.special.as_ref()?.source
    }

    /// What is kept for late joiners.
    pub(in super::super) fn latched(&self) -> Option<&Outgoing> {
        self.special.as_ref()?.latched.as_ref()
    }

    pub(in super::super) fn replicas(&self) -> &[Replica] {
        self.special.as_ref().map_or(&[], |special| &special.replicas)
    }

    pub(super) fn special_mut(&mut self) -> &mut Special {
        self.special.get_or_insert_default()
    }
}
