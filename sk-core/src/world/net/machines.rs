//! Machines of the simulated network: the ways between them, and their ends.

use super::Token;
use super::faults::{Held, LinkFaults};
use super::sim_socket::{Ending, Kind, Phase};
use super::switch::Switch;
use super::wire::{Delivery, Medium, SocketId};
use sk_flat::Instant;
use std::time::Duration;

/// How the processes of a simulated machine end without a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Death {
    /// The process is killed: the kernel resets its connections, and the disk keeps what was written.
    Killed,
    /// The machine is gone, or its cable: peers hear nothing and wishes to connect are not answered. The disk
    /// keeps what was written.
    Vanished,
    /// The power fails: as `Vanished`, and the disk keeps of what was not synchronised what chance leaves.
    PowerCut,
}

impl Switch {
    fn machine_of(&self, id: SocketId) -> Option<usize> {
        self.sockets.get(&id).map(|socket| self.shares[socket.share].machine)
    }

    /// The machines of a stream's ends.
    fn machines(&self, from: SocketId, to: SocketId) -> Option<(usize, usize)> {
        Some((self.machine_of(from)?, self.machine_of(to)?))
    }

    /// The faults on the way of a stream's end to the other.
    pub(super) fn faults_of(&self, from: SocketId) -> LinkFaults {
        if self.ways.are_fine() {
            return LinkFaults::default();
        }
        let other = match self.sockets.get(&from).map(|socket| &socket.kind) {
            Some(Kind::Stream(end)) => end.other,
            _ => None,
        };
        let machines = other.and_then(|other| self.machines(from, other));
        machines.map(|(from, to)| self.ways.faults(from, to)).unwrap_or_default()
    }

    /// Sends something of a stream's end on its way, unless a partition holds it back. Answers when it arrives.
    pub(super) fn send_over(
        &mut self,
        (machine, other): (usize, usize),
        held: Held,
        now: Instant,
        transit: Duration,
        not_before: Instant,
    ) -> Option<Instant> {
        let Held { what, .. } = self.ways.hold(machine, other, held)?;
        let lateness = self.ways.faults(machine, other).lateness(&mut self.wire.rng);
        Some(self.wire.carry(now, transit + lateness, not_before, what))
    }

    /// Sends something from one end of a stream to the other, behind what was sent before.
    pub(super) fn pass(&mut self, from: SocketId, now: Instant, what: impl FnOnce(SocketId) -> Delivery) {
        let Some(end) = self.end(from) else { return };
        let (Some(other), medium, last_due) = (end.other, end.medium, end.last_due) else { return };
        let transit = self.wire.transit(medium);
        let what = what(other);
        let due = if self.ways.are_fine() {
            Some(self.wire.carry(now, transit, last_due, what))
        } else {
            let Some(machines) = self.machines(from, other) else { return };
            self.send_over(machines, Held { from: Some(from), what }, now, transit, last_due)
        };
        if let (Some(end), Some(due)) = (self.end(from), due) {
            end.last_due = due;
        }
    }

    /// Sends bytes, in pieces where the way cuts them.
    pub(super) fn pass_bytes(&mut self, from: SocketId, now: Instant, bytes: Vec<u8>) {
        let faults = self.faults_of(from);
        if faults.piece_bytes_max == 0 {
            return self.pass(from, now, |to| Delivery::Bytes { to, bytes });
        }
        for bytes in faults.cut(bytes, &mut self.wire.rng) {
            self.pass(from, now, |to| Delivery::Bytes { to, bytes });
            // The next piece comes a little later, so that they do not join again on arrival.
            let gap = Duration::from_nanos(self.wire.rng.below(50_000));
            if let Some(end) = self.end(from) {
                end.last_due += gap;
            }
        }
    }

    /// How many of `wanted` bytes a write takes. One cut short by the way hears soon that there is room.
    pub(super) fn admit(&mut self, id: SocketId, wanted: usize, now: Instant) -> std::io::Result<usize> {
        let faults = self.faults_of(id);
        let limit = faults.write_limit(wanted, &mut self.wire.rng);
        let end = self.end(id).ok_or(std::io::ErrorKind::NotConnected)?;
        let count = end.admit(limit)?;
        if limit < wanted && count > 0 {
            end.starved = true;
            self.wire
                .carry(now, Duration::from_micros(20), now, Delivery::Credit { to: id, bytes: 0 });
        }
        Ok(count)
    }

    /// Sends a datagram, as often as it arrives.
    pub(super) fn pass_datagram(&mut self, from: usize, now: Instant, what: (Delivery, Option<SocketId>)) {
        let (what, receiver) = what;
        let transit = self.wire.transit(Medium::Udp);
        let to = receiver.and_then(|id| self.machine_of(id)).filter(|_| !self.ways.are_fine());
        let Some(to) = to else {
            self.wire.carry(now, transit, now, what);
            return;
        };
        let copies = self.ways.faults(from, to).copies(&mut self.wire.rng);
        for _ in 0..copies {
            let Delivery::Datagram { to: address, from: sender, bytes } = &what else { return };
            let copy = Delivery::Datagram { to: *address, from: *sender, bytes: bytes.clone() };
            self.send_over((from, to), Held { from: None, what: copy }, now, transit, now);
        }
    }

    /// Ends a partition: what it held back goes on its way, in order.
    pub(super) fn heal(&mut self, from: usize, to: usize, now: Instant) {
        let mut not_before = now;
        for Held { from: sender, what } in self.ways.heal(from, to) {
            let transit = self.wire.transit(Medium::Tcp) + self.ways.faults(from, to).delay;
            let last_due = sender.and_then(|id| self.end(id)).map_or(now, |end| end.last_due);
            not_before = self.wire.carry(now, transit, not_before.max(last_due), what);
            if let Some(end) = sender.and_then(|id| self.end(id)) {
                end.last_due = not_before;
            }
        }
    }

    /// Resets every stream between two machines, at both ends and at once.
    pub(super) fn reset(&mut self, one: usize, other: usize) {
        let between = |machines| machines == (one, other) || machines == (other, one);
        let streams = self.sockets.iter().filter_map(|(&id, socket)| match &socket.kind {
            Kind::Stream(end) => Some((id, end.other?)),
            _ => None,
        });
        let broken: Vec<SocketId> = streams
            .filter(|&(id, to)| self.machines(id, to).is_some_and(between))
            .map(|(id, _)| id)
            .collect();
        broken.into_iter().for_each(|id| self.break_off(id));
    }

    /// An end hears that its connection was reset; nothing that is under way to it arrives any more.
    fn break_off(&mut self, id: SocketId) {
        let Some(end) = self.end(id) else { return };
        end.other = None;
        end.ending = Some(Ending::Reset);
        if end.phase == Phase::Connecting {
            end.phase = Phase::Refused;
        }
        self.changed(id);
    }

    /// Ends the processes of a machine. Their sockets are gone and can do nothing any more.
    pub(super) fn end_machine(&mut self, machine: usize, death: Death) {
        let mut dead = Vec::new();
        for (number, share) in self.shares.iter_mut().enumerate() {
            if share.machine == machine {
                share.dead = true;
                dead.push(number);
            }
        }
        let theirs: Vec<SocketId> = self
            .sockets
            .iter()
            .filter(|(_, socket)| dead.contains(&socket.share))
            .map(|(&id, _)| id)
            .collect();
        for id in theirs {
            self.drop_silently(id, death);
        }
    }

    fn drop_silently(&mut self, id: SocketId, death: Death) {
        let Some(socket) = self.sockets.remove(&id) else { return };
        match socket.kind {
            Kind::Stream(end) => {
                if let Some(port) = end.port {
                    self.client_ports.remove(&port);
                }
                if let (Death::Killed, Some(other)) = (death, end.other) {
                    self.break_off(other);
                }
            }
            Kind::Listener(waiting) => {
                self.listening.remove(&waiting.at);
                if death != Death::Killed {
                    self.dark.insert(waiting.at);
                }
                for end in waiting.ends {
                    self.drop_silently(end, death);
                }
            }
            Kind::Datagrams(mailbox) => {
                self.bound.remove(&mailbox.at);
            }
            Kind::Signals | Kind::Bell { .. } => {}
        }
        if death != Death::Killed {
            // What had left the machine arrives; what was under way to it finds nobody.
            let to_it = |what: &Delivery| what.receiver() == Some(id);
            self.wire.forget(to_it);
            self.ways.forget(to_it);
        }
    }

    pub(super) fn add_bell(&mut self, share: usize, token: Token) -> SocketId {
        self.add(share, Some(token), Kind::Bell { rung: false, last_due: Instant::ZERO })
    }

    /// Whether what passes inside the machine of a bell is late.
    pub(super) fn is_late_inside(&self, id: SocketId) -> bool {
        let faults = self.machine_of(id).map(|machine| self.ways.faults(machine, machine));
        faults.is_some_and(|faults| !(faults.delay.is_zero() && faults.jitter_max.is_zero()))
    }

    /// When what goes through a pipe now arrives.
    pub(super) fn next_arrival(&mut self, id: SocketId, now: Instant) -> Instant {
        let transit = self.wire.transit(Medium::Pipe);
        let Some(machine) = self.machine_of(id) else { return now };
        let lateness = self.ways.faults(machine, machine).lateness(&mut self.wire.rng);
        let Some(Kind::Bell { last_due, .. }) = self.sockets.get_mut(&id).map(|socket| &mut socket.kind)
        else {
            return now;
        };
        *last_due = (now + transit + lateness).max(*last_due);
        *last_due
    }

    /// Rings a bell, behind all that was sent through its pipe.
    pub(super) fn ring(&mut self, id: SocketId, now: Instant) {
        let Some(Kind::Bell { last_due, .. }) = self.sockets.get(&id).map(|socket| &socket.kind) else {
            return;
        };
        let due = now.max(*last_due);
        self.wire.carry(due, Duration::ZERO, due, Delivery::Ring { to: id });
    }
}
