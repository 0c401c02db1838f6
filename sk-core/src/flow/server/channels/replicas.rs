//! Replicating channels: a channel that repeats what another one carries.
//!
//! A replica has one source, and the source knows its replicas. The source counts a replica as a subscriber
//! while somebody hears the replica; so what nobody hears costs nothing, over all levels.

use super::super::{ConnectionId, ServerCore};
use super::audience::Replica;
use crate::flow::channel::Owner;
use crate::flow::delivery::Outgoing;
use crate::flow::error::RefusalCode;
use crate::flow::limits::REPLICA_LEVELS_MAX;
use crate::flow::{ChannelKind, ChannelRef, Event, Right};

/// Stands in `detached` for a source where there was none.
const NO_CHANNEL: ChannelRef = ChannelRef { id: 0, epoch: 0 };

impl ServerCore {
    pub(in super::super) fn attach(
        &mut self,
        id: ConnectionId,
        tag: u32,
        replica: ChannelRef,
        source: ChannelRef,
    ) {
        match self.may_attach(id, replica, source) {
            Err(code) => self.refuse(id, tag, code),
            Ok(()) => {
                self.join(replica, source);
                self.answer(id, tag, &Event::Attached { replica, source });
            }
        }
    }

    fn may_attach(
        &self,
        id: ConnectionId,
        replica: ChannelRef,
        source: ChannelRef,
    ) -> Result<(), RefusalCode> {
        let (known, beside) = self.channels.get(replica).ok_or(RefusalCode::Gone)?;
        let (of_source, _) = self.channels.get(source).ok_or(RefusalCode::Gone)?;
        if known.owner != Owner::Flow(id.wire()) {
            return Err(RefusalCode::NotOwner);
        }
        if !self.is_allowed(id, Right::Subscribe, of_source.name.as_str()) {
            return Err(RefusalCode::Denied);
        }
        // Nobody could hold back a source for the sake of a reliable replica's subscribers.
        let streams = known.kind == ChannelKind::Stream && of_source.kind == ChannelKind::Stream;
        if !streams || beside.is_reliable() {
            return Err(RefusalCode::WrongKind);
        }
        if beside.source().is_some() {
            return Err(RefusalCode::Attached);
        }
        let above = self.levels_above(source, replica).ok_or(RefusalCode::Cycle)?;
        if above + 1 + self.levels_below(replica) > REPLICA_LEVELS_MAX {
            return Err(RefusalCode::Cycle);
        }
        Ok(())
    }

    /// How many channels one after another `channel` repeats; `None` if `forbidden` is it or one of them.
    fn levels_above(&self, channel: ChannelRef, forbidden: ChannelRef) -> Option<usize> {
        let mut at = channel;
        let mut levels = 0;
        while at != forbidden {
            match self.channels.get(at).and_then(|(_, beside)| beside.source()) {
                Some(source) => (at, levels) = (source, levels + 1),
                None => return Some(levels),
            }
        }
        None
    }

    /// How many channels one after another repeat `channel`.
    fn levels_below(&self, channel: ChannelRef) -> usize {
        let replicas = self.channels.get(channel).map_or(&[][..], |(_, beside)| beside.replicas());
        replicas
            .iter()
            .map(|replica| 1 + self.levels_below(replica.channel))
            .max()
            .unwrap_or(0)
    }

    fn join(&mut self, replica: ChannelRef, source: ChannelRef) {
        let Some((known, beside)) = self.channels.get_mut(replica) else { return };
        let (owner, heard) = (known.owner, beside.is_heard());
        beside.special_mut().source = Some(source);
        if let Some((_, beside)) = self.channels.get_mut(source) {
            beside.special_mut().replicas.push(Replica { channel: replica, heard: false });
        }
        if heard {
            self.tell_owner(replica, owner, false);
            if let Some(latched) = self.latch_of(source) {
                self.repeat_on(replica, &latched);
            }
            self.replica_is_heard(source, replica, true);
        }
    }

    /// It may be sent where nothing is attached: the source may just have gone.
    pub(in super::super) fn detach(&mut self, id: ConnectionId, tag: u32, replica: ChannelRef) {
        let Some((known, beside)) = self.channels.get(replica) else {
            return self.refuse(id, tag, RefusalCode::Gone);
        };
        if known.owner != Owner::Flow(id.wire()) {
            return self.refuse(id, tag, RefusalCode::NotOwner);
        }
        let source = beside.source().unwrap_or(NO_CHANNEL);
        self.answer(id, tag, &Event::Detached { replica, source });
        self.part(replica);
    }

    /// Ends the repeating without its owner's will: the source has gone, or the right to it.
    pub(in super::super) fn force_apart(&mut self, replica: ChannelRef) {
        let Some((known, beside)) = self.channels.get(replica) else { return };
        let Some(source) = beside.source() else { return };
        self.tell_owning_flow(known.owner, &Event::Detached { replica, source });
        self.part(replica);
    }

    /// From here on the owner publishes again, if somebody hears it.
    fn part(&mut self, replica: ChannelRef) {
        let Some((known, beside)) = self.channels.get_mut(replica) else { return };
        let (owner, heard) = (known.owner, beside.is_heard());
        let Some(source) = beside.special.as_mut().and_then(|special| special.source.take()) else { return };
        self.keep_no_longer(replica);
        if let Some((_, beside)) = self.channels.get_mut(source) {
            let was_heard = beside.is_heard();
            beside.special_mut().replicas.retain(|known| known.channel != replica);
            self.audience_changed(source, was_heard);
        }
        if heard {
            self.tell_owner(replica, owner, true);
        }
    }

    /// A channel goes: it repeats nothing any more and is not repeated, and nothing is kept of it.
    pub(super) fn cut_ties(&mut self, channel: ChannelRef) {
        let Some((_, beside)) = self.channels.get(channel) else { return };
        let Some(special) = &beside.special else { return };
        let replicas = special.replicas.clone();
        let pollers: Vec<ConnectionId> = special.pollers.iter().map(|poller| poller.connection).collect();
        for replica in replicas {
            self.force_apart(replica.channel);
        }
        for poller in pollers {
            self.end_polling(poller, channel);
        }
        self.keep_no_longer(channel);
        let Some((_, beside)) = self.channels.get_mut(channel) else { return };
        let Some(source) = beside.special.as_mut().and_then(|special| special.source.take()) else { return };
        let Some((_, beside)) = self.channels.get_mut(source) else { return };
        let was_heard = beside.is_heard();
        beside.special_mut().replicas.retain(|known| known.channel != channel);
        self.audience_changed(source, was_heard);
    }

    pub(super) fn is_attached(&self, channel: ChannelRef) -> bool {
        self.channels.get(channel).is_some_and(|(_, beside)| beside.source().is_some())
    }

    /// A replica began or ceased to be heard, and so may its source.
    pub(super) fn replica_is_heard(&mut self, source: ChannelRef, replica: ChannelRef, heard: bool) {
        let Some((_, beside)) = self.channels.get_mut(source) else { return };
        let was_heard = beside.is_heard();
        let replicas = &mut beside.special_mut().replicas;
        if let Some(known) = replicas.iter_mut().find(|known| known.channel == replica) {
            known.heard = heard;
        }
        self.audience_changed(source, was_heard);
    }

    /// Repeats a message on all replicas that somebody hears.
    pub(in super::super) fn repeat(&mut self, channel: ChannelRef, outgoing: &Outgoing) {
        for replica in self.heard_replicas(channel) {
            self.repeat_on(replica, outgoing);
        }
    }

    fn repeat_on(&mut self, replica: ChannelRef, outgoing: &Outgoing) {
        if let Some((_, beside)) = self.channels.get_mut(replica) {
            beside.published += 1;
            beside.last = Some(self.now);
        }
        let repeated = outgoing.repeated_on(replica);
        self.keep_newest(replica, &repeated);
        self.deliver(replica, &repeated);
        self.repeat(replica, &repeated);
    }
}
