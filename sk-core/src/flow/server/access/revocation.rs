//! What happens when a connection may do more or less than before: what it does without the right ends, and it is
//! told what it sees.

use super::super::connection::incoming::{Call, Incoming};
use super::super::connection::telling::Telling;
use super::super::{ConnectionId, ServerCore};
use super::permission::{Permission, owning_right};
use crate::flow::channel::Channel;
use crate::flow::delivery::DropReason;
use crate::flow::error::RefusalCode;
use crate::flow::{ChannelRef, Event, Flags, Message as _, Right, Rights};

impl ServerCore {
    /// Changes what a connection may do, for every name alike, from its next command on. What it does already and
    /// has no right to any more ends.
    pub fn change_rights(&mut self, id: ConnectionId, rights: Rights) {
        self.change_permission(id, Permission::of(rights));
        self.settle();
    }

    pub(super) fn change_permission(&mut self, id: ConnectionId, permission: Permission) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let before = std::mem::replace(&mut connection.rights, permission);
        if connection.closing.is_none() {
            self.enforce_rights(id);
            self.tell_what_is_seen(id, &before);
        }
    }

    /// Ends what a connection does and has no right to.
    pub(super) fn enforce_rights(&mut self, id: ConnectionId) {
        self.enforce_on_owned(id);
        self.enforce_on_heard(id);
        self.enforce_on_calls(id);
        self.recheck_watches(id);
    }

    fn enforce_on_owned(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get(id) else { return };
        for channel in connection.owned.clone() {
            let Some((known, beside)) = self.channels.get(channel) else { continue };
            let source = beside.source();
            if !self.is_allowed(id, owning_right(known.kind), known.name.as_str()) {
                self.remove_channel(channel, None, DropReason::Rights);
            } else if source.is_some_and(|source| !self.is_allowed_on(id, Right::Subscribe, source)) {
                self.force_apart(channel);
            }
        }
    }

    fn enforce_on_heard(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get(id) else { return };
        let (subscribed, polled) = (connection.output.channels(), connection.polls.clone());
        for channel in subscribed {
            if self.is_allowed_on(id, Right::Subscribe, channel) {
                continue;
            }
            let waiting = self.counts(id, channel).map_or(0, |counts| counts.queued);
            self.end_subscription(id, channel, DropReason::Rights);
            if waiting > 0 {
                let reason = DropReason::Rights as u8;
                self.answer(id, 0, &Event::Dropped { channel, reason, total: waiting });
            }
            self.answer(id, 0, &Event::Unsubscribed { channel });
        }
        for channel in polled {
            if !self.is_allowed_on(id, Right::Subscribe, channel) {
                self.end_polling(id, channel);
            }
        }
    }

    fn enforce_on_calls(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get(id) else { return };
        let may_call = connection.rights.has(Right::Call);
        let calls: Vec<(u32, Call)> = connection.calls.iter().map(|(tag, call)| (*tag, *call)).collect();
        for (tag, call) in calls {
            match call {
                Call::Open(request) => self.end_request_without_right(id, request),
                // Where some services may be called, it is looked at again when the call is whole.
                Call::Begun if may_call => {}
                Call::Begun => {
                    if let Some(connection) = self.connections.get_mut(id) {
                        connection.calls.remove(&tag);
                        connection.gathering.forget(Incoming::Call(tag));
                    }
                    self.refuse(id, tag, RefusalCode::Denied);
                }
            }
        }
    }

    /// Tells a flow of the channels that it sees from now on, and that those are gone which it sees no more.
    fn tell_what_is_seen(&mut self, id: ConnectionId, before: &Permission) {
        let Some(connection) = self.connections.get(id) else { return };
        if !self.sessions.flows.contains(&id) {
            return;
        }
        // A flow that is still being told what there is hears of the rest in due course.
        let told = match connection.replay.as_ref().map(|replay| &replay.what) {
            Some(Telling::Channels { begins_flow: true, next }) => usize::from(*next),
            _ => usize::MAX,
        };
        let (form, now) = (connection.form, connection.rights.clone());
        let changed = |channel: &Channel| {
            let (was, is) = (before.sees(id, channel), now.sees(id, channel));
            (was != is).then_some(is)
        };
        let frames: Vec<_> = self
            .channels
            .iter()
            .filter(|(channel, _)| (channel.reference.id as usize) < told)
            .filter_map(|(channel, _)| {
                let reference = channel.reference;
                changed(channel).map(|seen| match seen {
                    true => channel.added(0, form),
                    false => Event::ChannelRemoved { channel: reference }.encode(0, Flags::NONE),
                })
            })
            .collect();
        for frame in frames {
            self.send(id, frame);
        }
    }

    /// The channels that a connection may know of.
    pub fn seen_by(&self, id: ConnectionId) -> impl Iterator<Item = ChannelRef> + '_ {
        let rights = self.connections.get(id).map(|connection| &connection.rights);
        self.channels
            .iter()
            .filter(move |(channel, _)| rights.is_some_and(|rights| rights.sees(id, channel)))
            .map(|(channel, _)| channel.reference)
    }

    /// What a connection does beyond its rights: nothing, unless the hub is at fault. For tests and simulations.
    pub fn widened_rights(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (id, connection) in self.connections.iter().filter(|(_, found)| found.closing.is_none()) {
            let mut complain = |what: &str, channel: ChannelRef| {
                found.push(format!("connection {id} {what} {channel} without the right to"));
            };
            for channel in connection.output.channels() {
                if !self.is_allowed_on(id, Right::Subscribe, channel) {
                    complain("hears", channel);
                }
            }
            for channel in &connection.polls {
                if !self.is_allowed_on(id, Right::Subscribe, *channel) {
                    complain("polls", *channel);
                }
            }
            for channel in &connection.owned {
                let Some((known, beside)) = self.channels.get(*channel) else { continue };
                if !self.is_allowed_on(id, owning_right(known.kind), *channel) {
                    complain("owns", *channel);
                }
                if let Some(source) = beside.source()
                    && !self.is_allowed_on(id, Right::Subscribe, source)
                {
                    complain("repeats", source);
                }
            }
            for call in connection.calls.values() {
                if let Call::Open(request) = call
                    && let Some(request) = self.requests.get(*request)
                    && !self.is_allowed_on(id, Right::Call, request.channel)
                {
                    complain("calls", request.channel);
                }
            }
            if connection.rights.is_of_account() && !self.has_rights_of_account(connection) {
                found.push(format!("connection {id} has rights that its account does not have"));
            }
        }
        found
    }
}
