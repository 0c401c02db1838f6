//! Runs a script and judges what it sees.

use crate::action::Action;
use crate::actors::{Identity, Member, Plain, SERVICE, Scribe, Talker, Wild};
use crate::ledger::{self, Complaint, Rule};
use crate::script::{Role, Script, Step};
use crate::start::{HubEnd, HubStart, STORE, start_actor};
use crate::{checks, log};
use sk_core::flow::{Right, Rights, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Node, Simulation};
use sk_core::world::{Clock, Death, DiskFaults, LinkFaults, SimulatedRng, SimulatedWorld, Storage};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The stream of what the runner itself leaves to chance.
const CHANCES_STREAM: u64 = 1 << 48;
/// Those from which the faults of the hub's disk are drawn.
const DISK_STREAM: u64 = 1 << 47;
/// How often the rules are looked at.
const CHECKS_EVERY: Duration = Duration::from_millis(100);
/// How long a loop without news waits; long, because simulated rounds cost real time.
const INTERVAL: Duration = Duration::from_millis(250);
/// After the script: how long everybody has to find the hub again, by the longest wait before a reconnection, a login
/// that finds nobody, a predecessor that is taken for alive, and some more.
const CALM: Duration = Duration::from_secs(16);
/// How long a last change, or a question about all, may take when nothing is wrong.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// How long the hub has to find out that somebody vanished.
const REAPING: Duration = Duration::from_secs(8);
/// How long a hub has to end.
const ENDING: Duration = Duration::from_secs(4);
/// The first identifier of a channel that a flow may have.
const CHANNEL_ID_FIRST: u16 = 1024;

/// Stands for a node's sync channel beside the numbers of its others.
const CLOCK: u8 = 255;
/// Identifiers of channels in runs that have too few.
const CHANNELS_OF_NARROW_RUNS: usize = 3;

/// What became of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The first rule that was broken.
    pub complaint: Option<Complaint>,
    /// Two runs of one script have the same.
    pub hash: u64,
    /// How much virtual time passed.
    pub virtual_time: Duration,
    /// Messages that were accepted for sending.
    pub published: u64,
    /// Messages that arrived.
    pub heard: u64,
}

/// Runs a script.
pub fn run(script: &Script) -> Outcome {
    ledger::begin();
    log::begin();
    let mut run = Run::new(script);
    // What panics inside a loop is caught there and counted; this is for what panics around it.
    let played = catch_unwind(AssertUnwindSafe(|| run.play()));
    let complaint = played.unwrap_or_else(|_| {
        let at = run.simulation.clock().now();
        Err(Complaint { rule: Rule::Panic, text: log::last_panic(), at })
    });
    let complaint = complaint.err();
    let (published, heard, trace) =
        ledger::with(|ledger| (ledger.messages_published, ledger.messages_heard, ledger.trace()));
    Outcome {
        complaint,
        hash: run.simulation.trace_hash() ^ trace.rotate_left(1),
        virtual_time: run.simulation.clock().now().since(Instant::ZERO),
        published,
        heard,
    }
}

/// Who acts on a node.
#[derive(Clone, Copy)]
pub(crate) enum Actor {
    Hub(Handle<SkFlowServer>),
    Member(Handle<Member>),
    Plain(Handle<Plain>),
    Talker(Handle<Talker>),
    Wild(Handle<Wild>),
    Scribe(Handle<Scribe>),
}

/// One that takes part.
pub(crate) struct Part {
    pub(crate) role: Role,
    pub(crate) life: u16,
    machine: SimulatedWorld,
    /// Its process, if it runs and is not the hub's.
    pub(crate) node: Option<Node>,
    pub(crate) actor: Option<Actor>,
    /// Of one inside the hub, on a thread of its own.
    pub(crate) thread: Option<(SkThread, Remote<Member>)>,
}

pub(crate) struct Run<'a> {
    script: &'a Script,
    pub(crate) simulation: Simulation,
    chances: SimulatedRng,
    pub(crate) parts: BTreeMap<u16, Part>,
}

impl<'a> Run<'a> {
    fn new(script: &'a Script) -> Run<'a> {
        let simulation = Simulation::new(script.seed);
        let chances = simulation.world().rng(CHANCES_STREAM);
        let parts = script.nodes.iter().map(|&(number, role)| {
            let machine = match role {
                Role::Hub | Role::Inside { .. } => simulation.world().clone(),
                _ => simulation.world().machine(),
            };
            (number, Part { role, life: 0, machine, node: None, actor: None, thread: None })
        });
        let parts = parts.collect();
        Run { script, simulation, chances, parts }
    }

    fn play(&mut self) -> Result<(), Complaint> {
        self.begin_ledger();
        let numbers: Vec<u16> = self.parts.keys().copied().collect();
        numbers.iter().for_each(|number| self.start(*number));
        self.go_on(Duration::from_millis(20))?;
        self.begin_pair();
        for Step { at_us, node, action } in &self.script.steps {
            let at = Instant::from_nanos(at_us * 1000);
            self.go_to(at)?;
            self.act(*node, *action);
        }
        self.go_on(CHECKS_EVERY)?;
        self.calm()?;
        self.leave()
    }

    fn begin_ledger(&self) {
        let mut pair = (None, None);
        ledger::with(|ledger| {
            ledger.narrow = self.is_narrow();
            for (number, part) in &self.parts {
                match part.role {
                    Role::Listener => pair.0 = Some(*number),
                    Role::Speaker => pair.1 = Some(*number),
                    Role::Inside { publish, subscribe, .. } => {
                        if !publish {
                            ledger.may_not_publish.insert(*number);
                        }
                        if !subscribe {
                            ledger.may_not_hear.insert(*number);
                        }
                    }
                    _ => {}
                }
            }
            ledger.pair = pair.0.zip(pair.1);
        });
    }

    fn begin_pair(&mut self) {
        let pair = ledger::with(|ledger| ledger.pair);
        if let Some((listener, speaker)) = pair {
            self.act(speaker, Action::Open(0));
            self.act(listener, Action::Hear(speaker, 0, 0));
        }
    }

    // ---- time ----

    fn go_on(&mut self, span: Duration) -> Result<(), Complaint> {
        self.go_to(self.simulation.clock().now() + span)
    }

    fn go_to(&mut self, until: Instant) -> Result<(), Complaint> {
        loop {
            let next = (self.simulation.clock().now() + CHECKS_EVERY).min(until);
            let went = self.simulation.run_until(next);
            ledger::with(|ledger| {
                ledger.now = next;
                if let Err(livelock) = went {
                    ledger.complain(Rule::Livelock, livelock.to_string());
                }
            });
            self.judge()?;
            if next == until {
                return Ok(());
            }
        }
    }

    fn judge(&mut self) -> Result<(), Complaint> {
        checks::always(self);
        ledger::with(|ledger| ledger.complaint.clone()).map_or(Ok(()), Err)
    }

    // ---- who takes part ----

    fn start(&mut self, number: u16) {
        let keeps = self.script.nodes.iter().any(|(_, role)| matches!(role, Role::Scribe(_)));
        let hub = HubStart { ids: self.channel_ids(), keeps };
        let Some(part) = self.parts.get_mut(&number) else { return };
        if part.actor.is_some() || part.thread.is_some() {
            return;
        }
        let who = Identity { node: number, life: part.life };
        if let Role::Inside { .. } = part.role {
            return self.start_inside(who);
        }
        let role = part.role;
        let name = format!("n{number}");
        let node = self.simulation.node(&part.machine, &name, |settings| {
            settings.mode = TimingMode::SelectIo;
            settings.interval = INTERVAL;
            settings.slow_interval = INTERVAL;
        });
        let actor = node.with(|cx| start_actor(cx, who, role, &hub));
        if actor.is_none() {
            // It could not begin; it may be started again.
            part.machine = node.quit();
            return;
        }
        part.node = Some(node);
        part.actor = actor;
        if role == Role::Hub {
            let insiders: Vec<u16> = self.insiders().collect();
            insiders.into_iter().for_each(|number| self.start(number));
        }
    }

    /// In some runs there are fewer identifiers than channels that somebody wants, so that each is used again and again.
    fn is_narrow(&self) -> bool {
        self.script.seed.is_multiple_of(4)
    }

    /// The identifiers of channels: just enough for all that are wanted at once, so that they are used again soon.
    fn channel_ids(&self) -> Range<u16> {
        let mut wanted = BTreeSet::new();
        for Step { node, action, .. } in &self.script.steps {
            match action {
                Action::Open(channel) => _ = wanted.insert((*node, *channel)),
                Action::Tick => _ = wanted.insert((*node, CLOCK)),
                Action::Serve => _ = wanted.insert((*node, SERVICE)),
                _ => {}
            }
        }
        let most = if self.is_narrow() { CHANNELS_OF_NARROW_RUNS } else { usize::MAX };
        let count = wanted.len().min(most) as u16;
        // One for the undisturbed pair.
        CHANNEL_ID_FIRST..CHANNEL_ID_FIRST + 1 + count
    }

    fn insiders(&self) -> impl Iterator<Item = u16> + '_ {
        let inside = |part: &Part| matches!(part.role, Role::Inside { .. });
        self.parts
            .iter()
            .filter(move |(_, part)| inside(part))
            .map(|(number, _)| *number)
    }

    /// The hub's process and its server, while it runs.
    pub(crate) fn hub(&self) -> Option<(&Node, Handle<SkFlowServer>)> {
        let part = self.parts.get(&0)?;
        match (&part.node, part.actor) {
            (Some(node), Some(Actor::Hub(server))) => Some((node, server)),
            _ => None,
        }
    }

    fn start_inside(&mut self, who: Identity) {
        let Some(&Role::Inside { thread, publish, subscribe }) = self.parts.get(&who.node).map(|p| &p.role)
        else {
            return;
        };
        let Some((node, server)) = self.hub() else { return };
        let mut rights = Rights::NONE;
        if publish {
            rights = rights.with(Right::Publish);
        }
        if subscribe {
            rights = rights.with(Right::Subscribe);
        }
        let started = node.with(|cx| {
            let seed = server.pipe(cx, rights).ok()?;
            if !thread {
                let hub = SkFlowSat::inside(cx, seed);
                return Some((Some(Actor::Member(Member::start(cx, who, hub))), None));
            }
            let thread = SkThread::new("inside")
                .mode(TimingMode::SelectIo)
                .interval(INTERVAL)
                .start(cx)
                .ok()?;
            let remote = thread.build(move |cx| {
                let hub = SkFlowSat::inside(cx, seed);
                let member = Member::start(cx, who, hub);
                cx.remote(member)
            });
            let remote = remote.ok()?;
            Some((None, Some((thread, remote))))
        });
        if let (Some((actor, thread)), Some(part)) = (started, self.parts.get_mut(&who.node)) {
            part.actor = actor;
            part.thread = thread;
        }
    }

    /// The process of a node; of one inside the hub, the hub's.
    pub(crate) fn node_of(&self, number: u16) -> Option<&Node> {
        let part = self.parts.get(&number)?;
        match part.role {
            Role::Inside { .. } => self.hub().map(|(node, _)| node),
            _ => part.node.as_ref(),
        }
    }

    /// Ends a node's process; answers whether one was running.
    fn end(&mut self, number: u16, death: Option<Death>) {
        if self.parts.get(&number).is_none_or(|part| part.node.is_none()) {
            return;
        }
        // Those inside the hub end with it; their threads are dropped after they have died.
        let mut threads = Vec::new();
        if number == 0 {
            let insiders: Vec<u16> = self.insiders().collect();
            for insider in insiders {
                if let Some(part) = self.parts.get_mut(&insider) {
                    part.actor = None;
                    part.life += 1;
                    threads.extend(part.thread.take());
                }
            }
            // The next hub numbers its connections anew.
            ledger::with(|ledger| (ledger.pair, ledger.received) = (None, BTreeMap::new()));
        }
        let Some(part) = self.parts.get_mut(&number) else { return };
        let Some(node) = part.node.take() else { return };
        ledger::with(|ledger| {
            ledger.forget_calls(number);
            ledger.hears_all.retain(|(node, _), _| *node != number);
            ledger.archive.abandon(|database| database.starts_with(&format!("n{number}.")));
        });
        part.actor = None;
        part.life += 1;
        part.machine = match death {
            Some(death) => node.die(death, &mut self.chances),
            None => node.quit(),
        };
    }

    // ---- what happens ----

    fn act(&mut self, number: u16, action: Action) {
        let Some(part) = self.parts.get(&number) else { return };
        let (hub, here) = (self.simulation.world().machine_number(), part.machine.machine_number());
        let world = self.simulation.world();
        match action {
            Action::Link(delay_us, jitter_us, piece) => {
                let faults = LinkFaults {
                    delay: Duration::from_micros(delay_us.into()),
                    jitter_max: Duration::from_micros(jitter_us.into()),
                    piece_bytes_max: piece.into(),
                    ..LinkFaults::default()
                };
                world.set_link(hub, here, faults);
            }
            Action::Refuse => world.set_link(hub, here, LinkFaults { refuse: true, ..LinkFaults::default() }),
            Action::Mend => {
                world.set_link(hub, here, LinkFaults::default());
                world.heal(hub, here);
                world.heal(here, hub);
            }
            Action::Part(out, back) => {
                if out {
                    world.partition(here, hub);
                }
                if back {
                    world.partition(hub, here);
                }
            }
            Action::Reset => world.reset(hub, here),
            Action::Die(death) => self.end(number, Some(death)),
            Action::Quit => self.end(number, None),
            Action::Start => self.start(number),
            Action::Disk(read, write, sync, kib) => self.spoil_disk([read, write, sync], kib),
            Action::Rot(at, bytes) => self.rot(at, bytes),
            _ => self.command(number, action),
        }
    }

    fn spoil_disk(&mut self, [read_errors, write_errors, sync_errors]: [u16; 3], kib: u16) {
        let bytes_max = (kib > 0).then(|| u64::from(kib) * 1024);
        let faults = DiskFaults { read_errors, write_errors, sync_errors, bytes_max };
        let world = self.simulation.world();
        world
            .storage()
            .set_faults(faults, world.rng(DISK_STREAM + self.chances.below(1 << 20)));
    }

    /// Makes other bytes of some of the store's, while no hub runs.
    fn rot(&mut self, at: u16, bytes: u16) {
        if self.hub().is_some() {
            return;
        }
        let storage = self.simulation.world().storage();
        let rotted = storage.open(STORE.as_ref(), false).and_then(|file| {
            let len = file.len()?;
            let from = (len * u64::from(at) / 1024).min(len.saturating_sub(1));
            let mut there = vec![0; usize::from(bytes).min((len - from) as usize)];
            file.read_at(from, &mut there)?;
            there.iter_mut().for_each(|byte| *byte ^= 0x5a);
            // From here on something may be wrong, even if the disk fails.
            ledger::with(|ledger| ledger.archive.rotten = true);
            file.write_at(from, &there)?;
            file.sync()
        });
        // A disk that fails, or has no store yet, does not rot.
        drop(rotted);
    }

    fn command(&mut self, number: u16, action: Action) {
        let Some(part) = self.parts.get(&number) else { return };
        if let Some((_, remote)) = &part.thread {
            // Refused only by a full mailbox.
            let _ = remote.post(move |member, cx| member.act(cx, action));
            return;
        }
        let (Some(node), Some(actor)) = (self.node_of(number), part.actor) else { return };
        node.with(|cx| match actor {
            Actor::Member(member) => cx.with(member, |member, cx| member.act(cx, action)).is_ok(),
            Actor::Plain(plain) => cx.with(plain, |plain, cx| plain.act(cx, action)).is_ok(),
            Actor::Talker(talker) => cx.with(talker, |talker, cx| talker.act(cx, action)).is_ok(),
            Actor::Wild(wild) => cx.with(wild, |wild, cx| wild.act(cx, action)).is_ok(),
            Actor::Scribe(scribe) => cx.with(scribe, |scribe, cx| scribe.act(cx, action)).is_ok(),
            Actor::Hub(_) => false,
        });
    }

    // ---- the end ----

    /// Everything is mended and everybody runs: the honest find all again, and the books are closed.
    fn calm(&mut self) -> Result<(), Complaint> {
        let numbers: Vec<u16> = self.parts.keys().copied().collect();
        self.spoil_disk([0; 3], 0);
        self.start(0);
        self.hush();
        for number in numbers.iter().copied().filter(|number| *number != 0) {
            self.act(number, Action::Mend);
            self.act(number, Action::Slow(0));
        }
        self.go_on(CALM)?;
        self.last_words(&numbers)?;
        checks::calm(self);
        self.judge()
    }

    /// Those who keep things change something once more, and when that is done they compare what they were told of
    /// others' things with what there is.
    fn last_words(&mut self, numbers: &[u16]) -> Result<(), Complaint> {
        if !self.parts.values().any(|part| matches!(part.role, Role::Scribe(_))) {
            return Ok(());
        }
        for actions in [&[Action::Write(2), Action::Save][..], &[Action::Ask]] {
            for number in numbers {
                actions.iter().for_each(|action| self.command(*number, *action));
            }
            self.go_on(LAST_WORDS)?;
        }
        Ok(())
    }

    /// The undisturbed pair has been heard enough: the rest of the run costs less without it.
    fn hush(&mut self) {
        let speakers = self.parts.iter().filter(|(_, part)| part.role == Role::Speaker);
        let speakers: Vec<u16> = speakers.map(|(number, _)| *number).collect();
        speakers.into_iter().for_each(|number| self.command(number, Action::Quit));
    }

    /// Everybody leaves, one way or another; then the hub has nothing left, and ends.
    fn leave(&mut self) -> Result<(), Complaint> {
        let numbers: Vec<u16> = self.parts.keys().copied().filter(|number| *number != 0).collect();
        let insiders: Vec<u16> = self.insiders().collect();
        ledger::with(|ledger| ledger.pair = None);
        for number in numbers {
            let death = match self.chances.below(3) {
                0 => Some(Death::Killed),
                1 => Some(Death::Vanished),
                _ => None,
            };
            if insiders.contains(&number) {
                self.leave_inside(number);
            } else {
                self.end(number, death);
            }
        }
        self.go_on(REAPING)?;
        checks::reaped(self);
        self.judge()?;
        self.end_hub()
    }

    fn leave_inside(&mut self, number: u16) {
        let Some(part) = self.parts.get_mut(&number) else { return };
        let (actor, thread) = (part.actor.take(), part.thread.take());
        match (actor, thread) {
            (_, Some((thread, _))) => thread.stop(),
            (Some(Actor::Member(member)), None) => {
                let Some((node, _)) = self.hub() else { return };
                node.with(|cx| {
                    let hub = cx.with(member, |member, _| member.hub());
                    cx.destroy_later(member);
                    if let Ok(hub) = hub {
                        cx.destroy_later(hub);
                    }
                });
            }
            _ => {}
        }
    }

    fn end_hub(&mut self) -> Result<(), Complaint> {
        if let Some((node, server)) = self.hub() {
            node.with(|cx| {
                let end = cx.spawn(HubEnd);
                attach!(cx, server.ended => end.quit());
                // It was asked between rounds, when none of its slots runs.
                let _ = server.shut_down(cx);
            });
        }
        self.go_on(ENDING)?;
        if let Some((node, _)) = self.hub()
            && !node.has_ended()
        {
            ledger::with(|ledger| {
                ledger.complain(Rule::Ended, "the hub was asked to end and did not".into())
            });
        }
        self.judge()
    }
}
