//! A whole simulated world: one clock, one network, one disk, for all its loops.

use super::net::Network;
use super::{
    NetworkSettings, Origin, OsSignal, SimulatedClock, SimulatedNet, SimulatedRng, SimulatedStorage,
    SimulatedWorker, World,
};
use std::sync::Arc;

/// The streams that the world itself draws from lie at the far end, away from those of loops.
const NETWORK_STREAM: u64 = u64::MAX;
const WORKER_STREAM: u64 = u64::MAX - 1;

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
#[derive(Clone, Debug)]
pub struct SimulatedWorld {
    seed: u64,
    clock: Arc<SimulatedClock>,
    network: Arc<Network>,
    storage: Arc<SimulatedStorage>,
    worker: Arc<SimulatedWorker>,
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
        }
    }

    /// Another loop's share. Its randomness is the stream of its number, in order of creation.
    pub fn world(&self) -> World {
        let net = SimulatedNet::new(self.network.clone());
        let share = net.share();
        World {
            clock: self.clock.clone(),
            storage: self.storage.clone(),
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
