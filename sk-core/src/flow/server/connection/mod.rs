//! The connections of a hub, and what is known of each.

pub(super) mod addresses;
pub(super) mod alarms;
mod deadlines;
pub(super) mod identity;
pub(super) mod incoming;
pub(super) mod output;
pub(super) mod talk;
pub(super) mod telling;

use super::super::channel::outgoing::Begun;
use super::super::definition::{Encoded, Tagged};
use super::super::delivery::Budget;
use super::super::error::{ClosingReason, ProtocolError};
use super::super::fragment::Gathering;
use super::super::inbound::Inbound;
use super::super::login::{Binding, Nonce};
use super::super::scram::ServerExchange;
use super::super::{ChannelRef, Command, Form, State};
use super::access::permission::Permission;
use super::blobs::desk::BlobDesk;
use super::channels::udp::UdpSession;
use super::databases::desk::Desk;
use super::services::requests::RequestId;
use identity::{ConnectionId, Origin};
use incoming::{Call, Incoming};
use output::Output;
use sk_flat::{Instant, Name};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use telling::Replay;

/// All that a hub keeps of one connection.
#[derive(Debug)]
pub(super) struct Connection {
    pub(super) origin: Origin,
    pub(super) inbound: Inbound<Command>,
    /// Frames from inside the process.
    pub(super) parts: VecDeque<Encoded>,
    pub(super) output: Output,
    pub(super) client_nonce: Nonce,
    pub(super) hub_nonce: Nonce,
    /// Of an encrypted connection.
    pub(super) binding: Option<Binding>,
    pub(super) user: Option<Name>,
    /// A login by password that is under way.
    pub(super) scram: Option<Box<ServerExchange>>,
    pub(super) rights: Permission,
    /// The full name of the flow, once it is one.
    pub(super) flow: Option<Name>,
    /// What the flow's successor would prove itself with, and whether it is one itself.
    pub(super) session: [u8; 16],
    pub(super) resumed: bool,
    /// The form of values in the events of the flow.
    pub(super) form: Form,
    pub(super) gathering: Gathering<Incoming>,
    /// Its session for datagrams, if it has one.
    pub(super) udp: Option<Box<UdpSession>>,
    /// The calls of this connection, by tag: those that it is sending and those that are open.
    pub(super) calls: BTreeMap<u32, Call>,
    /// The open requests to services of this connection's.
    pub(super) serving: BTreeSet<RequestId>,
    pub(super) owned: Vec<ChannelRef>,
    pub(super) replay: Option<Replay>,
    pub(super) desk: Desk,
    pub(super) blobs: BlobDesk,
    /// Channels that it registered to poll.
    pub(super) polls: Vec<ChannelRef>,
    /// The answer to `poll` while it is being given, with its tag.
    pub(super) latest: Option<Box<(u32, Begun)>>,
    /// Whether it waits for a turn.
    pub(super) queued: bool,
    /// Whether it is listed as having something to write.
    pub(super) dirty: bool,
    pub(super) opened: Instant,
    pub(super) heard: Instant,
    /// When the transport last took something.
    pub(super) taken: Instant,
    pub(super) pinged: Instant,
    pub(super) reported: Instant,
    pub(super) frame_begun: Option<Instant>,
    /// When it is to be looked at, if ever.
    pub(super) alarm: Option<Instant>,
    /// Its login failed, and it hears so then: too many failed that came from where it comes from.
    pub(super) login_refused_at: Option<Instant>,
    /// A command that waits because much was announced to everybody just before, and whether it has to wait still.
    pub(super) paced: Option<Box<Tagged<Command>>>,
    pub(super) is_paced: bool,
    /// Whether it is listed as having lost messages.
    pub(super) lossy: bool,
    pub(super) closing: Option<(ClosingReason, Instant)>,
}

impl Connection {
    /// Whether its other end is in this process.
    pub(super) fn is_inside(&self) -> bool {
        matches!(self.origin, Origin::Inside { .. })
    }

    pub(super) fn new(origin: Origin, hub_nonce: Nonce, now: Instant, unfinished: Budget) -> Connection {
        Connection {
            origin,
            inbound: Inbound::new(),
            parts: VecDeque::new(),
            output: Output::default(),
            client_nonce: [0; 32],
            hub_nonce,
            binding: None,
            user: None,
            scram: None,
            rights: Permission::NONE,
            flow: None,
            session: [0; 16],
            resumed: false,
            form: Form::Binary,
            gathering: Gathering::charged_to(unfinished),
            udp: None,
            calls: BTreeMap::new(),
            serving: BTreeSet::new(),
            owned: Vec::new(),
            replay: None,
            desk: Desk::default(),
            blobs: BlobDesk::default(),
            polls: Vec::new(),
            latest: None,
            queued: false,
            dirty: false,
            opened: now,
            heard: now,
            taken: now,
            pinged: now,
            reported: now,
            frame_begun: None,
            alarm: None,
            login_refused_at: None,
            paced: None,
            is_paced: false,
            lossy: false,
            closing: None,
        }
    }

    /// The next command, whether it came as bytes or from inside.
    pub(super) fn next_command(&mut self) -> Result<Option<Tagged<Command>>, ProtocolError> {
        if let Some(again) = self.desk.take_again().or_else(|| self.paced.take().map(|paced| *paced)) {
            return Ok(Some(again));
        }
        match self.inbound.next()? {
            Some(command) => Ok(Some(command)),
            None => self.parts.pop_front().map(|frame| self.inbound.accept(frame)).transpose(),
        }
    }

    /// Whether commands must wait: the connection ends, a list or a message is being told, its answers pile up, it
    /// waits for the disk, it announces too much, or it is synchronous and a call of it has no answer yet.
    pub(super) fn is_held(&self) -> bool {
        self.is_unread() || self.awaits_answer()
    }

    /// Whether nothing more is to be read.
    pub(super) fn is_unread(&self) -> bool {
        self.closing.is_some()
            || self.replay.is_some()
            || self.latest.is_some()
            || self.login_refused_at.is_some()
            || self.is_paced
            || self.output.answers_pile_up()
            || self.desk.is_held()
            || self.blobs.is_held()
    }

    /// Whether something is to be sent.
    pub(super) fn has_output(&self) -> bool {
        let tells = self.replay.as_ref().is_some_and(|replay| !replay.what.waits());
        !self.output.is_empty() || tells || self.latest.is_some() || self.desk.has_news()
    }

    /// Whether later commands wait for the answer to a call. It is read from all the same, so that its end is
    /// seen; a client that waits for an answer sends little.
    pub(super) fn awaits_answer(&self) -> bool {
        self.inbound.state() == State::Synchronous
            && (self.output.has_talks()
                || self.blobs.is_waiting()
                || self.calls.values().any(|call| matches!(call, Call::Open(_))))
    }

    /// Whether input waits that has not been looked at.
    pub(super) fn has_input(&self) -> bool {
        self.inbound.pending() > 0 || !self.parts.is_empty() || self.desk.has_again() || self.paced.is_some()
    }
}

/// All connections of a hub.
#[derive(Debug, Default)]
pub(super) struct Connections {
    slots: Vec<Slot>,
    free: VecDeque<u32>,
    live: usize,
}

#[derive(Debug)]
struct Slot {
    generation: u32,
    connection: Option<Box<Connection>>,
}

impl Connections {
    pub(super) fn add(&mut self, connection: Connection) -> ConnectionId {
        let index = self.free.pop_front().unwrap_or_else(|| {
            self.slots.push(Slot { generation: 0, connection: None });
            (self.slots.len() - 1) as u32
        });
        let slot = &mut self.slots[index as usize];
        slot.generation = slot.generation.checked_add(1).unwrap_or(1);
        slot.connection = Some(Box::new(connection));
        self.live += 1;
        ConnectionId { generation: slot.generation, index }
    }

    pub(super) fn remove(&mut self, id: ConnectionId) -> Option<Box<Connection>> {
        self.get(id)?;
        let removed = self.slots[id.index as usize].connection.take();
        self.free.push_back(id.index);
        self.live -= 1;
        removed
    }

    pub(super) fn get(&self, id: ConnectionId) -> Option<&Connection> {
        let slot = self.slots.get(id.index as usize)?;
        slot.connection.as_deref().filter(|_| slot.generation == id.generation)
    }

    pub(super) fn get_mut(&mut self, id: ConnectionId) -> Option<&mut Connection> {
        let slot = self.slots.get_mut(id.index as usize)?;
        slot.connection.as_deref_mut().filter(|_| slot.generation == id.generation)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (ConnectionId, &Connection)> {
        self.slots.iter().enumerate().filter_map(|(index, slot)| {
            let id = ConnectionId { generation: slot.generation, index: index as u32 };
            Some((id, slot.connection.as_deref()?))
        })
    }

    pub(super) fn ids(&self) -> Vec<ConnectionId> {
        self.iter().map(|(id, _)| id).collect()
    }

    pub(super) fn len(&self) -> usize {
        self.live
    }
}
