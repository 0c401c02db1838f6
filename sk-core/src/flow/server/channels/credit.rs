//! Credit: the owner of a reliable channel is told how much it may publish, so that its slowest subscriber
//! keeps up.

use super::super::{ConnectionId, ServerCore};
use super::audience::Credit;
use crate::flow::limits::CREDIT_BYTES;
use crate::flow::{ChannelRef, Event};

impl ServerCore {
    /// Looks whether the owner may publish more, now that a subscriber took something or has gone.
    pub(in super::super) fn renew_credit(&mut self, channel: ChannelRef) {
        if self.credit(channel).is_none_or(|credit| credit.is_ample()) {
            return;
        }
        let Some((_, subscribers)) = self.channels.get(channel) else { return };
        let queued = subscribers.list.iter().filter_map(|subscriber| {
            Some(self.connections.get(subscriber.connection)?.output.queued(subscriber.slot))
        });
        let behind = queued.max().unwrap_or(0) as u64;
        let Some(credit) = self.credit(channel) else { return };
        let granted = (credit.used + CREDIT_BYTES).saturating_sub(behind + credit.unfinished);
        // Little by little would cost more frames than it is worth.
        if granted >= credit.granted + CREDIT_BYTES / 4 {
            credit.granted = granted;
            self.tell_credit(channel);
        }
    }

    /// Tells the owner of a reliable channel what it may publish.
    pub(in super::super) fn tell_credit(&mut self, channel: ChannelRef) {
        let Some((known, subscribers)) = self.channels.get(channel) else { return };
        let credit = subscribers.special.as_ref().and_then(|special| special.credit);
        let owner = known.owner;
        if let Some(credit) = credit {
            self.tell_owning_flow(owner, &Event::Credit { channel, bytes: credit.granted });
        }
    }

    /// A connection took something: the owners of reliable channels may go on.
    pub(in super::super) fn give_credit(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        if connection.output.credit_due.is_empty() {
            return;
        }
        for channel in std::mem::take(&mut connection.output.credit_due) {
            self.renew_credit(channel);
        }
    }

    pub(in super::super) fn credit(&mut self, channel: ChannelRef) -> Option<&mut Credit> {
        self.channels.get_mut(channel)?.1.special.as_mut()?.credit.as_mut()
    }
}
