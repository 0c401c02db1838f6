//! Channels: opening, closing, changing, telling everyone.

pub(super) mod audience;
mod credit;
mod fan_out;
mod keeping;
pub(super) mod pacing;
mod polling;
pub(super) mod publish;
mod replicas;
pub(super) mod subscriptions;
pub(super) mod udp;

use super::super::channel::{Channel, Owner};
use super::super::database::{DatabaseKind, Entity};
use super::super::delivery::DropReason;
use super::super::error::RefusalCode;
use super::super::limits::CHANNELS_PER_FLOW_MAX;
use super::super::{ChannelKind, ChannelRef, Encoded, Event, Flags, Form, Message, Properties, Right};
use super::access::permission::owning_right;
use super::connection::incoming::Incoming;
use super::connection::telling::Telling;
use super::{ConnectionId, Notice, ServerCore, owning_flow};
use crate::testing::{Bug, is_planted};
use audience::Subscribers;
use sk_flat::Name;

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
                self.tell_credit(channel);
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
        if !connection.rights.allows(owning_right(kind), full.as_str()) && !is_planted(Bug::RightsSkipped) {
            return Err(RefusalCode::Denied);
        }
        if connection.owned.len() >= CHANNELS_PER_FLOW_MAX {
            return Err(RefusalCode::TooManyChannels);
        }
        if !properties.is_map() {
            return Err(RefusalCode::BadProperties);
        }
        let beside = Subscribers::of(&properties);
        self.channels.add(full, kind, Owner::Flow(id.wire()), properties, beside)
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
        let beside = Subscribers::of(&properties);
        let channel = self.channels.add(name, kind, Owner::Hub, properties, beside)?;
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
            .is_some_and(|found| found.rights.allows(Right::Administer, known.name.as_str()));
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
        self.cut_ties(channel);
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
            if let Some(udp) = &mut connection.udp {
                udp.forget(channel);
            }
        }
        self.entity_ended(DatabaseKind::Channel, &known.name, Entity::Channel(channel));
        let event = Event::ChannelRemoved { channel };
        self.tell_flows(&known, asked, |tag, _| event.encode(tag, Flags::NONE));
        self.notices.push_back(Notice::ChannelRemoved { channel, name: known.name });
    }

    pub(super) fn change_header(
        &mut self,
        id: ConnectionId,
        tag: u32,
        channel: ChannelRef,
        properties: Properties,
    ) {
        let Some((known, subscribers)) = self.channels.get_mut(channel) else {
            return self.refuse(id, tag, RefusalCode::Gone);
        };
        if known.owner != Owner::Flow(id.wire()) {
            return self.refuse(id, tag, RefusalCode::NotOwner);
        }
        if !properties.is_map() {
            return self.refuse(id, tag, RefusalCode::BadProperties);
        }
        known.properties = properties.clone();
        let latch = properties.is_latched();
        if latch || subscribers.special.is_some() {
            subscribers.special_mut().latch = latch;
        }
        let known = known.clone();
        if !latch {
            self.keep_no_longer(channel);
        }
        self.tell_flows(&known, Some((id, tag)), |tag, form| {
            Event::HeaderChanged { channel, properties: properties.clone().in_form(form) }
                .encode(tag, Flags::NONE)
        });
    }

    fn tell_added(&mut self, channel: ChannelRef, asked: Option<(ConnectionId, u32)>) {
        let Some((known, _)) = self.channels.get(channel) else { return };
        let known = known.clone();
        self.entity_began(DatabaseKind::Channel, &known.name, Entity::Channel(channel));
        match asked {
            Some((id, tag)) if is_planted(Bug::ChannelUntold) && channel.id % 3 == 0 => {
                self.send(id, known.added(tag, Form::Binary));
            }
            _ => self.tell_flows(&known, asked, |tag, form| known.added(tag, form)),
        }
        self.notices.push_back(Notice::ChannelAdded { channel, name: known.name });
    }

    /// Sends a frame about a channel to every flow that sees it, in the form of its values, and to the one that asked with
    /// its tag. A flow that is still being told what there is hears of channels beyond that point in due course.
    pub(super) fn tell_flows(
        &mut self,
        channel: &Channel,
        asked: Option<(ConnectionId, u32)>,
        frame: impl Fn(u32, Form) -> Encoded,
    ) {
        let mut made: [Option<Encoded>; 2] = [None, None];
        for index in 0..self.sessions.flows.len() {
            let id = self.sessions.flows[index];
            let Some(connection) = self.connections.get(id) else { continue };
            let told = connection.replay.as_ref().is_none_or(|replay| match replay.what {
                Telling::Channels { begins_flow: true, next } => next > channel.reference.id as u16,
                _ => true,
            });
            if told && connection.closing.is_none() && connection.rights.sees(id, channel) {
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
        self.announced.add(made.iter().flatten().map(Encoded::len).max().unwrap_or(0));
    }
}
