//! What the passing of time does: pings, silence, closing, and reports of losses.

use super::super::{ConnectionId, Ending, ServerCore, is_waiting};
use super::addresses::Place;
use crate::flow::Event;
use crate::flow::error::ClosingReason;
use crate::flow::limits::{
    CHECK_INTERVAL, DROPPED_REPORT_INTERVAL, FRAME_TIME_MAX, LOGIN_TIME_MAX, PING_AFTER, SILENCE_MAX,
};
use crate::testing::{Bug, is_planted};
use sk_flat::Instant;
use std::collections::BTreeMap;

impl ServerCore {
    /// Ends the requests that had no answer in time, and looks at the connections whose time has come, those four
    /// times a second.
    pub fn tick(&mut self, now: Instant) {
        self.now = now;
        self.end_late_requests();
        if now < self.next_check {
            return self.settle();
        }
        self.next_check = now + CHECK_INTERVAL;
        self.go_on_announcing();
        while let Some((at, id)) = self.alarms.next_due(now) {
            let Some(connection) = self.connections.get_mut(id) else { continue };
            if connection.alarm == Some(at) {
                connection.alarm = None;
                self.check(id);
                self.set_next_alarm(id);
            }
        }
        let mut lossy = std::mem::take(&mut self.lossy);
        lossy.retain(|id| !self.report_if_due(*id));
        lossy.append(&mut self.lossy);
        self.lossy = lossy;
        self.report_ticks();
        self.settle();
    }

    /// When a connection of which nothing is heard is to be looked at.
    fn set_next_alarm(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let at = if let Some((_, deadline)) = connection.closing {
            deadline
        } else if connection.is_inside() {
            return;
        } else if let Some(at) = connection.login_refused_at {
            at
        } else if connection.user.is_none() {
            connection.opened + LOGIN_TIME_MAX
        } else {
            let ping = connection.heard.max(connection.pinged) + PING_AFTER;
            let frame = connection.frame_begun.map_or(ping, |begun| begun + FRAME_TIME_MAX);
            ping.min(connection.heard + SILENCE_MAX).min(frame)
        };
        // Not now again, whatever is found then.
        let at = at.max(self.now + CHECK_INTERVAL);
        self.alarms.set(id, &mut connection.alarm, at);
    }

    /// Sees to it that the connection is looked at then, or before.
    pub(in super::super) fn look_at(&mut self, id: ConnectionId, at: Instant) {
        if let Some(connection) = self.connections.get_mut(id) {
            self.alarms.set(id, &mut connection.alarm, at);
        }
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
            return;
        }
        if let Some(at) = connection.login_refused_at {
            if now >= at {
                self.close(id, ClosingReason::LoginFailed);
            }
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
    }

    /// Tells a subscriber what it lost, if it was not told just before. Answers whether that is done with.
    fn report_if_due(&mut self, id: ConnectionId) -> bool {
        let Some(connection) = self.connections.get_mut(id) else { return true };
        if connection.output.paused || self.now.since(connection.reported) < DROPPED_REPORT_INTERVAL {
            return false;
        }
        connection.reported = self.now;
        connection.lossy = false;
        for (channel, reason, total) in connection.output.take_losses() {
            self.answer(id, 0, &Event::Dropped { channel, reason: reason as u8, total });
        }
        true
    }

    /// Closes the oldest connection without login of the place that has most of them, so that a good
    /// login always finds room.
    pub(in super::super) fn evict(&mut self) {
        let mut by_place: BTreeMap<Option<Place>, (usize, Instant, ConnectionId)> = BTreeMap::new();
        self.newcomers.retain(|id| self.connections.get(*id).is_some_and(is_waiting));
        for id in &self.newcomers {
            let Some(connection) = self.connections.get(*id) else { continue };
            let id = *id;
            let entry = by_place
                .entry(Place::of(connection.origin))
                .or_insert((0, connection.opened, id));
            entry.0 += 1;
            if connection.opened < entry.1 {
                (entry.1, entry.2) = (connection.opened, id);
            }
        }
        let busiest = by_place
            .into_values()
            .max_by_key(|(count, opened, id)| (*count, std::cmp::Reverse(*opened), std::cmp::Reverse(*id)));
        if let Some((.., id)) = busiest {
            self.close(id, ClosingReason::Crowded);
        }
    }
}
