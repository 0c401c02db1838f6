//! The world a loop lives in: everything that comes from outside, handed in as traits.
//!
//! Nothing else in the workspace asks the operating system for time, sockets, durable storage,
//! randomness or blocking work. Each trait has a real and a simulated implementation; with the
//! simulated ones a whole program, several loops included, runs on one thread under a virtual clock
//! and repeats exactly for the same seed.

pub mod clock;
pub mod net;
pub mod rng;
pub mod simulated;
pub mod storage;
pub mod worker;

pub use clock::{Clock, RealClock, SimulatedClock};
pub(crate) use net::SimulatedBell;
pub use net::{
    Datagram, Death, Endpoint, LinkFaults, Listener, Net, NetworkSettings, OsSignal, OsSignals, Readiness,
    RealNet, SimulatedNet, SimulatedShare, Stream, Token, Wake,
};
pub use rng::{RealRng, Rng, SimulatedRng};
pub use simulated::SimulatedWorld;
pub use storage::{DiskFaults, Found, RealStorage, SimulatedStorage, Storage, StoredFile, StoredFolder};
pub use worker::{JOBS_WAITING_MAX, Job, RealWorker, SimulatedWorker, Worker};

use std::io;
use std::sync::Arc;

/// One loop's share of a world.
///
/// Clock, storage and worker are common to all loops of an application; sockets and randomness are each
/// loop's own. It stays on the thread that made it: another thread's loop grows its own from a
/// [`WorldSeed`].
///
/// ```
/// use sk_core::world::World;
///
/// let world = World::real()?;
/// let seed = world.for_thread()?;
/// let other = std::thread::spawn(move || seed.grow().map(|world| world.clock.now()));
/// let there = other.join().expect("the thread does not panic")?;
/// assert!(there <= world.clock.now()); // one clock
/// # Ok::<(), std::io::Error>(())
/// ```
pub struct World {
    /// The application's clock.
    pub clock: Arc<dyn Clock>,
    /// This loop's sockets.
    pub net: Box<dyn Net>,
    /// The application's files.
    pub storage: Arc<dyn Storage>,
    /// This loop's randomness.
    pub rng: Box<dyn Rng>,
    /// Where the application's blocking work goes.
    pub worker: Arc<dyn Worker>,
    origin: Origin,
    share: Option<SimulatedShare>,
}

/// Where further shares come from.
#[derive(Clone)]
enum Origin {
    Real,
    Simulated(SimulatedWorld),
}

impl World {
    /// The first share of the real world: the machine's clock, sockets, files and randomness.
    ///
    /// # Errors
    /// When the process has no descriptors left: it needs four for each loop.
    pub fn real() -> io::Result<World> {
        Ok(World {
            clock: Arc::new(RealClock::new()),
            net: Box::new(RealNet::new()?),
            storage: Arc::new(RealStorage::new()),
            rng: Box::new(RealRng),
            worker: Arc::new(RealWorker::new()),
            origin: Origin::Real,
            share: None,
        })
    }

    /// In a simulated world, what its scheduler asks about this loop.
    pub fn simulated_share(&self) -> Option<&SimulatedShare> {
        self.share.as_ref()
    }

    /// What another thread's loop grows its share from, with the same clock, storage and worker.
    ///
    /// # Errors
    /// None as yet; a world may come to need a resource for it.
    pub fn for_thread(&self) -> io::Result<WorldSeed> {
        Ok(WorldSeed {
            clock: self.clock.clone(),
            storage: self.storage.clone(),
            worker: self.worker.clone(),
            origin: self.origin.clone(),
        })
    }
}

/// A world on its way to another thread. A clone grows into a share of its own.
#[derive(Clone)]
pub struct WorldSeed {
    clock: Arc<dyn Clock>,
    storage: Arc<dyn Storage>,
    worker: Arc<dyn Worker>,
    origin: Origin,
}

impl WorldSeed {
    /// The share of the calling thread's loop.
    ///
    /// # Errors
    /// As [`World::real`].
    pub fn grow(self) -> io::Result<World> {
        let WorldSeed { clock, storage, worker, origin } = self;
        match origin {
            Origin::Real => {
                let (net, rng) = (Box::new(RealNet::new()?), Box::new(RealRng));
                Ok(World { clock, net, storage, rng, worker, origin, share: None })
            }
            Origin::Simulated(world) => Ok(world.world()),
        }
    }
}
