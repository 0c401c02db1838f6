//! A client that is not honest.

use crate::action::{Action, Wildness};
use crate::identity::Identity;
use crate::ledger;
use crate::rule::Rule;
use crate::script::Way;
use bytes::Bytes;
use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::{Credentials, SatelliteCore, SatelliteEvent};
use sk_core::flow::wire::WRITE_PARTS_MAX;
use sk_core::flow::{ChannelRef, Command, Flags, Message, Policy};
use sk_core::prelude::*;

/// How many bytes of noise are sent.
const NOISE_BYTES: u64 = 300;
/// How many references that never were, or are another's, are tried.
const TRIES_MAX: usize = 20;

/// Something that connects and misbehaves in one way, at a time.
pub(crate) struct Wild {
    who: Identity,
    kind: Wildness,
    socket: Option<Handle<Socket>>,
    core: Option<SatelliteCore>,
    done: bool,
}

object! { pub(crate) Wild { slots { hear() gone(&CloseReason) go_on() } } }

impl Wild {
    pub(crate) fn start(cx: &mut Cx, who: Identity) -> Handle<Wild> {
        cx.spawn(Wild { who, kind: Wildness::Noise, socket: None, core: None, done: true })
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        let Action::Wild(kind) = action else { return };
        if let Some(socket) = self.socket.take() {
            cx.destroy_later(socket);
        }
        self.kind = kind;
        self.done = false;
        let this = cx.this(self);
        let Ok(socket) = Socket::connect_placed(cx.under(this), &Way::Tcp.address(self.who.hub).endpoint())
        else {
            return;
        };
        attach!(cx, socket.readable => this.hear);
        attach!(cx, socket.connected => this.go_on);
        attach!(cx, socket.closed => this.gone);
        self.socket = Some(socket);
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        self.core = match kind {
            Wildness::Noise | Wildness::SizeBomb | Wildness::Half => None,
            Wildness::FalseToken => {
                let credentials = Credentials::Token(OwnerToken::new([9; 32]));
                Some(SatelliteCore::flow(credentials, nonce, cx.now()))
            }
            _ => Some(SatelliteCore::flow(Way::Tcp.credentials(self.who.hub), nonce, cx.now())),
        };
    }

    fn go_on(&mut self, cx: &mut Cx) {
        let Some(socket) = self.socket else { return };
        match &mut self.core {
            Some(core) => {
                while core.has_output() {
                    let slices = core.slices(WRITE_PARTS_MAX);
                    let bytes: Vec<u8> = slices.iter().flat_map(|slice| slice.iter().copied()).collect();
                    drop(slices);
                    core.wrote(bytes.len());
                    let _ = socket.write(cx, bytes);
                }
            }
            None => self.misbehave(cx),
        }
    }

    fn hear(&mut self, cx: &mut Cx) {
        let mut room = [0; 4096];
        while let Some(socket) = self.socket {
            let Ok(count @ 1..) = socket.read(cx, &mut room) else { break };
            let Some(core) = &mut self.core else { continue };
            if core.receive(&room[..count], cx.now()).is_err() {
                // Of a hub that does not know this token it is no wonder.
                self.core = None;
                break;
            }
            while let Some(event) = core.next_event() {
                match event {
                    SatelliteEvent::LoggedIn { .. } if self.kind == Wildness::FalseToken => {
                        let text = format!("n{} was let in with a false token", self.who.node);
                        ledger::with(|ledger| ledger.complain(Rule::Rights, text));
                    }
                    SatelliteEvent::Message { .. } => {
                        let text = format!("n{} heard what it did not subscribe to", self.who.node);
                        ledger::with(|ledger| ledger.complain(Rule::Delivery, text));
                    }
                    _ => {}
                }
            }
            if core.is_ready() {
                self.misbehave(cx);
            }
        }
        if self.core.is_some() {
            self.go_on(cx);
        }
    }

    fn misbehave(&mut self, cx: &mut Cx) {
        let Some(socket) = self.socket else { return };
        if std::mem::replace(&mut self.done, true) {
            return;
        }
        let bytes = match self.kind {
            Wildness::Noise | Wildness::LateNoise => {
                let length = 1 + cx.world().rng.next_u64() % NOISE_BYTES;
                let mut noise = vec![0; length as usize];
                cx.world().rng.fill(&mut noise);
                noise
            }
            Wildness::SizeBomb => vec![1, 0, 0xff, 0xff, 0xff, 0x7f, 0, 0, 0, 0],
            Wildness::WrongState => greeting().encode(1, Flags::NONE).to_vec(),
            Wildness::Half => {
                let mut half = greeting().encode(1, Flags::NONE).to_vec();
                half.truncate(20);
                half
            }
            Wildness::Usurper => self.on_channels_of_others(),
            Wildness::Stale => stale(cx),
            Wildness::FalseToken => return,
        };
        if matches!(
            self.kind,
            Wildness::Noise | Wildness::LateNoise | Wildness::SizeBomb | Wildness::WrongState
        ) {
            ledger::with(|ledger| ledger.wild_sent += 1);
        }
        // Whether it goes out is no concern of one who does not care.
        let _ = socket.write(cx, bytes);
    }

    fn on_channels_of_others(&self) -> Vec<u8> {
        let Some(core) = &self.core else { return Vec::new() };
        let frames = core.channels().take(TRIES_MAX).flat_map(|info| {
            let payload = Bytes::from_static(b"forged");
            let publish = Command::Publish { channel: info.channel, message: 1, payload };
            publish.encode(1, Flags::of(true, true)).to_vec()
        });
        frames.collect()
    }

    fn gone(&mut self, cx: &mut Cx, _: &CloseReason) {
        if let Some(socket) = self.socket.take() {
            cx.destroy_later(socket);
        }
        self.core = None;
        let now = cx.clock_now().as_nanos();
        ledger::with(|ledger| ledger.note(&[10, self.who.node.into(), self.who.life.into(), now]));
    }
}

fn greeting() -> Command {
    Command::Hello {
        magic: *b"SpecialK",
        version: 1,
        version_oldest: 1,
        fragment_bytes: 65_536,
        message_bytes: 1 << 20,
        nonce: [0; 32],
    }
}

/// References that never were, or were once: all of them are honest mistakes, to be refused.
fn stale(cx: &mut Cx) -> Vec<u8> {
    let mut bytes = Vec::new();
    for tag in 1..=TRIES_MAX as u32 {
        let chance = cx.world().rng.next_u64();
        let channel = ChannelRef { id: (chance & 0x7fff) as i16, epoch: (chance >> 16) as u16 % 4 };
        let command = match chance >> 62 {
            0 => Command::Subscribe { channel, depth: 1, policy: Policy::Latest, divisor: 1 },
            1 => Command::Unsubscribe { channel },
            _ => Command::Publish { channel, message: tag, payload: Bytes::from_static(b"stale") },
        };
        let flags = if chance >> 62 < 2 { Flags::NONE } else { Flags::of(true, true) };
        bytes.extend(command.encode(tag, flags).to_vec());
    }
    bytes
}
