//! What the passing of time does: pings, silence, closing, and reports of losses.

use super::super::Event;
use super::super::error::ClosingReason;
use super::super::limits::{
    CHECK_INTERVAL, DROPPED_REPORT_INTERVAL, FRAME_TIME_MAX, LOGIN_TIME_MAX, PING_AFTER, SILENCE_MAX,
};
use super::{ConnectionId, Ending, Origin, ServerCore, is_waiting};
use crate::testing::{Bug, is_planted};
use sk_flat::Instant;
use std::collections::BTreeMap;

impl ServerCore {
    /// Ends the requests that had no answer in time, and looks at the deadlines of all connections, those four
    /// times a second.
    pub fn tick(&mut self, now: Instant) {
        self.now = now;
        self.end_late_requests();
        if now < self.next_check {
            return self.settle();
        }
        self.next_check = now + CHECK_INTERVAL;
        for id in self.connections.ids() {
            self.check(id);
        }
        self.report_ticks();
        self.settle();
    }

    /// When [`tick`](ServerCore::tick) wants to be called next.
    pub fn next_deadline(&self) -> Instant {
        self.requests
            .next_deadline()
            .map_or(self.next_check, |deadline| deadline.min(self.next_check))
    }

    fn check(&mut self, id: ConnectionId) {
        let now = self.now;
        let Some(connection) = self.connections.get_mut(id) else { return };
        if let Some((reason, deadline)) = connection.closing {
            if now >= deadline {
                self.finish(id, Ending::Closed(reason));
            }
            return;
        }
        if connection.is_inside() {
            // A pipe's end shows in its queue. A loop that stood still for long, its own modules with it, must
            // not take them for dead.
            self.report_if_due(id);
            return;
        }
        let late_login = connection.user.is_none() && now.since(connection.opened) >= LOGIN_TIME_MAX;
        let late_frame = connection.frame_begun.is_some_and(|begun| now.since(begun) >= FRAME_TIME_MAX);
        if connection.is_held() {
            // Who is not read from shows life by reading.
            connection.heard = connection.heard.max(connection.taken);
        }
        if connection.desk.is_held() || connection.blobs.awaits_disk() {
            // It is the disk that is slow, not the peer.
            connection.heard = now;
        }
        let silence = now.since(connection.heard);
        if late_login || late_frame || silence >= SILENCE_MAX && !is_planted(Bug::SilenceForgiven) {
            return self.close(id, ClosingReason::Silent);
        }
        let asks =
            connection.user.is_some() && silence >= PING_AFTER && now.since(connection.pinged) >= PING_AFTER;
        if asks {
            connection.pinged = now;
            self.pings = self.pings.wrapping_add(1).max(1);
            let tag = self.pings;
            self.answer(id, tag, &Event::Ping {});
        }
        self.report_if_due(id);
    }

    fn report_if_due(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        if !connection.output.has_losses || self.now.since(connection.reported) < DROPPED_REPORT_INTERVAL {
            return;
        }
        connection.reported = self.now;
        for (channel, reason, total) in connection.output.take_losses() {
            self.answer(id, 0, &Event::Dropped { channel, reason: reason as u8, total });
        }
    }

    /// Closes the oldest connection without login of the address that has most of them, so that a good
    /// login always finds a place.
    pub(super) fn evict(&mut self) {
        let mut by_address: BTreeMap<Option<std::net::IpAddr>, (usize, Instant, ConnectionId)> =
            BTreeMap::new();
        for (id, connection) in self.connections.iter().filter(|(_, connection)| is_waiting(connection)) {
            let address = match connection.origin {
                Origin::Network(address) => Some(address),
                Origin::Unix { .. } | Origin::Line | Origin::Inside { .. } => None,
            };
            let entry = by_address.entry(address).or_insert((0, connection.opened, id));
            entry.0 += 1;
            if connection.opened < entry.1 {
                (entry.1, entry.2) = (connection.opened, id);
            }
        }
        let busiest = by_address
            .into_values()
            .max_by_key(|(count, opened, id)| (*count, std::cmp::Reverse(*opened), std::cmp::Reverse(*id)));
        if let Some((.., id)) = busiest {
            self.close(id, ClosingReason::Crowded);
        }
    }
}
