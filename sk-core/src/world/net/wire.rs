//! What is under way between simulated sockets, and when it arrives.

use crate::world::{Endpoint, Rng, SimulatedRng};
use sk_flat::Instant;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

/// How a simulated network behaves.
///
/// ```
/// use sk_core::world::{NetworkSettings, SimulatedWorld};
/// use std::time::Duration;
///
/// let slow = NetworkSettings { tcp_latency: Duration::from_millis(20), ..NetworkSettings::default() };
/// let world = SimulatedWorld::with_network(1, slow);
/// # drop(world);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NetworkSettings {
    /// From one end of a TCP connection to the other.
    pub tcp_latency: Duration,
    /// From one end of a Unix socket to the other.
    pub unix_latency: Duration,
    /// From one UDP socket to another.
    pub udp_latency: Duration,
    /// From one end of a pipe inside a process to the other.
    pub pipe_latency: Duration,
    /// Up to this much is added to each latency, drawn from the seed. Streams keep their order;
    /// datagrams may overtake each other.
    pub jitter_max: Duration,
    /// How many bytes of one direction of a stream may be under way or unread before the writer has to
    /// wait.
    pub window_bytes: usize,
}

impl Default for NetworkSettings {
    fn default() -> NetworkSettings {
        NetworkSettings {
            tcp_latency: Duration::from_micros(50),
            unix_latency: Duration::from_micros(5),
            udp_latency: Duration::from_micros(50),
            pipe_latency: Duration::from_micros(1),
            jitter_max: Duration::ZERO,
            window_bytes: 64 * 1024,
        }
    }
}

/// A socket of the simulated network; never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SocketId(pub(super) u64);

/// What a delivery travels over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Medium {
    Tcp,
    Unix,
    Udp,
    Pipe,
}

/// One thing on its way.
#[derive(Debug)]
pub(super) enum Delivery {
    /// A wish to connect. How long the answer will take is drawn when it leaves, so that the instant of
    /// the outcome is known beforehand.
    Connect { client: SocketId, to: Endpoint, answer_after: Duration },
    /// The connection is made.
    Connected { client: SocketId },
    /// Nobody listens there.
    Refused { client: SocketId },
    /// Bytes of a stream.
    Bytes { to: SocketId, bytes: Vec<u8> },
    /// The other end writes no more.
    Finished { to: SocketId },
    /// The other end is gone; `reset` if it left bytes unread.
    Closed { to: SocketId, reset: bool },
    /// The other end has read this much, which may be written anew.
    Credit { to: SocketId, bytes: usize },
    /// A datagram.
    Datagram { to: SocketAddr, from: SocketAddr, bytes: Vec<u8> },
    /// The other end of a pipe has something.
    Ring { to: SocketId },
}

impl Delivery {
    /// The socket it goes to, where that is known.
    pub(super) fn receiver(&self) -> Option<SocketId> {
        match self {
            Delivery::Connect { .. } | Delivery::Datagram { .. } => None,
            Delivery::Connected { client: to }
            | Delivery::Refused { client: to }
            | Delivery::Bytes { to, .. }
            | Delivery::Finished { to }
            | Delivery::Closed { to, .. }
            | Delivery::Credit { to, .. }
            | Delivery::Ring { to } => Some(*to),
        }
    }
}

/// Everything under way, in order of arrival.
#[derive(Debug)]
pub(super) struct Wire {
    settings: NetworkSettings,
    pub(super) rng: SimulatedRng,
    sent: u64,
    under_way: BTreeMap<(Instant, u64), Delivery>,
}

impl Wire {
    pub(super) fn new(settings: NetworkSettings, rng: SimulatedRng) -> Wire {
        Wire { settings, rng, sent: 0, under_way: BTreeMap::new() }
    }

    pub(super) fn window_bytes(&self) -> usize {
        self.settings.window_bytes
    }

    /// How long the next passage takes.
    pub(super) fn transit(&mut self, over: Medium) -> Duration {
        let latency = match over {
            Medium::Tcp => self.settings.tcp_latency,
            Medium::Unix => self.settings.unix_latency,
            Medium::Udp => self.settings.udp_latency,
            Medium::Pipe => self.settings.pipe_latency,
        };
        if self.settings.jitter_max.is_zero() {
            return latency;
        }
        let jitter_max_ns = u64::try_from(self.settings.jitter_max.as_nanos()).unwrap_or(u64::MAX);
        latency + Duration::from_nanos(self.rng.next_u64() % jitter_max_ns.saturating_add(1).max(1))
    }

    /// Puts one thing on its way and answers when it arrives: `transit` after `leaves`, but not before
    /// `not_before`, which keeps the bytes of a stream in order. Things that arrive at the same instant
    /// arrive in the order in which they were sent.
    ///
    /// Every delivery of the simulated network passes here: the place for loss, delay and partition.
    pub(super) fn carry(
        &mut self,
        leaves: Instant,
        transit: Duration,
        not_before: Instant,
        what: Delivery,
    ) -> Instant {
        let due = (leaves + transit).max(not_before);
        self.sent += 1;
        self.under_way.insert((due, self.sent), what);
        due
    }

    /// Drops what is under way and fulfils `gone`.
    pub(super) fn forget(&mut self, gone: impl Fn(&Delivery) -> bool) {
        self.under_way.retain(|_, what| !gone(what));
    }

    /// The next thing that has arrived by `now`, and when it did.
    pub(super) fn take_due(&mut self, now: Instant) -> Option<(Instant, Delivery)> {
        let first = self.under_way.first_entry()?;
        if first.key().0 > now {
            return None;
        }
        let ((due, _), what) = first.remove_entry();
        Some((due, what))
    }

    /// What is under way, in order of arrival.
    pub(super) fn under_way(&self) -> impl Iterator<Item = (Instant, &Delivery)> {
        self.under_way.iter().map(|(&(due, _), what)| (due, what))
    }
}
