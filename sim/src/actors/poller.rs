//! A client that asks for the newest messages of channels over a synchronous connection.

use super::wire::{self, Heard};
use crate::action::Action;
use crate::identity::Identity;
use crate::ledger;
use crate::rule::Rule;
use crate::script::Way;
use crate::stamp::{Origin, channel_name};
use crate::wishes::Wishes;
use sk_core::flow::satellite::{SatelliteCore, SatelliteEvent};
use sk_core::flow::{ChannelRef, RefusalCode};
use sk_core::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// How often it looks at deadlines.
const LOOKS_EVERY: Duration = Duration::from_millis(100);
/// How long it waits before it connects anew.
const CONNECTS_AFTER: Duration = Duration::from_millis(300);

/// A channel for which the hub keeps the newest message.
struct Registration {
    channel: ChannelRef,
    /// When it was known here that the hub does.
    since: Instant,
    /// The last that came.
    last: Option<(Origin, u64)>,
}

/// What was asked under a tag.
enum Asked {
    Register(String, ChannelRef),
    /// With what the hub had for sure at that moment.
    Newest(String, Option<(Origin, u64)>),
}

/// A program that looks in now and then.
pub(crate) struct Poller {
    who: Identity,
    way: Way,
    socket: Option<Handle<Socket>>,
    core: Option<SatelliteCore>,
    wanted: BTreeSet<String>,
    registered: BTreeMap<String, Registration>,
    asked: BTreeMap<u32, Asked>,
    connect_at: Instant,
    ready: bool,
}

object! { pub(crate) Poller { slots { look() hear() gone(&CloseReason) } } }

impl Poller {
    pub(crate) fn start(cx: &mut Cx, who: Identity, way: Way) -> Handle<Poller> {
        cx.spawn_with(|cx, this: Handle<Poller>| {
            let timer = cx.under(this).spawn(Timer::default());
            attach!(cx, timer.timeout => this.look);
            // It was made just now.
            let _ = timer.start(cx, LOOKS_EVERY);
            Poller {
                who,
                way,
                socket: None,
                core: None,
                wanted: BTreeSet::new(),
                registered: BTreeMap::new(),
                asked: BTreeMap::new(),
                connect_at: Instant::ZERO,
                ready: false,
            }
        })
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        match action {
            Action::Poll(node, channel) => self.poll(&channel_name(node, channel)),
            Action::PollNoMore(node, channel) => {
                let name = channel_name(node, channel);
                self.wanted.remove(&name);
                if let (Some(core), Some(old)) = (&mut self.core, self.registered.remove(&name)) {
                    // What cannot be said any more ends with the connection.
                    let _ = core.poll_deregister(old.channel);
                }
            }
            _ => {}
        }
        self.flush(cx);
    }

    pub(crate) fn wishes(&self) -> Wishes {
        let connection = self.core.as_ref().map(SatelliteCore::connection).filter(|id| *id != 0);
        Wishes { ready: self.ready, connection, ..Wishes::default() }
    }

    /// Asks for the newest message, or first of all to be one for whom it is kept.
    fn poll(&mut self, name: &str) {
        self.wanted.insert(name.to_owned());
        let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) else { return };
        let Some(Registration { channel, since, last }) = self.registered.get(name) else {
            // The answer says what there is.
            let _ = core.list();
            return;
        };
        let heard = ledger::with(|ledger| ledger.latest.floor(self.who.hub, *channel, *since));
        if let Ok(tag) = core.poll(*channel) {
            self.asked.insert(tag, Asked::Newest(name.to_owned(), newer(heard, *last)));
        }
    }

    fn register(&mut self, name: String, channel: ChannelRef) {
        let is_asked = |asked: &Asked| matches!(asked, Asked::Register(known, _) if *known == name);
        let is_new = self.wanted.contains(&name)
            && !self.registered.contains_key(&name)
            && !self.asked.values().any(is_asked);
        if let Some(core) = self.core.as_mut().filter(|_| is_new)
            && let Ok(tag) = core.poll_register(channel)
        {
            self.asked.insert(tag, Asked::Register(name, channel));
        }
    }

    fn look(&mut self, cx: &mut Cx) {
        let now = cx.now();
        if self.core.as_mut().is_some_and(|core| core.tick(now).is_err()) {
            return self.lose(cx);
        }
        if self.core.is_none() && now >= self.connect_at {
            self.connect(cx);
        }
        self.flush(cx);
    }

    fn connect(&mut self, cx: &mut Cx) {
        self.connect_at = cx.now() + CONNECTS_AFTER;
        let this = cx.this(self);
        let to = self.way.address(self.who.hub).endpoint();
        let Ok(socket) = Socket::connect_placed(cx.under(this), &to) else { return };
        attach!(cx, socket.readable => this.hear);
        attach!(cx, socket.connected => this.look);
        attach!(cx, socket.drained => this.look);
        attach!(cx, socket.closed => this.gone);
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        self.socket = Some(socket);
        let credentials = self.way.credentials(self.who.home);
        self.core = Some(SatelliteCore::synchronous(credentials, nonce, cx.now()));
        self.flush(cx);
    }

    fn hear(&mut self, cx: &mut Cx) {
        while let (Some(socket), Some(core)) = (self.socket, &mut self.core) {
            match wire::hear(cx, core, socket, wire::ROOM, self.who.node) {
                Heard::Nothing => break,
                Heard::Something => self.take_events(cx),
                Heard::Nonsense => return self.lose(cx),
            }
        }
        self.flush(cx);
    }

    fn take_events(&mut self, cx: &mut Cx) {
        while let Some(event) = self.core.as_mut().and_then(SatelliteCore::next_event) {
            ledger::with(|ledger| ledger.now = cx.clock_now());
            match event {
                SatelliteEvent::Ready => {
                    self.ready = true;
                    let connection = self.core.as_ref().map_or(0, SatelliteCore::connection);
                    ledger::with(|ledger| ledger.was_let_in(self.who, connection));
                }
                SatelliteEvent::Listed { channels, .. } => {
                    channels.into_iter().for_each(|info| self.register(info.name, info.channel));
                }
                SatelliteEvent::Done { tag } => {
                    if let Some(Asked::Register(name, channel)) = self.asked.remove(&tag) {
                        let since = cx.clock_now();
                        self.registered.insert(name, Registration { channel, since, last: None });
                    }
                }
                SatelliteEvent::Latest { tag, channel, payload } => self.told(tag, channel, &payload),
                SatelliteEvent::Refused { tag, code, .. } => self.refused(tag, code),
                _ => {}
            }
        }
    }

    fn told(&mut self, tag: u32, channel: ChannelRef, payload: &[u8]) {
        let Some(Asked::Newest(name, floor)) = self.asked.remove(&tag) else {
            let text = format!("n{} was told what it did not ask for", self.who.node);
            return ledger::with(|ledger| ledger.complain(Rule::Latest, text));
        };
        let last = ledger::with(|ledger| ledger.was_polled(self.who, (&name, channel), payload, floor));
        if let Some(registered) = self.registered.get_mut(&name).filter(|known| known.channel == channel) {
            registered.last = last;
        }
    }

    fn refused(&mut self, tag: u32, code: u16) {
        let Some(Asked::Newest(name, floor)) = self.asked.remove(&tag) else { return };
        if code == RefusalCode::NothingYet.code() {
            if let Some((_, sequence)) = floor {
                let text =
                    format!("n{}: {name} has nothing, after message {sequence} was out", self.who.node);
                ledger::with(|ledger| ledger.complain(Rule::Latest, text));
            }
        } else {
            self.registered.remove(&name);
        }
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
        self.registered.clear();
        self.asked.clear();
        self.connect_at = cx.now() + CONNECTS_AFTER;
        ledger::with(|ledger| ledger.note(&[16, self.who.node.into(), cx.clock_now().as_nanos()]));
    }
}

/// The newer of two; of different origins the first, which was out last.
fn newer(one: Option<(Origin, u64)>, other: Option<(Origin, u64)>) -> Option<(Origin, u64)> {
    match (one, other) {
        (Some((origin, sequence)), Some((of, last))) if origin == of => Some((origin, sequence.max(last))),
        (one, other) => one.or(other),
    }
}
