//! The rules of the hub, with its two sides talking through memory.

#[cfg(feature = "store")]
mod accounts;
mod blobs;
mod channels;
mod databases;
mod deadlines;
mod delivery;
mod inspect;
mod login;
mod policies;
mod polling;
mod reliable;
mod replicas;
#[cfg(feature = "store")]
mod rights;
#[cfg(feature = "store")]
mod rights_matrix;
#[cfg(feature = "store")]
mod rights_model;
mod service_limits;
mod services;
mod sessions;
#[cfg(feature = "store")]
mod stored;
mod sync;
mod udp;
mod watches;

use super::super::error::RefusalCode;
use super::super::limits::*;
use super::super::satellite::{Credentials, SatelliteCore, SatelliteEvent};
use super::super::{
    ChannelKind, ChannelRef, Command, Flags, Form, Header, Inbound, Policy, Properties, Right, Rights, Tagged,
};
use super::*;
use bytes::Bytes;
use sk_flat::SkVariant;
use std::time::Duration;

const UID: u32 = 1000;
const OWNER: Origin = Origin::Unix { uid: UID };

fn hub() -> ServerCore {
    let user = "robot".parse().expect("a name");
    let settings = Settings { user, token: Some(OwnerToken::new([7; 32])), owner_uid: Some(UID) };
    ServerCore::new(settings, Instant::ZERO)
}

fn no_properties() -> Properties {
    Properties::new(&SkVariant::map([] as [(&str, SkVariant); 0])).expect("an empty map")
}

fn set_async() -> Command {
    Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Binary }
}

fn subscribe(channel: ChannelRef, depth: u16) -> Command {
    Command::Subscribe { channel, policy: Policy::Latest, depth, divisor: 1 }
}

fn at(ms: u64) -> Instant {
    Instant::ZERO + Duration::from_millis(ms)
}

/// A client that sends exactly what a test tells it to.
struct Raw {
    id: ConnectionId,
    inbound: Inbound<Event>,
}

impl Raw {
    fn open(hub: &mut ServerCore, origin: Origin) -> Raw {
        let id = hub.open(origin, [1; 32], hub.now).expect("a place");
        Raw { id, inbound: Inbound::new() }
    }

    fn hello(fragment_bytes: u32) -> Command {
        let (version, version_oldest) = (VERSION, VERSION_OLDEST);
        Command::Hello {
            magic: MAGIC,
            version,
            version_oldest,
            fragment_bytes,
            message_bytes: 1 << 24,
            nonce: [2; 32],
        }
    }

    fn send(&self, hub: &mut ServerCore, tag: u32, command: &Command) {
        self.send_flagged(hub, tag, Flags::NONE, command);
    }

    fn send_flagged(&self, hub: &mut ServerCore, tag: u32, flags: Flags, command: &Command) {
        hub.receive(self.id, &command.encode(tag, flags).to_vec(), hub.now);
    }

    /// Everything that the hub has for this client.
    fn read(&mut self, hub: &mut ServerCore) -> Vec<Tagged<Event>> {
        let mut events = Vec::new();
        loop {
            let one = self.read_one(hub);
            if one.is_empty() {
                return events;
            }
            events.extend(one);
        }
    }

    /// The next frame that the hub has for this client.
    fn read_one(&mut self, hub: &mut ServerCore) -> Vec<Tagged<Event>> {
        let mut events = Vec::new();
        if let Some(frame) = hub.take(self.id) {
            self.inbound.feed(&frame.to_vec());
            while let Some(event) = self.inbound.next().expect("the hub is honest") {
                if matches!(
                    event.message,
                    Event::Welcome { .. } | Event::LoggedIn { .. } | Event::FlowBegun { .. }
                ) {
                    self.inbound.advance();
                }
                events.push(event);
            }
        }
        events
    }

    fn flow(hub: &mut ServerCore, origin: Origin) -> Raw {
        Raw::flow_with(hub, origin, FRAGMENT_BYTES_MAX as u32)
    }

    fn flow_with(hub: &mut ServerCore, origin: Origin, fragment_bytes: u32) -> Raw {
        let mut raw = Raw::open(hub, origin);
        for command in [Raw::hello(fragment_bytes), Command::LoginPeer {}, set_async()] {
            raw.send(hub, 1, &command);
        }
        raw.read(hub);
        assert_eq!(raw.inbound.state(), State::Flow);
        raw
    }

    fn synchronous(hub: &mut ServerCore, origin: Origin) -> Raw {
        let mut raw = Raw::open(hub, origin);
        for command in [Raw::hello(FRAGMENT_BYTES_MAX as u32), Command::LoginPeer {}] {
            raw.send(hub, 1, &command);
        }
        raw.read(hub);
        assert_eq!(raw.inbound.state(), State::Synchronous);
        raw
    }

    /// Sends a command and answers what came with its tag.
    fn ask(&mut self, hub: &mut ServerCore, command: &Command) -> Vec<Event> {
        self.send(hub, 79, command);
        tagged(&self.read(hub), 79)
    }

    fn create(&mut self, hub: &mut ServerCore, name: &str) -> ChannelRef {
        self.send(hub, 77, &Command::CreateStream { name: name.to_owned(), properties: no_properties() });
        let events = self.read(hub);
        let created = events.iter().find_map(|event| match &event.message {
            Event::ChannelAdded { channel, .. } if event.tag == 77 => Some(*channel),
            _ => None,
        });
        created.unwrap_or_else(|| panic!("no channel, but {events:?}"))
    }

    fn serve(&mut self, hub: &mut ServerCore, name: &str) -> ChannelRef {
        self.send(hub, 77, &Command::CreateService { name: name.to_owned(), properties: no_properties() });
        let events = tagged(&self.read(hub), 77);
        match events.as_slice() {
            [Event::ChannelAdded { channel, .. }] => *channel,
            other => panic!("no service, but {other:?}"),
        }
    }

    /// A call in one fragment with the default deadline.
    fn call(&self, hub: &mut ServerCore, tag: u32, channel: ChannelRef, payload: &'static [u8]) {
        let payload = Bytes::from_static(payload);
        self.send_flagged(hub, tag, Flags::WHOLE, &Command::Call { channel, deadline_ms: 0, payload });
    }

    fn answer(&self, hub: &mut ServerCore, request: u64, more: u8, payload: &'static [u8]) {
        let payload = Bytes::from_static(payload);
        self.send_flagged(hub, 0, Flags::WHOLE, &Command::Answer { request, more, payload });
    }

    /// The ids of the requests that came.
    fn requests(&mut self, hub: &mut ServerCore) -> Vec<u64> {
        let events = messages(self.read(hub));
        events
            .iter()
            .filter_map(|event| match event {
                Event::Request { request, .. } => Some(*request),
                _ => None,
            })
            .collect()
    }

    /// The only request that came.
    fn request(&mut self, hub: &mut ServerCore) -> u64 {
        match self.requests(hub).as_slice() {
            [request] => *request,
            other => panic!("one request was expected: {other:?}"),
        }
    }

    fn subscribe(&mut self, hub: &mut ServerCore, channel: ChannelRef) {
        self.send(hub, 78, &subscribe(channel, 0));
        assert!(tagged(&self.read(hub), 78).contains(&Event::Subscribed { channel }));
    }

    fn publish(&self, hub: &mut ServerCore, channel: ChannelRef, payload: Bytes) {
        self.send_flagged(hub, 9, Flags::WHOLE, &Command::Publish { channel, message: 1, payload });
    }
}

fn with_properties(of: impl IntoIterator<Item = (&'static str, SkVariant)>) -> Properties {
    Properties::new(&SkVariant::map(of)).expect("a small map")
}

impl Raw {
    fn create_with(&mut self, hub: &mut ServerCore, name: &str, properties: Properties) -> ChannelRef {
        self.send(hub, 76, &Command::CreateStream { name: name.to_owned(), properties });
        let events = tagged(&self.read(hub), 76);
        let created = events.iter().find_map(|event| match event {
            Event::ChannelAdded { channel, .. } => Some(*channel),
            _ => None,
        });
        created.unwrap_or_else(|| panic!("no channel, but {events:?}"))
    }

    fn subscribe_as(&mut self, hub: &mut ServerCore, channel: ChannelRef, policy: Policy, depth: u16) {
        self.send(hub, 78, &Command::Subscribe { channel, policy, depth, divisor: 1 });
        assert!(tagged(&self.read(hub), 78).contains(&Event::Subscribed { channel }));
    }

    /// Hands a message over without copying it, as a module inside the process does.
    fn hand(&self, hub: &mut ServerCore, channel: ChannelRef, payload: &Bytes) {
        for (flags, payload) in crate::flow::fragment::cut(payload.clone(), FRAGMENT_BYTES_MAX) {
            let publish = Command::Publish { channel, message: 1, payload };
            hub.accept(self.id, publish.encode(9, flags), hub.now);
            while hub.work(hub.now) {}
        }
    }

    /// The payloads of the messages of a channel that come now.
    fn heard(&mut self, hub: &mut ServerCore, channel: ChannelRef) -> Vec<Vec<u8>> {
        let mut messages = Vec::new();
        for event in self.read(hub) {
            if let Event::Data { channel: on, payload, .. } = &event.message
                && *on == channel
            {
                if event.flags.has(Flags::FIRST) {
                    messages.push(Vec::new());
                }
                let begun = messages.last_mut().expect("a message begins before it goes on");
                begun.extend_from_slice(payload);
            }
        }
        messages
    }
}

fn tagged(events: &[Tagged<Event>], tag: u32) -> Vec<Event> {
    events
        .iter()
        .filter(|event| event.tag == tag)
        .map(|event| in_usual_words(event.message.clone()))
        .collect()
}

/// In which words a code is said to whom has tests of its own. What an owner says who declines is not touched.
fn in_usual_words(event: Event) -> Event {
    match event {
        Event::Refused { code, .. } if code != RefusalCode::Declined.code() => {
            let text = RefusalCode::from_code(code).map_or_else(String::new, |code| code.to_string());
            Event::Refused { code, text }
        }
        event => event,
    }
}

fn messages(events: Vec<Tagged<Event>>) -> Vec<Event> {
    events.into_iter().map(|event| event.message).collect()
}

fn ending(hub: &mut ServerCore, id: ConnectionId) -> Option<Ending> {
    std::iter::from_fn(|| hub.next_notice()).find_map(|notice| match notice {
        Notice::Ended { connection, ending } if connection == id => Some(ending),
        _ => None,
    })
}

fn refusal(events: &[Tagged<Event>], tag: u32) -> Option<RefusalCode> {
    tagged(events, tag).iter().find_map(|event| match event {
        Event::Refused { code, .. } => RefusalCode::from_code(*code),
        _ => None,
    })
}
