//! What is kept after it was sent: the last message for late joiners, the newest for those who poll.

use super::super::{ConnectionId, ServerCore, owning_flow};
use crate::flow::ChannelRef;
use crate::flow::delivery::Outgoing;
use crate::flow::limits::KEPT_BYTES_MAX;
use crate::testing::{Bug, is_planted};

impl ServerCore {
    /// What a late joiner of a channel hears first. Of a replicating channel it is what its source keeps.
    pub(super) fn latch_of(&self, channel: ChannelRef) -> Option<Outgoing> {
        let (_, subscribers) = self.channels.get(channel)?;
        let from_source = subscribers.source().and_then(|source| self.latch_of(source));
        match from_source {
            Some(message) => Some(message.repeated_on(channel)),
            None => subscribers.latched().cloned(),
        }
    }

    /// Keeps a message in place of the one before it.
    pub(super) fn keep_newest(&mut self, channel: ChannelRef, outgoing: &Outgoing) {
        let Some((known, subscribers)) = self.channels.get_mut(channel) else { return };
        let Some(special) = &mut subscribers.special else { return };
        if !special.latch && special.pollers.is_empty() {
            return;
        }
        let owner = known.owner;
        let latch = special.latch;
        if latch && is_planted(Bug::LatchStale) && special.latched.is_some() && outgoing.message() % 4 == 3 {
            return;
        }
        let old = special.latched.take();
        let mut pollers = std::mem::take(&mut special.pollers);
        let payer = owning_flow(&self.connections, owner);
        let latched = self.keep(payer, old, latch.then_some(outgoing));
        let is_stale = |newest: &Option<Outgoing>| {
            is_planted(Bug::PollStale) && newest.is_some() && outgoing.message() % 4 == 3
        };
        for poller in pollers.iter_mut().filter(|poller| !is_stale(&poller.newest)) {
            poller.newest = self.keep(Some(poller.connection), poller.newest.take(), Some(outgoing));
        }
        if let Some((_, subscribers)) = self.channels.get_mut(channel) {
            let special = subscribers.special_mut();
            special.latched = latched;
            special.pollers = pollers;
        }
    }

    /// Forgets what is kept for late joiners.
    pub(super) fn keep_no_longer(&mut self, channel: ChannelRef) {
        let Some((known, subscribers)) = self.channels.get_mut(channel) else { return };
        let Some(special) = &mut subscribers.special else { return };
        let (old, owner) = (special.latched.take(), known.owner);
        let payer = owning_flow(&self.connections, owner);
        self.keep(payer, old, None);
    }

    /// Keeps `new` in place of `old` for a connection that is charged for it, or for the hub. What finds no
    /// room is not kept: an older one would be false.
    pub(in super::super) fn keep(
        &mut self,
        payer: Option<ConnectionId>,
        old: Option<Outgoing>,
        new: Option<&Outgoing>,
    ) -> Option<Outgoing> {
        let freed = old.map_or(0, |old| old.charge());
        self.kept -= freed;
        let mut connection = payer.and_then(|id| self.connections.get_mut(id));
        if let Some(connection) = &mut connection {
            connection.output.kept -= freed;
        }
        let charge = new?.charge();
        let fits = connection.as_ref().is_none_or(|found| charge <= found.output.room());
        if !fits || self.kept + charge > KEPT_BYTES_MAX {
            return None;
        }
        self.kept += charge;
        if let Some(connection) = connection {
            connection.output.kept += charge;
        }
        new.cloned()
    }
}
