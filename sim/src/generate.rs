//! Scripts by chance.
//!
//! Which kinds of things happen at all is drawn first, for each seed anew: a run in which few kinds happen often
//! finds what a run with a little of everything does not.

use crate::action::{Action, WILDNESSES};
use crate::script::{Role, Script, Step, Way};
use sk_core::world::{Death, Rng, SimulatedRng};

/// The stream that scripts are drawn from, apart from all that runs draw from.
const STREAM: u64 = 1 << 50;
/// Channels of one node.
const CHANNELS: u64 = 3;

/// The number of the undisturbed pair's first.
const SPEAKER: u16 = 1;
/// Later than any run lasts.
const FOR_EVER_US: u32 = 3_600_000_003;

/// The script of a seed.
pub fn script(seed: u64) -> Script {
    let mut draw = Draw { rng: SimulatedRng::new(seed, STREAM) };
    let nodes = draw.nodes();
    let kinds = draw.kinds(&nodes);
    let actors: Vec<(u16, Role)> = nodes
        .iter()
        .copied()
        .filter(|(_, role)| !role.is_hub() && !matches!(role, Role::Speaker | Role::Listener))
        .collect();
    let mut steps = Vec::new();
    draw.beginnings(&mut steps, &actors);
    // Everybody is let in by then, in most runs.
    let mut at_us = 45_000;
    for _ in 0..10 + draw.below(60) {
        let (node, role) = actors[draw.below(actors.len() as u64) as usize];
        let kind = kinds[draw.below(kinds.len() as u64) as usize];
        draw.step(&mut steps, at_us, (node, role), (kind, &kinds), &actors);
        at_us += if draw.one_in(3) { draw.below(200_000) } else { draw.below(5_000) };
    }
    steps.sort_by_key(|step| step.at_us);
    Script { seed, nodes, steps }
}

/// A kind of thing that happens.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Channels,
    Subscriptions,
    Bursts,
    Replicas,
    Clocks,
    LargeBursts,
    Aborts,
    Churn,
    Slowness,
    Wildness,
    Lateness,
    Partitions,
    Resets,
    Refusals,
    Deaths,
    HubDeaths,
    Changes,
    DiskFaults,
    Rot,
    Strays,
    Looks,
    Files,
    Datagrams,
}

impl Kind {
    /// It happens to a node whatever that does.
    fn is_of_world(self) -> bool {
        matches!(
            self,
            Kind::Lateness
                | Kind::Partitions
                | Kind::Resets
                | Kind::Refusals
                | Kind::Deaths
                | Kind::HubDeaths
        )
    }
}

/// The numbers of those with such a role.
fn those(nodes: &[(u16, Role)], is: impl Fn(Role) -> bool) -> Vec<u16> {
    let them = nodes.iter().filter(|(_, role)| is(*role));
    them.map(|(number, _)| *number).collect()
}

fn is_poller(role: Role) -> bool {
    matches!(role, Role::Poller(_))
}

fn is_filer(role: Role) -> bool {
    matches!(role, Role::Filer(_))
}

fn is_scribe(role: Role) -> bool {
    matches!(role, Role::Scribe(_))
}

/// One more takes part.
fn add(nodes: &mut Vec<(u16, Role)>, role: Role) {
    nodes.push((nodes.len() as u16, role));
}

struct Draw {
    rng: SimulatedRng,
}

impl Draw {
    fn below(&mut self, limit: u64) -> u64 {
        self.rng.below(limit)
    }

    fn one_in(&mut self, count: u64) -> bool {
        self.rng.next_u64().is_multiple_of(count)
    }

    fn one_of<T: Copy>(&mut self, many: &[T]) -> T {
        many[self.below(many.len() as u64) as usize]
    }

    /// The way of one who speaks the protocol over a plain socket.
    fn way(&mut self) -> Way {
        self.one_of(&[Way::Tcp, Way::Unix])
    }

    fn any_way(&mut self) -> Way {
        self.one_of(&[Way::Tcp, Way::Unix, Way::Unix, Way::Web])
    }

    fn nodes(&mut self) -> Vec<(u16, Role)> {
        let mut nodes = vec![(0, Role::Hub), (1, Role::Speaker), (2, Role::Listener)];
        for number in 3..5 + self.below(4) as u16 {
            let role = match self.below(10) {
                8 | 9 => Role::Talker,
                0..3 => Role::Satellite(self.any_way()),
                3..6 => Role::Plain(self.way()),
                6 => Role::Inside {
                    thread: self.one_in(2),
                    publish: !self.one_in(3),
                    subscribe: !self.one_in(3),
                },
                _ => Role::Wild,
            };
            nodes.push((number, role));
        }
        if self.one_in(4) {
            for _ in 0..1 + self.below(3) {
                let way = self.any_way();
                add(&mut nodes, Role::Scribe(way));
            }
        }
        if self.one_in(4) {
            let way = self.way();
            add(&mut nodes, Role::Poller(way));
        }
        if self.one_in(5) {
            for _ in 0..1 + self.below(2) {
                let way = self.any_way();
                add(&mut nodes, Role::Filer(way));
            }
        }
        if self.one_in(4) {
            add(&mut nodes, Role::Follower);
        }
        if self.one_in(8) {
            let hub = nodes.len() as u16;
            add(&mut nodes, Role::OtherHub);
            for _ in 0..1 + self.below(3) {
                let way = self.any_way();
                add(&mut nodes, Role::Guest(way, hub));
            }
        }
        nodes
    }

    fn kinds(&mut self, nodes: &[(u16, Role)]) -> Vec<Kind> {
        let sometimes = [
            Kind::LargeBursts,
            Kind::Replicas,
            Kind::Clocks,
            Kind::Datagrams,
            Kind::Aborts,
            Kind::Churn,
            Kind::Slowness,
            Kind::Wildness,
            Kind::Lateness,
            Kind::Partitions,
            Kind::Resets,
            Kind::Refusals,
            Kind::Deaths,
        ];
        let mut kinds =
            vec![Kind::Channels, Kind::Subscriptions, Kind::Subscriptions, Kind::Bursts, Kind::Bursts];
        kinds.extend(sometimes.into_iter().filter(|_| self.one_in(2)));
        if nodes.iter().any(|(_, role)| is_scribe(*role)) {
            kinds.extend([Kind::Changes; 6]);
            let sometimes = [Kind::DiskFaults, Kind::Rot, Kind::HubDeaths];
            kinds.extend(sometimes.into_iter().filter(|_| self.one_in(3)));
        }
        if self.one_in(8) {
            kinds.push(Kind::HubDeaths);
        }
        if nodes.iter().any(|(_, role)| *role == Role::OtherHub) {
            kinds.extend([Kind::Strays; 2]);
        }
        if nodes.iter().any(|(_, role)| is_filer(*role)) {
            kinds.extend([Kind::Files; 5]);
            let sometimes = [Kind::DiskFaults, Kind::HubDeaths];
            kinds.extend(sometimes.into_iter().filter(|_| self.one_in(3)));
        }
        if nodes.iter().any(|(_, role)| is_poller(*role)) {
            kinds.extend([Kind::Looks; 3]);
        }
        kinds
    }

    /// Most have something to say and somebody to hear from the start.
    fn beginnings(&mut self, steps: &mut Vec<Step>, actors: &[(u16, Role)]) {
        for node in those(actors, |role| role == Role::Talker) {
            self.serve(steps, node);
        }
        for node in those(actors, is_scribe) {
            for _ in 0..1 + self.below(3) {
                let at_us = 25_000 + self.below(20_000);
                self.keep(steps, at_us, node, actors);
            }
        }
        let speaks = |role: &Role| {
            matches!(role, Role::Satellite(_) | Role::Guest(..) | Role::Plain(_) | Role::Inside { .. })
        };
        for &(node, role) in actors.iter().filter(|(_, role)| speaks(role)) {
            let at_us = 25_000 + self.below(10_000);
            for channel in 0..self.below(CHANNELS) as u8 {
                steps.push(Step { at_us, node, action: Action::Open(channel) });
            }
            for _ in 0..self.below(4) {
                let at_us = 25_000 + self.below(20_000);
                self.step(steps, at_us, (node, role), (Kind::Subscriptions, &[]), actors);
            }
        }
    }

    fn step(
        &mut self,
        steps: &mut Vec<Step>,
        at_us: u64,
        (node, role): (u16, Role),
        (kind, kinds): (Kind, &[Kind]),
        actors: &[(u16, Role)],
    ) {
        let mut add = |at_us, node, action| steps.push(Step { at_us, node, action });
        let channel = self.below(CHANNELS) as u8;
        if role == Role::Wild {
            return add(
                at_us,
                node,
                Action::Wild(WILDNESSES[self.below(WILDNESSES.len() as u64) as usize].0),
            );
        }
        if role == Role::Talker
            && ![Kind::Deaths, Kind::Partitions, Kind::Resets, Kind::HubDeaths].contains(&kind)
        {
            return self.talk(steps, at_us, node, actors);
        }
        if role == Role::Follower {
            return self.follow(steps, at_us, node);
        }
        match kind {
            Kind::Files => {
                let node = self.one_of(&those(actors, is_filer));
                return self.file(steps, at_us, node, (kinds, actors));
            }
            kind if is_filer(role) && !kind.is_of_world() => {
                return self.file(steps, at_us, node, (kinds, actors));
            }
            Kind::Looks => {
                let node = self.one_of(&those(actors, is_poller));
                return self.look(steps, at_us, node, actors);
            }
            kind if is_poller(role) && !kind.is_of_world() => return self.look(steps, at_us, node, actors),
            Kind::Strays => return self.stray(steps, at_us, actors),
            Kind::DiskFaults => return self.spoil_disk(steps, at_us),
            Kind::Rot => return self.rot(steps, at_us),
            Kind::Changes => {
                let node = self.one_of(&those(actors, is_scribe));
                return self.keep(steps, at_us, node, actors);
            }
            kind if is_scribe(role) && !kind.is_of_world() => {
                return self.keep(steps, at_us, node, actors);
            }
            _ => {}
        }
        let mut add = |at_us, node, action| steps.push(Step { at_us, node, action });
        let other = actors[self.below(actors.len() as u64) as usize].0;
        let later = at_us + 1000 + self.below(700_000);
        match kind {
            Kind::Channels if self.one_in(4) => add(at_us, node, Action::Close(channel)),
            Kind::Channels => add(at_us, node, Action::Open(channel)),
            Kind::Subscriptions if self.one_in(5) => add(at_us, node, Action::Unhear(other, channel)),
            Kind::Subscriptions => {
                let depth = [0, 1, 3, 1024][self.below(4) as usize];
                if matches!(role, Role::Satellite(_) | Role::Guest(..)) && self.one_in(4) {
                    return add(at_us, node, Action::HearAll(other, channel, depth));
                }
                add(at_us, node, Action::Hear(other, channel, depth));
            }
            Kind::Replicas if self.one_in(4) => add(at_us, node, Action::RepeatNoMore(channel)),
            Kind::Replicas => {
                let source = self.below(CHANNELS) as u8;
                add(at_us, node, Action::Repeat(channel, other, source));
            }
            Kind::Clocks => {
                let divisor = [0, 1, 2, 4][self.below(4) as usize];
                let action = match self.below(8) {
                    0 => Action::TickNoMore,
                    1 => Action::FollowNoMore,
                    2..4 => Action::Tick,
                    _ => Action::Follow(other, divisor),
                };
                add(at_us, node, action);
            }
            Kind::Datagrams => {
                add(at_us, node, Action::Open(channel));
                add(at_us + self.below(2_000), other, Action::Hear(node, channel, 0));
                add(at_us + self.below(30_000), node, Action::ByUdp(channel));
                let rate = |draw: &mut Draw| if draw.one_in(2) { draw.below(300) as u16 } else { 0 };
                let (loss, twice, jitter) = (rate(self), rate(self), self.below(20_000) as u32);
                add(at_us, node, Action::Lossy(loss, twice, jitter));
                for _ in 0..1 + self.below(6) {
                    let (count, bytes) = (1 + self.below(8) as u16, 30 + self.below(4000) as u32);
                    add(at_us + self.below(80_000), node, Action::Burst(channel, count, bytes));
                }
                add(later, node, Action::Mend);
            }
            Kind::Bursts => {
                add(
                    at_us,
                    node,
                    Action::Burst(channel, 1 + self.below(20) as u16, 30 + self.below(300) as u32),
                );
            }
            Kind::LargeBursts => {
                let bytes = 1000 << self.below(9);
                add(at_us, node, Action::Burst(channel, 1 + self.below(6) as u16, bytes));
            }
            Kind::Aborts => add(at_us, node, Action::Abort(channel, self.below(5000) as u32)),
            Kind::Churn => {
                // Everything about one channel, so close together that the orders meet on the way.
                for _ in 0..3 + self.below(8) {
                    let at_us = at_us + self.below(2_000);
                    let (doer, action) = match self.below(5) {
                        0 => (node, Action::Close(channel)),
                        1 => (node, Action::Open(channel)),
                        2 => (other, Action::Hear(node, channel, 0)),
                        3 => (other, Action::Unhear(node, channel)),
                        _ => (node, Action::Burst(channel, 1 + self.below(4) as u16, 40)),
                    };
                    add(at_us, doer, action);
                }
            }
            Kind::Slowness => {
                add(at_us, node, Action::Slow(1 + self.below(400) as u32));
                add(later, node, Action::Slow(0));
            }
            Kind::Wildness
            | Kind::Changes
            | Kind::DiskFaults
            | Kind::Rot
            | Kind::Strays
            | Kind::Looks
            | Kind::Files => {}
            Kind::Lateness => {
                let piece = [0, 3, 50, 1400][self.below(4) as usize];
                let (delay, jitter) = (self.below(100_000), self.below(50_000));
                add(at_us, node, Action::Link(delay as u32, jitter as u32, piece));
                add(later, node, Action::Mend);
            }
            Kind::Partitions => {
                let out = self.one_in(2);
                add(at_us, node, Action::Part(out, !out || self.one_in(2)));
                let end = if self.one_in(4) { Action::Reset } else { Action::Mend };
                // Some last longer than a hub waits for a silent peer.
                let longer = if self.one_in(4) { self.below(8_000_000) } else { 0 };
                add(later + longer, node, end);
                add(later + longer, node, Action::Mend);
            }
            Kind::Resets => add(at_us, node, Action::Reset),
            Kind::Refusals => {
                add(at_us, node, Action::Refuse);
                add(at_us, node, Action::Reset);
                add(later, node, Action::Mend);
            }
            Kind::Deaths => self.death(steps, at_us, node),
            Kind::HubDeaths => self.death(steps, at_us, 0),
        }
    }

    fn keep(&mut self, steps: &mut Vec<Step>, at_us: u64, node: u16, actors: &[(u16, Role)]) {
        let scribes = those(actors, is_scribe);
        let action = match self.below(8) {
            0 | 1 => Action::Save,
            2 => Action::Load,
            3 => Action::Watch(self.one_of(&scribes)),
            _ => Action::Write(1 + self.below(12) as u16),
        };
        steps.push(Step { at_us, node, action });
    }

    fn spoil_disk(&mut self, steps: &mut Vec<Step>, at_us: u64) {
        let rate = |draw: &mut Draw| if draw.one_in(2) { draw.below(300) as u16 } else { 0 };
        let (read, write, sync) = (rate(self), rate(self), rate(self));
        let kib = if self.one_in(3) { 1 + self.below(3000) as u16 } else { 0 };
        steps.push(Step { at_us, node: 0, action: Action::Disk(read, write, sync, kib) });
        let after = at_us + 1000 + self.below(400_000);
        steps.push(Step { at_us: after, node: 0, action: Action::Disk(0, 0, 0, 0) });
    }

    /// The hub ends, its file changes, and it is started again.
    fn rot(&mut self, steps: &mut Vec<Step>, at_us: u64) {
        let death = if self.one_in(2) { Action::Die(Death::Killed) } else { Action::Quit };
        let at = if self.one_in(2) { 0 } else { self.below(1024) as u16 };
        let most = if self.one_in(2) { 8 } else { 5000 };
        let bytes = 1 + self.below(most) as u16;
        let after = at_us + 1000 + self.below(300_000);
        for (at_us, action) in [(at_us, death), (at_us + 1, Action::Rot(at, bytes)), (after, Action::Start)] {
            steps.push(Step { at_us, node: 0, action });
        }
    }

    fn talk(&mut self, steps: &mut Vec<Step>, at_us: u64, node: u16, actors: &[(u16, Role)]) {
        let other = self.one_of(&those(actors, |role| role == Role::Talker));
        let action = match self.below(8) {
            0 | 1 => Action::Serve,
            2 => Action::Unserve,
            _ => Action::Call(other, 1 + self.below(4) as u16, self.below(9000) as u32),
        };
        steps.push(Step { at_us, node, action });
    }

    /// A follower is late, asks for other ticks, or keeps up again.
    fn follow(&mut self, steps: &mut Vec<Step>, at_us: u64, node: u16) {
        let action = match self.below(6) {
            0 => Action::Follow(SPEAKER, self.one_of(&[0, 1, 2, 4])),
            1 => Action::Late(0),
            2 => Action::Late(FOR_EVER_US),
            // Never as long as anything else in a run: who was first at the hub is known then.
            _ => Action::Late(10 * self.below(9_000) as u32 + 3),
        };
        steps.push(Step { at_us, node, action });
    }

    /// Looks at a channel twice and more: the first time it is only asked for, and the others come by and by.
    fn look(&mut self, steps: &mut Vec<Step>, at_us: u64, node: u16, actors: &[(u16, Role)]) {
        let (other, channel) = (self.one_of(actors).0, self.below(CHANNELS) as u8);
        if self.one_in(8) {
            return steps.push(Step { at_us, node, action: Action::PollNoMore(other, channel) });
        }
        let mut at_us = at_us;
        for _ in 0..2 + self.below(6) {
            steps.push(Step { at_us, node, action: Action::Poll(other, channel) });
            at_us += self.below(60_000);
        }
    }

    /// Files are put, moved, removed and looked at; sometimes one end of an upload dies while it is under way.
    fn file(
        &mut self,
        steps: &mut Vec<Step>,
        at_us: u64,
        node: u16,
        (kinds, actors): (&[Kind], &[(u16, Role)]),
    ) {
        let (one, other) = (self.below(6) as u8, self.below(6) as u8);
        let whose = self.one_of(&those(actors, is_filer));
        let action = match self.below(10) {
            0 => Action::MakeFolder,
            1 => Action::Shift(one, other),
            2 => Action::Drop(one),
            3 => Action::Browse(whose),
            4 | 5 => Action::Fetch(whose, one),
            _ => {
                let most = self.one_of(&[300, 9_000, 150_000, 900_000]);
                let (version, bytes) = (self.below(4) as u16, self.below(most) as u32);
                let dies = self.one_of(&[0, node]);
                let may_die = kinds.contains(&if dies == 0 { Kind::HubDeaths } else { Kind::Deaths });
                if may_die && self.one_in(2) {
                    let within = 100 << self.below(9);
                    let dies_us = at_us + self.below(within);
                    let how = self.one_of(&[Death::PowerCut, Death::PowerCut, Death::Killed]);
                    steps.push(Step { at_us: dies_us, node: dies, action: Action::Die(how) });
                    let after = dies_us + 1 + self.below(500_000);
                    steps.push(Step { at_us: after, node: dies, action: Action::Start });
                    // The same again, so that it can go on.
                    let at_us = at_us + 600_000;
                    steps.push(Step { at_us, node, action: Action::Put(one, version, bytes) });
                }
                Action::Put(one, version, bytes)
            }
        };
        steps.push(Step { at_us, node, action });
    }

    /// A satellite mistakes one hub for another for a while; sometimes the other one dies.
    fn stray(&mut self, steps: &mut Vec<Step>, at_us: u64, actors: &[(u16, Role)]) {
        let strays = those(actors, |role| matches!(role, Role::Satellite(_) | Role::Guest(..)));
        let node = self.one_of(&strays);
        let hub = actors.iter().map(|(_, role)| role.hub()).max().unwrap_or(0);
        if self.one_in(4) {
            return self.death(steps, at_us, hub);
        }
        let after = at_us + 1000 + self.below(900_000);
        for (at_us, action) in [(at_us, Action::Stray), (after, Action::Home)] {
            steps.push(Step { at_us, node, action });
        }
    }

    /// Servers serve from the start.
    fn serve(&mut self, steps: &mut Vec<Step>, node: u16) {
        steps.push(Step { at_us: 25_000 + self.below(10_000), node, action: Action::Serve });
    }

    fn death(&mut self, steps: &mut Vec<Step>, at_us: u64, node: u16) {
        let action = match self.below(4) {
            0 => Action::Die(Death::Killed),
            1 => Action::Die(Death::Vanished),
            2 => Action::Die(Death::PowerCut),
            _ => Action::Quit,
        };
        steps.push(Step { at_us, node, action });
        let after = at_us + 1 + self.below(500_000);
        steps.push(Step { at_us: after, node, action: Action::Start });
    }
}
