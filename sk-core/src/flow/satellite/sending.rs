//! A satellite's way out: commands first, then one fragment of each publishing channel, call and answer in turn.

use super::super::delivery::charge_of;
use super::super::fragment::cut;
use super::super::limits::{CONNECTION_BYTES_MAX, CONTROL_BYTES_MAX, FRAGMENT_BYTES_MAX, WIRE_BYTES_AHEAD};
use super::super::wire::Wire;
use super::super::{ChannelRef, Command, Encoded, Flags, Message as _, Path};
use bytes::Bytes;
use rustc_hash::FxHashMap;
use std::collections::VecDeque;
use std::fmt;

type Fragments = Box<dyn Iterator<Item = (Flags, Bytes)> + Send>;

/// What keeps its order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Stream {
    /// The messages of a channel.
    Channel(ChannelRef),
    /// The call of a tag.
    Call(u32),
    /// The answers to a request.
    Answer(u64),
    /// The pieces of uploads to a channel: they have to end in their order.
    Upload(ChannelRef),
}

/// What a message is, without its bytes.
#[derive(Clone, Debug)]
pub(super) enum Kind {
    Publish { channel: ChannelRef, message: u32 },
    Call { tag: u32, channel: ChannelRef, deadline_ms: u32 },
    Answer { request: u64, more: bool },
    Upload { tag: u32, channel: ChannelRef, path: Path, offset: u64 },
}

impl Kind {
    fn stream(&self) -> Stream {
        match *self {
            Kind::Publish { channel, .. } => Stream::Channel(channel),
            Kind::Call { tag, .. } => Stream::Call(tag),
            Kind::Answer { request, .. } => Stream::Answer(request),
            Kind::Upload { channel, .. } => Stream::Upload(channel),
        }
    }

    fn frame(&self, flags: Flags, payload: Bytes) -> Encoded {
        match *self {
            Kind::Publish { channel, message } => {
                Command::Publish { channel, message, payload }.encode(0, flags)
            }
            Kind::Call { tag, channel, deadline_ms } => {
                Command::Call { channel, deadline_ms, payload }.encode(tag, flags)
            }
            Kind::Upload { tag, channel, ref path, offset } => {
                Command::BlobWrite { channel, path: path.clone(), offset, payload }.encode(tag, flags)
            }
            Kind::Answer { request, more } => {
                Command::Answer { request, more: u8::from(more), payload }.encode(0, flags)
            }
        }
    }
}

enum Sending {
    Message(Message),
    /// A command that comes after the messages before it.
    Command(Encoded),
}

struct Message {
    kind: Kind,
    charge: usize,
    begun: bool,
    fragments: Fragments,
}

impl Sending {
    fn is_begun(&self) -> bool {
        matches!(self, Sending::Message(Message { begun: true, .. }))
    }

    fn charge(&self) -> usize {
        match self {
            Sending::Message(message) => message.charge,
            Sending::Command(frame) => frame.len(),
        }
    }
}

/// What a satellite has to send.
pub(super) struct Outbox {
    wire: Wire<()>,
    commands: VecDeque<Encoded>,
    streams: FxHashMap<Stream, VecDeque<Sending>>,
    turns: VecDeque<Stream>,
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
    pub(super) fn message(&mut self, kind: Kind, payload: Bytes) -> bool {
        let charge = self.charge(payload.len());
        if self.bytes + charge > CONNECTION_BYTES_MAX {
            return false;
        }
        let fragments = Box::new(cut(payload, self.fragment_bytes_max));
        self.queue(kind.stream(), Sending::Message(Message { kind, charge, begun: false, fragments }));
        true
    }

    /// Queues a command that must not overtake the messages before it.
    pub(super) fn command_after(&mut self, stream: Stream, command: &Command, tag: u32) -> bool {
        if !self.streams.contains_key(&stream) {
            return self.command(command, tag);
        }
        let frame = command.encode(tag, Flags::NONE);
        let fits = self.bytes + frame.len() <= CONNECTION_BYTES_MAX + CONTROL_BYTES_MAX;
        if fits {
            self.queue(stream, Sending::Command(frame));
        }
        fits
    }

    fn queue(&mut self, stream: Stream, sending: Sending) {
        self.bytes += sending.charge();
        let waiting = self.streams.entry(stream).or_default();
        if waiting.is_empty() {
            self.turns.push_back(stream);
        }
        waiting.push_back(sending);
    }

    /// Nobody listens any more: messages that have not begun are dropped. Answers how many, and their cost.
    pub(super) fn stop(&mut self, channel: ChannelRef) -> (usize, usize) {
        self.retain(Stream::Channel(channel), Sending::is_begun)
    }

    /// The channel, or the request, is gone: nothing more is sent of it. Answers how many messages that cuts.
    pub(super) fn forget(&mut self, stream: Stream) -> usize {
        self.retain(stream, |_| false).0
    }

    fn retain(&mut self, key: Stream, keep: impl Fn(&Sending) -> bool) -> (usize, usize) {
        let Some(stream) = self.streams.get_mut(&key) else { return (0, 0) };
        let (before, bytes_before) = (stream.len(), self.bytes);
        let bytes = &mut self.bytes;
        stream.retain(|sending| {
            let kept = keep(sending);
            *bytes -= if kept { 0 } else { sending.charge() };
            kept
        });
        let dropped = before - stream.len();
        if stream.is_empty() {
            self.streams.remove(&key);
            self.turns.retain(|turn| *turn != key);
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
            let Some(key) = self.turns.pop_front() else { return };
            let Some(stream) = self.streams.get_mut(&key) else { continue };
            let (frame, charge) = match stream.front_mut() {
                Some(Sending::Message(message)) => match message.fragments.next() {
                    Some((flags, payload)) => {
                        message.begun = true;
                        let done = flags.has(Flags::LAST).then_some(message.charge);
                        (Some(message.kind.frame(flags, payload)), done)
                    }
                    None => (None, Some(message.charge)),
                },
                Some(Sending::Command(frame)) => (Some(frame.clone()), Some(frame.len())),
                None => (None, None),
            };
            if let Some(frame) = frame {
                self.wire.push(frame, ());
            }
            if let Some(charge) = charge {
                self.bytes -= charge;
                stream.pop_front();
            }
            if stream.is_empty() {
                self.streams.remove(&key);
            } else {
                self.turns.push_back(key);
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

    fn publish(outbox: &mut Outbox, channel: ChannelRef, message: u32, payload: Bytes) -> bool {
        outbox.message(Kind::Publish { channel, message }, payload)
    }

    fn next(outbox: &mut Outbox) -> Option<Encoded> {
        outbox.fill();
        outbox.wire.take().map(|(frame, ())| frame)
    }

    #[test]
    fn a_heavy_stream_does_not_delay_a_light_one() {
        let mut outbox = Outbox::default();
        assert!(publish(&mut outbox, HEAVY, 1, Bytes::from(vec![0; 1_000_000])));
        assert!(publish(&mut outbox, LIGHT, 2, Bytes::from_static(b"pulse")));
        assert!(next(&mut outbox).is_some_and(|frame| frame.payload.len() == FRAGMENT_BYTES_MAX));
        assert!(next(&mut outbox).is_some_and(|frame| frame.payload == b"pulse"[..]));
        assert_eq!(std::iter::from_fn(|| next(&mut outbox)).count(), 15);
        assert!(outbox.is_empty() && outbox.bytes == 0);
    }

    #[test]
    fn after_a_stop_only_the_begun_message_goes_on() {
        let mut outbox = Outbox::default();
        for message in 0..3 {
            assert!(publish(&mut outbox, HEAVY, message, Bytes::from(vec![0; 3 * FRAGMENT_BYTES_MAX])));
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
            assert_eq!(publish(&mut outbox, HEAVY, index, message.clone()), index < 32, "message {index}");
        }
        let commands = (0..).take_while(|tag| outbox.command(&Command::Ping {}, *tag)).count();
        assert_eq!(commands, CONTROL_BYTES_MAX / 10, "ten bytes each");
        assert_eq!(outbox.forget(Stream::Channel(HEAVY)), 32);
        assert!(publish(&mut outbox, HEAVY, 1, message));
    }

    #[test]
    fn a_decline_does_not_overtake_the_answers_before_it() {
        let mut outbox = Outbox::default();
        let more = Kind::Answer { request: 5, more: true };
        assert!(outbox.message(more, Bytes::from(vec![0; 2 * FRAGMENT_BYTES_MAX])));
        let decline = Command::Decline { request: 5, text: String::new() };
        assert!(outbox.command_after(Stream::Answer(5), &decline, 1));
        assert!(outbox.command_after(Stream::Answer(6), &decline, 2));
        let kinds: Vec<u8> = std::iter::from_fn(|| next(&mut outbox)).map(|frame| frame.head[0]).collect();
        assert_eq!(kinds, [0x23, 0x22, 0x22, 0x23]);
        assert_eq!(outbox.bytes, 0);
    }
}
