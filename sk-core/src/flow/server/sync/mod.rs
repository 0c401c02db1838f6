//! Sync channels: a source's ticks to its targets, and who keeps up with them.

mod target;

use super::super::channel::Owner;
use super::super::delivery::Outgoing;
use super::super::error::{ProtocolError, RefusalCode};
use super::super::limits::TICK_REPORT_INTERVAL;
use super::super::{ChannelKind, ChannelRef, Event};
use super::{ConnectionId, ServerCore, owning_flow};
use sk_flat::Instant;
use std::time::Duration;
use target::Target;

/// Whether a subscriber may ask for this divisor; 0 leaves it to the hub.
pub(super) fn is_divisor(divisor: u8) -> bool {
    matches!(divisor, 0 | 1 | 2 | 4)
}

/// A sync channel that has had a tick or a target.
#[derive(Debug, Default)]
pub(super) struct Clock {
    last: Option<(u64, Instant)>,
    /// In the order of their subscriptions.
    targets: Vec<Target>,
}

impl ServerCore {
    /// A tick of a source: every target that it is for gets it, the newest only.
    pub(super) fn sync_tick(
        &mut self,
        id: ConnectionId,
        tag: u32,
        channel: ChannelRef,
        sequence: u64,
    ) -> Result<(), ProtocolError> {
        let Some((known, _)) = self.channels.get(channel) else {
            self.refuse(id, tag, RefusalCode::Gone);
            return Ok(());
        };
        let refused = match (known.owner, known.kind) {
            (Owner::Flow(owner), _) if owner != id.wire() => Some(RefusalCode::NotOwner),
            (Owner::Hub, _) => Some(RefusalCode::NotOwner),
            (_, ChannelKind::Sync) => None,
            _ => Some(RefusalCode::WrongKind),
        };
        if let Some(code) = refused {
            self.refuse(id, tag, code);
            return Ok(());
        }
        let now = self.now;
        let clock = self.clocks.entry(channel).or_default();
        let before = clock.last.replace((sequence, now));
        if before.is_some_and(|(last, _)| sequence <= last) {
            return Err(ProtocolError::BadValue { kind: "sync_tick", field: "sequence", value: sequence });
        }
        let period = before.map_or(Duration::ZERO, |(last, at)| period(now.since(at), sequence - last));
        let outgoing = Outgoing::tick(channel, sequence, &self.budget);
        for target in &mut clock.targets {
            if !target.tick(sequence, period, now) {
                continue;
            }
            let Some(connection) = self.connections.get_mut(target.connection) else { continue };
            connection.output.offer(target.slot, &outgoing);
            if !connection.dirty {
                connection.dirty = true;
                self.dirty.push(target.connection);
            }
        }
        Ok(())
    }

    /// A target's pulse is over. What comes after the end of its subscription, or too late, is no crime.
    pub(super) fn tick_done(
        &mut self,
        id: ConnectionId,
        channel: ChannelRef,
        sequence: u64,
    ) -> Result<(), ProtocolError> {
        let now = self.now;
        let Some(clock) = self.clocks.get_mut(&channel) else { return Ok(()) };
        if clock.last.is_none_or(|(last, _)| sequence > last) {
            return Err(ProtocolError::BadValue { kind: "tick_done", field: "sequence", value: sequence });
        }
        if let Some(target) = clock.targets.iter_mut().find(|target| target.connection == id) {
            target.done(sequence, now);
        }
        Ok(())
    }

    pub(super) fn add_target(&mut self, id: ConnectionId, channel: ChannelRef, slot: usize, wish: u8) {
        let now = self.now;
        let targets = &mut self.clocks.entry(channel).or_default().targets;
        match targets.iter_mut().find(|target| target.connection == id) {
            Some(target) => target.wish(wish, now),
            None => targets.push(Target::new(id, slot, wish, now)),
        }
    }

    pub(super) fn remove_target(&mut self, id: ConnectionId, channel: ChannelRef) {
        if let Some(clock) = self.clocks.get_mut(&channel) {
            clock.targets.retain(|target| target.connection != id);
        }
    }

    /// A flow takes the place of another one, and its targets' too.
    pub(super) fn move_target(
        &mut self,
        channel: ChannelRef,
        from: ConnectionId,
        to: ConnectionId,
        slot: usize,
    ) {
        if let Some(clock) = self.clocks.get_mut(&channel)
            && let Some(target) = clock.targets.iter_mut().find(|target| target.connection == from)
        {
            target.connection = to;
            target.slot = slot;
        }
    }

    /// Tells targets and sources how the targets keep up, each at most once a second.
    pub(super) fn report_ticks(&mut self) {
        let now = self.now;
        let mut reports = Vec::new();
        for (channel, clock) in &mut self.clocks {
            for target in &mut clock.targets {
                if let Some(report) = target.report(now, TICK_REPORT_INTERVAL) {
                    reports.push((*channel, target.connection, report));
                }
            }
        }
        for (channel, target, report) in reports {
            let event = Event::TickReport {
                channel,
                target: target.wire(),
                lag_ns: u64::try_from(report.lag.as_nanos()).unwrap_or(u64::MAX),
                done: report.done,
                missed: report.missed,
                divisor: report.divisor,
            };
            self.answer(target, 0, &event);
            let owner = self.channels.get(channel).map(|(known, _)| known.owner);
            if let Some(source) = owner.and_then(|owner| owning_flow(&self.connections, owner))
                && source != target
            {
                self.answer(source, 0, &event);
            }
        }
    }
}

/// The time of one tick where so many went by.
fn period(passed: Duration, ticks: u64) -> Duration {
    let passed = u64::try_from(passed.as_nanos()).unwrap_or(u64::MAX);
    Duration::from_nanos(passed / ticks.max(1))
}
