//! The open requests of a hub: ids that are never used twice, and which deadline comes first.

use super::super::connection::identity::ConnectionId;
use crate::flow::ChannelRef;
use sk_flat::Instant;
use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

/// Identity of a request: no two of a hub share it, and that of one that is over finds nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RequestId {
    generation: u32,
    index: u32,
}

impl RequestId {
    /// The number on the wire, never 0.
    pub const fn wire(self) -> u64 {
        (self.generation as u64) << 32 | self.index as u64
    }

    /// The id of a number on the wire.
    pub const fn from_wire(wire: u64) -> RequestId {
        RequestId { generation: (wire >> 32) as u32, index: wire as u32 }
    }
}

/// A request that waits for its answer.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Request {
    pub(in super::super) channel: ChannelRef,
    pub(in super::super) asker: ConnectionId,
    /// The tag of the call.
    pub(in super::super) tag: u32,
    /// Who answers; `None` is the hub itself.
    pub(in super::super) owner: Option<ConnectionId>,
    /// How long each answer may take.
    pub(super) span: Duration,
    pub(in super::super) deadline: Instant,
}

/// All open requests.
#[derive(Debug, Default)]
pub(in super::super) struct Requests {
    slots: Vec<Slot>,
    free: VecDeque<u32>,
    deadlines: BTreeSet<(Instant, RequestId)>,
}

#[derive(Debug)]
struct Slot {
    generation: u32,
    request: Option<Request>,
}

impl Requests {
    pub(in super::super) fn add(&mut self, request: Request) -> RequestId {
        let index = self.free.pop_front().unwrap_or_else(|| {
            self.slots.push(Slot { generation: 0, request: None });
            (self.slots.len() - 1) as u32
        });
        let slot = &mut self.slots[index as usize];
        slot.generation = slot.generation.checked_add(1).unwrap_or(1);
        slot.request = Some(request);
        let id = RequestId { generation: slot.generation, index };
        self.deadlines.insert((request.deadline, id));
        id
    }

    pub(in super::super) fn get(&self, id: RequestId) -> Option<&Request> {
        let slot = self.slots.get(id.index as usize)?;
        slot.request.as_ref().filter(|_| slot.generation == id.generation)
    }

    pub(in super::super) fn remove(&mut self, id: RequestId) -> Option<Request> {
        let deadline = self.get(id)?.deadline;
        self.deadlines.remove(&(deadline, id));
        self.free.push_back(id.index);
        self.slots[id.index as usize].request.take()
    }

    /// The time for the next answer begins anew.
    pub(super) fn refresh(&mut self, id: RequestId, now: Instant) {
        let Some(request) = self.get(id).copied() else { return };
        let deadline = now + request.span;
        self.deadlines.remove(&(request.deadline, id));
        self.deadlines.insert((deadline, id));
        if let Some(request) = &mut self.slots[id.index as usize].request {
            request.deadline = deadline;
        }
    }

    /// A request whose deadline has passed.
    pub(super) fn next_late(&self, now: Instant) -> Option<RequestId> {
        self.deadlines
            .first()
            .filter(|(deadline, _)| *deadline <= now)
            .map(|(_, id)| *id)
    }

    /// The first deadline.
    pub(in super::super) fn next_deadline(&self) -> Option<Instant> {
        self.deadlines.first().map(|(deadline, _)| *deadline)
    }

    /// How many are open.
    pub(in super::super) fn len(&self) -> usize {
        self.deadlines.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(deadline_ns: u64) -> Request {
        Request {
            channel: ChannelRef { id: 2000, epoch: 1 },
            asker: ConnectionId::from_wire(1 << 32),
            tag: 1,
            owner: None,
            span: Duration::from_nanos(100),
            deadline: Instant::from_nanos(deadline_ns),
        }
    }

    #[test]
    fn an_id_that_is_over_finds_nothing_though_its_place_is_taken_again() {
        let mut requests = Requests::default();
        let first = requests.add(request(10));
        assert!(first.wire() != 0 && RequestId::from_wire(first.wire()) == first);
        assert!(requests.remove(first).is_some());
        let second = requests.add(request(20));
        assert_eq!(first.index, second.index);
        assert!(requests.get(first).is_none() && requests.remove(first).is_none());
        requests.slots[second.index as usize].generation = u32::MAX;
        requests.deadlines.clear();
        requests.slots[second.index as usize].request = None;
        requests.free.push_back(second.index);
        assert_ne!(requests.add(request(30)).wire() >> 32, 0, "no generation is 0");
    }

    #[test]
    fn deadlines_come_in_their_order_and_move_when_they_are_refreshed() {
        let mut requests = Requests::default();
        let (late, soon) = (requests.add(request(20)), requests.add(request(10)));
        assert_eq!(requests.next_late(Instant::from_nanos(9)), None);
        assert_eq!(requests.next_late(Instant::from_nanos(10)), Some(soon));
        requests.refresh(soon, Instant::from_nanos(9));
        assert_eq!(requests.next_late(Instant::from_nanos(100)), Some(late));
        requests.remove(late);
        assert_eq!(requests.next_deadline(), Some(Instant::from_nanos(109)));
        assert_eq!(requests.len(), 1);
    }
}
