//! Publishing: fragments in, whole messages out to every subscriber.

use super::super::channel::Owner;
use super::super::delivery::Outgoing;
use super::super::error::{ProtocolError, RefusalCode};
use super::super::fragment::{Gathered, Pieces, cut};
use super::super::limits::{FRAGMENT_BYTES_MAX, MESSAGE_BYTES_MAX};
use super::super::{ChannelRef, Flags};
use super::connection::Incoming;
use super::{ConnectionId, ServerCore};
use bytes::Bytes;

/// The fields of a `publish`.
pub(super) struct Piece {
    pub(super) channel: ChannelRef,
    pub(super) message: u32,
    pub(super) payload: Bytes,
}

impl ServerCore {
    pub(super) fn publish(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        piece: Piece,
    ) -> Result<(), ProtocolError> {
        let Piece { channel, message, payload } = piece;
        let owner = self.channels.get(channel).map(|(known, _)| known.owner);
        if owner != Some(Owner::Flow(id.wire())) {
            // A channel may go while fragments for it are under way: refuse a message once, drop the rest.
            self.late_fragments += 1;
            if flags.has(Flags::FIRST) {
                self.refuse(id, tag, if owner.is_none() { RefusalCode::Gone } else { RefusalCode::NotOwner });
            }
            return Ok(());
        }
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        let bytes_max = connection.inbound.message_bytes_max();
        match connection
            .gathering
            .take(Incoming::Publish(channel), message, flags, payload, bytes_max)?
        {
            Gathered::More | Gathered::Ignored => {}
            Gathered::Whole(pieces) => self.fan_out(channel, message, pieces),
            Gathered::Aborted => self.abort(channel),
            Gathered::Overfull => {
                self.abort(channel);
                self.refuse(id, tag, RefusalCode::Full);
            }
        }
        Ok(())
    }

    /// Publishes on a channel of the hub's own. Answers whether anybody listened.
    ///
    /// # Errors
    /// `Gone` if the channel is closed, `NotOwner` if a flow owns it, `Full` if the message is longer
    /// than 16 MiB.
    pub fn publish_own(&mut self, channel: ChannelRef, message: Bytes) -> Result<bool, RefusalCode> {
        let (known, subscribers) = self.channels.get(channel).ok_or(RefusalCode::Gone)?;
        if known.owner != Owner::Hub {
            return Err(RefusalCode::NotOwner);
        }
        if message.len() > MESSAGE_BYTES_MAX {
            return Err(RefusalCode::Full);
        }
        let heard = !subscribers.list.is_empty();
        self.next_own_message = self.next_own_message.wrapping_add(1);
        let pieces = cut(message, FRAGMENT_BYTES_MAX).map(|(_, piece)| piece).collect();
        self.fan_out(channel, self.next_own_message, pieces);
        Ok(heard)
    }

    /// One message to every subscriber: encoded once, shared by all.
    fn fan_out(&mut self, channel: ChannelRef, message: u32, pieces: Pieces) {
        let Some((_, subscribers)) = self.channels.get(channel) else { return };
        if subscribers.list.is_empty() {
            return;
        }
        let outgoing = Outgoing::new(channel, message, pieces);
        for subscriber in &subscribers.list {
            let Some(connection) = self.connections.get_mut(subscriber.connection) else { continue };
            connection.output.offer(subscriber.slot, &outgoing);
            if !connection.dirty {
                connection.dirty = true;
                self.dirty.push(subscriber.connection);
            }
        }
    }

    fn abort(&mut self, channel: ChannelRef) {
        let Some((_, subscribers)) = self.channels.get(channel) else { return };
        for subscriber in &subscribers.list {
            if let Some(connection) = self.connections.get_mut(subscriber.connection) {
                connection.output.aborted(subscriber.slot);
            }
        }
    }
}
