//! A whole simulated world: one clock, one network, one disk, for all its loops.

use super::net::Network;
use super::{
    Death, LinkFaults, NetworkSettings, Origin, OsSignal, SimulatedClock, SimulatedNet, SimulatedRng,
    SimulatedStorage, SimulatedWorker, World,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The streams that the world itself draws from lie at the far end, away from those of loops.
const NETWORK_STREAM: u64 = u64::MAX;
const WORKER_STREAM: u64 = u64::MAX - 1;
/// How far apart the workers' streams of machines and their processes lie, downwards.
const WORKER_STREAMS: u64 = 1 << 32;

/// What all loops of a simulation share, and the levers of whoever runs it. A clone is the same world.
///
/// Nothing in it depends on the machine: the same seed and the same calls give the same bytes in the same
/// order at the same virtual times. Nothing blocks either. A scheduler steps the loop that is due next,
/// which it learns from [`SimulatedShare::next_event`](super::SimulatedShare::next_event) of each loop and
/// [`SimulatedWorker::next_due`], and sets the clock to it.
///
/// ```
/// use sk_core::world::{Clock, Endpoint, SimulatedWorld, Token};
///
/// let simulation = SimulatedWorld::new(7);
/// let (mut server, mut client) = (simulation.world(), simulation.world());
/// let any = Endpoint::Ip("127.0.0.1:0".parse()?);
/// let mut listener = server.net.listen(&any, Token(1))?;
/// let mut stream = client.net.connect(&listener.local(), Token(2))?;
///
/// let mut ready = Vec::new();
/// while ready.is_empty() {
///     let next = server.simulated_share().and_then(|share| share.next_event());
///     simulation.clock().set(next.expect("the client is under way"));
///     server.net.wait(None, &mut ready)?;
/// }
/// assert_eq!(simulation.clock().now().as_nanos(), 50_000); // one way over simulated TCP
/// listener.accept(Token(3))?;
/// assert!(!stream.connected()?); // the answer is still under way
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// The world begins with one machine. [`machine`](SimulatedWorld::machine) adds others, each with a disk and
/// a worker of its own; the value it answers is the same world as seen from there. Ways between machines can
/// be made [faulty](SimulatedWorld::set_link), [cut](SimulatedWorld::partition) and mended while loops run, and a
/// machine's processes can [die](SimulatedWorld::die) and be [started anew](SimulatedWorld::restarted).
#[derive(Clone, Debug)]
pub struct SimulatedWorld {
    seed: u64,
    clock: Arc<SimulatedClock>,
    network: Arc<Network>,
    storage: Arc<SimulatedStorage>,
    worker: Arc<SimulatedWorker>,
    machine: usize,
    /// Machines and processes that were made, in this order.
    made: Arc<AtomicU64>,
}

impl SimulatedWorld {
    /// A world at virtual time zero, without files, with the default network.
    pub fn new(seed: u64) -> SimulatedWorld {
        SimulatedWorld::with_network(seed, NetworkSettings::default())
    }

    /// As [`new`](SimulatedWorld::new), with another network.
    pub fn with_network(seed: u64, settings: NetworkSettings) -> SimulatedWorld {
        let clock = Arc::new(SimulatedClock::new());
        let network = Network::new(clock.clone(), settings, SimulatedRng::new(seed, NETWORK_STREAM));
        let worker = SimulatedWorker::new(clock.clone(), SimulatedRng::new(seed, WORKER_STREAM));
        SimulatedWorld {
            seed,
            clock,
            network: Arc::new(network),
            storage: Arc::new(SimulatedStorage::new()),
            worker: Arc::new(worker),
            machine: 0,
            made: Arc::new(AtomicU64::new(0)),
        }
    }

    /// Another machine in the same network, with an empty disk.
    pub fn machine(&self) -> SimulatedWorld {
        let made = self.made.fetch_add(1, Ordering::Relaxed) + 1;
        SimulatedWorld {
            storage: Arc::new(SimulatedStorage::new()),
            worker: Arc::new(self.worker_of(made)),
            machine: usize::try_from(made).unwrap_or(usize::MAX),
            ..self.clone()
        }
    }

    /// The same machine for its next process, after [`die`](SimulatedWorld::die): what the disk kept is there, and
    /// no work is under way.
    pub fn restarted(&self) -> SimulatedWorld {
        let made = self.made.fetch_add(1, Ordering::Relaxed) + 1;
        SimulatedWorld { worker: Arc::new(self.worker_of(made)), ..self.clone() }
    }

    fn worker_of(&self, made: u64) -> SimulatedWorker {
        let stream = WORKER_STREAM - made * WORKER_STREAMS;
        SimulatedWorker::new(self.clock.clone(), SimulatedRng::new(self.seed, stream))
    }

    /// The machine's number in its world: 0 is the first.
    pub fn machine_number(&self) -> usize {
        self.machine
    }

    /// How the ways between two machines misbehave from now on, both directions alike. The same number twice
    /// means what passes inside that machine, pipes between its loops included.
    pub fn set_link(&self, one: usize, other: usize, faults: LinkFaults) {
        self.network.set_way(one, other, faults);
        self.network.set_way(other, one, faults);
    }

    /// Nothing that leaves one machine for the other from now on arrives: streams stall, datagrams are lost.
    /// What was under way arrives. The other direction is a matter of its own.
    pub fn partition(&self, from: usize, to: usize) {
        self.network.part(from, to);
    }

    /// Ends a partition: what streams and wishes to connect sent meanwhile arrives now.
    pub fn heal(&self, from: usize, to: usize) {
        self.network.heal(from, to);
    }

    /// Breaks every connection between two machines; both ends hear of a reset.
    pub fn reset(&self, one: usize, other: usize) {
        self.network.reset(one, other);
    }

    /// All processes of this machine end without a word. Their loops are to be dropped: what they still do
    /// reaches nobody, and not the disk. Of work that waits on the worker, chance decides: it is lost, done or half
    /// done.
    pub fn die(&self, death: Death, rng: &mut SimulatedRng) {
        self.network.end_machine(self.machine, death);
        self.worker.give_up(rng, |operations| self.storage.give_out_after(operations));
        match death {
            Death::Killed | Death::Vanished => self.storage.end_process(),
            Death::PowerCut => self.storage.power_cut_by_chance(rng),
        }
    }

    /// The only process of this machine ends as it should: its work is done to the end, and then its files are closed.
    pub(crate) fn finish(&self) {
        self.worker.finish();
        self.storage.end_process();
    }

    /// Another loop's share. Its randomness is the stream of its number, in order of creation.
    pub fn world(&self) -> World {
        let net = SimulatedNet::new(self.network.clone(), self.machine);
        let share = net.share();
        World {
            clock: self.clock.clone(),
            storage: Arc::new(self.storage.for_process()),
            rng: Box::new(self.rng(share.number() as u64)),
            worker: self.worker.clone(),
            net: Box::new(net),
            origin: Origin::Simulated(self.clone()),
            share: Some(share),
        }
    }

    /// The virtual clock.
    pub fn clock(&self) -> &Arc<SimulatedClock> {
        &self.clock
    }

    /// The disk, whose power can be cut.
    pub fn storage(&self) -> &Arc<SimulatedStorage> {
        &self.storage
    }

    /// The blocking work that waits.
    pub fn worker(&self) -> &Arc<SimulatedWorker> {
        &self.worker
    }

    /// The random stream of that number. Loops have those from 0 on; who wants one of his own takes it
    /// from 2^32 on.
    pub fn rng(&self, stream: u64) -> SimulatedRng {
        SimulatedRng::new(self.seed, stream)
    }

    /// Sends the application a POSIX signal.
    pub fn raise(&self, signal: OsSignal) {
        self.network.raise(signal);
    }
}
