//! When which connection is to be looked at: idle ones cost nothing until then.

use super::super::ConnectionId;
use sk_flat::Instant;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// One alarm for each connection, kept as the earliest instant that was asked for. What was asked for later in
/// time is found out when the alarm goes off, so hearing from a peer moves nothing here.
#[derive(Debug, Default)]
pub(in super::super) struct Alarms {
    heap: BinaryHeap<Reverse<(Instant, ConnectionId)>>,
}

impl Alarms {
    /// Sees to it that the connection is looked at then, or before; `set` is the alarm it has.
    pub(in super::super) fn set(&mut self, id: ConnectionId, set: &mut Option<Instant>, at: Instant) {
        if set.is_none_or(|before| at < before) {
            *set = Some(at);
            self.heap.push(Reverse((at, id)));
        }
    }

    /// The next alarm that is due. It may be of a connection that is gone, or of before an earlier one was set.
    pub(super) fn next_due(&mut self, now: Instant) -> Option<(Instant, ConnectionId)> {
        let Reverse((at, _)) = self.heap.peek()?;
        if *at > now {
            return None;
        }
        self.heap.pop().map(|Reverse(alarm)| alarm)
    }

    #[cfg(test)]
    pub(in super::super) fn len(&self) -> usize {
        self.heap.len()
    }
}
