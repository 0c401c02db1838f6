//! A client that serves and calls, frame by frame: satellites do not offer services yet.

use crate::action::Action;
use crate::identity::Identity;
use crate::ledger::{self, CallKey};
use crate::rule::Rule;
use crate::script::Way;
use crate::stamp::{channel_name, own_name};
use bytes::Bytes;
use sk_core::flow::{ChannelRef, Command, Event, Flags, Form, Inbound, Message, Properties, Tagged};
use sk_core::prelude::*;
use sk_flat::SkVariant;
use std::collections::BTreeMap;

/// The channel number of a node's service, beyond those of its streams.
pub(crate) const SERVICE: u8 = 9;
const LOOKS_EVERY: Duration = Duration::from_millis(50);
const CONNECTS_AFTER: Duration = Duration::from_millis(300);
/// How long an answer may take, and how late one that is late is.
const DEADLINE_MS: u32 = 400;
const ANSWER_LATENESS_MAX_MS: u64 = 600;
/// One call of so many is given up by its asker.
const CANCEL_EVERY: u32 = 7;
/// The longest fragment of a call.
const FRAGMENT_BYTES: usize = 3000;
/// A hub that is not heard of for so long is lost.
const SILENCE_MAX: Duration = Duration::from_secs(6);
const PING_AFTER: Duration = Duration::from_secs(2);

/// What a server does about a request.
struct Due {
    at: Instant,
    request: u64,
    payload: Bytes,
}

/// A program that speaks the protocol by itself, for services.
pub(crate) struct Talker {
    who: Identity,
    socket: Option<Handle<Socket>>,
    inbound: Inbound<Event>,
    /// Which connection of this life it is.
    link: u32,
    ready: bool,
    serves: bool,
    names: BTreeMap<String, ChannelRef>,
    next_tag: u32,
    /// Requests whose last fragment has not come.
    requests: BTreeMap<u64, Vec<u8>>,
    replies: BTreeMap<u32, Vec<u8>>,
    due: Vec<Due>,
    connect_at: Instant,
    heard: Instant,
}

object! { pub(crate) Talker { slots { look() hear() gone(&CloseReason) } } }

impl Talker {
    pub(crate) fn start(cx: &mut Cx, who: Identity) -> Handle<Talker> {
        cx.spawn_with(|cx, this: Handle<Talker>| {
            let timer = cx.under(this).spawn(Timer::default());
            attach!(cx, timer.timeout => this.look);
            // It was made just now.
            let _ = timer.start(cx, LOOKS_EVERY);
            Talker {
                who,
                socket: None,
                inbound: Inbound::new(),
                link: 0,
                ready: false,
                serves: false,
                names: BTreeMap::new(),
                next_tag: 0,
                requests: BTreeMap::new(),
                replies: BTreeMap::new(),
                due: Vec::new(),
                connect_at: Instant::ZERO,
                heard: Instant::ZERO,
            }
        })
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        match action {
            Action::Serve => {
                self.serves = true;
                self.serve(cx);
            }
            Action::Unserve => {
                self.serves = false;
                if let Some(&channel) = self.names.get(&channel_name(self.who.node, SERVICE)) {
                    self.send(cx, &Command::RemoveChannel { channel }, Flags::NONE);
                }
            }
            Action::Call(node, count, bytes) => {
                for _ in 0..count {
                    self.call(cx, node, bytes as usize);
                }
            }
            _ => {}
        }
    }

    fn send(&mut self, cx: &mut Cx, command: &Command, flags: Flags) -> u32 {
        self.next_tag += 1;
        self.send_with(cx, self.next_tag, command, flags);
        self.next_tag
    }

    fn send_with(&self, cx: &mut Cx, tag: u32, command: &Command, flags: Flags) {
        if let Some(socket) = self.socket {
            // One that takes nothing any more is told as closed.
            let _ = socket.write(cx, command.encode(tag, flags).to_vec());
        }
    }

    fn serve(&mut self, cx: &mut Cx) {
        let properties = Properties::new(&SkVariant::map([("doc", SkVariant::from("echoes"))]));
        if let (true, Ok(properties)) = (self.ready, properties) {
            let name = own_name(self.who.node, SERVICE);
            self.send(cx, &Command::CreateService { name, properties }, Flags::NONE);
        }
    }

    fn call(&mut self, cx: &mut Cx, node: u16, bytes: usize) {
        let Some(&channel) = self.names.get(&channel_name(node, SERVICE)) else { return };
        if !self.ready {
            return;
        }
        self.next_tag += 1;
        let tag = self.next_tag;
        let mut payload = format!("n{} {} {} {tag} ", self.who.node, self.who.life, self.link).into_bytes();
        payload.resize(payload.len().max(bytes), b'.');
        let check = crc32fast::hash(&payload);
        ledger::with(|ledger| ledger.was_called(self.key(tag), check));
        let pieces = payload.chunks(FRAGMENT_BYTES).count();
        for (index, piece) in payload.chunks(FRAGMENT_BYTES).enumerate() {
            let payload = Bytes::copy_from_slice(piece);
            let call = Command::Call { channel, deadline_ms: DEADLINE_MS, payload };
            self.send_with(cx, tag, &call, Flags::of(index == 0, index + 1 == pieces));
        }
        if tag.is_multiple_of(CANCEL_EVERY) {
            ledger::with(|ledger| ledger.was_cancelled(self.key(tag)));
            self.send(cx, &Command::Cancel { call: tag }, Flags::NONE);
        }
    }

    fn key(&self, tag: u32) -> CallKey {
        CallKey { node: self.who.node, life: self.who.life, link: self.link, tag }
    }

    fn look(&mut self, cx: &mut Cx) {
        let now = cx.now();
        if self.socket.is_none() && now >= self.connect_at {
            self.connect(cx);
        }
        if self.socket.is_some() && now.since(self.heard) >= SILENCE_MAX {
            return self.lose(cx);
        }
        if self.ready && now.since(self.heard) >= PING_AFTER {
            self.send(cx, &Command::Ping {}, Flags::NONE);
        }
        let (due, later) = std::mem::take(&mut self.due).into_iter().partition(|due| due.at <= now);
        self.due = later;
        for Due { request, payload, .. } in due {
            self.answer(cx, request, payload);
        }
    }

    fn connect(&mut self, cx: &mut Cx) {
        self.connect_at = cx.now() + CONNECTS_AFTER;
        let this = cx.this(self);
        let Ok(socket) = Socket::connect_placed(cx.under(this), &Way::Unix.address(self.who.hub).endpoint())
        else {
            return;
        };
        attach!(cx, socket.readable => this.hear);
        attach!(cx, socket.closed => this.gone);
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        self.socket = Some(socket);
        self.inbound = Inbound::new();
        self.link += 1;
        self.heard = cx.now();
        let hello = Command::Hello {
            magic: *b"SpecialK",
            version: 1,
            version_oldest: 1,
            fragment_bytes: 65_536,
            message_bytes: 1 << 20,
            nonce,
        };
        self.send(cx, &hello, Flags::NONE);
    }

    fn hear(&mut self, cx: &mut Cx) {
        let mut room = [0; 8192];
        while let Some(socket) = self.socket {
            let Ok(count @ 1..) = socket.read(cx, &mut room) else { return };
            self.heard = cx.now();
            self.inbound.feed(&room[..count]);
            loop {
                match self.inbound.next() {
                    Ok(Some(event)) => self.on_event(cx, event),
                    Ok(None) => break,
                    Err(error) => {
                        let text = format!("n{}: the hub sent what no hub sends: {error}", self.who.node);
                        ledger::with(|ledger| ledger.complain(Rule::Honest, text));
                        return self.lose(cx);
                    }
                }
            }
        }
    }

    fn on_event(&mut self, cx: &mut Cx, event: Tagged<Event>) {
        let Tagged { tag, flags, message } = event;
        match message {
            Event::Welcome { .. } => {
                self.inbound.advance();
                self.send(cx, &Command::LoginPeer {}, Flags::NONE);
            }
            Event::LoggedIn { .. } => {
                self.inbound.advance();
                let begin = Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Binary };
                self.send(cx, &begin, Flags::NONE);
            }
            Event::FlowBegun { .. } => {
                self.inbound.advance();
                self.ready = true;
                if self.serves {
                    self.serve(cx);
                }
            }
            Event::Ping {} => self.send_with(cx, tag, &Command::Pong {}, Flags::NONE),
            Event::ChannelAdded { channel, name, .. } => _ = self.names.insert(name, channel),
            Event::ChannelRemoved { channel } => self.names.retain(|_, known| *known != channel),
            Event::Request { request, payload, .. } => self.on_request(cx, request, flags, &payload),
            Event::Reply { more, payload } => self.on_reply(tag, flags, more, &payload),
            Event::Refused { code, .. } => ledger::with(|ledger| ledger.was_ended(self.key(tag), None, code)),
            _ => {}
        }
    }

    fn on_request(&mut self, cx: &mut Cx, request: u64, flags: Flags, payload: &[u8]) {
        let whole = self.requests.entry(request).or_default();
        whole.extend_from_slice(payload);
        if !flags.has(Flags::LAST) {
            return;
        }
        let payload = Bytes::from(self.requests.remove(&request).unwrap_or_default());
        let chance = cx.world().rng.next_u64();
        match chance % 8 {
            0 => {
                let decline = Command::Decline { request, text: "not today".into() };
                self.send(cx, &decline, Flags::NONE);
            }
            // Never answered: the hub has to end it.
            1 => {}
            2 | 3 => {
                let at = cx.now() + Duration::from_millis(chance % ANSWER_LATENESS_MAX_MS);
                self.due.push(Due { at, request, payload });
            }
            _ => self.answer(cx, request, payload),
        }
    }

    fn answer(&mut self, cx: &mut Cx, request: u64, payload: Bytes) {
        let pieces = payload.chunks(FRAGMENT_BYTES).count();
        for (index, piece) in payload.chunks(FRAGMENT_BYTES).enumerate() {
            let answer = Command::Answer { request, more: 0, payload: Bytes::copy_from_slice(piece) };
            self.send(cx, &answer, Flags::of(index == 0, index + 1 == pieces));
        }
    }

    fn on_reply(&mut self, tag: u32, flags: Flags, more: u8, payload: &[u8]) {
        let whole = self.replies.entry(tag).or_default();
        whole.extend_from_slice(payload);
        if flags.has(Flags::LAST) && more == 0 {
            let whole = self.replies.remove(&tag).unwrap_or_default();
            let check = crc32fast::hash(&whole);
            ledger::with(|ledger| ledger.was_ended(self.key(tag), Some(check), 0));
        }
    }

    fn gone(&mut self, cx: &mut Cx, _: &CloseReason) {
        self.lose(cx);
    }

    fn lose(&mut self, cx: &mut Cx) {
        if let Some(socket) = self.socket.take() {
            cx.destroy_later(socket);
        }
        ledger::with(|ledger| ledger.forget_calls(self.who.node));
        self.ready = false;
        self.names.clear();
        self.requests.clear();
        self.replies.clear();
        self.due.clear();
        self.connect_at = cx.now() + CONNECTS_AFTER;
    }
}
