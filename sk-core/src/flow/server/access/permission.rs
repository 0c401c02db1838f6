//! What a connection may do: one question for every command, and what happens when the answer changes.

use super::super::connection::telling::Telling;
use super::super::connection::{Call, Incoming};
use super::super::{ConnectionId, ServerCore};
use crate::flow::channel::{Channel, Owner};
use crate::flow::delivery::DropReason;
use crate::flow::error::RefusalCode;
use crate::flow::rights::Grants;
use crate::flow::{ChannelKind, ChannelRef, Event, Flags, Message as _, Right, Rights};
use std::sync::Arc;

/// What a connection may do. Before the login that is nothing.
#[derive(Clone, Debug)]
pub(in super::super) struct Permission {
    /// The rights that it has for any name at all.
    rights: Rights,
    /// For which names; none: for every name.
    grants: Option<Arc<Grants>>,
}

impl Permission {
    pub(in super::super) const NONE: Permission = Permission { rights: Rights::NONE, grants: None };

    /// These rights, for every name.
    pub(in super::super) fn of(rights: Rights) -> Permission {
        Permission { rights, grants: None }
    }

    /// Those of an account.
    pub(in super::super) fn granted(grants: &Arc<Grants>) -> Permission {
        Permission { rights: grants.rights(), grants: Some(grants.clone()) }
    }

    /// Whether it comes from an account's database, and changes with that.
    pub(in super::super) fn is_of_account(&self) -> bool {
        self.grants.is_some()
    }

    /// Whether it has a right for any name at all: no command goes further without.
    pub(in super::super) fn has(&self, right: Right) -> bool {
        self.rights.has(right)
    }

    /// Whether it has a right for this name.
    pub(in super::super) fn allows(&self, right: Right, name: &str) -> bool {
        self.has(right) && self.grants.as_ref().is_none_or(|grants| grants.has(right, name))
    }

    /// Whether it has a right for every name.
    pub(in super::super) fn allows_everywhere(&self, right: Right) -> bool {
        self.has(right) && self.grants.as_ref().is_none_or(|grants| grants.has_everywhere(right))
    }

    /// Whether a connection with it hears of a channel: of its own, of those that it may list, and of those that it
    /// may make use of.
    pub(in super::super) fn sees(&self, own: ConnectionId, channel: &Channel) -> bool {
        let name = channel.name.as_str();
        channel.owner == Owner::Flow(own.wire())
            || self.allows(Right::List, name)
            || self.allows(using_right(channel.kind), name)
    }
}

/// The right to own a channel of this kind.
pub(in super::super) fn owning_right(kind: ChannelKind) -> Right {
    match kind {
        ChannelKind::Stream | ChannelKind::Sync => Right::Publish,
        ChannelKind::Service => Right::Serve,
        ChannelKind::Blob => Right::BlobWrite,
    }
}

/// The right to make use of another's channel of this kind.
fn using_right(kind: ChannelKind) -> Right {
    match kind {
        ChannelKind::Stream | ChannelKind::Sync => Right::Subscribe,
        ChannelKind::Service => Right::Call,
        ChannelKind::Blob => Right::BlobRead,
    }
}

impl ServerCore {
    /// The question that every command asks for the name that it is about.
    pub(in super::super) fn is_allowed(&self, id: ConnectionId, right: Right, name: &str) -> bool {
        self.connections
            .get(id)
            .is_some_and(|connection| connection.rights.allows(right, name))
    }

    /// The same about a channel; one that is gone is nobody's.
    pub(in super::super) fn is_allowed_on(
        &self,
        id: ConnectionId,
        right: Right,
        channel: ChannelRef,
    ) -> bool {
        let known = self.channels.get(channel);
        known.is_some_and(|(known, _)| self.is_allowed(id, right, known.name.as_str()))
    }

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
