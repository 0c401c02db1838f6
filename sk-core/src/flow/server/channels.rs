//! Channels: opening, closing, changing, telling everyone.

use super::super::channel::Owner;
use super::super::delivery::DropReason;
use super::super::error::RefusalCode;
use super::super::limits::CHANNELS_PER_FLOW_MAX;
use super::super::{ChannelKind, ChannelRef, Encoded, Event, Flags, Form, Message, Properties, Right};
use super::audience::Subscribers;
use super::connection::Incoming;
use super::{ConnectionId, Notice, ServerCore, owning_flow};
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
        self.cut_ties(channel);
        let Some((known, subscribers)) = self.channels.remove(channel) else { return };
        self.clocks.remove(&channel);
        if known.kind == ChannelKind::Service {
            self.end_requests_to(channel, known.owner);
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
        let event = Event::ChannelRemoved { channel };
        self.tell_flows(channel, asked, |tag, _| event.encode(tag, Flags::NONE));
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
        if !latch {
            self.keep_no_longer(channel);
        }
        self.tell_flows(channel, Some((id, tag)), |tag, form| {
            Event::HeaderChanged { channel, properties: properties.clone().in_form(form) }
                .encode(tag, Flags::NONE)
        });
    }

    fn tell_added(&mut self, channel: ChannelRef, asked: Option<(ConnectionId, u32)>) {
        let Some((known, _)) = self.channels.get(channel) else { return };
        let known = known.clone();
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
        for index in 0..self.sessions.flows.len() {
            let id = self.sessions.flows[index];
            let Some(connection) = self.connections.get(id) else { continue };
            let told = connection
                .replay
                .is_none_or(|replay| !replay.begins_flow || replay.next > channel.id as u16);
            if told && connection.closing.is_none() {
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

    /// Adds lines to a list that is being told, and moves frames to the wire.
    pub(super) fn fill(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.output.fill();
        while let Some(replay) = &mut connection.replay
            && connection.output.has_room_for_list()
        {
            let (tag, form, flow) = (replay.tag, replay.form, replay.begins_flow);
            let frame = match self.channels.from_id(replay.next) {
                Some((channel, _)) => {
                    replay.next = channel.reference.id as u16 + 1;
                    replay.told += 1;
                    if flow { channel.added(0, form) } else { channel.listed(tag, form) }
                }
                None => {
                    let count = replay.told;
                    connection.replay = None;
                    if flow {
                        self.notices.push_back(Notice::FlowBegun { connection: id });
                        let name = connection.flow.as_ref().map(Name::to_string).unwrap_or_default();
                        let (session, resumed) = (connection.session, connection.resumed.into());
                        Event::FlowBegun { channels: count, name, session, resumed }.encode(tag, Flags::NONE)
                    } else {
                        Event::ListEnd { count }.encode(tag, Flags::NONE)
                    }
                }
            };
            // A list pauses long before the limit of the control queue.
            connection.output.control(frame);
            connection.output.fill();
        }
        connection.fill_latest();
        if connection.output.paused && connection.replay.is_none() {
            self.tell_inherited(id);
        }
    }
}
