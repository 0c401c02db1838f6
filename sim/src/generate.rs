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

/// The script of a seed.
pub fn script(seed: u64) -> Script {
    let mut draw = Draw { rng: SimulatedRng::new(seed, STREAM) };
    let nodes = draw.nodes();
    let with_scribes = nodes.iter().any(|(_, role)| matches!(role, Role::Scribe(_)));
    let kinds = draw.kinds(with_scribes);
    let actors: Vec<(u16, Role)> = nodes
        .iter()
        .copied()
        .filter(|(_, role)| !matches!(role, Role::Hub | Role::Speaker | Role::Listener))
        .collect();
    let mut steps = Vec::new();
    draw.beginnings(&mut steps, &actors);
    // Everybody is let in by then, in most runs.
    let mut at_us = 45_000;
    for _ in 0..10 + draw.below(60) {
        let (node, role) = actors[draw.below(actors.len() as u64) as usize];
        let kind = kinds[draw.below(kinds.len() as u64) as usize];
        draw.step(&mut steps, at_us, (node, role), kind, &actors);
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

fn scribes_of(actors: &[(u16, Role)]) -> impl Iterator<Item = u16> + '_ {
    actors
        .iter()
        .filter(|(_, role)| matches!(role, Role::Scribe(_)))
        .map(|(number, _)| *number)
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

    fn way(&mut self) -> Way {
        if self.one_in(2) { Way::Tcp } else { Way::Unix }
    }

    fn nodes(&mut self) -> Vec<(u16, Role)> {
        let mut nodes = vec![(0, Role::Hub), (1, Role::Speaker), (2, Role::Listener)];
        for number in 3..5 + self.below(4) as u16 {
            let role = match self.below(10) {
                8 | 9 => Role::Talker,
                0..3 => Role::Satellite(self.way()),
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
            let first = nodes.len() as u16;
            for number in first..first + 1 + self.below(3) as u16 {
                nodes.push((number, Role::Scribe(self.way())));
            }
        }
        nodes
    }

    fn kinds(&mut self, with_scribes: bool) -> Vec<Kind> {
        let sometimes = [
            Kind::LargeBursts,
            Kind::Replicas,
            Kind::Clocks,
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
        if with_scribes {
            kinds.extend([Kind::Changes; 6]);
            let sometimes = [Kind::DiskFaults, Kind::Rot, Kind::HubDeaths];
            kinds.extend(sometimes.into_iter().filter(|_| self.one_in(3)));
        }
        if self.one_in(8) {
            kinds.push(Kind::HubDeaths);
        }
        kinds
    }

    /// Most have something to say and somebody to hear from the start.
    fn beginnings(&mut self, steps: &mut Vec<Step>, actors: &[(u16, Role)]) {
        for &(node, _) in actors.iter().filter(|(_, role)| *role == Role::Talker) {
            self.serve(steps, node);
        }
        for &(node, _) in actors.iter().filter(|(_, role)| matches!(role, Role::Scribe(_))) {
            for _ in 0..1 + self.below(3) {
                let at_us = 25_000 + self.below(20_000);
                self.keep(steps, at_us, node, actors);
            }
        }
        let speaks = |role: &Role| !matches!(role, Role::Wild | Role::Talker | Role::Scribe(_));
        for &(node, role) in actors.iter().filter(|(_, role)| speaks(role)) {
            let at_us = 25_000 + self.below(10_000);
            for channel in 0..self.below(CHANNELS) as u8 {
                steps.push(Step { at_us, node, action: Action::Open(channel) });
            }
            for _ in 0..self.below(4) {
                let at_us = 25_000 + self.below(20_000);
                self.step(steps, at_us, (node, role), Kind::Subscriptions, actors);
            }
        }
    }

    fn step(
        &mut self,
        steps: &mut Vec<Step>,
        at_us: u64,
        (node, role): (u16, Role),
        kind: Kind,
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
        match kind {
            Kind::DiskFaults => return self.spoil_disk(steps, at_us),
            Kind::Rot => return self.rot(steps, at_us),
            Kind::Changes => {
                let scribes: Vec<u16> = scribes_of(actors).collect();
                let node = scribes[self.below(scribes.len() as u64) as usize];
                return self.keep(steps, at_us, node, actors);
            }
            kind if matches!(role, Role::Scribe(_)) && !kind.is_of_world() => {
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
                if matches!(role, Role::Satellite(_)) && self.one_in(4) {
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
            Kind::Wildness | Kind::Changes | Kind::DiskFaults | Kind::Rot => {}
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
        let scribes: Vec<u16> = scribes_of(actors).collect();
        let action = match self.below(8) {
            0 | 1 => Action::Save,
            2 => Action::Load,
            3 => Action::Watch(scribes[self.below(scribes.len() as u64) as usize]),
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
        let talkers: Vec<u16> = actors
            .iter()
            .filter(|(_, role)| *role == Role::Talker)
            .map(|(number, _)| *number)
            .collect();
        let other = talkers[self.below(talkers.len() as u64) as usize];
        let action = match self.below(8) {
            0 | 1 => Action::Serve,
            2 => Action::Unserve,
            _ => Action::Call(other, 1 + self.below(4) as u16, self.below(9000) as u32),
        };
        steps.push(Step { at_us, node, action });
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
