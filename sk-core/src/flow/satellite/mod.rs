//! A satellite's side of the protocol without its socket.
//!
//! Received bytes and the present go in with [`SatelliteCore::receive`]; typed events come out of
//! [`SatelliteCore::next_event`]; what is to be sent lies in [`SatelliteCore::slices`]. Names are mapped to
//! references here: a subscription by name waits until the channel exists, and comes into force again when
//! a channel of that name is opened anew.

mod accounts;
mod blobs;
mod channels;
mod creating;
mod databases;
mod event;
mod incoming;
mod sending;
mod services;
mod sync;
#[cfg(test)]
mod tests;
mod udp;

pub use accounts::{AccountInfo, PasswordLogin};
pub use databases::DatabaseInfo;
pub use event::{ChannelInfo, SatelliteError, SatelliteEvent, TickReport};
pub use sync::Divisor;

use super::definition::Encoded;
use super::error::ProtocolError;
use super::fragment::Gathering;
use super::limits::{FRAGMENT_BYTES_MAX, MAGIC, MESSAGE_BYTES_MAX};
use super::limits::{
    LOGIN_TIME_MAX, PING_AFTER, SILENCE_MAX, SUBSCRIPTION_DEPTH_MAX, VERSION, VERSION_OLDEST,
};
use super::login::{Binding, Nonce, OwnerToken};
use super::scram::{ClientExchange, Derivation};
use super::server::Session;
use super::wire::Slices;
use super::{ChannelRef, Command, Event, Form, Inbound, Policy, State};
use bytes::Bytes;
use rustc_hash::FxHashMap;
use sending::{Kind, Outbox};
use services::Incoming;
use sk_flat::{Instant, Name};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// How a satellite logs in.
#[derive(Clone, Debug)]
pub enum Credentials {
    /// By the owner's token; the hub must prove that it knows it too.
    Token(OwnerToken),
    /// By an account's name and password; the hub must prove that it knows the account.
    Password(PasswordLogin),
    /// By the user id of this process, over a Unix socket or from inside the hub.
    Peer,
}

/// A channel of the satellite's own.
#[derive(Debug)]
struct Own {
    listened: bool,
    /// The hub keeps its last message, so that it is worth sending while nobody listens.
    latched: bool,
    credit: Option<Credit>,
    next_message: u32,
}

/// What may be published on a reliable channel.
#[derive(Debug, Default)]
struct Credit {
    used: u64,
    granted: u64,
    /// A message was turned away for want of it.
    wanted: bool,
}

/// A connection to a hub without its socket; see the example of
/// [`ServerCore`](super::server::ServerCore).
#[derive(Debug)]
pub struct SatelliteCore {
    inbound: Inbound<Event>,
    outbox: Outbox,
    credentials: Credentials,
    wants_flow: bool,
    nonce: Nonce,
    hub_nonce: Nonce,
    /// Of an encrypted connection.
    binding: Option<Binding>,
    user: Option<Name>,
    connection: u64,
    /// What to call the flow, or empty.
    flow_name: String,
    /// Of the flow before, whose place this one is to take; then its own.
    session: Session,
    resumed: bool,
    /// The tag of `set_async`, until it is answered.
    becoming: u32,
    /// All channels, for a flow.
    channels: FxHashMap<ChannelRef, ChannelInfo>,
    names: BTreeMap<String, ChannelRef>,
    own: FxHashMap<ChannelRef, Own>,
    /// Names that the user wants to hear, with the policy and the depth.
    wanted: BTreeMap<String, (Policy, u16)>,
    /// Names of sync channels to be followed.
    followed: BTreeMap<String, Divisor>,
    creating: creating::Creating,
    gathering: Gathering<Incoming>,
    /// The tags of open calls.
    calls: BTreeSet<u32>,
    /// The requests that wait for an answer of this satellite's.
    requests: BTreeSet<u64>,
    /// Answers to polls, by tag.
    polled: Gathering<u32>,
    listed: Vec<ChannelInfo>,
    /// A login by password that is under way, and what is to be derived for it.
    scram: Option<ClientExchange>,
    derivation: Option<Derivation>,
    /// The tags of downloads under way.
    downloads: BTreeSet<u32>,
    /// Lists of other things under way, by the tags of their commands.
    lists: BTreeMap<u32, databases::List>,
    /// The full name of the flow, once it is one.
    flow_full_name: Option<String>,
    events: VecDeque<SatelliteEvent>,
    next_tag: u32,
    lost: u64,
    udp: udp::Udp,
    closing: bool,
    opened: Instant,
    heard: Instant,
    pinged: Instant,
}

impl SatelliteCore {
    /// A connection that becomes a flow as soon as it has logged in. `nonce` are 32 bytes from the world's
    /// `Rng`, new for each connection.
    pub fn flow(credentials: Credentials, nonce: Nonce, now: Instant) -> SatelliteCore {
        SatelliteCore::begin(credentials, nonce, true, now)
    }

    /// The same with a name for the flow: the hub calls it `account.name`, and refuses a second one of that name.
    pub fn named(mut self, name: &str) -> SatelliteCore {
        self.name_flow(name);
        self
    }

    /// The same for a core that has not logged in yet; later it is of no effect.
    pub fn name_flow(&mut self, name: &str) {
        name.clone_into(&mut self.flow_name);
    }

    /// The same that takes the place of an earlier flow, if the hub still has that: its name, channels,
    /// subscriptions and current database, with all that waits. The earlier flow's [`session`] proves that it may.
    ///
    /// [`session`]: SatelliteCore::session
    pub fn resuming(mut self, session: Session) -> SatelliteCore {
        self.session = session;
        self
    }

    /// A connection that stays synchronous: for a list, and then to be closed.
    pub fn synchronous(credentials: Credentials, nonce: Nonce, now: Instant) -> SatelliteCore {
        SatelliteCore::begin(credentials, nonce, false, now)
    }

    /// Binds the login to this very connection, which is an encrypted one; before the hub's first frame.
    pub fn bind(&mut self, binding: Binding) {
        self.binding = Some(binding);
    }

    /// The owner's token as this connection uses it.
    fn token_here(&self, token: &OwnerToken) -> OwnerToken {
        self.binding
            .as_ref()
            .map_or_else(|| token.clone(), |binding| token.bound_to(binding))
    }

    fn begin(credentials: Credentials, nonce: Nonce, wants_flow: bool, now: Instant) -> SatelliteCore {
        let mut core = SatelliteCore {
            inbound: Inbound::new(),
            outbox: Outbox::default(),
            credentials,
            wants_flow,
            nonce,
            hub_nonce: [0; 32],
            binding: None,
            user: None,
            connection: 0,
            flow_name: String::new(),
            session: [0; 16],
            resumed: false,
            becoming: 0,
            channels: FxHashMap::default(),
            names: BTreeMap::new(),
            own: FxHashMap::default(),
            wanted: BTreeMap::new(),
            followed: BTreeMap::new(),
            creating: creating::Creating::default(),
            gathering: Gathering::default(),
            polled: Gathering::default(),
            calls: BTreeSet::new(),
            requests: BTreeSet::new(),
            listed: Vec::new(),
            scram: None,
            derivation: None,
            downloads: BTreeSet::new(),
            lists: BTreeMap::new(),
            flow_full_name: None,
            events: VecDeque::new(),
            next_tag: 0,
            lost: 0,
            udp: udp::Udp::default(),
            closing: false,
            opened: now,
            heard: now,
            pinged: now,
        };
        core.greet(FRAGMENT_BYTES_MAX as u32);
        core
    }

    /// Proposes shorter fragments: a transport that is slow keeps what is light waiting for less time then. To be
    /// asked for before the first byte is sent.
    pub fn with_fragments_of(mut self, bytes_max: u32) -> SatelliteCore {
        self.outbox = Outbox::default();
        self.next_tag = 0;
        self.greet(bytes_max);
        self
    }

    fn greet(&mut self, fragment_bytes: u32) {
        self.send(&Command::Hello {
            magic: MAGIC,
            version: VERSION,
            version_oldest: VERSION_OLDEST,
            fragment_bytes,
            message_bytes: MESSAGE_BYTES_MAX as u32,
            nonce: self.nonce,
        });
    }

    /// Takes received bytes; what they say comes out of [`next_event`](SatelliteCore::next_event).
    ///
    /// # Errors
    /// What no honest hub sends; the connection is then to be closed.
    pub fn receive(&mut self, bytes: &[u8], now: Instant) -> Result<(), ProtocolError> {
        self.heard = now;
        self.inbound.feed(bytes);
        while let Some(event) = self.inbound.next()? {
            self.on_event(event)?;
        }
        Ok(())
    }

    /// Takes a frame from a hub in the same process; the payload is not copied.
    ///
    /// # Errors
    /// As [`receive`](SatelliteCore::receive).
    pub fn accept(&mut self, frame: Encoded, now: Instant) -> Result<(), ProtocolError> {
        self.heard = now;
        let event = self.inbound.accept(frame)?;
        self.on_event(event)
    }

    /// The next event.
    pub fn next_event(&mut self) -> Option<SatelliteEvent> {
        self.events.pop_front()
    }

    /// Whether commands may be given.
    pub fn is_ready(&self) -> bool {
        !self.closing
            && self.inbound.state() == if self.wants_flow { State::Flow } else { State::Synchronous }
    }

    /// Whether the hub has answered this core's first frame.
    pub fn has_greeted(&self) -> bool {
        self.inbound.state() != State::Greeting
    }

    /// The account, after the login.
    pub fn user(&self) -> Option<&Name> {
        self.user.as_ref()
    }

    /// The id of this connection at the hub, 0 before the login.
    pub fn connection(&self) -> u64 {
        self.connection
    }

    /// The session of this flow, once it is one: who proves it may take this flow's place.
    pub fn session(&self) -> Session {
        self.session
    }

    /// Whether this flow took the place of an earlier one.
    pub fn is_resumed(&self) -> bool {
        self.resumed
    }

    /// Whether the channel of this full name is this flow's own.
    pub fn owns(&self, name: &str) -> bool {
        self.names.get(name).is_some_and(|channel| self.own.contains_key(channel))
    }

    /// The channel of a full name, for a flow.
    pub fn channel(&self, name: &str) -> Option<&ChannelInfo> {
        self.channels.get(self.names.get(name)?)
    }

    /// The channel of a reference, for a flow.
    pub fn channel_of(&self, channel: ChannelRef) -> Option<&ChannelInfo> {
        self.channels.get(&channel)
    }

    /// All channels by name, for a flow.
    pub fn channels(&self) -> impl Iterator<Item = &ChannelInfo> {
        self.names.values().filter_map(|channel| self.channels.get(channel))
    }

    /// Whether somebody listens to a channel of one's own.
    pub fn is_listened(&self, channel: ChannelRef) -> bool {
        self.own.get(&channel).is_some_and(|own| own.listened)
    }

    /// Whether it is of any use to publish on a channel of one's own: somebody listens, or the hub keeps the
    /// last message for who will.
    pub fn is_worthwhile(&self, channel: ChannelRef) -> bool {
        self.own.get(&channel).is_some_and(|own| own.listened || own.latched)
    }

    /// How many messages were not sent because nobody listened any more, or not received because too many
    /// were unfinished at once.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Publishes a message. Answers `false`, having sent nothing, while nobody listens and the channel has no
    /// latch.
    ///
    /// # Errors
    /// If the channel is not one's own, the message is too long, or too much waits, here or, of a reliable
    /// channel, for its slowest subscriber: then nothing is sent. After the latter `Room` says when to go on.
    pub fn publish(&mut self, channel: ChannelRef, payload: Bytes) -> Result<bool, SatelliteError> {
        let max = self.inbound.message_bytes_max();
        let own = self.own.get_mut(&channel).ok_or(SatelliteError::NotOwn(channel))?;
        if payload.len() > max {
            return Err(SatelliteError::TooLong { length: payload.len(), max });
        }
        if !own.listened && !own.latched {
            return Ok(false);
        }
        let cost = self.outbox.charge(payload.len()) as u64;
        if let Some(credit) = &mut own.credit
            && credit.used >= credit.granted
        {
            credit.wanted = true;
            return Err(SatelliteError::Full);
        }
        if !self
            .outbox
            .message(Kind::Publish { channel, message: own.next_message }, payload)
        {
            return Err(SatelliteError::Full);
        }
        if let Some(credit) = &mut own.credit {
            credit.used += cost;
        }
        own.next_message = own.next_message.wrapping_add(1);
        Ok(true)
    }

    /// Wants to hear the channel of this full name, now or when it will exist: the newest messages, of which
    /// at most `depth` wait at the hub, 0 for its default.
    ///
    /// # Errors
    /// If the name cannot be, or the connection is no ready flow.
    pub fn subscribe(&mut self, name: &str, depth: u16) -> Result<(), SatelliteError> {
        self.subscribe_as(name, Policy::Latest, depth)
    }

    /// As [`subscribe`](SatelliteCore::subscribe), with a policy. With `All`, the hub ends the connection when
    /// more than `depth` messages wait.
    ///
    /// # Errors
    /// As [`subscribe`](SatelliteCore::subscribe).
    pub fn subscribe_as(&mut self, name: &str, policy: Policy, depth: u16) -> Result<(), SatelliteError> {
        self.need_flow("subscribe")?;
        Name::new(name)?;
        let depth = depth.min(SUBSCRIPTION_DEPTH_MAX);
        if let Some(channel) = self.names.get(name).copied() {
            self.command(&hear(channel, policy, depth))?;
        }
        self.wanted.insert(name.to_owned(), (policy, depth));
        Ok(())
    }

    /// Wants to hear a channel no more.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn unsubscribe(&mut self, name: &str) -> Result<(), SatelliteError> {
        self.need_flow("unsubscribe")?;
        let known = self.names.get(name).copied();
        if let (Some(_), Some(channel)) = (self.wanted.remove(name), known) {
            self.command(&Command::Unsubscribe { channel })?;
        }
        Ok(())
    }

    /// Ends a subscription that this flow took over with its place and does not want.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn renounce(&mut self, name: &str) -> Result<(), SatelliteError> {
        self.need_flow("unsubscribe")?;
        if let Some(channel) = self.names.get(name).copied() {
            self.command(&Command::Unsubscribe { channel })?;
        }
        Ok(())
    }

    /// Asks for a list of all channels; `Listed` with the tag answers.
    ///
    /// # Errors
    /// If the connection is not a ready synchronous one.
    pub fn list(&mut self) -> Result<u32, SatelliteError> {
        if self.wants_flow || !self.is_ready() {
            return Err(SatelliteError::State("list_channels"));
        }
        self.command(&Command::ListChannels { form: Form::Binary })
    }

    /// Asks whether the hub is there; `Pong` with the tag answers.
    ///
    /// # Errors
    /// If the connection is not ready.
    pub fn ping(&mut self) -> Result<u32, SatelliteError> {
        if !self.is_ready() {
            return Err(SatelliteError::State("ping"));
        }
        self.command(&Command::Ping {})
    }

    /// Looks at the deadlines: pings a silent hub, gives it up in the end.
    ///
    /// # Errors
    /// `Silent`; the connection is then to be closed.
    pub fn tick(&mut self, now: Instant) -> Result<(), SatelliteError> {
        let silence = now.since(self.heard);
        let early = self.inbound.state() < State::Synchronous;
        if silence >= SILENCE_MAX || early && now.since(self.opened) >= LOGIN_TIME_MAX {
            return Err(SatelliteError::Silent);
        }
        if !early && silence >= PING_AFTER && now.since(self.pinged) >= PING_AFTER {
            self.pinged = now;
            self.send(&Command::Ping {});
        }
        Ok(())
    }

    /// Whether something is to be sent.
    pub fn has_output(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// The next bytes for the transport, for one vectored write of at most `slices_max` parts.
    pub fn slices(&mut self, slices_max: usize) -> Slices<'_> {
        self.outbox.fill();
        self.outbox.wire().slices(slices_max)
    }

    /// Notes that the transport took the first `count` bytes.
    pub fn wrote(&mut self, count: usize) {
        self.outbox.wire().wrote(count, |()| ());
    }

    /// Takes the next whole frame, for a hub in the same process.
    pub fn take(&mut self) -> Option<Encoded> {
        self.outbox.fill();
        self.outbox.wire().take().map(|(frame, ())| frame)
    }

    fn is_flow(&self) -> bool {
        self.wants_flow && self.is_ready()
    }

    fn need_flow(&self, command: &'static str) -> Result<(), SatelliteError> {
        if self.is_flow() { Ok(()) } else { Err(SatelliteError::State(command)) }
    }

    fn tag(&mut self) -> u32 {
        // 0 means "no answer", so it is passed over.
        self.next_tag = self.next_tag.wrapping_add(1).max(1);
        self.next_tag
    }

    fn command(&mut self, command: &Command) -> Result<u32, SatelliteError> {
        let tag = self.tag();
        if self.outbox.command(command, tag) { Ok(tag) } else { Err(SatelliteError::Full) }
    }

    /// A command of the connection itself: the little queue of the beginning always has room for it.
    fn send(&mut self, command: &Command) -> u32 {
        let tag = self.tag();
        self.outbox.command(command, tag);
        tag
    }
}

/// The command for a subscription to a streaming channel.
fn hear(channel: ChannelRef, policy: Policy, depth: u16) -> Command {
    Command::Subscribe { channel, policy, depth, divisor: 1 }
}
