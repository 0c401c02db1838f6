//! Names of flows, and sessions: a satellite that comes back takes its own place again.

use super::super::channels::audience::Credit;
use super::super::connection::telling::Telling;
use super::super::{ConnectionId, Notice, ServerCore, owning_flow};
use crate::flow::channel::Owner;
use crate::flow::database::{DatabaseKind, Entity};
use crate::flow::error::{ClosingReason, RefusalCode};
use crate::flow::{ChannelKind, ChannelRef, Event, Flags, Form, Message as _, Right};
use rustc_hash::FxHashMap;
use sha2::{Digest, Sha256};
use sk_flat::Name;
use std::collections::BTreeMap;

/// What a flow proves that it is the continuation of another one with. Zeros prove nothing.
pub type Session = [u8; 16];

/// The flows of a hub by what tells them apart.
#[derive(Debug, Default)]
pub(in super::super) struct Sessions {
    names: BTreeMap<Name, ConnectionId>,
    sessions: FxHashMap<Session, ConnectionId>,
    /// All flows, for what is told to everyone.
    pub(in super::super) flows: Vec<ConnectionId>,
}

impl Sessions {
    /// The flow of a full name.
    pub(in super::super) fn by_name(&self, name: &Name) -> Option<ConnectionId> {
        self.names.get(name).copied()
    }
}

/// The session of the connection with this nonce. Only its peer knows the nonce, and learns the session itself
/// after the login.
fn session_of(hub_nonce: &[u8; 32]) -> Session {
    let digest = Sha256::new()
        .chain_update(b"SpecialK flow 1 session")
        .chain_update(hub_nonce)
        .finalize();
    std::array::from_fn(|index| digest[index])
}

impl ServerCore {
    /// Whether the connection of this id is open and has a right for this name.
    pub fn has_right(&self, connection: u64, right: Right, name: &str) -> bool {
        self.is_allowed(ConnectionId::from_wire(connection), right, name)
    }

    pub(in super::super) fn set_async(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &str,
        session: Session,
        form: Form,
    ) {
        let Some(connection) = self.connections.get(id) else { return };
        let Some(user) = &connection.user else { return };
        let chosen = if name.is_empty() { format!("flow-{}", id.wire()) } else { name.to_owned() };
        let Ok(full) = Name::new(&chosen).and_then(|name| Name::compose(user, &name)) else {
            return self.refuse(id, tag, RefusalCode::BadName);
        };
        let predecessor = self.sessions.sessions.get(&session).copied();
        let predecessor = predecessor.filter(|old| {
            self.connections
                .get(*old)
                .is_some_and(|old| old.user.as_ref() == Some(user) && old.closing.is_none())
        });
        let is_taken = predecessor.is_none() && self.sessions.names.contains_key(&full);
        let full = match is_taken {
            false => full,
            // A module whose former thread hangs: it cannot come back later, when the name is free.
            true if connection.is_inside() => match Name::new(&format!("{full}-{}", id.wire())) {
                Ok(full) => full,
                Err(_) => return self.refuse(id, tag, RefusalCode::BadName),
            },
            true => return self.refuse(id, tag, RefusalCode::Exists),
        };
        let own = session_of(&connection.hub_nonce);
        self.end_all_polling(id);
        let full = match predecessor {
            Some(old) => self.take_place(old, id).unwrap_or(full),
            None => full,
        };
        if predecessor.is_none() {
            self.entity_began(DatabaseKind::Flow, &full, Entity::Flow(id.wire()));
        }
        self.sessions.names.insert(full.clone(), id);
        self.sessions.sessions.insert(own, id);
        self.sessions.flows.push(id);
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.flow = Some(full);
        connection.session = own;
        connection.resumed = predecessor.is_some();
        connection.form = form;
        connection.inbound.advance();
        self.tell_list(id, tag, form, Telling::Channels { begins_flow: true, next: 0 });
    }

    /// Gives a flow's place to its successor: name, channels and subscriptions with all that waits. What was
    /// half-sent begins anew. Answers the name.
    fn take_place(&mut self, old: ConnectionId, new: ConnectionId) -> Option<Name> {
        let gone = self.connections.get_mut(old)?;
        let name = gone.flow.clone();
        let owned = std::mem::take(&mut gone.owned);
        let kept = std::mem::take(&mut gone.output.kept);
        let subscriptions = gone.output.give_away();
        let selected = self.select(old, None);
        for channel in &owned {
            self.change_owner(*channel, old, new);
        }
        self.select(new, selected);
        let come = self.connections.get_mut(new)?;
        come.owned = owned;
        come.output.kept = kept;
        come.output.paused = true;
        for subscription in subscriptions {
            let Some(come) = self.connections.get_mut(new) else { break };
            let (channel, slot) = come.output.take_over(subscription);
            self.move_target(channel, old, new, slot);
            let Some((_, beside)) = self.channels.get_mut(channel) else { continue };
            if let Some(known) = beside.list.iter_mut().find(|known| known.connection == old) {
                known.connection = new;
                known.slot = slot;
            }
        }
        if let Some(name) = &name {
            // The flow's database is the successor's before the former one ends.
            self.entity_began(DatabaseKind::Flow, name, Entity::Flow(new.wire()));
        }
        self.notices.push_back(Notice::Resumed { from: old, connection: new });
        self.close(old, ClosingReason::Replaced);
        // It may not have all the rights of its predecessor.
        self.enforce_rights(new);
        name
    }

    fn change_owner(&mut self, channel: ChannelRef, old: ConnectionId, new: ConnectionId) {
        let Some((known, _)) = self.channels.get(channel) else { return };
        if known.kind == ChannelKind::Service {
            // The successor knows nothing of requests that were under way.
            self.end_requests_to(channel, Owner::Flow(old.wire()));
        }
        let Some((known, beside)) = self.channels.get_mut(channel) else { return };
        known.owner = Owner::Flow(new.wire());
        let known = known.clone();
        if let Some(credit) = beside.special.as_mut().and_then(|special| special.credit.as_mut()) {
            // Both sides count anew; how much may be sent is told when the flow has begun.
            *credit = Credit { granted: 0, ..Credit::NEW };
        }
        let changed = Event::OwnerChanged { channel, owner: new.wire() };
        self.tell_flows(&known, None, |tag, _| changed.encode(tag, Flags::NONE));
    }

    /// Tells a flow that took another's place how its channels are, after it was told which there are.
    pub(in super::super) fn tell_inherited(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.output.paused = false;
        if let Some(selected) = &connection.desk.selected {
            let event = Event::DatabaseSelected { database: selected.to_string() };
            self.answer(id, 0, &event);
        }
        let Some(connection) = self.connections.get(id) else { return };
        for channel in connection.owned.clone() {
            let Some((_, beside)) = self.channels.get(channel) else { continue };
            let (source, heard, reliable) = (beside.source(), beside.is_heard(), beside.is_reliable());
            match source {
                Some(source) => self.answer(id, 0, &Event::Attached { replica: channel, source }),
                None if heard => self.answer(id, 0, &Event::StartPublishing { channel }),
                None => {}
            }
            if reliable {
                self.renew_credit(channel);
                self.tell_credit(channel);
            }
        }
    }

    /// Tells the owner of a channel something about it. One who is only just being told which channels there
    /// are hears how they stand when that is done.
    pub(in super::super) fn tell_owning_flow(&mut self, owner: Owner, event: &Event) {
        let Some(id) = owning_flow(&self.connections, owner) else { return };
        if self.connections.get(id).is_some_and(|connection| !connection.output.paused) {
            self.answer(id, 0, event);
        }
    }

    /// A flow ends, and with it its name and its session.
    pub(in super::super) fn end_session(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get(id) else { return };
        let Some(name) = &connection.flow else { return };
        if self.sessions.names.get(name) == Some(&id) {
            self.sessions.names.remove(name);
        }
        if self.sessions.sessions.get(&connection.session) == Some(&id) {
            self.sessions.sessions.remove(&connection.session);
        }
        if let Some(place) = self.sessions.flows.iter().position(|flow| *flow == id) {
            self.sessions.flows.swap_remove(place);
        }
    }
}
