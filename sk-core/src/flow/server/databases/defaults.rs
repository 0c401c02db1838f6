//! What the hub itself knows of flows, channels and accounts, as variables of their databases. They are made
//! when they are read: an idle flow costs nothing for them.

use super::super::super::ChannelRef;
use super::super::super::database::{DatabaseName, Entity};
use super::super::super::delivery::Counts;
use super::super::{ConnectionId, ServerCore};
use sk_flat::{Instant, SkVariant};

/// Variables by key, sorted.
pub(in super::super) type Computed = Vec<(&'static str, SkVariant)>;

impl ServerCore {
    /// The variables that the hub makes up for this database, sorted by key.
    pub(super) fn computed(&self, name: &DatabaseName) -> Computed {
        let mut computed = match self.databases.entity(name) {
            Some(Entity::Flow(flow)) => self.about_flow(ConnectionId::from_wire(flow)),
            Some(Entity::Channel(channel)) => self.about_channel(channel),
            Some(Entity::User) => self.about_account(name.entity()),
            Some(Entity::Hub) | None => Vec::new(),
        };
        computed.sort_unstable_by_key(|(key, _)| *key);
        computed
    }

    fn about_flow(&self, id: ConnectionId) -> Computed {
        let Some(connection) = self.connections.get(id) else { return Vec::new() };
        let mut counts = Counts::default();
        connection.output.add_counts(&mut counts);
        let text = |text: Option<String>| SkVariant::from(text.unwrap_or_default());
        vec![
            ("hub.channels", (connection.owned.len() as u64).into()),
            ("hub.connected_ms", self.passed_ms(connection.opened)),
            ("hub.connection", id.wire().into()),
            ("hub.delivered", counts.delivered.into()),
            ("hub.dropped", counts.dropped_in_all().into()),
            ("hub.kind", "flow".into()),
            ("hub.name", text(connection.flow.as_ref().map(ToString::to_string))),
            ("hub.peer", connection.origin.to_string().into()),
            ("hub.queued", counts.queued.into()),
            ("hub.silent_ms", self.passed_ms(connection.heard)),
            ("hub.subscriptions", (connection.output.subscriptions() as u64).into()),
            ("hub.user", text(connection.user.as_ref().map(ToString::to_string))),
            ("hub.watches", (connection.desk.watches.len() as u64).into()),
        ]
    }

    fn about_channel(&self, channel: ChannelRef) -> Computed {
        let Some((known, subscribers)) = self.channels.get(channel) else { return Vec::new() };
        let mut counts = Counts::default();
        for subscriber in &subscribers.list {
            if let Some(connection) = self.connections.get(subscriber.connection)
                && let Some(one) = connection.output.counts(channel)
            {
                counts.add(one);
            }
        }
        vec![
            ("hub.delivered", counts.delivered.into()),
            ("hub.dropped", counts.dropped_in_all().into()),
            ("hub.epoch", u64::from(known.reference.epoch).into()),
            ("hub.hash", known.hash.into()),
            ("hub.id", i64::from(known.reference.id).into()),
            ("hub.kind", known.kind.to_string().into()),
            ("hub.name", known.name.to_string().into()),
            ("hub.owner", known.owner.wire().into()),
            ("hub.properties", known.properties.variant()),
            ("hub.queued", counts.queued.into()),
            ("hub.subscribers", (subscribers.list.len() as u64).into()),
        ]
    }

    fn about_account(&self, user: &str) -> Computed {
        let of_user = |found: Option<&sk_flat::Name>| found.is_some_and(|found| found.as_str() == user);
        let connections = self.connections.iter().filter(|(_, found)| of_user(found.user.as_ref()));
        let (mut all, mut flows, mut channels) = (0_u64, 0_u64, 0_u64);
        for (_, connection) in connections {
            all += 1;
            flows += u64::from(connection.flow.is_some());
            channels += connection.owned.len() as u64;
        }
        let usage = self.databases.usage(user);
        vec![
            ("hub.channels", channels.into()),
            ("hub.connections", all.into()),
            ("hub.database_bytes", (usage.bytes as u64).into()),
            ("hub.database_variables", (usage.keys as u64).into()),
            ("hub.databases", (usage.databases as u64).into()),
            ("hub.flows", flows.into()),
            ("hub.kind", "user".into()),
            ("hub.name", user.into()),
            ("hub.unreadable_rights", self.unreadable_rights(user)),
        ]
    }

    /// What is wrong with the account's rights, by key.
    fn unreadable_rights(&self, user: &str) -> SkVariant {
        let unreadable = self.accounts.unreadable(user).iter();
        SkVariant::map(unreadable.map(|(key, why)| (key.clone(), why.to_string().into())))
    }

    fn passed_ms(&self, since: Instant) -> SkVariant {
        (self.now.since(since).as_millis() as u64).into()
    }
}
