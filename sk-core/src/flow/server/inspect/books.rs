//! What the hub can show of its books, and how few identifiers it may have.

use super::super::{ConnectionId, ServerCore};
use crate::flow::ChannelRef;
use crate::flow::delivery::Counts;
use std::ops::Range;

impl ServerCore {
    /// Every connection that is open.
    pub fn connection_ids(&self) -> impl Iterator<Item = ConnectionId> + '_ {
        self.connections.iter().map(|(id, _)| id)
    }

    /// Every live subscription: its connection, its channel and its counts.
    pub fn subscriptions(&self) -> impl Iterator<Item = (ConnectionId, ChannelRef, &Counts)> {
        self.connections.iter().flat_map(|(id, connection)| {
            connection.output.books().map(move |(channel, counts)| (id, channel, counts))
        })
    }

    /// From now on flows get their channels' identifiers from this range, those below the range that were freed
    /// included. A simulation gives few, so that they are used again soon.
    pub fn narrow_channel_ids(&mut self, ids: Range<u16>) {
        self.channels.narrow(ids);
    }
}
