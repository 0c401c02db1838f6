//! What each event of the hub does to a satellite.

use super::super::delivery::DropReason;
use super::super::error::ProtocolError;
use super::super::fragment::{Gathered, joined};
use super::super::limits::{FRAGMENT_BYTES_MIN, MAGIC, VERSION, VERSION_OLDEST};
use super::super::server::Session;
use super::super::{ChannelRef, Command, Event, Flags, Form, Tagged};
use super::sending::Stream;
use super::services::{Asked, Incoming};
use super::{ChannelInfo, Credentials, Credit, Own, SatelliteCore, SatelliteEvent, TickReport, hear};
use bytes::Bytes;
use sk_flat::Name;
use std::time::Duration;

impl Own {
    /// A channel that nobody listens to yet. Of a reliable one the hub says what may be published.
    fn of(info: &ChannelInfo) -> Own {
        Own {
            listened: false,
            latched: info.properties.is_latched(),
            credit: info.properties.is_reliable().then(Credit::default),
            next_message: 0,
        }
    }
}

impl SatelliteCore {
    pub(super) fn on_event(&mut self, tagged: Tagged<Event>) -> Result<(), ProtocolError> {
        let Tagged { tag, flags, message } = tagged;
        match message {
            Event::Welcome { magic, version, fragment_bytes, message_bytes, nonce } => {
                self.welcomed(magic, version, fragment_bytes, message_bytes)?;
                self.hub_nonce = nonce;
                self.log_in();
            }
            Event::LoggedIn { connection, user, proof } => self.logged_in(connection, user, &proof)?,
            Event::ScramChallenge { message } => self.on_challenge(&message)?,
            Event::Ping {} => {
                self.outbox.command(&Command::Pong {}, tag);
            }
            Event::Pong {} => self.events.push_back(SatelliteEvent::Pong { tag }),
            Event::FlowBegun { name, session, resumed, .. } => {
                self.flow_full_name = Some(name);
                self.flow_begun(session, resumed != 0);
            }
            Event::ChannelListed { channel, kind, hash, owner, name, properties } => {
                self.listed.push(ChannelInfo { channel, kind, hash, owner, name, properties });
            }
            Event::ListEnd { .. } if self.end_list(tag) => {}
            Event::ListEnd { .. } => {
                let channels = std::mem::take(&mut self.listed);
                self.events.push_back(SatelliteEvent::Listed { tag, channels });
            }
            Event::ChannelAdded { channel, kind, hash, owner, name, properties } => {
                self.added(tag, ChannelInfo { channel, kind, hash, owner, name, properties });
            }
            Event::ChannelRemoved { channel } => self.removed(channel),
            Event::StartPublishing { channel } => self.listened(channel, true),
            Event::StopPublishing { channel } => self.listened(channel, false),
            Event::Data { channel, message, payload } => self.data(channel, message, flags, payload)?,
            Event::Dropped { channel, reason, total } => {
                let reason = DropReason::from_wire(reason);
                self.events.push_back(SatelliteEvent::Dropped { channel, reason, total });
            }
            Event::Subscribed { channel } => self.events.push_back(SatelliteEvent::Subscribed(channel)),
            Event::Unsubscribed { channel } => {
                self.gathering.forget(Incoming::Data(channel));
                self.events.push_back(SatelliteEvent::Unsubscribed(channel));
            }
            Event::Done {} => self.events.push_back(SatelliteEvent::Done { tag }),
            Event::Saved {} => self.events.push_back(SatelliteEvent::Saved { tag }),
            Event::Flag { value } => self.events.push_back(SatelliteEvent::Flag { tag, value: value != 0 }),
            Event::Value { value } => self.events.push_back(SatelliteEvent::Value { tag, value }),
            Event::HeaderChanged { channel, properties } => {
                if let Some(info) = self.channels.get_mut(&channel) {
                    info.properties = properties;
                    if let Some(own) = self.own.get_mut(&channel) {
                        own.latched = info.properties.is_latched();
                    }
                    let info = info.clone();
                    self.events.push_back(SatelliteEvent::HeaderChanged { tag, info });
                }
            }
            Event::OwnerChanged { channel, owner } => {
                if let Some(info) = self.channels.get_mut(&channel) {
                    info.owner = owner;
                    self.events.push_back(SatelliteEvent::OwnerChanged(info.clone()));
                }
            }
            Event::Request { channel, request, asker, payload } => {
                self.on_request(flags, Asked { channel, request, asker }, payload)?;
            }
            Event::Tick { channel, sequence } => {
                self.events.push_back(SatelliteEvent::Tick { channel, sequence });
            }
            Event::TickReport { channel, target, lag_ns, done, missed, divisor } => {
                let report = TickReport {
                    channel,
                    target,
                    is_own: target == self.connection,
                    lag: Duration::from_nanos(lag_ns),
                    done,
                    missed,
                    divisor,
                };
                self.events.push_back(SatelliteEvent::TickReport(report));
            }
            Event::RequestOver { request } => self.on_request_over(request),
            Event::Reply { more, payload } => self.on_reply(tag, flags, more, payload)?,
            Event::Attached { replica, source } => {
                self.events.push_back(SatelliteEvent::Attached { tag, replica, source });
            }
            Event::Detached { replica, source } => {
                self.events.push_back(SatelliteEvent::Detached { tag, replica, source });
            }
            Event::Latest { channel, message, payload } => {
                self.latest(tag, flags, channel, message, payload)?
            }
            Event::Credit { channel, bytes } => self.credited(channel, bytes),
            Event::UdpOpened { session, key, port } => self.udp_opened(tag, session, key, port),
            Event::Refused { code, text } => {
                if let Some(asked) = self.creating.answered(tag) {
                    self.creation_answered(asked, None);
                }
                self.on_call_over(tag);
                self.lists.remove(&tag);
                self.on_blob_refused(tag);
                if tag != 0 && tag == self.becoming {
                    // This connection can become nothing any more.
                    self.closing = true;
                }
                self.events.push_back(SatelliteEvent::Refused { tag, code, text });
            }
            event @ (Event::BlobResume { .. }
            | Event::BlobListed { .. }
            | Event::BlobEntry { .. }
            | Event::BlobData { .. }) => self.on_blob_event(tag, flags, event),
            event @ (Event::UserListed { .. }
            | Event::DatabaseSelected { .. }
            | Event::DatabaseListed { .. }
            | Event::KeyListed { .. }
            | Event::Variable { .. }
            | Event::Changed { .. }
            | Event::Deleted { .. }
            | Event::Watching { .. }
            | Event::WatchOver {}) => self.on_database_event(tag, event),
            Event::Closing { reason, text } => {
                self.closing = true;
                self.events.push_back(SatelliteEvent::Closing { reason, text });
            }
        }
        Ok(())
    }

    fn welcomed(
        &mut self,
        magic: [u8; 8],
        version: u16,
        fragment: u32,
        message: u32,
    ) -> Result<(), ProtocolError> {
        let bad =
            |field, value: u32| Err(ProtocolError::BadValue { kind: "welcome", field, value: value.into() });
        if magic != MAGIC {
            return Err(ProtocolError::NotFlow);
        }
        if !(VERSION_OLDEST..=VERSION).contains(&version) {
            return bad("version", version.into());
        }
        if (fragment as usize) < FRAGMENT_BYTES_MIN || fragment as usize > self.inbound.fragment_bytes_max() {
            return bad("fragment_bytes", fragment);
        }
        if message < fragment || message as usize > self.inbound.message_bytes_max() {
            return bad("message_bytes", message);
        }
        self.inbound.agree(fragment, message);
        self.outbox.fragment_bytes_max = fragment as usize;
        self.inbound.advance();
        Ok(())
    }

    fn log_in(&mut self) {
        let command = match &self.credentials {
            Credentials::Token(token) => Command::LoginToken {
                proof: self.token_here(token).client_proof(&self.nonce, &self.hub_nonce),
            },
            Credentials::Password(login) => {
                let user = login.user().clone();
                self.begin_scram(&user)
            }
            Credentials::Peer => Command::LoginPeer {},
        };
        self.send(&command);
    }

    fn logged_in(&mut self, connection: u64, user: String, proof: &[u8; 32]) -> Result<(), ProtocolError> {
        let true_hub = match &self.credentials {
            Credentials::Token(token) => {
                self.token_here(token).hub_is_true(&self.nonce, &self.hub_nonce, proof)
            }
            Credentials::Password(_) => self.scram.take().is_some_and(|exchange| exchange.hub_is_true(proof)),
            Credentials::Peer => true,
        };
        if !true_hub {
            return Err(ProtocolError::FalseHub);
        }
        let bad = |_| ProtocolError::BadValue { kind: "logged_in", field: "user", value: user.len() as u64 };
        self.user = Some(Name::new(&user).map_err(bad)?);
        self.connection = connection;
        self.inbound.advance();
        self.events.push_back(SatelliteEvent::LoggedIn { user, connection });
        if self.wants_flow {
            let name = self.flow_name.clone();
            self.becoming = self.send(&Command::SetAsync { name, session: self.session, form: Form::Binary });
        } else {
            self.events.push_back(SatelliteEvent::Ready);
        }
        Ok(())
    }

    fn flow_begun(&mut self, session: Session, resumed: bool) {
        self.inbound.advance();
        self.becoming = 0;
        (self.session, self.resumed) = (session, resumed);
        let inherited: Vec<ChannelInfo> =
            self.channels().filter(|info| info.owner == self.connection).cloned().collect();
        for info in inherited {
            self.own.insert(info.channel, Own::of(&info));
            let (channel, name) = (info.channel, info.name);
            self.events.push_back(SatelliteEvent::Created { tag: 0, channel, name });
        }
        self.events.push_back(SatelliteEvent::Ready);
    }

    fn added(&mut self, tag: u32, info: ChannelInfo) {
        let channel = info.channel;
        self.names.insert(info.name.clone(), channel);
        self.channels.insert(channel, info.clone());
        let asked = self.creating.answered(tag).filter(|_| info.owner == self.connection);
        let created = asked.is_some_and(|asked| self.creation_answered(asked, Some(channel)));
        let name = info.name.clone();
        if let Some((policy, depth)) = self.wanted.get(&name) {
            let command = hear(channel, *policy, *depth);
            self.send(&command);
        }
        let own = created.then(|| Own::of(&info));
        self.follow_if_wanted(&info);
        self.events.push_back(SatelliteEvent::ChannelAdded(info));
        if let Some(own) = own {
            self.own.insert(channel, own);
            self.events.push_back(SatelliteEvent::Created { tag, channel, name });
        }
    }

    fn removed(&mut self, channel: ChannelRef) {
        self.own.remove(&channel);
        self.lost += self.outbox.forget(Stream::Channel(channel)) as u64;
        self.outbox.forget(Stream::Upload(channel));
        self.gathering.forget(Incoming::Data(channel));
        if let Some(info) = self.channels.remove(&channel) {
            if self.names.get(&info.name) == Some(&channel) {
                self.names.remove(&info.name);
            }
            self.events.push_back(SatelliteEvent::ChannelRemoved(info));
        }
    }

    fn listened(&mut self, channel: ChannelRef, listened: bool) {
        let Some(own) = self.own.get_mut(&channel) else { return };
        own.listened = listened;
        if listened {
            self.events.push_back(SatelliteEvent::StartPublishing(channel));
        } else {
            if !own.latched {
                let (count, cost) = self.outbox.stop(channel);
                self.lost += count as u64;
                if let Some(credit) = &mut own.credit {
                    credit.used -= cost as u64;
                }
            }
            self.events.push_back(SatelliteEvent::StopPublishing(channel));
        }
    }

    fn credited(&mut self, channel: ChannelRef, bytes: u64) {
        let Some(own) = self.own.get_mut(&channel) else { return };
        let credit = own.credit.get_or_insert_default();
        credit.granted = bytes;
        if credit.used < bytes && std::mem::take(&mut credit.wanted) {
            self.events.push_back(SatelliteEvent::Room(channel));
        }
    }

    fn latest(
        &mut self,
        tag: u32,
        flags: Flags,
        channel: ChannelRef,
        message: u32,
        payload: Bytes,
    ) -> Result<(), ProtocolError> {
        let max = self.inbound.message_bytes_max();
        match self.polled.take(tag, message, flags, payload, max)? {
            Gathered::More | Gathered::Ignored | Gathered::Aborted => {}
            Gathered::Overfull => self.lost += 1,
            Gathered::Whole(pieces) => {
                let payload = joined(pieces);
                self.events.push_back(SatelliteEvent::Latest { tag, channel, payload });
            }
        }
        Ok(())
    }

    fn data(
        &mut self,
        channel: ChannelRef,
        message: u32,
        flags: Flags,
        payload: Bytes,
    ) -> Result<(), ProtocolError> {
        let max = self.inbound.message_bytes_max();
        match self.gathering.take(Incoming::Data(channel), message, flags, payload, max)? {
            Gathered::More | Gathered::Ignored | Gathered::Aborted => {}
            Gathered::Overfull => self.lost += 1,
            Gathered::Whole(pieces) => {
                // What was on its way when the subscription was given up is of no interest any more.
                let wanted = self
                    .channels
                    .get(&channel)
                    .is_some_and(|info| self.wanted.contains_key(&info.name));
                if wanted {
                    self.events
                        .push_back(SatelliteEvent::Message { channel, payload: joined(pieces) });
                }
            }
        }
        Ok(())
    }
}
