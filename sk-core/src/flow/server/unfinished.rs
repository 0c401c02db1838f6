//! Unfinished messages of all connections together: how much they may hold, and who gives way.

use super::super::delivery::DropReason;
use super::super::error::RefusalCode;
use super::super::limits::HUB_UNFINISHED_BYTES_MAX;
use super::connection::Connection;
use super::connection::incoming::Incoming;
use super::services::requests::RequestId;
use super::{ConnectionId, ServerCore};
use std::cmp::Reverse;

/// What is to be left at the limit, so that it need not be looked for each time.
const BYTES_LEFT: usize = HUB_UNFINISHED_BYTES_MAX / 16 * 15;

impl ServerCore {
    /// If unfinished messages hold too much in all, those who hold most give theirs up: who sends his messages to
    /// their end is not punished for those who begin and do not end.
    pub(super) fn bound_unfinished(&mut self) {
        if self.unfinished.get() <= HUB_UNFINISHED_BYTES_MAX {
            return;
        }
        let held = self.connections.iter().map(|(id, connection)| (held_by(connection), id));
        let mut heavy: Vec<(usize, ConnectionId)> = held.filter(|(bytes, _)| *bytes > 0).collect();
        heavy.sort_unstable_by_key(|(bytes, id)| (Reverse(*bytes), *id));
        for (_, id) in heavy {
            if self.unfinished.get() <= BYTES_LEFT {
                return;
            }
            self.give_up_unfinished(id);
        }
    }

    fn give_up_unfinished(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let by_datagram = connection.udp.as_mut().map(|udp| udp.give_up()).unwrap_or_default();
        let given_up = connection.gathering.give_up();
        for channel in by_datagram {
            self.drop_for_all(channel, DropReason::Aborted);
        }
        for incoming in given_up {
            match incoming {
                Incoming::Publish(channel) => {
                    self.drop_for_all(channel, DropReason::Aborted);
                    self.refuse(id, 0, RefusalCode::Full);
                }
                Incoming::Call(tag) => self.give_up_call(id, tag),
                Incoming::Upload(tag) => self.give_up_piece(id, tag),
                Incoming::Answer(request) => {
                    self.end_request(RequestId::from_wire(request), Some((RefusalCode::Full, None)));
                }
            }
        }
    }
}

fn held_by(connection: &Connection) -> usize {
    connection.gathering.bytes() + connection.udp.as_ref().map_or(0, |udp| udp.bytes())
}
