//! What the owner of a server core learns from it, and the limit of its log.

use super::super::ChannelRef;
use super::connection::identity::{ConnectionId, Ending};
use super::services::requests::RequestId;
use bytes::Bytes;
use sk_flat::{Instant, Name};

/// Something that happened in the hub, for whoever runs it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Notice {
    /// A connection logged in.
    LoggedIn {
        /// Which.
        connection: ConnectionId,
        /// To which account.
        user: Name,
    },
    /// A connection became a flow.
    FlowBegun {
        /// Which.
        connection: ConnectionId,
    },
    /// A flow took the place of another one of its session, with all that this had.
    Resumed {
        /// The former connection, which ends.
        from: ConnectionId,
        /// The new one.
        connection: ConnectionId,
    },
    /// A connection is over: its transport is to be closed, its id finds nobody any more.
    Ended {
        /// Which.
        connection: ConnectionId,
        /// Why.
        ending: Ending,
    },
    /// A channel was opened.
    ChannelAdded {
        /// Its reference.
        channel: ChannelRef,
        /// Its full name.
        name: Name,
    },
    /// A channel was closed.
    ChannelRemoved {
        /// Its reference.
        channel: ChannelRef,
        /// Its full name.
        name: Name,
    },
    /// A channel of the hub's own got its first subscriber.
    StartPublishing {
        /// Its reference.
        channel: ChannelRef,
    },
    /// A channel of the hub's own lost its last subscriber.
    StopPublishing {
        /// Its reference.
        channel: ChannelRef,
    },
    /// Somebody asks a service of the hub's own.
    Request {
        /// The service.
        channel: ChannelRef,
        /// To be answered with [`ServerCore::answer_own`](super::ServerCore::answer_own).
        request: RequestId,
        /// Who asks.
        asker: ConnectionId,
        /// What.
        payload: Bytes,
    },
    /// Nobody waits any more for the answer to a request to a service of the hub's own.
    RequestOver {
        /// Which.
        request: RequestId,
    },
}

/// Lets a number of lines pass each second and counts the rest.
#[derive(Debug)]
pub(super) struct LogLimit {
    lines_per_second_max: u32,
    second: u64,
    lines: u32,
    silenced: u64,
}

impl LogLimit {
    pub(super) fn new(lines_per_second_max: u32) -> LogLimit {
        LogLimit { lines_per_second_max, second: 0, lines: 0, silenced: 0 }
    }

    /// Whether a line may be written now, and how many were kept back before it.
    pub(super) fn pass(&mut self, now: Instant) -> Option<u64> {
        let second = now.as_nanos() / 1_000_000_000;
        if second != self.second {
            self.second = second;
            self.lines = 0;
        }
        if self.lines == self.lines_per_second_max {
            self.silenced += 1;
            return None;
        }
        self.lines += 1;
        Some(std::mem::take(&mut self.silenced))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_log_is_limited_each_second_and_the_rest_is_counted() {
        let mut limit = LogLimit::new(10);
        let now = Instant::from_nanos(5_000_000_000);
        assert_eq!((0..25).filter_map(|_| limit.pass(now)).sum::<u64>(), 0);
        assert_eq!(limit.pass(now + Duration::from_secs(1)), Some(15));
        assert_eq!(limit.pass(now + Duration::from_secs(1)), Some(0));
    }
}
