//! An honest client of another make: the protocol's core over a plain socket.

use super::wire::{self, Heard};
use crate::action::Action;
use crate::channels::{is_reliable, properties_of};
use crate::identity::Identity;
use crate::ledger;
use crate::script::Way;
use crate::stamp::{Origin, channel_name, own_name};
use crate::wishes::Wishes;
use bytes::Bytes;
use sk_core::flow::satellite::{SatelliteCore, SatelliteEvent};
use sk_core::flow::{ChannelRef, Command, Flags, Message};
use sk_core::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// How often it looks at deadlines, and how often a slow reader reads.
const LOOKS_EVERY: Duration = Duration::from_millis(100);
const READS_EVERY: Duration = Duration::from_millis(5);
/// How long it waits before it connects anew.
const CONNECTS_AFTER: Duration = Duration::from_millis(300);
/// Ids of messages that are given up lie apart from those of the core.
const ABORTED_FROM: u32 = 1 << 31;
/// The longest first fragment of a message that is given up.
const FRAGMENT_BYTES_MAX: usize = 60_000;

/// A program that speaks the protocol itself.
pub(crate) struct Plain {
    who: Identity,
    way: Way,
    timer: Handle<Timer>,
    socket: Option<Handle<Socket>>,
    core: Option<SatelliteCore>,
    /// Every channel there is, in step with the events.
    names: BTreeMap<ChannelRef, String>,
    /// The channels it wants to have.
    own: BTreeSet<u8>,
    /// Those it has: one that was asked to be closed is there until the hub says so.
    held: BTreeMap<u8, ChannelRef>,
    /// What it wants to hear, with the depth.
    wanted: BTreeMap<String, u16>,
    aborted: u32,
    bytes_per_look: usize,
    connect_at: Instant,
    ready: bool,
}

object! { pub(crate) Plain { slots { look() hear() gone(&CloseReason) go_on() } } }

impl Plain {
    pub(crate) fn start(cx: &mut Cx, who: Identity, way: Way) -> Handle<Plain> {
        cx.spawn_with(|cx, this: Handle<Plain>| {
            let timer = cx.under(this).spawn(Timer::default());
            attach!(cx, timer.timeout => this.look);
            // It was made just now.
            let _ = timer.start(cx, LOOKS_EVERY);
            Plain {
                who,
                way,
                timer,
                socket: None,
                core: None,
                names: BTreeMap::new(),
                own: BTreeSet::new(),
                held: BTreeMap::new(),
                wanted: BTreeMap::new(),
                aborted: ABORTED_FROM,
                bytes_per_look: 0,
                connect_at: Instant::ZERO,
                ready: false,
            }
        })
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        let who = self.who;
        let Some(core) = &mut self.core else { return self.wish(action) };
        // Refused commands are told in the events; what cannot be asked now is asked when the link is there.
        match action {
            Action::Open(channel) if core.is_ready() && !self.own.contains(&channel) => {
                let _ = core.create(&own_name(who.node, channel), &properties_of(who.node, channel));
            }
            Action::Close(channel) => {
                if let Some(reference) = self.held.get(&channel) {
                    let _ = core.remove(*reference);
                }
            }
            Action::Hear(node, channel, depth) if core.is_ready() => {
                let _ = core.subscribe(&channel_name(node, channel), depth);
            }
            Action::Unhear(node, channel) => {
                let name = channel_name(node, channel);
                let _ = core.unsubscribe(&name);
                let connection = core.connection();
                if let Some((reference, _)) = self.names.iter().find(|(_, known)| **known == name) {
                    ledger::with(|ledger| ledger.gave_up(who, connection, *reference));
                }
            }
            Action::Burst(channel, count, bytes) => {
                for _ in 0..count {
                    self.publish(cx, channel, bytes as usize);
                }
            }
            Action::Abort(channel, bytes) => self.abort(cx, channel, bytes as usize),
            Action::Slow(bytes) => {
                self.bytes_per_look = bytes as usize;
                let every = if bytes == 0 { LOOKS_EVERY } else { READS_EVERY };
                // It is this object's child.
                let _ = self.timer.start(cx, every);
                self.look(cx);
            }
            _ => {}
        }
        self.wish(action);
        self.flush(cx);
    }

    /// Remembers what it wants from now on.
    fn wish(&mut self, action: Action) {
        match action {
            Action::Open(channel) => {
                self.own.insert(channel);
            }
            Action::Close(channel) => {
                self.own.remove(&channel);
            }
            Action::Hear(node, channel, depth) => {
                self.wanted.insert(channel_name(node, channel), depth);
            }
            Action::Unhear(node, channel) => {
                self.wanted.remove(&channel_name(node, channel));
            }
            _ => {}
        }
    }

    pub(crate) fn wishes(&self) -> Wishes {
        let own = self.own.iter().map(|channel| channel_name(self.who.node, *channel));
        Wishes {
            hub: self.who.hub,
            ready: self.ready,
            connection: self.connection(),
            own: own.collect(),
            wanted: self.wanted.keys().cloned().collect(),
            known: Some(self.names.keys().copied().collect()),
        }
    }

    fn connection(&self) -> Option<u64> {
        self.core.as_ref().map(SatelliteCore::connection).filter(|id| *id != 0)
    }

    fn publish(&mut self, cx: &mut Cx, channel: u8, bytes: usize) {
        let (Some(core), Some(reference)) = (&mut self.core, self.held.get(&channel)) else { return };
        let origin = Origin { node: self.who.node, life: self.who.life, channel };
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            let stamp = ledger.next_stamp(origin, *reference);
            if core.publish(*reference, stamp.message(bytes)) == Ok(true) {
                ledger.was_published(&stamp, true);
            }
        });
    }

    /// Begins a message and gives it up, which the core never does by itself.
    fn abort(&mut self, cx: &mut Cx, channel: u8, bytes: usize) {
        self.flush(cx);
        let (Some(core), Some(socket), Some(reference)) = (&self.core, self.socket, self.held.get(&channel))
        else {
            return;
        };
        // Behind a message of the core that is half out it would be dishonest, and so it would be to use up credit that the
        // core counts on.
        if core.has_output() || !core.is_ready() || is_reliable(self.who.node, channel) {
            return;
        }
        self.aborted += 1;
        let publish = |payload| Command::Publish { channel: *reference, message: self.aborted, payload };
        let first = publish(Bytes::from(vec![0; bytes.clamp(1, FRAGMENT_BYTES_MAX)]));
        for frame in [first.encode(0, Flags::FIRST), publish(Bytes::new()).encode(0, Flags::ABORT)] {
            // A socket that takes nothing any more is told as closed.
            let _ = socket.write(cx, frame.to_vec());
        }
    }

    fn connect(&mut self, cx: &mut Cx) {
        self.connect_at = cx.now() + CONNECTS_AFTER;
        let this = cx.this(self);
        let Ok(socket) = Socket::connect_placed(cx.under(this), &self.way.address(self.who.hub).endpoint())
        else {
            return;
        };
        attach!(cx, socket.readable => this.hear);
        attach!(cx, socket.connected => this.go_on);
        attach!(cx, socket.drained => this.go_on);
        attach!(cx, socket.closed => this.gone);
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        self.socket = Some(socket);
        self.core = Some(SatelliteCore::flow(self.way.credentials(self.who.home), nonce, cx.now()));
        self.flush(cx);
    }

    fn look(&mut self, cx: &mut Cx) {
        let now = cx.now();
        match &mut self.core {
            None if now >= self.connect_at => self.connect(cx),
            None => {}
            Some(core) => {
                if core.tick(now).is_err() {
                    return self.lose(cx);
                }
                self.read(cx);
            }
        }
        self.flush(cx);
    }

    fn hear(&mut self, cx: &mut Cx) {
        if self.bytes_per_look == 0 {
            self.read(cx);
            self.flush(cx);
        }
    }

    fn read(&mut self, cx: &mut Cx) {
        let most = if self.bytes_per_look == 0 { wire::ROOM } else { self.bytes_per_look };
        while let (Some(socket), Some(core)) = (self.socket, &mut self.core) {
            match wire::hear(cx, core, socket, most, self.who.node) {
                Heard::Nothing => return,
                Heard::Something => self.take_events(cx),
                Heard::Nonsense => return self.lose(cx),
            }
            if self.bytes_per_look != 0 {
                return;
            }
        }
    }

    fn take_events(&mut self, cx: &mut Cx) {
        while let Some(event) = self.core.as_mut().and_then(SatelliteCore::next_event) {
            match event {
                SatelliteEvent::Ready => self.let_in(cx),
                SatelliteEvent::ChannelAdded(info) => {
                    self.names.insert(info.channel, info.name);
                }
                SatelliteEvent::Created { channel, name, .. } => {
                    let mine = (0..=u8::MAX).find(|own| channel_name(self.who.node, *own) == name);
                    if let Some(own) = mine {
                        self.held.insert(own, channel);
                    }
                }
                SatelliteEvent::ChannelRemoved(info) => {
                    self.names.remove(&info.channel);
                    self.held.retain(|_, reference| *reference != info.channel);
                    self.take_free_name(&info.name);
                }
                SatelliteEvent::Message { channel, payload } => {
                    let connection = self.connection().unwrap_or(0);
                    let name = self.names.get(&channel).map_or("(nothing)", String::as_str);
                    ledger::with(|ledger| {
                        ledger.now = cx.clock_now();
                        ledger.was_heard(self.who, connection, (name, channel), &payload);
                    });
                }
                SatelliteEvent::Refused { text, .. } => {
                    ledger::with(|ledger| ledger.was_refused(self.who.node, &text));
                }
                _ => {}
            }
        }
    }

    /// A name is free that a former process of this client may have had until now.
    fn take_free_name(&mut self, full_name: &str) {
        let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) else { return };
        let mut mine = self
            .own
            .iter()
            .filter(|channel| channel_name(self.who.node, **channel) == full_name);
        if let Some(channel) = mine.next()
            && !core.is_creating(full_name)
        {
            let _ = core.create(&own_name(self.who.node, *channel), &properties_of(self.who.node, *channel));
        }
    }

    fn let_in(&mut self, cx: &mut Cx) {
        self.ready = true;
        let Some(core) = &mut self.core else { return };
        let connection = core.connection();
        ledger::with(|ledger| ledger.was_let_in(self.who, connection));
        for channel in &self.own {
            let _ = core.create(&own_name(self.who.node, *channel), &properties_of(self.who.node, *channel));
        }
        for (name, depth) in &self.wanted {
            let _ = core.subscribe(name, *depth);
        }
        ledger::with(|ledger| ledger.note(&[8, self.who.node.into(), cx.clock_now().as_nanos()]));
    }

    fn go_on(&mut self, cx: &mut Cx) {
        self.flush(cx);
    }

    fn flush(&mut self, cx: &mut Cx) {
        if let (Some(core), Some(socket)) = (&mut self.core, self.socket) {
            wire::flush(cx, core, socket);
        }
    }

    fn gone(&mut self, cx: &mut Cx, _: &CloseReason) {
        self.lose(cx);
    }

    fn lose(&mut self, cx: &mut Cx) {
        if let Some(socket) = self.socket.take() {
            cx.destroy_later(socket);
        }
        self.core = None;
        self.ready = false;
        self.names.clear();
        self.held.clear();
        self.connect_at = cx.now() + CONNECTS_AFTER;
        ledger::with(|ledger| ledger.note(&[9, self.who.node.into(), cx.clock_now().as_nanos()]));
    }
}
