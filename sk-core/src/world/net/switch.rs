//! The simulated network in between: it knows every socket and applies what arrives.

use super::endpoint::client_name;
use super::faults::{Held, Ways};
use super::sim_socket::{End, Ending, Kind, Phase, Socket};
use super::wire::{Delivery, SocketId, Wire};
use super::{Endpoint, OsSignal, Readiness, Token};
use sk_flat::Instant;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::SocketAddr;
use std::time::Duration;

/// One loop's part.
#[derive(Debug, Default)]
pub(super) struct Share {
    /// The machine that its loop runs on.
    pub(super) machine: usize,
    /// Its process is no more.
    pub(super) dead: bool,
    woken: bool,
    /// The sockets whose state has changed since the last look, in the order of their changes.
    changed: VecDeque<SocketId>,
}

/// All sockets of a simulated world.
#[derive(Debug)]
pub(super) struct Switch {
    pub(super) wire: Wire,
    pub(super) sockets: BTreeMap<SocketId, Socket>,
    pub(super) listening: BTreeMap<Endpoint, SocketId>,
    pub(super) bound: BTreeMap<SocketAddr, SocketId>,
    /// The ports of connecting ends.
    pub(super) client_ports: BTreeSet<u16>,
    pub(super) port_given_last: u16,
    sockets_made: u64,
    pub(super) shares: Vec<Share>,
    pub(super) signals: VecDeque<OsSignal>,
    pub(super) ways: Ways,
    /// Where a machine listened that is gone without a word: nobody answers there.
    pub(super) dark: BTreeSet<Endpoint>,
}

impl Switch {
    pub(super) fn new(wire: Wire) -> Switch {
        Switch {
            wire,
            sockets: BTreeMap::new(),
            listening: BTreeMap::new(),
            bound: BTreeMap::new(),
            client_ports: BTreeSet::new(),
            port_given_last: u16::MAX,
            sockets_made: 0,
            shares: Vec::new(),
            signals: VecDeque::new(),
            ways: Ways::default(),
            dark: BTreeSet::new(),
        }
    }

    pub(super) fn add_share(&mut self, machine: usize) -> usize {
        self.shares.push(Share { machine, ..Share::default() });
        self.shares.len() - 1
    }

    pub(super) fn wake(&mut self, share: usize) {
        self.shares[share].woken = true;
    }

    pub(super) fn is_woken(&self, share: usize) -> bool {
        self.shares[share].woken
    }

    pub(super) fn add(&mut self, share: usize, token: Option<Token>, kind: Kind) -> SocketId {
        self.sockets_made += 1;
        let id = SocketId(self.sockets_made);
        self.sockets.insert(id, Socket { share, token, listed: false, kind });
        self.changed(id);
        id
    }

    /// Notes that a socket's state has changed, for the next look of its loop.
    pub(super) fn changed(&mut self, id: SocketId) {
        if let Some(socket) = self.sockets.get_mut(&id)
            && socket.token.is_some()
            && !socket.listed
        {
            socket.listed = true;
            self.shares[socket.share].changed.push_back(id);
        }
    }

    /// Reports what has changed and is ready, once for each change.
    pub(super) fn look(&mut self, share: usize, ready: &mut Vec<Readiness>) {
        self.shares[share].woken = false;
        let pending = !self.signals.is_empty();
        while let Some(id) = self.shares[share].changed.pop_front() {
            let Some(socket) = self.sockets.get_mut(&id) else { continue };
            socket.listed = false;
            // What was read or written since the change is not reported any more.
            if let (Some(token), (readable, writable)) = (socket.token, socket.state(pending))
                && (readable || writable)
            {
                ready.push(Readiness { token, readable, writable });
            }
            if let Kind::Bell { rung, .. } = &mut socket.kind {
                *rung = false;
            }
        }
    }

    /// When a loop will next be told something.
    pub(super) fn next_event(&self, share: usize, now: Instant) -> Option<Instant> {
        let pending = !self.signals.is_empty();
        let part = &self.shares[share];
        let is_ready = |id: &SocketId| {
            self.sockets
                .get(id)
                .is_some_and(|socket| socket.state(pending) != (false, false))
        };
        if part.woken || part.changed.iter().any(is_ready) {
            return Some(now);
        }
        let mut first: Option<Instant> = None;
        for (due, what) in self.wire.under_way() {
            if first.is_some_and(|first| first <= due) {
                break;
            }
            if let Some(at) = self.told_at(share, due, what) {
                first = Some(first.map_or(at, |first| first.min(at)));
            }
        }
        first
    }

    /// When the loop will be told because of a thing under way, if it will.
    fn told_at(&self, share: usize, due: Instant, what: &Delivery) -> Option<Instant> {
        let is_ours = |id: &SocketId| {
            self.sockets
                .get(id)
                .filter(|socket| socket.share == share && socket.token.is_some())
        };
        match what {
            // Whoever gave up before his wish arrives is heard of by nobody.
            Delivery::Connect { client, .. } if !self.sockets.contains_key(client) => None,
            Delivery::Connect { client, to, answer_after } => {
                let listener = self.listener_at(to).and_then(|id| is_ours(&id));
                if listener.is_some_and(|socket| matches!(&socket.kind, Kind::Listener(w) if w.has_room())) {
                    return Some(due);
                }
                is_ours(client).map(|_| due + *answer_after)
            }
            Delivery::Connected { client } | Delivery::Refused { client } => is_ours(client).map(|_| due),
            Delivery::Bytes { to, .. } | Delivery::Finished { to } | Delivery::Closed { to, .. } => {
                is_ours(to).map(|_| due)
            }
            Delivery::Ring { to } => is_ours(to).map(|_| due),
            Delivery::Credit { to, .. } => is_ours(to)
                .filter(|s| matches!(&s.kind, Kind::Stream(end) if end.starved))
                .map(|_| due),
            Delivery::Datagram { to, bytes, .. } => {
                let socket = self.bound_at(*to).and_then(|id| is_ours(&id))?;
                matches!(&socket.kind, Kind::Datagrams(m) if m.has_room(bytes.len())).then_some(due)
            }
        }
    }

    /// Applies everything that has arrived by `now`.
    pub(super) fn settle(&mut self, now: Instant) {
        while let Some((due, what)) = self.wire.take_due(now) {
            self.arrive(due, what);
        }
    }

    fn arrive(&mut self, at: Instant, what: Delivery) {
        let to = match what {
            Delivery::Connect { client, to, answer_after } => {
                self.answer_wish(client, &to, at, answer_after);
                return;
            }
            Delivery::Ring { to } => {
                if let Some(Kind::Bell { rung, .. }) = self.sockets.get_mut(&to).map(|s| &mut s.kind) {
                    *rung = true;
                    self.changed(to);
                }
                return;
            }
            Delivery::Datagram { to, from, bytes } => {
                let Some(id) = self.bound_at(to) else { return };
                if let Some(Kind::Datagrams(mailbox)) = self.sockets.get_mut(&id).map(|s| &mut s.kind)
                    && mailbox.has_room(bytes.len())
                {
                    mailbox.put(from, bytes);
                    self.changed(id);
                }
                return;
            }
            Delivery::Connected { client: to }
            | Delivery::Refused { client: to }
            | Delivery::Bytes { to, .. }
            | Delivery::Finished { to }
            | Delivery::Closed { to, .. }
            | Delivery::Credit { to, .. } => to,
        };
        let Some(end) = self.end(to) else { return };
        if end.ending == Some(Ending::Reset) || end.phase == Phase::Refused {
            return;
        }
        let mut tells = true;
        match what {
            Delivery::Connected { .. } => end.phase = Phase::Open,
            Delivery::Refused { .. } => end.phase = Phase::Refused,
            Delivery::Bytes { bytes, .. } => end.incoming.extend(bytes),
            Delivery::Finished { .. } => end.ending = end.ending.max(Some(Ending::Finished)),
            Delivery::Closed { reset, .. } => {
                let ending = if reset { Ending::Reset } else { Ending::Closed };
                end.ending = end.ending.max(Some(ending));
            }
            Delivery::Credit { bytes, .. } => {
                end.credit += bytes;
                tells = std::mem::take(&mut end.starved);
            }
            Delivery::Connect { .. } | Delivery::Datagram { .. } | Delivery::Ring { .. } => {}
        }
        if tells {
            self.changed(to);
        }
    }

    /// A wish to connect arrives, and the answer leaves; none where a machine is gone without a word.
    fn answer_wish(&mut self, client: SocketId, to: &Endpoint, at: Instant, answer_after: Duration) {
        let listener = self.listener_at(to);
        if listener.is_none() && self.dark.contains(to) {
            return;
        }
        let machine_of = |id: SocketId| self.sockets.get(&id).map(|socket| self.shares[socket.share].machine);
        let machines = listener.and_then(machine_of).zip(machine_of(client));
        let refuse = machines.is_some_and(|(here, there)| self.ways.faults(there, here).refuse);
        let answer = if !refuse && self.meet(client, to, at + answer_after) {
            Delivery::Connected { client }
        } else {
            Delivery::Refused { client }
        };
        let made = self.end(client).and_then(|end| end.other);
        match machines.filter(|_| !self.ways.are_fine()) {
            Some(machines) => {
                let due = self.send_over(machines, Held { from: made, what: answer }, at, answer_after, at);
                if let (Some(end), Some(due)) = (made.and_then(|made| self.end(made)), due) {
                    end.last_due = end.last_due.max(due);
                }
            }
            None => {
                self.wire.carry(at, answer_after, at, answer);
            }
        }
    }

    /// A wish to connect arrives: makes the server's end, unless nobody listens, too many wait or the
    /// client has given up. What the server writes arrives after the answer.
    fn meet(&mut self, client: SocketId, to: &Endpoint, answer_due: Instant) -> bool {
        let Some(listener) = self.listener_at(to) else { return false };
        let Some(end) = self.end(client) else { return false };
        let (medium, peer) = (end.medium, end.port.map(|port| client_name(to, port)));
        let Some(Socket { kind: Kind::Listener(waiting), share, .. }) = self.sockets.get(&listener) else {
            return false;
        };
        if !waiting.has_room() {
            return false;
        }
        let share = *share;
        let mut server = End::new(medium, Phase::Open, self.wire.window_bytes());
        server.other = Some(client);
        server.peer = peer.flatten();
        server.last_due = answer_due;
        let server = self.add(share, None, Kind::Stream(server));
        if let Some(end) = self.end(client) {
            end.other = Some(server);
        }
        if let Some(Kind::Listener(waiting)) = self.sockets.get_mut(&listener).map(|s| &mut s.kind) {
            waiting.ends.push_back(server);
        }
        self.changed(listener);
        true
    }

    /// One end of a stream, if it still exists.
    pub(super) fn end(&mut self, id: SocketId) -> Option<&mut End> {
        match self.sockets.get_mut(&id).map(|socket| &mut socket.kind) {
            Some(Kind::Stream(end)) => Some(end),
            _ => None,
        }
    }

    /// Removes a socket whose handle was dropped, and tells the other side.
    pub(super) fn close(&mut self, id: SocketId, now: Instant) {
        if let Some(end) = self.end(id) {
            let (reset, port) = (!end.incoming.is_empty(), end.port);
            self.pass(id, now, |to| Delivery::Closed { to, reset });
            if let Some(port) = port {
                self.client_ports.remove(&port);
            }
        }
        let Some(socket) = self.sockets.remove(&id) else { return };
        match socket.kind {
            Kind::Listener(waiting) => {
                self.listening.remove(&waiting.at);
                for end in waiting.ends {
                    self.pass(end, now, |to| Delivery::Closed { to, reset: true });
                    self.sockets.remove(&end);
                }
            }
            Kind::Datagrams(mailbox) => {
                self.bound.remove(&mailbox.at);
            }
            Kind::Stream(_) | Kind::Signals | Kind::Bell { .. } => {}
        }
    }

    /// A POSIX signal arrives. Like the kernel's, one that is pending already is not counted again.
    pub(super) fn raise(&mut self, signal: OsSignal) {
        if !self.signals.contains(&signal) {
            self.signals.push_back(signal);
        }
        let watching = self.sockets.iter().filter(|(_, socket)| matches!(socket.kind, Kind::Signals));
        let watching: Vec<SocketId> = watching.map(|(&id, _)| id).collect();
        watching.into_iter().for_each(|id| self.changed(id));
    }
}
