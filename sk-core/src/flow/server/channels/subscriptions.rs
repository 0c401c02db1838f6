//! Subscriptions: beginning, changing, ending, and what owners hear of them.

use super::super::connection::output::Keep;
use super::super::sync::is_divisor;
use super::super::{ConnectionId, Notice, ServerCore};
use super::audience::Subscriber;
use crate::flow::channel::Owner;
use crate::flow::delivery::DropReason;
use crate::flow::error::{ProtocolError, RefusalCode};
use crate::flow::limits::{SUBSCRIPTION_DEPTH_DEFAULT, SUBSCRIPTION_DEPTH_MAX, SUBSCRIPTIONS_PER_FLOW_MAX};
use crate::flow::{ChannelKind, ChannelRef, Event, Policy, Right};
use crate::testing::{Bug, is_planted};

/// What a subscriber wishes for.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Wish {
    pub(in super::super) policy: Policy,
    pub(in super::super) depth: u16,
    pub(in super::super) divisor: u8,
}

impl ServerCore {
    pub(in super::super) fn subscribe(
        &mut self,
        id: ConnectionId,
        tag: u32,
        channel: ChannelRef,
        wish: Wish,
    ) -> Result<(), ProtocolError> {
        let Wish { policy, depth, divisor } = wish;
        if depth > SUBSCRIPTION_DEPTH_MAX {
            return Err(ProtocolError::BadValue { kind: "subscribe", field: "depth", value: depth.into() });
        }
        let depth = if depth == 0 { SUBSCRIPTION_DEPTH_DEFAULT } else { depth };
        let Some((known, subscribers)) = self.channels.get_mut(channel) else {
            self.refuse(id, tag, RefusalCode::Gone);
            return Ok(());
        };
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        if !connection.rights.allows(Right::Subscribe, known.name.as_str()) && !is_planted(Bug::RightsSkipped)
        {
            self.refuse(id, tag, RefusalCode::Denied);
            return Ok(());
        }
        let is_sync = known.kind == ChannelKind::Sync;
        if is_sync && !is_divisor(divisor) {
            let value = divisor.into();
            return Err(ProtocolError::BadValue { kind: "subscribe", field: "divisor", value });
        }
        // Of ticks only the newest is worth anything.
        let depth = if is_sync { 1 } else { depth };
        let is_stream = known.kind == ChannelKind::Stream && divisor == 1;
        if !(is_stream || is_sync && policy == Policy::Latest) {
            self.refuse(id, tag, RefusalCode::WrongKind);
            return Ok(());
        }
        let output = &mut connection.output;
        if !output.is_subscribed(channel) && output.subscriptions() >= SUBSCRIPTIONS_PER_FLOW_MAX {
            self.refuse(id, tag, RefusalCode::TooManySubscriptions);
            return Ok(());
        }
        let reliable = subscribers.is_reliable();
        // Of a reliable channel the owner's credit says how much waits.
        let depth = if reliable { usize::MAX } else { usize::from(depth) };
        let (slot, new) = output.subscribe(channel, Keep { policy, depth, reliable });
        let was_heard = subscribers.is_heard();
        if new {
            subscribers.list.push(Subscriber { connection: id, slot });
        }
        if is_sync {
            self.add_target(id, channel, slot, divisor);
        }
        self.answer(id, tag, &Event::Subscribed { channel });
        if new {
            if let Some(latched) = self.latch_of(channel) {
                self.deliver_to(&Subscriber { connection: id, slot }, &latched);
            }
            self.audience_changed(channel, was_heard);
        }
        Ok(())
    }

    pub(in super::super) fn unsubscribe(&mut self, id: ConnectionId, tag: u32, channel: ChannelRef) {
        self.end_subscription(id, channel, DropReason::Gone);
        self.answer(id, tag, &Event::Unsubscribed { channel });
    }

    pub(in super::super) fn end_subscription(
        &mut self,
        id: ConnectionId,
        channel: ChannelRef,
        reason: DropReason,
    ) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let Some(counts) = connection.output.unsubscribe(channel, reason) else { return };
        self.ended.add(&counts);
        self.remove_target(id, channel);
        let Some((_, subscribers)) = self.channels.get_mut(channel) else { return };
        let was_heard = subscribers.is_heard();
        if !(is_planted(Bug::SubscriptionKept) && reason == DropReason::Gone) {
            subscribers.list.retain(|subscriber| subscriber.connection != id);
        }
        self.audience_changed(channel, was_heard);
        self.renew_credit(channel);
    }

    /// Tells whom it concerns if the channel began or ceased to be heard: the owner, or of a replicating
    /// channel, its source.
    pub(super) fn audience_changed(&mut self, channel: ChannelRef, was_heard: bool) {
        let Some((known, subscribers)) = self.channels.get(channel) else { return };
        let (heard, owner, source) = (subscribers.is_heard(), known.owner, subscribers.source());
        match source {
            _ if heard == was_heard => {}
            Some(source) => self.replica_is_heard(source, channel, heard),
            None => self.tell_owner(channel, owner, heard),
        }
    }

    pub(super) fn tell_owner(&mut self, channel: ChannelRef, owner: Owner, start: bool) {
        match owner {
            Owner::Hub if start => self.notices.push_back(Notice::StartPublishing { channel }),
            Owner::Hub => self.notices.push_back(Notice::StopPublishing { channel }),
            Owner::Flow(_) => {
                let event = if start {
                    Event::StartPublishing { channel }
                } else {
                    Event::StopPublishing { channel }
                };
                self.tell_owning_flow(owner, &event);
            }
        }
    }
}
