//! A satellite as programs have it.

use crate::action::Action;
use crate::channels::{is_latched, properties_of};
use crate::identity::Identity;
use crate::ledger;
use crate::stamp::{Origin, USER, channel_name, clock_name, own_name};
use crate::wishes::Wishes;
use sk_core::flow::satellite::ChannelInfo;
use sk_core::flow::{ChannelRef, Divisor, FlowMessage, SkFlowSat};
use sk_core::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// How often the undisturbed pair's first publishes.
const SPEAKS_EVERY: Duration = Duration::from_millis(20);

/// A program around an `SkFlowSat`.
pub(crate) struct Member {
    who: Identity,
    hub: Handle<SkFlowSat>,
    /// Every channel of that name that exists, as the hub's events tell.
    known: BTreeMap<String, ChannelRef>,
    own: BTreeSet<u8>,
    wanted: BTreeSet<String>,
    /// Its loop's ticks are a clock for others.
    ticks: bool,
    /// The sync channel that its loop follows.
    follows: Option<String>,
    /// Of one that publishes all the time.
    voice: Option<Handle<Timer>>,
    ready: bool,
}

object! {
    pub(crate) Member {
        slots {
            hear(&FlowMessage) added(&ChannelInfo) removed(&ChannelInfo) let_in() lose(&str) refused(&str) speak()
        }
    }
}

impl Member {
    /// Starts the program around a satellite that was made just now.
    pub(crate) fn start(cx: &mut Cx, who: Identity, hub: Handle<SkFlowSat>) -> Handle<Member> {
        let member = cx.spawn(Member {
            who,
            hub,
            known: BTreeMap::new(),
            own: BTreeSet::new(),
            wanted: BTreeSet::new(),
            ticks: false,
            follows: None,
            voice: None,
            ready: false,
        });
        attach!(cx, hub.message => member.hear);
        attach!(cx, hub.channel_added => member.added);
        attach!(cx, hub.channel_removed => member.removed);
        attach!(cx, hub.ready => member.let_in);
        attach!(cx, hub.lost => member.lose);
        attach!(cx, hub.refused => member.refused);
        member
    }

    /// Publishes all the time from now on.
    pub(crate) fn speak_always(cx: &mut Cx, this: Handle<Member>) {
        let timer = cx.spawn(Timer::default());
        attach!(cx, timer.timeout => this.speak);
        // Both were made just now.
        let _ = timer.start(cx, SPEAKS_EVERY);
        let _ = cx.with(this, |member, _| member.voice = Some(timer));
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        match action {
            Action::Open(channel) => {
                self.own.insert(channel);
                let properties = properties_of(self.who.node, channel);
                // A name of ours is a name.
                let _ = self.hub.open(cx, &own_name(self.who.node, channel), properties);
            }
            Action::Hear(node, channel, _) => {
                let name = channel_name(node, channel);
                let _ = self.hub.subscribe(cx, &name);
                ledger::with(|ledger| ledger.hears_all.insert((self.who.node, name.clone()), false));
                self.wanted.insert(name);
            }
            Action::HearAll(node, channel, depth) => {
                let name = channel_name(node, channel);
                let _ = self.hub.subscribe_to_all(cx, &name, depth);
                let at = (self.who.node, name.clone());
                ledger::with(|ledger| _ = ledger.hears_all.entry(at).or_insert(true));
                self.wanted.insert(name);
            }
            Action::Unhear(node, channel) => {
                let name = channel_name(node, channel);
                let _ = self.hub.unsubscribe(cx, &name);
                self.wanted.remove(&name);
                ledger::with(|ledger| ledger.hears_all.remove(&(self.who.node, name.clone())));
                if let (Some(connection), Some(reference)) = (self.hub.connection(cx), self.known.get(&name))
                {
                    ledger::with(|ledger| ledger.gave_up(self.who, connection, *reference));
                }
            }
            Action::Repeat(channel, node, source) => {
                let (replica, source) = (channel_name(self.who.node, channel), channel_name(node, source));
                if self.hub.repeat(cx, &own_name(self.who.node, channel), &source).is_ok() {
                    ledger::with(|ledger| {
                        if is_latched(self.who.node, channel) {
                            ledger.latched_replicas.insert(replica.clone());
                        }
                        ledger.repeats.insert((replica, source));
                    });
                }
            }
            // Refused where there is no such channel, or it is no more.
            Action::RepeatNoMore(channel) => {
                let _ = self.hub.repeat_no_more(cx, &own_name(self.who.node, channel));
            }
            Action::ByUdp(channel) => {
                let name = channel_name(self.who.node, channel);
                ledger::with(|ledger| _ = ledger.by_udp.insert(name));
                // Refused where there is no such channel.
                let _ = self.hub.publish_by_udp(cx, &own_name(self.who.node, channel));
            }
            Action::Tick => {
                self.ticks = self.hub.sync_source(cx, &clock_name(self.who.node)).is_ok();
            }
            Action::TickNoMore => {
                let _ = self.hub.end_sync_source(cx);
                self.ticks = false;
            }
            Action::Follow(node, divisor) => {
                let divisor = match divisor {
                    1 => Divisor::Every,
                    2 => Divisor::Second,
                    4 => Divisor::Fourth,
                    _ => Divisor::Auto,
                };
                let name = format!("{USER}.{}", clock_name(node));
                if node != self.who.node && self.hub.sync_to(cx, &name, divisor).is_ok() {
                    self.follows = Some(name);
                }
            }
            Action::FollowNoMore => {
                let _ = self.hub.end_sync_to(cx);
                self.follows = None;
            }
            Action::Burst(channel, count, bytes) => {
                for _ in 0..count {
                    self.publish(cx, channel, bytes as usize);
                }
            }
            Action::Quit => {
                if let Some(timer) = self.voice.take() {
                    cx.destroy_later(timer);
                }
            }
            _ => {}
        }
    }

    /// What it should find at its hub.
    pub(crate) fn wishes(&self, cx: &mut Cx) -> Wishes {
        let own = self.own.iter().map(|channel| channel_name(self.who.node, *channel));
        let clock = self.ticks.then(|| format!("{USER}.{}", clock_name(self.who.node)));
        let heard = self.wanted.iter().chain(&self.follows).cloned();
        Wishes {
            hub: self.who.hub,
            ready: self.ready,
            connection: self.hub.connection(cx),
            own: own.chain(clock).collect(),
            wanted: heard.collect(),
            known: Some(self.known.values().copied().collect()),
        }
    }

    /// The satellite behind.
    pub(crate) fn hub(&self) -> Handle<SkFlowSat> {
        self.hub
    }

    fn publish(&mut self, cx: &mut Cx, channel: u8, bytes: usize) {
        let latched = is_latched(self.who.node, channel);
        // The last message of a channel with a latch is kept until there is a hub.
        let nowhere = latched.then_some(ChannelRef { id: 0, epoch: 0 });
        let known = self.known.get(&channel_name(self.who.node, channel)).copied();
        let Some(reference) = known.or(nowhere) else { return };
        let origin = Origin { node: self.who.node, life: self.who.life, channel };
        if !self.own.contains(&channel) {
            return;
        }
        let stamp = ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            ledger.next_stamp(origin, reference)
        });
        let sent = self
            .hub
            .publish_bytes(cx, &own_name(self.who.node, channel), stamp.message(bytes));
        if sent || latched {
            ledger::with(|ledger| ledger.was_published(&stamp, sent));
        }
    }

    fn speak(&mut self, cx: &mut Cx) {
        self.publish(cx, 0, 64);
    }

    fn hear(&mut self, cx: &mut Cx, message: &FlowMessage) {
        let connection = self.hub.connection(cx).unwrap_or(0);
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            let channel = (message.name(), message.channel().channel);
            ledger.was_heard(self.who, connection, channel, message.payload());
        });
    }

    fn added(&mut self, _: &mut Cx, info: &ChannelInfo) {
        debug_assert!(info.name.starts_with(USER));
        self.known.insert(info.name.clone(), info.channel);
    }

    fn removed(&mut self, _: &mut Cx, info: &ChannelInfo) {
        if self.known.get(&info.name) == Some(&info.channel) {
            self.known.remove(&info.name);
        }
    }

    fn let_in(&mut self, cx: &mut Cx) {
        self.ready = true;
        let connection = self.hub.connection(cx).unwrap_or(0);
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            ledger.was_let_in(self.who, connection);
        });
    }

    fn lose(&mut self, cx: &mut Cx, why: &str) {
        self.ready = false;
        self.known.clear();
        let now = cx.clock_now().as_nanos();
        ledger::with(|ledger| ledger.note(&[5, self.who.node.into(), why.len() as u64, now]));
    }

    fn refused(&mut self, _: &mut Cx, why: &str) {
        ledger::with(|ledger| ledger.was_refused(self.who.node, why));
    }
}
