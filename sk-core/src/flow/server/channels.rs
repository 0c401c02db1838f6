//! Channels and subscriptions: opening, closing, telling everyone, starting and stopping owners.

use super::super::channel::Owner;
use super::super::database::{DatabaseKind, Entity};
use super::super::delivery::DropReason;
use super::super::error::{ProtocolError, RefusalCode};
use super::super::limits::{
    CHANNELS_PER_FLOW_MAX, SUBSCRIPTION_DEPTH_DEFAULT, SUBSCRIPTION_DEPTH_MAX, SUBSCRIPTIONS_PER_FLOW_MAX,
};
use super::super::{
    ChannelKind, ChannelRef, Encoded, Event, Flags, Form, Message, Policy, Properties, Right, State,
};
use super::connection::Incoming;
use super::telling::Telling;
use super::{ConnectionId, Notice, ServerCore, Subscriber, Subscribers, owning_flow};
use crate::testing::{Bug, is_planted};
use sk_flat::Name;

/// What a subscriber wishes for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wish {
    pub(super) policy: Policy,
    pub(super) depth: u16,
    pub(super) divisor: u8,
}

impl ServerCore {
    pub(super) fn create_channel(
        &mut self,
        id: ConnectionId,
        tag: u32,
        kind: ChannelKind,
        name: &str,
        properties: Properties,
    ) {
        match self.try_create(id, kind, name, properties) {
            Ok(channel) => {
                if let Some(connection) = self.connections.get_mut(id) {
                    connection.owned.push(channel);
                }
                self.tell_added(channel, Some((id, tag)));
            }
            Err(code) => self.refuse(id, tag, code),
        }
    }

    fn try_create(
        &mut self,
        id: ConnectionId,
        kind: ChannelKind,
        name: &str,
        properties: Properties,
    ) -> Result<ChannelRef, RefusalCode> {
        let connection = self.connections.get(id).ok_or(RefusalCode::Denied)?;
        let user = connection.user.as_ref().ok_or(RefusalCode::Denied)?;
        let full = Name::new(name)
            .and_then(|name| Name::compose(user, &name))
            .map_err(|_| RefusalCode::BadName)?;
        if connection.owned.len() >= CHANNELS_PER_FLOW_MAX {
            return Err(RefusalCode::TooManyChannels);
        }
        if !properties.is_map() {
            return Err(RefusalCode::BadProperties);
        }
        self.channels
            .add(full, kind, Owner::Flow(id.wire()), properties, Subscribers::default())
    }

    /// Opens a streaming channel of the hub's own. It outlives every flow; administrators may remove it.
    ///
    /// # Errors
    /// `Exists`, `NoFreeChannel`, or `BadProperties` if they are not a map.
    pub fn open_channel(&mut self, name: Name, properties: Properties) -> Result<ChannelRef, RefusalCode> {
        self.open_own(ChannelKind::Stream, name, properties)
    }

    /// Opens a channel of the hub's own.
    pub(super) fn open_own(
        &mut self,
        kind: ChannelKind,
        name: Name,
        properties: Properties,
    ) -> Result<ChannelRef, RefusalCode> {
        if !properties.is_map() {
            return Err(RefusalCode::BadProperties);
        }
        let channel = self.channels.add(name, kind, Owner::Hub, properties, Subscribers::default())?;
        self.tell_added(channel, None);
        self.settle();
        Ok(channel)
    }

    /// Closes any channel by the hub's own will; answers whether it was open.
    pub fn close_channel(&mut self, channel: ChannelRef) -> bool {
        let open = self.channels.get(channel).is_some();
        self.remove_channel(channel, None, DropReason::Gone);
        self.settle();
        open
    }

    pub(super) fn remove_on_request(&mut self, id: ConnectionId, tag: u32, channel: ChannelRef) {
        let Some((known, _)) = self.channels.get(channel) else {
            return self.refuse(id, tag, RefusalCode::Gone);
        };
        let administers = self
            .connections
            .get(id)
            .is_some_and(|found| found.rights.has(Right::Administer));
        if known.owner == Owner::Flow(id.wire()) || administers {
            self.remove_channel(channel, Some((id, tag)), DropReason::Gone);
        } else {
            self.refuse(id, tag, RefusalCode::NotOwner);
        }
    }

    /// Closes a channel: its subscriptions end, its unfinished message is forgotten, everyone is told.
    pub(super) fn remove_channel(
        &mut self,
        channel: ChannelRef,
        asked: Option<(ConnectionId, u32)>,
        reason: DropReason,
    ) {
        let Some((known, subscribers)) = self.channels.remove(channel) else { return };
        self.clocks.remove(&channel);
        match known.kind {
            ChannelKind::Service => self.end_requests_to(channel, known.owner),
            ChannelKind::Blob => self.end_blob(&known.name),
            ChannelKind::Stream | ChannelKind::Sync => {}
        }
        for subscriber in subscribers.list {
            if let Some(connection) = self.connections.get_mut(subscriber.connection)
                && let Some(counts) = connection.output.unsubscribe(channel, reason)
            {
                self.ended.add(&counts);
            }
        }
        if let Some(owner) = owning_flow(&self.connections, known.owner)
            && let Some(connection) = self.connections.get_mut(owner)
        {
            connection.owned.retain(|owned| *owned != channel);
            connection.gathering.forget(Incoming::Publish(channel));
        }
        self.entity_ended(DatabaseKind::Channel, &known.name, Entity::Channel(channel));
        let event = Event::ChannelRemoved { channel };
        self.tell_flows(channel, asked, |tag, _| event.encode(tag, Flags::NONE));
        self.notices.push_back(Notice::ChannelRemoved { channel, name: known.name });
    }

    fn tell_added(&mut self, channel: ChannelRef, asked: Option<(ConnectionId, u32)>) {
        let Some((known, _)) = self.channels.get(channel) else { return };
        let known = known.clone();
        self.entity_began(DatabaseKind::Channel, &known.name, Entity::Channel(channel));
        self.tell_flows(channel, asked, |tag, form| known.added(tag, form));
        self.notices.push_back(Notice::ChannelAdded { channel, name: known.name });
    }

    /// Sends a frame about a channel to every flow in the form of its values, and to the one that asked with
    /// its tag. A flow that is still being told what there is hears of channels beyond that point in due course.
    pub(super) fn tell_flows(
        &mut self,
        channel: ChannelRef,
        asked: Option<(ConnectionId, u32)>,
        frame: impl Fn(u32, Form) -> Encoded,
    ) {
        let mut made: [Option<Encoded>; 2] = [None, None];
        for id in self.connections.ids() {
            let Some(connection) = self.connections.get(id) else { continue };
            let flow = connection.inbound.state() == State::Flow && connection.closing.is_none();
            let told = connection.replay.as_ref().is_none_or(|replay| match replay.what {
                Telling::Channels { begins_flow: true, next } => next > channel.id as u16,
                _ => true,
            });
            if flow && told {
                let form = connection.form;
                match asked {
                    Some((asker, tag)) if asker == id => self.send(id, frame(tag, form)),
                    _ => {
                        let shared = made[form as usize].get_or_insert_with(|| frame(0, form)).clone();
                        self.send(id, shared);
                    }
                }
            }
        }
    }

    pub(super) fn subscribe(
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
        let is_sync = known.kind == ChannelKind::Sync;
        if is_sync && !super::sync::is_divisor(divisor) {
            let value = divisor.into();
            return Err(ProtocolError::BadValue { kind: "subscribe", field: "divisor", value });
        }
        // Of ticks only the newest is worth anything.
        let depth = if is_sync { 1 } else { depth };
        let is_stream = known.kind == ChannelKind::Stream && divisor == 1;
        if !(is_stream || is_sync) || policy != Policy::Latest {
            self.refuse(id, tag, RefusalCode::WrongKind);
            return Ok(());
        }
        let owner = known.owner;
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        let output = &mut connection.output;
        if !output.is_subscribed(channel) && output.subscriptions() >= SUBSCRIPTIONS_PER_FLOW_MAX {
            self.refuse(id, tag, RefusalCode::TooManySubscriptions);
            return Ok(());
        }
        let (slot, new) = output.subscribe(channel, usize::from(depth));
        if new {
            subscribers.list.push(Subscriber { connection: id, slot });
        }
        let first = new && subscribers.list.len() == 1;
        if is_sync {
            self.add_target(id, channel, slot, divisor);
        }
        self.answer(id, tag, &Event::Subscribed { channel });
        if first {
            self.tell_owner(channel, owner, true);
        }
        Ok(())
    }

    pub(super) fn unsubscribe(&mut self, id: ConnectionId, tag: u32, channel: ChannelRef) {
        self.end_subscription(id, channel, DropReason::Gone);
        self.answer(id, tag, &Event::Unsubscribed { channel });
    }

    pub(super) fn end_subscription(&mut self, id: ConnectionId, channel: ChannelRef, reason: DropReason) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let Some(counts) = connection.output.unsubscribe(channel, reason) else { return };
        self.ended.add(&counts);
        self.remove_target(id, channel);
        let Some((known, subscribers)) = self.channels.get_mut(channel) else { return };
        let owner = known.owner;
        if !(is_planted(Bug::SubscriptionKept) && reason == DropReason::Gone) {
            subscribers.list.retain(|subscriber| subscriber.connection != id);
        }
        if subscribers.list.is_empty() {
            self.tell_owner(channel, owner, false);
        }
    }

    fn tell_owner(&mut self, channel: ChannelRef, owner: Owner, start: bool) {
        match owner {
            Owner::Hub if start => self.notices.push_back(Notice::StartPublishing { channel }),
            Owner::Hub => self.notices.push_back(Notice::StopPublishing { channel }),
            Owner::Flow(_) => {
                let Some(owner) = owning_flow(&self.connections, owner) else { return };
                let event = if start {
                    Event::StartPublishing { channel }
                } else {
                    Event::StopPublishing { channel }
                };
                self.answer(owner, 0, &event);
            }
        }
    }
}
