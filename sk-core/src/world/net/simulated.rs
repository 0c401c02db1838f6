//! A network inside the process, driven by a virtual clock.

use super::addresses::datagram_way;
use super::faults::LinkFaults;
use super::machines::Death;
use super::sim_socket::{Kind, Phase};
use super::switch::Switch;
use super::wire::{Delivery, Medium, NetworkSettings, SocketId, Wire};
use super::{Datagram, Endpoint, Listener, Net, OsSignal, OsSignals, Readiness, Stream, Token, Wake};
use crate::world::{Clock, SimulatedClock, SimulatedRng};
use sk_flat::Instant;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The user id of every simulated process.
pub(crate) const SIMULATED_UID: u32 = 1000;

/// The longest datagram that IPv4 carries.
const DATAGRAM_BYTES_MAX: usize = 65_507;

/// The network that all loops of a simulated world share.
#[derive(Debug)]
pub(crate) struct Network {
    clock: Arc<SimulatedClock>,
    switch: Mutex<Switch>,
}

impl Network {
    pub(crate) fn new(clock: Arc<SimulatedClock>, settings: NetworkSettings, rng: SimulatedRng) -> Network {
        Network { clock, switch: Mutex::new(Switch::new(Wire::new(settings, rng))) }
    }

    /// The switch at the present instant, with everything applied that has arrived by then.
    pub(super) fn at_present(&self) -> (MutexGuard<'_, Switch>, Instant) {
        let mut switch = self.switch.lock().unwrap_or_else(PoisonError::into_inner);
        let now = self.clock.now();
        switch.settle(now);
        (switch, now)
    }

    pub(crate) fn raise(&self, signal: OsSignal) {
        self.at_present().0.raise(signal);
    }

    pub(crate) fn set_way(&self, from: usize, to: usize, faults: LinkFaults) {
        self.at_present().0.ways.set(from, to, faults);
    }

    pub(crate) fn part(&self, from: usize, to: usize) {
        self.at_present().0.ways.part(from, to);
    }

    pub(crate) fn heal(&self, from: usize, to: usize) {
        let (mut switch, now) = self.at_present();
        switch.heal(from, to, now);
    }

    pub(crate) fn reset(&self, one: usize, other: usize) {
        self.at_present().0.reset(one, other);
    }

    pub(crate) fn end_machine(&self, machine: usize, death: Death) {
        self.at_present().0.end_machine(machine, death);
    }
}

/// The sockets of one loop in a simulated world.
///
/// TCP and Unix sockets are byte streams with a window, UDP loses what finds no room; each delivery
/// arrives after the latency of [`NetworkSettings`]. Readiness is edge-triggered as with epoll: a socket
/// is reported when it is made and once after each change (data, room, a connection, an end), with all
/// that holds at the moment of the look; what was read or written meanwhile is not reported any more.
///
/// What differs from the real one: a Unix socket has no file in the simulated storage, a connection made
/// over it takes a round trip, and a write to a peer that has closed fails as soon as the news has
/// arrived.
#[derive(Debug)]
pub struct SimulatedNet {
    network: Arc<Network>,
    share: usize,
}

impl SimulatedNet {
    pub(crate) fn new(network: Arc<Network>, machine: usize) -> SimulatedNet {
        let share = network.at_present().0.add_share(machine);
        SimulatedNet { network, share }
    }

    /// What a scheduler asks about this loop.
    pub fn share(&self) -> SimulatedShare {
        SimulatedShare { network: self.network.clone(), share: self.share }
    }

    /// The earliest instant at which [`wait`](Net::wait) will have something to report or was woken: the
    /// present, if it would now; `None` if nothing is under way to this loop.
    pub fn next_event(&self) -> Option<Instant> {
        self.share().next_event()
    }

    fn open(&self, id: SocketId) -> Handle {
        Handle { network: self.network.clone(), id }
    }

    /// The switch, for a process that lives.
    fn alive(&self) -> io::Result<(MutexGuard<'_, Switch>, Instant)> {
        let (switch, now) = self.network.at_present();
        if switch.shares[self.share].dead {
            return Err(io::ErrorKind::NetworkDown.into());
        }
        Ok((switch, now))
    }
}

impl Net for SimulatedNet {
    /// Never blocks and moves no clock: reports what is ready at the present virtual time.
    fn wait(&mut self, _timeout: Option<Duration>, ready: &mut Vec<Readiness>) -> io::Result<()> {
        self.network.at_present().0.look(self.share, ready);
        Ok(())
    }

    fn waker(&self) -> Arc<dyn Wake> {
        Arc::new(self.share())
    }

    fn listen(&mut self, at: &Endpoint, token: Token) -> io::Result<Box<dyn Listener>> {
        let (id, local) = self.alive()?.0.listen(self.share, at, token)?;
        Ok(Box::new(SimulatedListener { socket: self.open(id), local }))
    }

    fn connect(&mut self, to: &Endpoint, token: Token) -> io::Result<Box<dyn Stream>> {
        let (mut switch, now) = self.alive()?;
        let id = switch.connect(self.share, to, token, now)?;
        drop(switch);
        Ok(Box::new(self.open(id)))
    }

    fn bind(&mut self, at: SocketAddr, token: Token) -> io::Result<Box<dyn Datagram>> {
        let (id, local) = self.alive()?.0.bind(self.share, at, token)?;
        Ok(Box::new(SimulatedDatagram { socket: self.open(id), local }))
    }

    fn watch_os_signals(&mut self, token: Token) -> io::Result<Box<dyn OsSignals>> {
        let id = self.network.at_present().0.add(self.share, Some(token), Kind::Signals);
        Ok(Box::new(self.open(id)))
    }

    /// Does nothing: simulated signals interrupt nobody.
    fn block_os_signals(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn release_os_signals(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// One loop's place in the simulated network, for the scheduler that steps the loops and for whoever
/// wakes this one.
#[derive(Clone, Debug)]
pub struct SimulatedShare {
    network: Arc<Network>,
    share: usize,
}

impl SimulatedShare {
    /// As [`SimulatedNet::next_event`].
    pub fn next_event(&self) -> Option<Instant> {
        let (switch, now) = self.network.at_present();
        switch.next_event(self.share, now)
    }

    /// Whether a [`Wake`] was used since the loop's last wait.
    pub fn woken(&self) -> bool {
        self.network.at_present().0.is_woken(self.share)
    }

    /// The number of the machine it runs on.
    pub fn machine(&self) -> usize {
        self.network.at_present().0.shares[self.share].machine
    }

    pub(super) fn network(&self) -> &Arc<Network> {
        &self.network
    }

    /// The number of the loop in its world, in order of creation.
    pub fn number(&self) -> usize {
        self.share
    }
}

impl Wake for SimulatedShare {
    fn wake(&self) {
        self.network.at_present().0.wake(self.share);
    }
}

/// A socket that is open: dropping it closes it.
#[derive(Debug)]
struct Handle {
    network: Arc<Network>,
    id: SocketId,
}

impl Drop for Handle {
    fn drop(&mut self) {
        let (mut switch, now) = self.network.at_present();
        switch.close(self.id, now);
    }
}

struct SimulatedListener {
    socket: Handle,
    local: Endpoint,
}

impl Listener for SimulatedListener {
    fn local(&self) -> Endpoint {
        self.local.clone()
    }

    fn accept(&mut self, token: Token) -> io::Result<Box<dyn Stream>> {
        let (mut switch, _) = self.socket.network.at_present();
        let next = switch
            .sockets
            .get_mut(&self.socket.id)
            .and_then(|socket| match &mut socket.kind {
                Kind::Listener(waiting) => waiting.ends.pop_front(),
                _ => None,
            });
        let id = next.ok_or(io::ErrorKind::WouldBlock)?;
        if let Some(socket) = switch.sockets.get_mut(&id) {
            socket.token = Some(token);
        }
        switch.changed(id);
        drop(switch);
        Ok(Box::new(Handle { network: self.socket.network.clone(), id }))
    }
}

/// The error for a socket that its own handle cannot find: it exists as long as the handle.
fn gone() -> io::Error {
    io::ErrorKind::NotConnected.into()
}

impl Stream for Handle {
    fn connected(&mut self) -> io::Result<bool> {
        let (mut switch, _) = self.network.at_present();
        match switch.end(self.id).ok_or_else(gone)?.phase {
            Phase::Connecting => Ok(false),
            Phase::Open => Ok(true),
            Phase::Refused => Err(io::ErrorKind::ConnectionRefused.into()),
        }
    }

    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let (mut switch, now) = self.network.at_present();
        let bytes = switch.end(self.id).ok_or_else(gone)?.read(into)?;
        if bytes > 0 {
            switch.pass(self.id, now, |to| Delivery::Credit { to, bytes });
        }
        Ok(bytes)
    }

    fn write_vectored(&mut self, parts: &[io::IoSlice<'_>]) -> io::Result<usize> {
        let (mut switch, now) = self.network.at_present();
        let wanted = parts.iter().map(|part| part.len()).sum();
        let count = switch.admit(self.id, wanted, now)?;
        if count > 0 {
            let mut bytes = Vec::with_capacity(count);
            for part in parts {
                bytes.extend_from_slice(&part[..part.len().min(count - bytes.len())]);
            }
            switch.pass_bytes(self.id, now, bytes);
        }
        Ok(count)
    }

    fn shutdown_write(&mut self) -> io::Result<()> {
        let (mut switch, now) = self.network.at_present();
        let end = switch.end(self.id).ok_or_else(gone)?;
        if end.phase != Phase::Open {
            return Err(io::ErrorKind::NotConnected.into());
        }
        if !std::mem::replace(&mut end.write_shut, true) {
            switch.pass(self.id, now, |to| Delivery::Finished { to });
        }
        Ok(())
    }

    fn peer(&self) -> Option<Endpoint> {
        let (mut switch, _) = self.network.at_present();
        switch.end(self.id)?.peer.clone()
    }

    fn peer_uid(&self) -> Option<u32> {
        let (mut switch, _) = self.network.at_present();
        (switch.end(self.id)?.medium == Medium::Unix).then_some(SIMULATED_UID)
    }
}

struct SimulatedDatagram {
    socket: Handle,
    local: SocketAddr,
}

impl Datagram for SimulatedDatagram {
    fn local(&self) -> SocketAddr {
        self.local
    }

    fn receive(&mut self, into: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        let (mut switch, _) = self.socket.network.at_present();
        let next = switch
            .sockets
            .get_mut(&self.socket.id)
            .and_then(|socket| match &mut socket.kind {
                Kind::Datagrams(mailbox) => mailbox.take(),
                _ => None,
            });
        let (from, bytes) = next.ok_or(io::ErrorKind::WouldBlock)?;
        let count = bytes.len().min(into.len());
        into[..count].copy_from_slice(&bytes[..count]);
        Ok((count, from))
    }

    fn send(&mut self, to: SocketAddr, datagram: &[u8]) -> io::Result<usize> {
        if datagram.len() > DATAGRAM_BYTES_MAX {
            return Err(io::Error::from_raw_os_error(libc::EMSGSIZE));
        }
        if to.is_ipv4() != self.local.is_ipv4() {
            return Err(io::Error::from_raw_os_error(libc::EAFNOSUPPORT));
        }
        let (mut switch, now) = self.socket.network.at_present();
        let (from, to) = datagram_way(self.local, to);
        let share = switch.sockets.get(&self.socket.id).ok_or_else(gone)?.share;
        let (machine, receiver) = (switch.shares[share].machine, switch.bound_at(to));
        let what = Delivery::Datagram { to, from, bytes: datagram.to_vec() };
        switch.pass_datagram(machine, now, (what, receiver));
        Ok(datagram.len())
    }
}

impl OsSignals for Handle {
    fn take(&mut self) -> io::Result<Option<OsSignal>> {
        Ok(self.network.at_present().0.signals.pop_front())
    }
}
