//! Runs a script and judges what it sees.

use crate::action::Action;
use crate::files::PATHS;
use crate::ledger;
use crate::parts::{Actor, Parts};
use crate::rule::{Complaint, Rule};
use crate::script::{Role, Script, Step};
use crate::start::{HubEnd, HubStart, STORE, is_narrow};
use crate::{checks, log};
use sk_core::prelude::*;
use sk_core::world::{Clock, Death, DiskFaults, LinkFaults, SimulatedRng, Storage};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The stream of what the runner itself leaves to chance.
const CHANCES_STREAM: u64 = 1 << 48;
/// Those from which the faults of the hub's disk are drawn.
const DISK_STREAM: u64 = 1 << 47;
/// How often the rules are looked at.
const CHECKS_EVERY: Duration = Duration::from_millis(100);
/// After the script: how long everybody has to find the hub again, by the longest wait before a reconnection, a login
/// that finds nobody, a predecessor that is taken for alive, and some more.
const CALM: Duration = Duration::from_secs(16);
/// How long a last change, or a question about all, may take when nothing is wrong.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// How long the hub has to find out that somebody vanished.
const REAPING: Duration = Duration::from_secs(8);
/// How long a hub has to end.
const ENDING: Duration = Duration::from_secs(4);
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
        let at = run.parts.simulation.clock().now();
        Err(Complaint { rule: Rule::Panic, text: log::last_panic(), at })
    });
    let complaint = complaint.err();
    let (published, heard, trace) =
        ledger::with(|ledger| (ledger.messages_published, ledger.messages_heard, ledger.trace()));
    Outcome {
        complaint,
        hash: run.parts.simulation.trace_hash() ^ trace.rotate_left(1),
        virtual_time: run.parts.simulation.clock().now().since(Instant::ZERO),
        published,
        heard,
    }
}

struct Run<'a> {
    script: &'a Script,
    hub_start: HubStart,
    chances: SimulatedRng,
    parts: Parts,
}

impl<'a> Run<'a> {
    fn new(script: &'a Script) -> Run<'a> {
        let parts = Parts::new(script);
        let chances = parts.simulation.world().rng(CHANCES_STREAM);
        Run { script, hub_start: HubStart::of(script), chances, parts }
    }

    fn play(&mut self) -> Result<(), Complaint> {
        self.begin_ledger();
        self.start_all();
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
            ledger.narrow = is_narrow(self.script);
            for (number, part) in &self.parts.all {
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
        let Some((listener, speaker)) = pair else { return };
        self.act(speaker, Action::Open(0));
        self.act(listener, Action::Hear(speaker, 0, 0));
        let followers = self.parts.with_role(|role| role == Role::Follower);
        if !followers.is_empty() {
            self.act(speaker, Action::Tick);
        }
        followers
            .into_iter()
            .for_each(|number| self.act(number, Action::Follow(speaker, 1)));
    }

    // ---- time ----

    fn now(&self) -> Instant {
        self.parts.simulation.clock().now()
    }

    fn go_on(&mut self, span: Duration) -> Result<(), Complaint> {
        self.go_to(self.now() + span)
    }

    fn go_to(&mut self, until: Instant) -> Result<(), Complaint> {
        loop {
            let next = (self.now() + CHECKS_EVERY).min(until);
            let went = self.parts.simulation.run_until(next);
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
        checks::always(&self.parts);
        ledger::with(|ledger| ledger.complaint.clone()).map_or(Ok(()), Err)
    }

    // ---- who takes part ----

    fn start(&mut self, number: u16) {
        self.parts.start(number, &self.hub_start);
    }

    fn start_all(&mut self) {
        self.parts.numbers().into_iter().for_each(|number| self.start(number));
    }

    fn end(&mut self, number: u16, death: Option<Death>) {
        self.parts.end(number, death, &mut self.chances);
    }

    /// A satellite calls another hub than its own from now on, or its own again.
    fn stray(&mut self, number: u16, astray: bool) {
        let hubs = self.parts.hubs();
        let Some(part) = self.parts.all.get_mut(&number) else { return };
        let is_one = matches!(part.role, Role::Satellite(_) | Role::Guest(..));
        let other = hubs.into_iter().find(|hub| *hub != part.role.hub()).filter(|_| astray);
        if !is_one || other == part.astray {
            return;
        }
        part.astray = other;
        self.end(number, None);
        self.start(number);
    }

    // ---- what happens ----

    fn act(&mut self, number: u16, action: Action) {
        let Some(part) = self.parts.all.get(&number) else { return };
        let hub = self.parts.all.get(&part.hub()).map_or(0, |hub| hub.machine.machine_number());
        let here = part.machine.machine_number();
        let world = self.parts.simulation.world();
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
            Action::Lossy(loss, duplication, jitter_us) => {
                let jitter_max = Duration::from_micros(jitter_us.into());
                let faults = LinkFaults { loss, duplication, jitter_max, ..LinkFaults::default() };
                world.set_link(hub, here, faults);
            }
            Action::Refuse => world.set_link(hub, here, LinkFaults { refuse: true, ..LinkFaults::default() }),
            Action::Mend => {
                // Whichever hub it called when that was done.
                for hub in self.parts.hubs().into_iter().filter_map(|hub| self.parts.all.get(&hub)) {
                    let hub = hub.machine.machine_number();
                    world.set_link(hub, here, LinkFaults::default());
                    world.heal(hub, here);
                    world.heal(here, hub);
                }
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
            Action::Stray => self.stray(number, true),
            Action::Home => self.stray(number, false),
            Action::Disk(read, write, sync, kib) => self.spoil_disk([read, write, sync], kib),
            Action::Rot(at, bytes) => self.rot(at, bytes),
            _ => self.command(number, action),
        }
    }

    fn spoil_disk(&mut self, [read_errors, write_errors, sync_errors]: [u16; 3], kib: u16) {
        let bytes_max = (kib > 0).then(|| u64::from(kib) * 1024);
        let faults = DiskFaults { read_errors, write_errors, sync_errors, bytes_max };
        let world = self.parts.simulation.world();
        world
            .storage()
            .set_faults(faults, world.rng(DISK_STREAM + self.chances.below(1 << 20)));
    }

    /// Makes other bytes of some of the store's, while no hub runs.
    fn rot(&mut self, at: u16, bytes: u16) {
        if self.parts.hub(0).is_some() {
            return;
        }
        let storage = self.parts.simulation.world().storage();
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
        let Some(part) = self.parts.all.get(&number) else { return };
        if let Some((_, remote)) = &part.thread {
            // Refused only by a full mailbox.
            let _ = remote.post(move |member, cx| member.act(cx, action));
            return;
        }
        let (Some(node), Some(actor)) = (self.parts.node_of(number), part.actor) else { return };
        node.with(|cx| match actor {
            Actor::Member(member) => cx.with(member, |member, cx| member.act(cx, action)).is_ok(),
            Actor::Plain(plain) => cx.with(plain, |plain, cx| plain.act(cx, action)).is_ok(),
            Actor::Talker(talker) => cx.with(talker, |talker, cx| talker.act(cx, action)).is_ok(),
            Actor::Wild(wild) => cx.with(wild, |wild, cx| wild.act(cx, action)).is_ok(),
            Actor::Scribe(scribe) => cx.with(scribe, |scribe, cx| scribe.act(cx, action)).is_ok(),
            Actor::Poller(poller) => cx.with(poller, |poller, cx| poller.act(cx, action)).is_ok(),
            Actor::Filer(filer) => cx.with(filer, |filer, cx| filer.act(cx, action)).is_ok(),
            Actor::Follower(follower) => cx.with(follower, |it, cx| it.act(cx, action)).is_ok(),
            Actor::Hub(_) => false,
        });
    }

    // ---- the end ----

    /// Everything is mended and everybody runs: the honest find all again, and the books are closed.
    fn calm(&mut self) -> Result<(), Complaint> {
        let numbers = self.parts.numbers();
        self.spoil_disk([0; 3], 0);
        self.parts.hubs().into_iter().for_each(|hub| self.start(hub));
        self.hush();
        for number in numbers.iter().copied().filter(|number| *number != 0) {
            self.act(number, Action::Mend);
            self.act(number, Action::Home);
            self.act(number, Action::Slow(0));
        }
        self.go_on(CALM)?;
        self.last_words(&numbers)?;
        checks::calm(&self.parts);
        self.judge()
    }

    /// Those who keep things change something once more, and when that is done they compare what they were told of
    /// others' things with what there is.
    fn last_words(&mut self, numbers: &[u16]) -> Result<(), Complaint> {
        let keeps = |role: Role| matches!(role, Role::Scribe(_) | Role::Filer(_));
        if self.parts.with_role(keeps).is_empty() {
            return Ok(());
        }
        let mut looks = vec![Action::Ask];
        let filers = self.parts.with_role(|role| matches!(role, Role::Filer(_)));
        let lives = |number: &u16| self.parts.all.get(number).is_some_and(|part| part.actor.is_some());
        // The channel of one that is no more is not there to be looked at.
        for filer in filers.into_iter().filter(lives) {
            looks.push(Action::Browse(filer));
            looks.extend((0..PATHS.len() as u8).map(|path| Action::Fetch(filer, path)));
        }
        for actions in [&[Action::Write(2), Action::Save, Action::Put(0, 0, 4000)][..], &looks] {
            for number in numbers {
                actions.iter().for_each(|action| self.command(*number, *action));
            }
            self.go_on(LAST_WORDS)?;
        }
        Ok(())
    }

    /// The undisturbed pair has been heard enough: the rest of the run costs less without it.
    fn hush(&mut self) {
        let speakers = self.parts.with_role(|role| role == Role::Speaker);
        speakers.into_iter().for_each(|number| self.command(number, Action::Quit));
    }

    /// Everybody leaves, one way or another; then the hubs have nothing left, and end.
    fn leave(&mut self) -> Result<(), Complaint> {
        let numbers = self.parts.with_role(|role| !role.is_hub());
        let insiders = self.parts.insiders();
        ledger::with(|ledger| ledger.pair = None);
        for number in numbers {
            let death = match self.chances.below(3) {
                0 => Some(Death::Killed),
                1 => Some(Death::Vanished),
                _ => None,
            };
            if insiders.contains(&number) {
                self.parts.leave_inside(number);
            } else {
                self.end(number, death);
            }
        }
        self.go_on(REAPING)?;
        checks::reaped(&self.parts);
        self.judge()?;
        self.end_hubs()
    }

    fn end_hubs(&mut self) -> Result<(), Complaint> {
        for hub in self.parts.hubs() {
            let Some((node, server)) = self.parts.hub(hub) else { continue };
            node.with(|cx| {
                let end = cx.spawn(HubEnd);
                attach!(cx, server.ended => end.quit());
                // It was asked between rounds, when none of its slots runs.
                let _ = server.shut_down(cx);
            });
        }
        self.go_on(ENDING)?;
        for hub in self.parts.hubs() {
            if let Some((node, _)) = self.parts.hub(hub)
                && !node.has_ended()
            {
                let text = format!("hub {hub} was asked to end and did not");
                ledger::with(|ledger| ledger.complain(Rule::Ended, text));
            }
        }
        self.judge()
    }
}
