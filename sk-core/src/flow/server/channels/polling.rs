//! Polling: a synchronous connection asks for the newest message of a channel when it wants one.

use super::super::connection::Connection;
use super::super::{ConnectionId, ServerCore};
use super::audience::Poller;
use crate::flow::channel::outgoing::Begun;
use crate::flow::error::RefusalCode;
use crate::flow::limits::SUBSCRIPTIONS_PER_FLOW_MAX;
use crate::flow::{ChannelKind, ChannelRef, Event, Flags, Message, Right};

impl ServerCore {
    pub(in super::super) fn poll_register(&mut self, id: ConnectionId, tag: u32, channel: ChannelRef) {
        match self.try_register(id, channel) {
            Ok(()) => self.answer(id, tag, &Event::Done {}),
            Err(code) => self.refuse(id, tag, code),
        }
    }

    fn try_register(&mut self, id: ConnectionId, channel: ChannelRef) -> Result<(), RefusalCode> {
        let (known, subscribers) = self.channels.get(channel).ok_or(RefusalCode::Gone)?;
        if !self.is_allowed(id, Right::Subscribe, known.name.as_str()) {
            return Err(RefusalCode::Denied);
        }
        if known.kind != ChannelKind::Stream {
            return Err(RefusalCode::WrongKind);
        }
        let was_heard = subscribers.is_heard();
        let connection = self.connections.get_mut(id).ok_or(RefusalCode::Denied)?;
        if connection.polls.contains(&channel) {
            return Ok(());
        }
        if connection.polls.len() >= SUBSCRIPTIONS_PER_FLOW_MAX {
            return Err(RefusalCode::TooManySubscriptions);
        }
        connection.polls.push(channel);
        let latched = self.latch_of(channel);
        let newest = self.keep(Some(id), None, latched.as_ref());
        if let Some((_, subscribers)) = self.channels.get_mut(channel) {
            subscribers.special_mut().pollers.push(Poller { connection: id, newest });
        }
        self.audience_changed(channel, was_heard);
        Ok(())
    }

    /// It may be sent where there is no registration: the channel may just have gone.
    pub(in super::super) fn poll_deregister(&mut self, id: ConnectionId, tag: u32, channel: ChannelRef) {
        self.end_polling(id, channel);
        self.answer(id, tag, &Event::Done {});
    }

    /// Ends all of it: the connection goes, or becomes a flow, which has no command for it.
    pub(in super::super) fn end_all_polling(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        for channel in std::mem::take(&mut connection.polls) {
            self.end_polling(id, channel);
        }
    }

    pub(in super::super) fn end_polling(&mut self, id: ConnectionId, channel: ChannelRef) {
        if let Some(connection) = self.connections.get_mut(id) {
            connection.polls.retain(|polled| *polled != channel);
        }
        let Some((_, subscribers)) = self.channels.get_mut(channel) else { return };
        let was_heard = subscribers.is_heard();
        let Some(special) = &mut subscribers.special else { return };
        let Some(place) = special.pollers.iter().position(|poller| poller.connection == id) else { return };
        let poller = special.pollers.swap_remove(place);
        self.keep(Some(id), poller.newest, None);
        self.audience_changed(channel, was_heard);
    }

    pub(in super::super) fn poll(&mut self, id: ConnectionId, tag: u32, channel: ChannelRef) {
        let newest = match self.channels.get(channel) {
            None => Err(RefusalCode::Gone),
            Some((_, subscribers)) => {
                let pollers = subscribers.special.as_ref().map_or(&[][..], |special| &special.pollers);
                match pollers.iter().find(|poller| poller.connection == id) {
                    None => Err(RefusalCode::NotRegistered),
                    Some(poller) => poller.newest.clone().ok_or(RefusalCode::NothingYet),
                }
            }
        };
        match newest {
            Err(code) => self.refuse(id, tag, code),
            Ok(message) => {
                let Some(connection) = self.connections.get_mut(id) else { return };
                if message.length() > connection.output.message_bytes_max {
                    return self.refuse(id, tag, RefusalCode::TooLong);
                }
                connection.latest = Some(Box::new((tag, Begun::new(message))));
                self.mark_dirty(id);
            }
        }
    }
}

impl Connection {
    /// Adds fragments of a message that is being told.
    pub(in super::super) fn fill_latest(&mut self) {
        while let Some(latest) = &mut self.latest
            && self.output.has_room_for_list()
        {
            let (tag, begun) = &mut **latest;
            let (flags, payload, _) = begun.next_piece(self.output.fragment_bytes_max);
            let (channel, message) = (begun.message.channel(), begun.message.message());
            let frame = Event::Latest { channel, message, payload }.encode(*tag, flags);
            if flags.has(Flags::LAST) {
                self.latest = None;
            }
            self.output.control(frame);
            self.output.fill();
        }
    }
}
