//! Publishing: fragments in, whole messages out to every subscriber.

use super::super::connection::incoming::Incoming;
use super::super::{ConnectionId, ServerCore};
use super::audience::Admitted;
use crate::flow::channel::Owner;
use crate::flow::delivery::{DropReason, charge_of};
use crate::flow::error::{ProtocolError, RefusalCode};
use crate::flow::fragment::{Gathered, cut};
use crate::flow::limits::{FRAGMENT_BYTES_MAX, MESSAGE_BYTES_MAX};
use crate::flow::{ChannelKind, ChannelRef, Flags};
use crate::testing::{Bug, is_planted};
use bytes::Bytes;

/// The fields of a `publish`.
pub(in super::super) struct Piece {
    pub(in super::super) channel: ChannelRef,
    pub(in super::super) message: u32,
    pub(in super::super) payload: Bytes,
}

impl ServerCore {
    pub(in super::super) fn publish(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        piece: Piece,
    ) -> Result<(), ProtocolError> {
        let Piece { channel, message, payload } = piece;
        let mut found = self.channels.get_mut(channel);
        let known = found.as_ref().map(|(known, _)| (known.owner, known.kind));
        if known != Some((Owner::Flow(id.wire()), ChannelKind::Stream)) {
            if is_planted(Bug::RaceIsSpurious) && known.is_none() {
                return Err(ProtocolError::FragmentSequence { message });
            }
            self.turn_away(id, tag, flags, known);
            return Ok(());
        }
        let credit = found.as_mut().and_then(|(_, beside)| beside.special.as_mut()?.credit.as_mut());
        let may_renew = credit.is_some() && (flags.has(Flags::LAST) || flags == Flags::ABORT);
        match credit.map_or(Admitted::Yes, |credit| credit.take(flags, payload.len())) {
            Admitted::Yes => {}
            Admitted::Not => {
                self.drop_for_all(channel, DropReason::Credit);
                return Ok(());
            }
            Admitted::StillNot => return Ok(()),
        }
        self.make_room_for_fragment(id, flags, payload.len());
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        let bytes_max = connection.inbound.message_bytes_max();
        let gathered =
            connection
                .gathering
                .take(Incoming::Publish(channel), message, flags, payload, bytes_max)?;
        let is_overtaken = matches!(gathered, Gathered::Whole(_))
            && connection.udp.as_deref_mut().is_some_and(|udp| !udp.takes(channel, message));
        if is_overtaken {
            self.drop_for_all(channel, DropReason::Aborted);
        } else {
            self.gathered(id, tag, (channel, message), gathered);
        }
        if may_renew {
            self.renew_credit(channel);
        }
        Ok(())
    }

    /// A fragment for a channel that is not its sender's, or no stream. A channel may go while fragments for it are
    /// under way: a message is refused once, the rest of it dropped.
    pub(super) fn turn_away(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        known: Option<(Owner, ChannelKind)>,
    ) {
        let code = match known {
            Some((owner, _)) if owner == Owner::Flow(id.wire()) => RefusalCode::WrongKind,
            Some(_) => RefusalCode::NotOwner,
            None => RefusalCode::Gone,
        };
        self.late_fragments += u64::from(code != RefusalCode::WrongKind);
        if flags.has(Flags::FIRST) {
            self.refuse(id, tag, code);
        }
    }

    /// What a fragment of a flow's own channel led to, whichever way it came.
    pub(in super::super) fn gathered(
        &mut self,
        id: ConnectionId,
        tag: u32,
        (channel, message): (ChannelRef, u32),
        gathered: Gathered,
    ) {
        match gathered {
            Gathered::More | Gathered::Ignored => {}
            // The owner may have sent this before it attached the channel to another one.
            Gathered::Whole(_) if self.is_attached(channel) => self.refuse(id, tag, RefusalCode::Attached),
            Gathered::Whole(pieces) => self.fan_out(channel, message, pieces),
            Gathered::Aborted => self.drop_for_all(channel, DropReason::Aborted),
            Gathered::Overfull => {
                self.drop_for_all(channel, DropReason::Aborted);
                self.refuse(id, tag, RefusalCode::Full);
            }
        }
    }

    /// Publishes on a channel of the hub's own. Answers whether anybody listened.
    ///
    /// # Errors
    /// `Gone` if the channel is closed, `NotOwner` if a flow owns it, `Full` if the message is longer
    /// than 16 MiB, or the channel is reliable and its slowest subscriber too far behind.
    pub fn publish_own(&mut self, channel: ChannelRef, message: Bytes) -> Result<bool, RefusalCode> {
        let (known, subscribers) = self.channels.get_mut(channel).ok_or(RefusalCode::Gone)?;
        if known.owner != Owner::Hub {
            return Err(RefusalCode::NotOwner);
        }
        if message.len() > MESSAGE_BYTES_MAX {
            return Err(RefusalCode::Full);
        }
        let heard = subscribers.is_heard();
        if let Some(credit) = subscribers.special.as_mut().and_then(|special| special.credit.as_mut()) {
            if !credit.is_left() {
                return Err(RefusalCode::Full);
            }
            credit.used += charge_of(message.len(), message.len().div_ceil(FRAGMENT_BYTES_MAX).max(1)) as u64;
        }
        self.next_own_message = self.next_own_message.wrapping_add(1);
        let pieces = cut(message, FRAGMENT_BYTES_MAX).map(|(_, piece)| piece).collect();
        self.fan_out(channel, self.next_own_message, pieces);
        self.settle();
        Ok(heard)
    }
}
