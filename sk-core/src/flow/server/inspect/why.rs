//! `inspect why A B`: where data on its way from A to B ends, one answer for each hop.

use super::super::channels::audience::Subscribers;
use super::super::{ConnectionId, ServerCore};
use crate::flow::Right;
use crate::flow::channel::{Channel, Owner};
use crate::flow::delivery::{Book, DropReason};
use crate::flow::report::{Hop, WhyReport};
use sk_flat::Name;
use std::time::Duration;

/// How many channels of one flow are gone through.
const CHANNELS_TOLD_MAX: usize = 32;
/// A publisher that was silent for this long is said to have stopped.
const STOPPED_AFTER: Duration = Duration::from_secs(2);

/// The hops found so far. What comes after a gap is told all the same: there may be more than one.
#[derive(Default)]
struct Way(Vec<Hop>);

impl Way {
    fn passes(&mut self, at: impl ToString, says: impl Into<String>) {
        self.0.push(Hop { at: at.to_string(), passes: true, says: says.into() });
    }

    fn ends(&mut self, at: impl ToString, says: impl Into<String>) {
        self.0.push(Hop { at: at.to_string(), passes: false, says: says.into() });
    }
}

impl ServerCore {
    pub(super) fn why_report(&self, from: &str, to: &str) -> WhyReport {
        let mut way = Way::default();
        let receiver = Name::new(to).ok().and_then(|name| self.flow_of(&name));
        let sender = Name::new(from).ok().and_then(|name| self.flow_of(&name));
        match (self.channels.by_name(from), sender) {
            (Some((known, beside)), _) => self.why_channel(&mut way, known, beside, to, receiver),
            (None, Some(sender)) => self.why_flow(&mut way, from, sender, to, receiver),
            (None, None) => way.ends(from, "there is no such channel, and no such flow"),
        }
        let passes = way.0.iter().all(|hop| hop.passes);
        WhyReport { from: from.to_owned(), to: to.to_owned(), passes, hops: way.0 }
    }

    /// A flow may own several channels: those that the receiver hears are told, or that it hears none.
    fn why_flow(
        &self,
        way: &mut Way,
        from: &str,
        sender: ConnectionId,
        to: &str,
        receiver: Option<ConnectionId>,
    ) {
        let Some(connection) = self.connections.get(sender) else { return };
        let owned = connection.owned.iter().filter_map(|channel| self.channels.get(*channel));
        let heard: Vec<_> = owned
            .filter(|(known, _)| {
                let output = receiver.and_then(|id| self.connections.get(id)).map(|found| &found.output);
                output.is_some_and(|output| output.is_subscribed(known.reference))
            })
            .collect();
        if receiver.is_none() {
            way.ends(to, "there is no such flow");
        } else if connection.owned.is_empty() {
            way.ends(from, "owns no channel");
        } else if heard.is_empty() {
            way.ends(to, format!("subscribes to none of the {} channels of {from}", connection.owned.len()));
        }
        for (known, beside) in heard.into_iter().take(CHANNELS_TOLD_MAX) {
            self.why_channel(way, known, beside, to, receiver);
        }
    }

    fn why_channel(
        &self,
        way: &mut Way,
        known: &Channel,
        beside: &Subscribers,
        to: &str,
        receiver: Option<ConnectionId>,
    ) {
        self.why_published(way, known, beside);
        let Some((id, connection)) = receiver.and_then(|id| Some((id, self.connections.get(id)?))) else {
            return way.ends(to, "there is no such flow");
        };
        if !connection.rights.has(Right::Subscribe) {
            way.ends(to, "its account has no right to subscribe");
        }
        if let Some(subscriber) = beside.list.iter().find(|one| one.connection == id) {
            if let Some(book) = connection.output.book(subscriber.slot) {
                why_book(way, to, book);
            }
            return;
        }
        // It may hear the channel by way of one that repeats it.
        let repeated = beside.replicas().iter().find_map(|replica| {
            let (replica, beside) = self.channels.get(replica.channel)?;
            self.reaches(beside, id).then_some((replica, beside))
        });
        match repeated {
            Some((replica, beside)) => {
                way.passes(&known.name, format!("is repeated by {}", replica.name));
                self.why_channel(way, replica, beside, to, receiver);
            }
            None => way.ends(to, format!("is not subscribed to {}", known.name)),
        }
    }

    /// Whether a connection hears a channel, itself or by way of others that repeat it.
    fn reaches(&self, beside: &Subscribers, id: ConnectionId) -> bool {
        beside.list.iter().any(|one| one.connection == id)
            || beside.replicas().iter().any(|replica| {
                self.channels
                    .get(replica.channel)
                    .is_some_and(|(_, beside)| self.reaches(beside, id))
            })
    }

    fn why_published(&self, way: &mut Way, known: &Channel, beside: &Subscribers) {
        let owner = match beside.source().and_then(|source| self.channel_name(source)) {
            Some(source) => format!("repeats {source}"),
            None if known.owner == Owner::Hub => "belongs to the hub".to_owned(),
            None => format!("is published by {}", self.owner_name(known.owner)),
        };
        let silent = beside.last.map(|last| self.now.since(last));
        match silent {
            None => way.ends(&known.name, format!("{owner}; nothing was published yet")),
            Some(silent) if silent >= STOPPED_AFTER => way.ends(
                &known.name,
                format!("{owner}; {} messages came, the last {} s ago", beside.published, silent.as_secs()),
            ),
            Some(_) => way.passes(&known.name, format!("{owner}; {} messages came", beside.published)),
        }
        let credit = beside.special.as_ref().and_then(|special| special.credit);
        if credit.is_some_and(|credit| !credit.is_left()) {
            way.ends(&known.name, "its owner has no credit left: the slowest subscriber does not keep up");
        }
    }

    fn flow_of(&self, name: &Name) -> Option<ConnectionId> {
        self.sessions.by_name(name)
    }
}

fn why_book(way: &mut Way, to: &str, book: &Book) {
    let counts = book.counts();
    let dropped: Vec<String> = DropReason::ALL
        .iter()
        .map(|(reason, ..)| (reason, counts.dropped[*reason as usize]))
        .filter(|(_, count)| *count > 0)
        .map(|(reason, count)| format!("{count} ({reason})"))
        .collect();
    let mut says =
        format!("is subscribed; {} of {} messages were delivered", counts.delivered, counts.offered);
    if !dropped.is_empty() {
        says += &format!("; dropped: {}", dropped.join(", "));
    }
    if counts.queued > 0 {
        says += &format!("; {} wait, {} bytes", counts.queued, book.bytes());
    }
    // Nothing gets there while everything that came is waiting or was dropped.
    if counts.offered > 0 && counts.delivered == 0 {
        way.ends(to, says + "; it reads nothing");
    } else {
        way.passes(to, says);
    }
}
