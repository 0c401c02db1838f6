//! A client that follows the ticks of a clock on a way without fault, and keeps an account of its own of how it does.

use super::wire::{self, Heard};
use crate::action::Action;
use crate::identity::Identity;
use crate::ledger;
use crate::pace::Pace;
use crate::rule::Rule;
use crate::script::Way;
use crate::stamp::{USER, clock_name};
use crate::wishes::Wishes;
use sk_core::flow::ChannelRef;
use sk_core::flow::satellite::{Divisor, SatelliteCore, SatelliteEvent};
use sk_core::prelude::*;
use std::collections::VecDeque;

/// How often it looks at deadlines.
const LOOKS_EVERY: Duration = Duration::from_millis(100);
/// How long it waits before it connects anew.
const CONNECTS_AFTER: Duration = Duration::from_millis(300);
/// How long anything is under way over a Unix socket without fault.
const TRANSIT: Duration = Duration::from_micros(5);

/// A program that follows a clock and says when it is done.
pub(crate) struct Follower {
    who: Identity,
    socket: Option<Handle<Socket>>,
    core: Option<SatelliteCore>,
    /// The clock's name, and the divisor that is asked for.
    clock: Option<(String, u8)>,
    /// How late it says that it is done.
    late: Duration,
    /// What is to be said, and when.
    due: VecDeque<(Instant, ChannelRef, u64)>,
    alarm: Handle<Timer>,
    pace: Pace,
    connect_at: Instant,
    ready: bool,
}

object! { pub(crate) Follower { slots { look() hear() gone(&CloseReason) say() } } }

impl Follower {
    pub(crate) fn start(cx: &mut Cx, who: Identity) -> Handle<Follower> {
        cx.spawn_with(|cx, this: Handle<Follower>| {
            let looks = cx.under(this).spawn(Timer::default());
            let alarm = cx.under(this).spawn(Timer::default());
            attach!(cx, looks.timeout => this.look);
            attach!(cx, alarm.timeout => this.say);
            // It was made just now.
            let _ = looks.start(cx, LOOKS_EVERY);
            Follower {
                who,
                socket: None,
                core: None,
                clock: None,
                late: Duration::ZERO,
                due: VecDeque::new(),
                alarm,
                pace: Pace::default(),
                connect_at: Instant::ZERO,
                ready: false,
            }
        })
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        match action {
            Action::Follow(node, divisor) => {
                self.clock = Some((format!("{USER}.{}", clock_name(node)), divisor));
                self.pace.change(divisor);
                self.follow();
            }
            Action::Late(us) => self.late = Duration::from_micros(us.into()),
            _ => {}
        }
        self.flush(cx);
    }

    pub(crate) fn wishes(&self) -> Wishes {
        let connection = self.core.as_ref().map(SatelliteCore::connection).filter(|id| *id != 0);
        let wanted = self.clock.iter().map(|(name, _)| name.clone()).collect();
        Wishes { ready: self.ready, connection, wanted, ..Wishes::default() }
    }

    fn follow(&mut self) {
        let (Some(core), Some((name, divisor))) = (&mut self.core, &self.clock) else { return };
        let divisor = match divisor {
            1 => Divisor::Every,
            2 => Divisor::Second,
            4 => Divisor::Fourth,
            _ => Divisor::Auto,
        };
        // What cannot be asked now is asked when the link is there.
        let _ = core.follow(name, divisor);
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
        let to = Way::Unix.address(self.who.hub).endpoint();
        let Ok(socket) = Socket::connect_placed(cx.under(this), &to) else { return };
        attach!(cx, socket.readable => this.hear);
        attach!(cx, socket.connected => this.look);
        attach!(cx, socket.drained => this.look);
        attach!(cx, socket.closed => this.gone);
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        self.socket = Some(socket);
        self.core = Some(SatelliteCore::flow(Way::Unix.credentials(self.who.home), nonce, cx.now()));
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
        // The hub's moment of what arrives here now.
        let left = Instant::from_nanos(cx.now().as_nanos().saturating_sub(TRANSIT.as_nanos() as u64));
        while let Some(event) = self.core.as_mut().and_then(SatelliteCore::next_event) {
            let wrong = match event {
                SatelliteEvent::Ready => {
                    self.ready = true;
                    let connection = self.core.as_ref().map_or(0, SatelliteCore::connection);
                    ledger::with(|ledger| ledger.was_let_in(self.who, connection));
                    self.pace = Pace::begin(self.clock.as_ref().map_or(1, |(_, divisor)| *divisor));
                    self.follow();
                    None
                }
                SatelliteEvent::Tick { channel, sequence } => {
                    let wrong = self.pace.tick(sequence, left);
                    self.plan(cx, channel, sequence);
                    wrong
                }
                SatelliteEvent::TickReport(report) if report.is_own => {
                    self.pace.told(report, left);
                    None
                }
                SatelliteEvent::ChannelRemoved(info)
                    if self.clock.as_ref().is_some_and(|(name, _)| *name == info.name) =>
                {
                    // The next one of that name begins from nothing.
                    self.pace = Pace::begin(self.clock.as_ref().map_or(1, |(_, divisor)| *divisor));
                    None
                }
                _ => None,
            };
            if let Some(wrong) = wrong {
                ledger::with(|ledger| {
                    ledger.now = cx.clock_now();
                    ledger.complain(Rule::Ticks, format!("n{}: {wrong}", self.who.node));
                });
            }
        }
    }

    fn plan(&mut self, cx: &mut Cx, channel: ChannelRef, sequence: u64) {
        self.due.push_back((cx.now() + self.late, channel, sequence));
        self.say(cx);
    }

    /// Says of the ticks whose time has come that it is done with them.
    fn say(&mut self, cx: &mut Cx) {
        let now = cx.now();
        while let Some((_, channel, sequence)) = self.due.pop_front_if(|(due, ..)| *due <= now) {
            if let Some(core) = &mut self.core
                && core.tick_done(channel, sequence).is_ok()
            {
                self.pace.done(sequence, now + TRANSIT);
            }
        }
        if let Some((due, ..)) = self.due.front() {
            // It is this object's child.
            let _ = self.alarm.start_once(cx, due.since(now));
        }
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
        self.due.clear();
        self.connect_at = cx.now() + CONNECTS_AFTER;
        ledger::with(|ledger| ledger.note(&[14, self.who.node.into(), cx.clock_now().as_nanos()]));
    }
}
