//! The hub's side of the protocol without its sockets.
//!
//! Connections are ids. Received bytes and the present go in; frames queue up for each connection, and
//! [`Notice`]s for whoever runs the hub. A transport does this for each connection:
//!
//! - [`ServerCore::open`] when it was accepted, with 32 random bytes;
//! - [`ServerCore::receive`] with what it read, as long as [`ServerCore::wants_input`] says so;
//! - for those that [`ServerCore::take_dirty`] names, [`ServerCore::slices`] to the socket and
//!   [`ServerCore::wrote`] with what the socket took;
//! - [`ServerCore::left`] at the end of its stream; and it closes at [`Notice::Ended`].
//!
//! Once a round the loop calls [`ServerCore::work`] for commands that waited for their turn and
//! [`ServerCore::tick`] for deadlines.

mod access;
mod blobs;
mod channels;
mod connection;
mod databases;
mod inspect;
mod notice;
mod refusing;
mod services;
mod sync;
#[cfg(test)]
mod tests;
mod turn;
mod unfinished;

pub use access::accounts::AccountsError;
pub use access::sessions::Session;
pub use channels::udp::DatagramCounts;
pub use connection::identity::{ConnectionId, Ending, Origin};
pub use notice::Notice;
pub use services::requests::RequestId;

use super::channel::{Channel, Owner, Registry};
use super::database::{DatabaseKind, DatabaseName, Databases, Entity};
use super::definition::Encoded;
use super::delivery::{Budget, Charge, Counts, DropReason};
use super::error::{ClosingReason, ProtocolError};
use super::frame::Flags;
use super::limits::{
    CHECK_INTERVAL, CONNECTIONS_MAX, FRAGMENT_BYTES_MAX, LINGER_TIME_MAX, LOG_LINES_PER_SECOND_MAX,
    LOGIN_TIME_MAX, UNAUTHENTICATED_MAX, UNFINISHED_BYTES_MAX_IN_ALL,
};
use super::login::{Binding, Nonce, OwnerToken};
use super::wire::Slices;
use super::{ChannelRef, Event, Message, State};
use access::accounts::Accounts;
use access::sessions::Sessions;
use blobs::desk::Filing;
use channels::audience::Subscribers;
use channels::pacing::Announced;
use channels::udp::Udp;
use connection::addresses::Addresses;
use connection::alarms::Alarms;
use connection::{Connection, Connections};
use databases::selected::Selected;
use databases::storing::Storing;
use notice::LogLimit;
use services::requests::Requests;
use sk_flat::{Instant, Name};
use std::collections::{BTreeMap, VecDeque};
use sync::Clock;
use thiserror::Error;

/// How a hub lets people in.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The name of the owner's account; it begins the names of the account's channels and has no dot.
    pub user: Name,
    /// The owner's token; without one nobody can log in by token.
    pub token: Option<OwnerToken>,
    /// The user id whose processes may log in over a Unix socket.
    pub owner_uid: Option<u32>,
}

/// The hub has no place for another connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("the hub serves {CONNECTIONS_MAX} connections already")]
pub struct TooManyConnections;

/// A hub without sockets.
///
/// ```
/// use sk_core::flow::server::{Origin, ServerCore, Settings};
/// use sk_core::flow::{Properties, satellite::{Credentials, SatelliteCore, SatelliteEvent}};
/// use sk_flat::Instant;
///
/// let settings = Settings { user: "robot".parse()?, token: None, owner_uid: Some(1000) };
/// let mut hub = ServerCore::new(settings, Instant::ZERO);
/// let connection = hub.open(Origin::Unix { uid: 1000 }, [1; 32], Instant::ZERO)?;
/// let mut satellite = SatelliteCore::flow(Credentials::Peer, [2; 32], Instant::ZERO);
///
/// // What two sockets would do.
/// for _ in 0..4 {
///     while let Some(frame) = satellite.take() {
///         hub.receive(connection, &frame.to_vec(), Instant::ZERO);
///     }
///     while let Some(frame) = hub.take(connection) {
///         satellite.receive(&frame.to_vec(), Instant::ZERO)?;
///     }
/// }
/// assert!(matches!(satellite.next_event(), Some(SatelliteEvent::LoggedIn { .. })));
/// assert!(matches!(satellite.next_event(), Some(SatelliteEvent::Ready)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ServerCore {
    settings: Settings,
    accounts: Accounts,
    connections: Connections,
    channels: Registry<Subscribers>,
    databases: Databases,
    selected: Selected,
    storing: Storing,
    filing: Filing,
    /// The command that is being carried out, by its name in the table.
    asked: Option<&'static str>,
    /// Connections with commands that wait for their turn.
    work: VecDeque<ConnectionId>,
    dirty: Vec<ConnectionId>,
    notices: VecDeque<Notice>,
    /// Connections to be closed when the call under way has done its part.
    to_close: VecDeque<(ConnectionId, ClosingReason)>,
    /// The counts of subscriptions that ended.
    ended: Counts,
    /// What waits and is kept in all, shared payloads counted once.
    budget: Budget,
    /// Of that, what is held of unfinished messages.
    unfinished: Budget,
    /// What is kept for late joiners and those who poll.
    kept: usize,
    sessions: Sessions,
    udp: Udp,
    addresses: Addresses,
    alarms: Alarms,
    /// Connections that lost messages and were not told yet.
    lossy: Vec<ConnectionId>,
    /// How many connections wait for their login.
    waiting: usize,
    /// Those, in the order in which they came, and among them some that wait no more.
    newcomers: VecDeque<ConnectionId>,
    late_fragments: u64,
    /// The open requests to services.
    requests: Requests,
    /// Those of them that the hub itself is to answer.
    serving: BTreeMap<RequestId, Charge>,
    unmatched_answers: u64,
    /// What everybody was told just now, and who waits with more.
    announced: Announced,
    /// The sync channels and their targets.
    clocks: BTreeMap<ChannelRef, Clock>,
    spurious: u64,
    /// Logins over TLS must be bound to their connection.
    must_bind: bool,
    log: LogLimit,
    started: Instant,
    now: Instant,
    next_check: Instant,
    pings: u32,
    next_own_message: u32,
}

impl ServerCore {
    /// A hub with nobody connected.
    pub fn new(settings: Settings, now: Instant) -> ServerCore {
        let budget = Budget::default();
        let mut core = ServerCore {
            accounts: Accounts::new(settings.token.as_ref()),
            settings,
            connections: Connections::default(),
            channels: Registry::default(),
            databases: Databases::default(),
            selected: Selected::default(),
            storing: Storing::default(),
            filing: Filing::default(),
            asked: None,
            work: VecDeque::new(),
            dirty: Vec::new(),
            notices: VecDeque::new(),
            to_close: VecDeque::new(),
            ended: Counts::default(),
            unfinished: budget.part(UNFINISHED_BYTES_MAX_IN_ALL),
            budget,
            kept: 0,
            sessions: Sessions::default(),
            udp: Udp::default(),
            addresses: Addresses::default(),
            alarms: Alarms::default(),
            lossy: Vec::new(),
            waiting: 0,
            newcomers: VecDeque::new(),
            late_fragments: 0,
            requests: Requests::default(),
            serving: BTreeMap::new(),
            unmatched_answers: 0,
            announced: Announced::default(),
            clocks: BTreeMap::new(),
            spurious: 0,
            must_bind: false,
            log: LogLimit::new(LOG_LINES_PER_SECOND_MAX),
            started: now,
            now,
            next_check: now + CHECK_INTERVAL,
            pings: 0,
            next_own_message: 0,
        };
        let owner = core.settings.user.clone();
        core.entity_began(DatabaseKind::User, &owner, Entity::User);
        core.databases.add_entity(DatabaseName::accounts(), Entity::Hub);
        core
    }

    /// Takes a new connection in; `nonce` are 32 bytes from the world's `Rng`. If too many wait for their
    /// login, the oldest of the address that has most of them goes.
    ///
    /// # Errors
    /// If the hub is full. The transport then closes the socket.
    pub fn open(
        &mut self,
        origin: Origin,
        nonce: Nonce,
        now: Instant,
    ) -> Result<ConnectionId, TooManyConnections> {
        self.now = now;
        if self.connections.len() >= CONNECTIONS_MAX {
            return Err(TooManyConnections);
        }
        if self.waiting >= UNAUTHENTICATED_MAX {
            self.evict();
        }
        self.databases.stir(&nonce);
        let id = self
            .connections
            .add(Connection::new(origin, nonce, now, self.unfinished.clone()));
        self.waiting += 1;
        while let Some(first) = self.newcomers.front()
            && !self.connections.get(*first).is_some_and(is_waiting)
        {
            self.newcomers.pop_front();
        }
        self.newcomers.push_back(id);
        self.look_at(id, now + LOGIN_TIME_MAX);
        self.settle();
        Ok(id)
    }

    /// Notes what a login of this connection, which is an encrypted one, can be bound to; before the login.
    pub fn bind(&mut self, id: ConnectionId, binding: Binding) {
        if let Some(connection) = self.connections.get_mut(id)
            && connection.user.is_none()
        {
            connection.binding = Some(binding);
        }
    }

    /// Whether a connection has neither logged in nor been bound.
    pub fn is_unbound(&self, id: ConnectionId) -> bool {
        self.connections
            .get(id)
            .is_some_and(|connection| connection.user.is_none() && connection.binding.is_none())
    }

    /// Lets nobody log in over an encrypted connection whose login is not bound to it, from here on. Satellites in
    /// Python cannot bind theirs.
    pub fn require_channel_binding(&mut self, required: bool) {
        self.must_bind = required;
    }

    /// Whether one more connection may come from there now; to be asked before [`open`](ServerCore::open). A
    /// storm from one address is turned away as cheaply as can be, and does not shut out others.
    pub fn admits(&mut self, origin: Origin, now: Instant) -> bool {
        self.addresses.admit(origin, now)
    }

    /// Notes that the peer, or the transport, ended a connection.
    pub fn left(&mut self, id: ConnectionId, now: Instant) {
        self.now = now;
        self.finish(id, Ending::Left);
        self.settle();
    }

    /// Whether the transport should read more from this connection.
    pub fn wants_input(&self, id: ConnectionId) -> bool {
        self.connections.get(id).is_some_and(|connection| {
            !connection.is_unread()
                && !connection.queued
                && connection.parts.is_empty()
                && connection.inbound.pending() <= 2 * FRAGMENT_BYTES_MAX
        })
    }

    /// The connections that got something to write since the last call.
    pub fn take_dirty(&mut self) -> impl Iterator<Item = ConnectionId> + '_ {
        for id in &self.dirty {
            if let Some(connection) = self.connections.get_mut(*id) {
                connection.dirty = false;
            }
        }
        self.dirty.drain(..)
    }

    /// Whether [`take_dirty`](ServerCore::take_dirty) would name any.
    pub fn has_dirty(&self) -> bool {
        !self.dirty.is_empty()
    }

    /// Whether commands wait for [`work`](ServerCore::work).
    pub fn has_work(&self) -> bool {
        !self.work.is_empty()
    }

    /// Whether a connection has something to write.
    pub fn has_output(&self, id: ConnectionId) -> bool {
        self.connections.get(id).is_some_and(Connection::has_output)
    }

    /// The next bytes for the transport, for one vectored write of at most `slices_max` parts.
    pub fn slices(&mut self, id: ConnectionId, slices_max: usize) -> Slices<'_> {
        self.fill(id);
        self.connections
            .get(id)
            .map(|connection| connection.output.wire().slices(slices_max))
            .unwrap_or_default()
    }

    /// Notes that the transport took the first `count` bytes.
    pub fn wrote(&mut self, id: ConnectionId, count: usize, now: Instant) {
        self.now = now;
        if let Some(connection) = self.connections.get_mut(id) {
            connection.taken = now;
            connection.output.wrote(count);
            self.after_output(id);
        }
    }

    /// Takes the next whole frame, for a transport inside the process: the payload is not copied. It
    /// counts as delivered.
    pub fn take(&mut self, id: ConnectionId) -> Option<Encoded> {
        self.fill(id);
        let connection = self.connections.get_mut(id)?;
        connection.taken = self.now;
        let frame = connection.output.take();
        self.after_output(id);
        frame
    }

    /// The next notice.
    pub fn next_notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    /// Ends every connection with `Closing{Shutdown}`. Nothing new is taken in by those that go.
    pub fn shut_down(&mut self, now: Instant) {
        self.now = now;
        for id in self.connections.ids() {
            self.close(id, ClosingReason::Shutdown);
        }
        self.settle();
    }

    /// How many connections come from inside the process.
    pub fn insiders(&self) -> usize {
        self.connections.iter().filter(|(_, connection)| connection.is_inside()).count()
    }

    /// How many connections there are, those that close included.
    pub fn connections(&self) -> usize {
        self.connections.len()
    }

    /// The state of a connection and the account it logged in to.
    pub fn connection(&self, id: ConnectionId) -> Option<(State, Option<&Name>)> {
        self.connections
            .get(id)
            .map(|connection| (connection.inbound.state(), connection.user.as_ref()))
    }

    /// All channels by identifier, each with the number of its subscribers.
    pub fn channels(&self) -> impl Iterator<Item = (&Channel, usize)> {
        self.channels
            .iter()
            .map(|(channel, subscribers)| (channel, subscribers.list.len()))
    }

    /// The counts of a live subscription.
    pub fn counts(&self, id: ConnectionId, channel: ChannelRef) -> Option<&Counts> {
        self.connections.get(id)?.output.counts(channel)
    }

    /// The sum of the counts of all subscriptions, live and ended.
    pub fn totals(&self) -> Counts {
        let mut sum = self.ended;
        self.connections
            .iter()
            .for_each(|(_, connection)| connection.output.add_counts(&mut sum));
        sum
    }

    /// Lets this hub hold no more bytes than that for all connections together, and half of it of unfinished
    /// messages; 256 MiB are what it may hold otherwise.
    pub fn narrow_bytes(&mut self, bytes_max: usize) {
        self.budget.narrow(bytes_max);
        self.unfinished.narrow(bytes_max / 2);
    }

    /// How many bytes wait for all connections, are kept, or are held of unfinished messages, requests and
    /// answers, shared payloads counted once.
    pub fn bytes_waiting(&self) -> usize {
        self.budget.used()
    }

    /// How many fragments came for channels that were gone or not their sender's, or for calls that were over,
    /// and were dropped.
    pub fn late_fragments(&self) -> u64 {
        self.late_fragments
    }

    /// How many connections were killed as spurious.
    pub fn spurious(&self) -> u64 {
        self.spurious
    }

    /// Sends a control frame. A peer that lets too many pile up is closed at the end of the call.
    fn send(&mut self, id: ConnectionId, frame: Encoded) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        if connection.closing.is_none() && !connection.output.control(frame) {
            self.to_close.push_back((id, ClosingReason::ControlFull));
        }
        self.mark_dirty(id);
    }

    fn answer(&mut self, id: ConnectionId, tag: u32, event: &Event) {
        self.send(id, event.encode(tag, Flags::NONE));
    }

    fn mark_dirty(&mut self, id: ConnectionId) {
        if let Some(connection) = self.connections.get_mut(id)
            && !connection.dirty
        {
            connection.dirty = true;
            self.dirty.push(id);
        }
    }

    /// Kills a connection for what it sent. Nobody else is touched.
    fn kill(&mut self, id: ConnectionId, error: ProtocolError) {
        let Some(connection) = self.connections.get(id) else { return };
        self.spurious += 1;
        if let Some(silenced) = self.log.pass(self.now) {
            let (origin, state) = (connection.origin, connection.inbound.state());
            tracing::warn!(connection = %id, %origin, %state, silenced, "Killing spurious client: {error}");
        }
        self.finish(id, Ending::Spurious(error));
    }

    /// Ends a connection that did nothing dishonest: its last frame says why, where it can.
    fn close(&mut self, id: ConnectionId, reason: ClosingReason) {
        if self.connections.get(id).is_none_or(|connection| connection.closing.is_some()) {
            return;
        }
        let dropped = if reason == ClosingReason::Shutdown { DropReason::Shutdown } else { DropReason::Gone };
        self.clear(id, dropped);
        let deadline = self.now + LINGER_TIME_MAX;
        let last = Event::Closing { reason: reason.code(), text: reason.to_string() }.encode(0, Flags::NONE);
        if let Some(connection) = self.connections.get_mut(id) {
            self.waiting -= usize::from(is_waiting(connection));
            connection.output.end_with(last);
            connection.replay = None;
            connection.latest = None;
            connection.closing = Some((reason, deadline));
            self.alarms.set(id, &mut connection.alarm, deadline);
            self.mark_dirty(id);
        }
    }

    /// Ends a connection at once.
    fn finish(&mut self, id: ConnectionId, ending: Ending) {
        self.clear(id, DropReason::Gone);
        if let Some(connection) = self.connections.remove(id) {
            self.waiting -= usize::from(is_waiting(&connection));
            self.notices.push_back(Notice::Ended { connection: id, ending });
        }
    }

    /// Removes what belongs to a connection: its calls, its channels, its subscriptions and what it polls.
    fn clear(&mut self, id: ConnectionId, reason: DropReason) {
        self.end_calls_of(id);
        self.end_session(id);
        self.end_udp_session(id);
        let Some(connection) = self.connections.get_mut(id) else { return };
        let owned = std::mem::take(&mut connection.owned);
        let subscribed = connection.output.channels();
        self.leave_databases(id);
        for channel in owned {
            self.remove_channel(channel, None, reason);
        }
        for channel in subscribed {
            self.end_subscription(id, channel, reason);
        }
        self.end_all_polling(id);
    }

    /// Does what must not happen in the middle of a call: closes those whose control queue ran over. Each
    /// closing tells others and may make more.
    fn settle(&mut self) {
        while let Some((id, reason)) = self.to_close.pop_front() {
            self.close(id, reason);
        }
    }

    fn after_output(&mut self, id: ConnectionId) {
        self.fill(id);
        self.go_on_reading(id);
        self.give_credit(id);
        let Some(connection) = self.connections.get(id) else { return };
        if let Some((reason, _)) = connection.closing {
            if connection.output.is_empty() {
                self.finish(id, Ending::Closed(reason));
            }
        } else if connection.has_input() && !connection.is_held() {
            self.enqueue(id);
        }
        self.settle();
    }

    fn enqueue(&mut self, id: ConnectionId) {
        if let Some(connection) = self.connections.get_mut(id)
            && !connection.queued
        {
            connection.queued = true;
            self.work.push_back(id);
        }
    }
}

/// Whether a connection counts as waiting for its login.
fn is_waiting(connection: &Connection) -> bool {
    connection.user.is_none() && connection.closing.is_none()
}

/// The flow that owns a channel, if no hub does.
fn owning_flow(connections: &Connections, owner: Owner) -> Option<ConnectionId> {
    let Owner::Flow(wire) = owner else { return None };
    let id = ConnectionId::from_wire(wire);
    connections.get(id).map(|_| id)
}
