//! Names in the simulated network: who listens where, and which port is free.

use super::endpoint::address;
use super::faults::Held;
use super::sim_socket::{End, Kind, Mailbox, Phase, Waiting};
use super::switch::Switch;
use super::wire::{Delivery, Medium, SocketId};
use super::{Endpoint, Token};
use sk_flat::Instant;
use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// The first port that is given to who asks for any.
const ANY_PORT_MIN: u16 = 32_768;

/// An address that stands for the machine itself, as a sender sees it.
fn reached(ip: IpAddr) -> IpAddr {
    match ip {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    }
}

/// The address that receives for all of the same family.
fn any_of(at: SocketAddr) -> SocketAddr {
    let ip = if at.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
    SocketAddr::new(ip, at.port())
}

/// Whether two sockets would both be meant by some address.
fn overlap(one: SocketAddr, other: SocketAddr) -> bool {
    one == other
        || (any_of(one) == any_of(other) && (one.ip().is_unspecified() || other.ip().is_unspecified()))
}

impl Switch {
    pub(super) fn listener_at(&self, to: &Endpoint) -> Option<SocketId> {
        let exact = self.listening.get(to).copied();
        match to {
            Endpoint::Ip(at) => exact.or_else(|| self.listening.get(&Endpoint::Ip(any_of(*at))).copied()),
            Endpoint::Unix(_) | Endpoint::Tty { .. } => exact,
        }
    }

    pub(super) fn bound_at(&self, to: SocketAddr) -> Option<SocketId> {
        self.bound.get(&to).or_else(|| self.bound.get(&any_of(to))).copied()
    }

    /// Begins to listen; answers where.
    pub(super) fn listen(
        &mut self,
        share: usize,
        at: &Endpoint,
        token: Token,
    ) -> io::Result<(SocketId, Endpoint)> {
        let at = match at {
            Endpoint::Ip(wanted) => {
                let taken: Vec<SocketAddr> = self.listening.keys().filter_map(address).collect();
                Endpoint::Ip(self.place(*wanted, &taken)?)
            }
            Endpoint::Unix(_) if self.listening.contains_key(at) => {
                return Err(io::ErrorKind::AddrInUse.into());
            }
            Endpoint::Unix(_) => at.clone(),
            Endpoint::Tty { .. } => return Err(io::ErrorKind::Unsupported.into()),
        };
        self.dark.remove(&at);
        let waiting = Waiting { at: at.clone(), ends: VecDeque::new() };
        let id = self.add(share, Some(token), Kind::Listener(waiting));
        self.listening.insert(at.clone(), id);
        Ok((id, at))
    }

    /// Binds a datagram socket; answers where.
    pub(super) fn bind(
        &mut self,
        share: usize,
        at: SocketAddr,
        token: Token,
    ) -> io::Result<(SocketId, SocketAddr)> {
        let taken: Vec<SocketAddr> = self.bound.keys().copied().collect();
        let at = self.place(at, &taken)?;
        let id = self.add(share, Some(token), Kind::Datagrams(Mailbox::new(at)));
        self.bound.insert(at, id);
        Ok((id, at))
    }

    /// Begins to connect.
    ///
    /// # Errors
    /// `NotFound` where there is no socket file, `AddrNotAvailable` when all ports are taken.
    pub(super) fn connect(
        &mut self,
        share: usize,
        to: &Endpoint,
        token: Token,
        now: Instant,
    ) -> io::Result<SocketId> {
        let (medium, to, port) = match to {
            Endpoint::Ip(at) => {
                let to = Endpoint::Ip(SocketAddr::new(reached(at.ip()), at.port()));
                let listening: BTreeSet<u16> =
                    self.listening.keys().filter_map(address).map(|at| at.port()).collect();
                let port = self.any_port(|switch, port| {
                    switch.client_ports.contains(&port) || listening.contains(&port)
                })?;
                self.client_ports.insert(port);
                (Medium::Tcp, to, Some(port))
            }
            Endpoint::Unix(_) if !self.listening.contains_key(to) && !self.dark.contains(to) => {
                return Err(io::ErrorKind::NotFound.into());
            }
            Endpoint::Unix(_) => (Medium::Unix, to.clone(), None),
            Endpoint::Tty { .. } => return Err(io::ErrorKind::NotFound.into()),
        };
        let mut end = End::new(medium, Phase::Connecting, self.wire.window_bytes());
        end.peer = Some(to.clone());
        end.port = port;
        let client = self.add(share, Some(token), Kind::Stream(end));
        let (transit, answer_after) = (self.wire.transit(medium), self.wire.transit(medium));
        let there = self.listener_at(&to).and_then(|id| self.sockets.get(&id));
        let machines = there.map(|there| (self.shares[share].machine, self.shares[there.share].machine));
        let wish = Delivery::Connect { client, to, answer_after };
        let due = match machines.filter(|_| !self.ways.are_fine()) {
            Some(machines) => {
                self.send_over(machines, Held { from: Some(client), what: wish }, now, transit, now)
            }
            None => Some(self.wire.carry(now, transit, now, wish)),
        };
        if let (Some(end), Some(due)) = (self.end(client), due) {
            end.last_due = due;
        }
        Ok(client)
    }

    /// The address itself, with a free port if it asks for any.
    fn place(&mut self, at: SocketAddr, taken: &[SocketAddr]) -> io::Result<SocketAddr> {
        let is_taken = |at| taken.iter().any(|&other| overlap(at, other));
        if at.port() != 0 {
            return if is_taken(at) { Err(io::ErrorKind::AddrInUse.into()) } else { Ok(at) };
        }
        let port = self.any_port(|switch, port| {
            switch.client_ports.contains(&port) || is_taken(SocketAddr::new(at.ip(), port))
        })?;
        Ok(SocketAddr::new(at.ip(), port))
    }

    fn any_port(&mut self, is_taken: impl Fn(&Switch, u16) -> bool) -> io::Result<u16> {
        for _ in ANY_PORT_MIN..=u16::MAX {
            let port = self.port_given_last.checked_add(1).unwrap_or(ANY_PORT_MIN);
            self.port_given_last = port;
            if !is_taken(self, port) {
                return Ok(port);
            }
        }
        Err(io::ErrorKind::AddrNotAvailable.into())
    }
}

/// The address under which a datagram of `local` reaches `to`, and where that is.
pub(super) fn datagram_way(local: SocketAddr, to: SocketAddr) -> (SocketAddr, SocketAddr) {
    let to = SocketAddr::new(reached(to.ip()), to.port());
    let ip = if local.ip().is_unspecified() { to.ip() } else { local.ip() };
    (SocketAddr::new(ip, local.port()), to)
}
