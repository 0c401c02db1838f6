//! One message to everybody who hears a channel: encoded once, shared by all.

use super::super::{ConnectionId, ServerCore};
use super::audience::Subscriber;
use crate::flow::ChannelRef;
use crate::flow::delivery::{DropReason, Outgoing};
use crate::flow::error::ClosingReason;
use crate::flow::fragment::Pieces;
use crate::flow::limits::SHED_SHARE;
use smallvec::SmallVec;

impl ServerCore {
    pub(in super::super) fn fan_out(&mut self, channel: ChannelRef, message: u32, pieces: Pieces) {
        let Some((_, subscribers)) = self.channels.get_mut(channel) else { return };
        subscribers.published += 1;
        subscribers.last = Some(self.now);
        let special = subscribers.special.is_some();
        if subscribers.list.is_empty() && !special {
            return;
        }
        let outgoing = Outgoing::new(channel, message, pieces, &self.budget);
        if special || self.budget.is_over() {
            self.fan_out_with_care(channel, &outgoing);
        } else {
            self.deliver(channel, &outgoing);
        }
    }

    /// What most messages do not need: room in a hub that is full, a latch, polls and replicas.
    fn fan_out_with_care(&mut self, channel: ChannelRef, outgoing: &Outgoing) {
        if self.budget.is_over() {
            self.make_room();
        }
        if self.budget.is_over() {
            self.drop_for_all(channel, DropReason::Full);
        } else {
            self.keep_newest(channel, outgoing);
            self.deliver(channel, outgoing);
            self.repeat(channel, outgoing);
        }
        self.renew_credit(channel);
    }

    pub(super) fn deliver(&mut self, channel: ChannelRef, outgoing: &Outgoing) {
        let Some((_, subscribers)) = self.channels.get(channel) else { return };
        for subscriber in &subscribers.list {
            let Some(connection) = self.connections.get_mut(subscriber.connection) else { continue };
            if !connection.output.offer(subscriber.slot, outgoing) {
                self.to_close.push_back((subscriber.connection, ClosingReason::QueueFull));
            }
            if !connection.dirty {
                connection.dirty = true;
                self.dirty.push(subscriber.connection);
            }
            if connection.output.has_losses && !connection.lossy {
                connection.lossy = true;
                self.lossy.push(subscriber.connection);
            }
        }
    }

    /// A message for one subscriber alone.
    pub(super) fn deliver_to(&mut self, subscriber: &Subscriber, outgoing: &Outgoing) {
        let Some(connection) = self.connections.get_mut(subscriber.connection) else { return };
        if !connection.output.offer(subscriber.slot, outgoing) {
            self.to_close.push_back((subscriber.connection, ClosingReason::QueueFull));
        }
        self.mark_dirty(subscriber.connection);
        self.mark_lossy(subscriber.connection);
    }

    /// Lists a connection to be told what it lost.
    fn mark_lossy(&mut self, id: ConnectionId) {
        if let Some(connection) = self.connections.get_mut(id)
            && connection.output.has_losses
            && !connection.lossy
        {
            connection.lossy = true;
            self.lossy.push(id);
        }
    }

    /// A message that nobody gets, here or on a replica: every book is told why.
    pub(in super::super) fn drop_for_all(&mut self, channel: ChannelRef, reason: DropReason) {
        let Some((_, subscribers)) = self.channels.get(channel) else { return };
        for subscriber in &subscribers.list {
            let Some(connection) = self.connections.get_mut(subscriber.connection) else { continue };
            if !connection.output.missed(subscriber.slot, reason) {
                self.to_close.push_back((subscriber.connection, ClosingReason::QueueFull));
            }
            if !connection.lossy {
                connection.lossy = true;
                self.lossy.push(subscriber.connection);
            }
        }
        for replica in self.heard_replicas(channel) {
            self.drop_for_all(replica, reason);
        }
    }

    pub(super) fn heard_replicas(&self, channel: ChannelRef) -> SmallVec<[ChannelRef; 4]> {
        let Some((_, subscribers)) = self.channels.get(channel) else { return SmallVec::new() };
        let heard = subscribers.replicas().iter().filter(|replica| replica.heard);
        heard.map(|replica| replica.channel).collect()
    }

    /// Too much waits in all. Those for whom the most waits lose first, so that who reads is not punished for
    /// those who do not: of their messages the oldest, and if those must not be missed, the connection.
    pub(in super::super) fn make_room(&mut self) {
        let waiting = self.connections.iter().map(|(id, connection)| (connection.output.bytes(), id));
        let mut heavy: Vec<(usize, ConnectionId)> = waiting.filter(|(bytes, _)| *bytes > 0).collect();
        heavy.sort_unstable_by_key(|(bytes, id)| (std::cmp::Reverse(*bytes), *id));
        let target = self.budget.max() - self.budget.max() / SHED_SHARE;
        let mut must_not_miss = Vec::new();
        for (_, id) in heavy {
            if self.budget.used() <= target {
                return;
            }
            if let Some(connection) = self.connections.get_mut(id)
                && connection.output.shed(&self.budget, target)
            {
                must_not_miss.push(id);
            }
            self.mark_lossy(id);
        }
        for id in must_not_miss {
            if self.budget.used() <= target {
                return;
            }
            self.close(id, ClosingReason::QueueFull);
        }
    }
}
