//! `inspect`: what the hub tells of itself, made from its own state at the moment of the question.

mod books;
mod why;

use super::super::channel::{Channel, Owner};
use super::super::error::RefusalCode;
use super::super::limits;
use super::super::report::{
    ChannelReport, CountsReport, CreditReport, DatagramsReport, FlowReport, FlowsReport, GraphChannel,
    GraphReport, HubReport, SubscriberReport,
};
use super::super::{ChannelRef, Event, Form, Right, Value};
use super::channels::audience::{Subscriber, Subscribers};
use super::{ConnectionId, DatagramCounts, ServerCore};
use sk_flat::{IntoVariant, Name, SkVariant};

/// How many entries one answer lists. What is beyond is counted.
const ENTRIES_MAX: usize = 1000;

fn datagrams(port: u16, counts: DatagramCounts) -> DatagramsReport {
    let DatagramCounts { taken, unknown, forged, replayed, malformed } = counts;
    DatagramsReport { port, taken, unknown, forged, replayed, malformed }
}

impl ServerCore {
    pub(super) fn inspect(&mut self, id: ConnectionId, tag: u32, subject: &str, form: Form) {
        if !self.may_inspect(id, subject) {
            return self.refuse(id, tag, RefusalCode::Denied);
        }
        let mut words = subject.split_whitespace();
        let report = match (words.next(), words.next(), words.next()) {
            (Some("graph"), None, _) => Ok(self.graph_for(id).into_variant()),
            (Some("channel"), Some(name), None) => self.channel_for(id, name).map(IntoVariant::into_variant),
            _ => self.report(subject),
        };
        let told = report.and_then(|report| Value::new(&report).map_err(|_| RefusalCode::TooLong));
        let sendable = told.map(|value| value.in_form(form));
        match sendable {
            Ok(value) if value.wire_bytes().is_ok() => self.answer(id, tag, &Event::Value { value }),
            Ok(_) => self.refuse(id, tag, RefusalCode::TooLong),
            Err(code) => self.refuse(id, tag, code),
        }
    }

    /// What is about names is for those who may list them; what is about everybody, for those who may list all. Of
    /// the graph, and of those around a channel, everyone is told the part that he may list.
    fn may_inspect(&self, id: ConnectionId, subject: &str) -> bool {
        let Some(connection) = self.connections.get(id) else { return false };
        let rights = &connection.rights;
        let mut words = subject.split_whitespace();
        match words.next() {
            Some("channel" | "why") => words.all(|name| rights.allows(Right::List, name)),
            Some("flows") => rights.allows_everywhere(Right::List),
            _ => rights.has(Right::List),
        }
    }

    /// What `inspect` answers to a subject.
    ///
    /// # Errors
    /// `NoSuchSubject` if there is none of that name, `Gone` if the channel it is about is not open.
    pub fn report(&self, subject: &str) -> Result<SkVariant, RefusalCode> {
        let mut words = subject.split_whitespace();
        let report = match (words.next(), words.next(), words.next()) {
            (Some("hub"), None, _) => self.hub_report().into_variant(),
            (Some("flows"), None, _) => self.flows_report().into_variant(),
            (Some("graph"), None, _) => self.graph_report().into_variant(),
            (Some("channel"), Some(name), None) => self.channel_report(name)?.into_variant(),
            (Some("why"), Some(from), Some(to)) if words.next().is_none() => {
                self.why_report(from, to).into_variant()
            }
            _ => return Err(RefusalCode::NoSuchSubject),
        };
        Ok(report)
    }

    fn hub_report(&self) -> HubReport {
        let named = |(name, value): (&str, u64)| (name.to_owned(), value);
        let subscriptions: usize = self
            .connections
            .iter()
            .map(|(_, connection)| connection.output.subscriptions())
            .sum();
        HubReport {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            protocol: limits::VERSION,
            up: self.now.since(self.started),
            connections: self.connections.len() as u32,
            waiting_for_login: self.waiting as u32,
            flows: self.sessions.flows.len() as u32,
            channels: self.channels.len() as u32,
            subscriptions: subscriptions as u32,
            counts: CountsReport::from(&self.totals()),
            bytes_waiting: self.budget.used() as u64,
            bytes_kept: self.kept as u64,
            spurious: self.spurious,
            late_fragments: self.late_fragments,
            datagrams: self.udp_port().map(|port| datagrams(port, self.datagram_counts())),
            limits: [
                ("connections", limits::CONNECTIONS_MAX as u64),
                ("connections without login", limits::UNAUTHENTICATED_MAX as u64),
                ("channels", limits::CHANNELS_MAX as u64),
                ("channels of a flow", limits::CHANNELS_PER_FLOW_MAX as u64),
                ("subscriptions of a flow", limits::SUBSCRIPTIONS_PER_FLOW_MAX as u64),
                ("bytes waiting for a connection", limits::CONNECTION_BYTES_MAX as u64),
                ("bytes waiting in all", self.budget.max() as u64),
                ("bytes of a message", limits::MESSAGE_BYTES_MAX as u64),
            ]
            .map(named)
            .into(),
        }
    }

    fn flows_report(&self) -> FlowsReport {
        let flows = self.connections.iter().take(ENTRIES_MAX).map(|(id, connection)| FlowReport {
            id: id.wire(),
            account: connection.user.as_ref().map(Name::to_string),
            flow: connection.flow.as_ref().map(Name::to_string),
            origin: connection.origin.to_string(),
            state: connection
                .closing
                .map_or_else(|| connection.inbound.state().to_string(), |_| "closing".to_owned()),
            since: self.now.since(connection.opened),
            bytes_waiting: connection.output.bytes() as u64,
            channels: connection.owned.len() as u32,
            subscriptions: connection.output.subscriptions() as u32,
        });
        let flows: Vec<FlowReport> = flows.collect();
        let left_out = (self.connections.len() - flows.len()) as u32;
        FlowsReport { flows, left_out }
    }

    fn channel_report(&self, name: &str) -> Result<ChannelReport, RefusalCode> {
        let (known, beside) = self.channels.by_name(name).ok_or(RefusalCode::Gone)?;
        let special = beside.special.as_ref();
        let credit = special.and_then(|special| special.credit);
        let subscribers = beside.list.iter().take(ENTRIES_MAX);
        let replicas = beside
            .replicas()
            .iter()
            .filter_map(|replica| self.channel_name(replica.channel));
        Ok(ChannelReport {
            name: known.name.to_string(),
            id: known.reference.id,
            epoch: known.reference.epoch,
            hash: known.hash,
            kind: known.kind.to_string(),
            owner: self.owner_name(known.owner),
            owner_id: known.owner.wire(),
            properties: known.properties.variant(),
            published: beside.published,
            last: beside.last.map(|last| self.now.since(last)),
            heard: beside.is_heard(),
            latch: special.is_some_and(|special| special.latch),
            bytes_latched: beside.latched().map_or(0, |message| message.charge() as u64),
            credit: credit.map(|credit| CreditReport { used: credit.used, granted: credit.granted }),
            repeats: beside.source().and_then(|source| self.channel_name(source)),
            repeated_by: replicas.take(ENTRIES_MAX).collect(),
            pollers: special.map_or(0, |special| special.pollers.len()) as u32,
            subscribers: subscribers.filter_map(|one| self.subscriber_report(known, one)).collect(),
            left_out: beside.list.len().saturating_sub(ENTRIES_MAX) as u32,
        })
    }

    fn subscriber_report(&self, channel: &Channel, subscriber: &Subscriber) -> Option<SubscriberReport> {
        let connection = self.connections.get(subscriber.connection)?;
        let book = connection.output.book(subscriber.slot)?;
        let (policy, depth) = book.policy();
        Some(SubscriberReport {
            id: subscriber.connection.wire(),
            flow: self.flow_name(subscriber.connection),
            policy: policy.to_string(),
            depth: (!channel.properties.is_reliable()).then_some(depth as u32),
            counts: CountsReport::from(book.counts()),
            bytes_waiting: book.bytes() as u64,
        })
    }

    fn graph_report(&self) -> GraphReport {
        let mut graph = GraphReport::default();
        let mut room = ENTRIES_MAX;
        let mut left_out = 0;
        // Answers whether one more entry fits.
        let mut fits = || {
            let fits = room > 0;
            room -= usize::from(fits);
            left_out += u32::from(!fits);
            fits
        };
        for id in &self.sessions.flows {
            if fits() {
                graph.flows.push(self.flow_name(*id));
            }
        }
        for (known, beside) in self.channels.iter() {
            let channel_fits = fits();
            let subscribers: Vec<String> = beside
                .list
                .iter()
                .filter(|_| fits())
                .map(|one| self.flow_name(one.connection))
                .collect();
            if channel_fits {
                graph.channels.push(self.graph_channel(known, beside, subscribers));
            }
        }
        graph.left_out = left_out;
        graph
    }

    /// The graph without what this connection may not list.
    fn graph_for(&self, id: ConnectionId) -> GraphReport {
        let mut graph = self.graph_report();
        let listed = |name: &str| self.is_allowed(id, Right::List, name);
        graph.flows.retain(|flow| listed(flow));
        graph.channels.retain(|channel| listed(&channel.name));
        for channel in &mut graph.channels {
            channel.subscribers.retain(|flow| listed(flow));
            channel.repeats = channel.repeats.take().filter(|source| listed(source));
        }
        graph
    }

    /// A channel without the names around it that this connection may not list.
    fn channel_for(&self, id: ConnectionId, name: &str) -> Result<ChannelReport, RefusalCode> {
        let mut report = self.channel_report(name)?;
        let listed = |name: &str| self.is_allowed(id, Right::List, name);
        let told = report.subscribers.len();
        report.subscribers.retain(|subscriber| listed(&subscriber.flow));
        report.left_out += (told - report.subscribers.len()) as u32;
        report.repeats = report.repeats.take().filter(|source| listed(source));
        report.repeated_by.retain(|replica| listed(replica));
        Ok(report)
    }

    fn graph_channel(&self, known: &Channel, beside: &Subscribers, subscribers: Vec<String>) -> GraphChannel {
        GraphChannel {
            name: known.name.to_string(),
            kind: known.kind.to_string(),
            owner: self.owner_name(known.owner),
            repeats: beside.source().and_then(|source| self.channel_name(source)),
            subscribers,
        }
    }

    pub(super) fn channel_name(&self, channel: ChannelRef) -> Option<String> {
        self.channels.get(channel).map(|(known, _)| known.name.to_string())
    }

    pub(super) fn owner_name(&self, owner: Owner) -> String {
        match owner {
            Owner::Hub => "hub".to_owned(),
            Owner::Flow(wire) => self.flow_name(ConnectionId::from_wire(wire)),
        }
    }

    fn flow_name(&self, id: ConnectionId) -> String {
        let flow = self.connections.get(id).and_then(|connection| connection.flow.as_ref());
        flow.map(Name::to_string).unwrap_or_default()
    }
}
