//! A satellite's way out: commands first, then one fragment of each publishing channel in turn.

use super::super::delivery::charge_of;
use super::super::fragment::cut;
use super::super::limits::{CONNECTION_BYTES_MAX, CONTROL_BYTES_MAX, FRAGMENT_BYTES_MAX, WIRE_BYTES_AHEAD};
use super::super::wire::Wire;
use super::super::{ChannelRef, Command, Encoded, Flags, Message};
use bytes::Bytes;
use rustc_hash::FxHashMap;
use std::collections::VecDeque;
use std::fmt;

type Fragments = Box<dyn Iterator<Item = (Flags, Bytes)> + Send>;

struct Sending {
    message: u32,
    charge: usize,
    begun: bool,
    fragments: Fragments,
}

/// What a satellite has to send.
pub(super) struct Outbox {
    wire: Wire<()>,
    commands: VecDeque<Encoded>,
    streams: FxHashMap<ChannelRef, VecDeque<Sending>>,
    turns: VecDeque<ChannelRef>,
    /// Charges of commands and messages that are not on the wire's side yet.
    bytes: usize,
    pub(super) fragment_bytes_max: usize,
}

impl Default for Outbox {
    fn default() -> Self {
        Outbox {
            wire: Wire::default(),
            commands: VecDeque::new(),
            streams: FxHashMap::default(),
            turns: VecDeque::new(),
            bytes: 0,
            fragment_bytes_max: FRAGMENT_BYTES_MAX,
        }
    }
}

impl fmt::Debug for Outbox {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Outbox")
            .field("bytes", &self.bytes)
            .field("streams", &self.streams.len())
            .finish()
    }
}

impl Outbox {
    /// Queues a command; `false` if there is no room. Messages leave some room for commands.
    pub(super) fn command(&mut self, command: &Command, tag: u32) -> bool {
        let frame = command.encode(tag, Flags::NONE);
        if self.bytes + frame.len() > CONNECTION_BYTES_MAX + CONTROL_BYTES_MAX {
            return false;
        }
        self.bytes += frame.len();
        self.commands.push_back(frame);
        true
    }

    /// What a message costs, here and of the credit of a reliable channel: its payload and a little for each
    /// fragment.
    pub(super) fn charge(&self, bytes: usize) -> usize {
        charge_of(bytes, bytes.div_ceil(self.fragment_bytes_max).max(1))
    }

    /// Queues a message; `false` if there is no room.
    pub(super) fn publish(&mut self, channel: ChannelRef, message: u32, payload: Bytes) -> bool {
        let charge = self.charge(payload.len());
        if self.bytes + charge > CONNECTION_BYTES_MAX {
            return false;
        }
        self.bytes += charge;
        let fragments = Box::new(cut(payload, self.fragment_bytes_max));
        let stream = self.streams.entry(channel).or_default();
        if stream.is_empty() {
            self.turns.push_back(channel);
        }
        stream.push_back(Sending { message, charge, begun: false, fragments });
        true
    }

    /// Nobody listens any more: messages that have not begun are dropped. Answers how many, and their cost.
    pub(super) fn stop(&mut self, channel: ChannelRef) -> (usize, usize) {
        self.retain(channel, |sending| sending.begun)
    }

    /// The channel is gone: nothing more is sent on it. Answers how many messages that cuts.
    pub(super) fn forget(&mut self, channel: ChannelRef) -> usize {
        self.retain(channel, |_| false).0
    }

    fn retain(&mut self, channel: ChannelRef, keep: impl Fn(&Sending) -> bool) -> (usize, usize) {
        let Some(stream) = self.streams.get_mut(&channel) else { return (0, 0) };
        let (before, bytes_before) = (stream.len(), self.bytes);
        let bytes = &mut self.bytes;
        stream.retain(|sending| {
            let kept = keep(sending);
            *bytes -= if kept { 0 } else { sending.charge };
            kept
        });
        let dropped = before - stream.len();
        if stream.is_empty() {
            self.streams.remove(&channel);
            self.turns.retain(|turn| *turn != channel);
        }
        (dropped, bytes_before - self.bytes)
    }

    /// Moves frames to the wire.
    pub(super) fn fill(&mut self) {
        while self.wire.bytes() < WIRE_BYTES_AHEAD {
            if let Some(frame) = self.commands.pop_front() {
                self.bytes -= frame.len();
                self.wire.push(frame, ());
                continue;
            }
            let Some(channel) = self.turns.pop_front() else { return };
            let Some(stream) = self.streams.get_mut(&channel) else { continue };
            if let Some(sending) = stream.front_mut()
                && let Some((flags, payload)) = sending.fragments.next()
            {
                sending.begun = true;
                let publish = Command::Publish { channel, message: sending.message, payload };
                self.wire.push(publish.encode(0, flags), ());
                if flags.has(Flags::LAST) {
                    self.bytes -= sending.charge;
                    stream.pop_front();
                }
            }
            if stream.is_empty() {
                self.streams.remove(&channel);
            } else {
                self.turns.push_back(channel);
            }
        }
    }

    pub(super) fn wire(&mut self) -> &mut Wire<()> {
        &mut self.wire
    }

    pub(super) fn is_empty(&self) -> bool {
        self.wire.is_empty() && self.commands.is_empty() && self.turns.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::frame::Header;
    use super::super::super::limits::ITEM_OVERHEAD_BYTES;
    use super::*;

    const HEAVY: ChannelRef = ChannelRef { id: 2000, epoch: 1 };
    const LIGHT: ChannelRef = ChannelRef { id: 2001, epoch: 1 };

    fn next(outbox: &mut Outbox) -> Option<Encoded> {
        outbox.fill();
        outbox.wire.take().map(|(frame, ())| frame)
    }

    #[test]
    fn a_heavy_stream_does_not_delay_a_light_one() {
        let mut outbox = Outbox::default();
        assert!(outbox.publish(HEAVY, 1, Bytes::from(vec![0; 1_000_000])));
        assert!(outbox.publish(LIGHT, 2, Bytes::from_static(b"pulse")));
        assert!(next(&mut outbox).is_some_and(|frame| frame.payload.len() == FRAGMENT_BYTES_MAX));
        assert!(next(&mut outbox).is_some_and(|frame| frame.payload == b"pulse"[..]));
        assert_eq!(std::iter::from_fn(|| next(&mut outbox)).count(), 15);
        assert!(outbox.is_empty() && outbox.bytes == 0);
    }

    #[test]
    fn after_a_stop_only_the_begun_message_goes_on() {
        let mut outbox = Outbox::default();
        for message in 0..3 {
            assert!(outbox.publish(HEAVY, message, Bytes::from(vec![0; 3 * FRAGMENT_BYTES_MAX])));
        }
        assert!(next(&mut outbox).is_some());
        assert_eq!(outbox.stop(HEAVY), (2, 2 * outbox.charge(3 * FRAGMENT_BYTES_MAX)));
        let flags: Vec<u8> = std::iter::from_fn(|| next(&mut outbox))
            .filter_map(|frame| Some(Header::parse(&frame.head)?.flags))
            .collect();
        assert_eq!(flags, [0, 2]);
        assert_eq!(outbox.bytes, 0);
    }

    #[test]
    fn what_waits_is_limited_in_bytes() {
        let mut outbox = Outbox::default();
        let message = Bytes::from(vec![0; 1024 * 1024 - 16 * ITEM_OVERHEAD_BYTES]);
        for index in 0..33 {
            assert_eq!(outbox.publish(HEAVY, index, message.clone()), index < 32, "message {index}");
        }
        let commands = (0..).take_while(|tag| outbox.command(&Command::Ping {}, *tag)).count();
        assert_eq!(commands, CONTROL_BYTES_MAX / 10, "ten bytes each");
        assert_eq!(outbox.forget(HEAVY), 32);
        assert!(outbox.publish(HEAVY, 1, message));
    }
}
