//! Unfinished messages of all connections together: who gives way when they hold as much as they may.

use super::super::Flags;
use super::super::delivery::{DropReason, charge_of};
use super::super::error::RefusalCode;
use super::connection::Connection;
use super::connection::incoming::Incoming;
use super::services::requests::RequestId;
use super::{ConnectionId, ServerCore};

impl ServerCore {
    /// Before a fragment of this connection is kept: if there is no room for it in all, whoever holds most gives all
    /// of his up, unless this one holds nearly as much. So who sends his messages to their end is not shut out by
    /// those who begin and do not end.
    pub(super) fn make_room_for_fragment(&mut self, id: ConnectionId, flags: Flags, bytes: usize) {
        let charge = charge_of(bytes, 1);
        if flags == Flags::WHOLE || self.unfinished.has_room_for(charge) {
            return;
        }
        let own = self.connections.get(id).map_or(0, held_by);
        let held = self.connections.iter().map(|(id, connection)| (held_by(connection), id));
        if let Some((most, heaviest)) = held.max()
            && most > 2 * (own + charge)
        {
            self.give_up_unfinished(heaviest);
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
