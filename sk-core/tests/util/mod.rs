//! The two backends that the world's contracts are run against.
#![allow(dead_code)] // Each test file uses its own part.

use sk_core::world::{
    Clock, Endpoint, Net, NetworkSettings, Readiness, SimulatedWorld, Storage, Token, Worker, World,
};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Far longer than anything here takes: reaching it means that something never came.
const WATCHDOG: Duration = Duration::from_secs(20);

/// A world to test: shares for several loops on this thread, and a way to let time pass.
pub enum Backend {
    Real { folder: TempFolder, first: Option<World> },
    Simulated(SimulatedWorld),
}

impl Backend {
    pub fn real() -> Backend {
        Backend::Real { folder: TempFolder::new(), first: None }
    }

    pub fn simulated() -> Backend {
        Backend::Simulated(SimulatedWorld::new(1))
    }

    /// A simulated network in which things take long and vary.
    pub fn simulated_far_away() -> Backend {
        let settings = NetworkSettings {
            tcp_latency: Duration::from_millis(80),
            udp_latency: Duration::from_millis(80),
            jitter_max: Duration::from_millis(40),
            ..NetworkSettings::default()
        };
        Backend::Simulated(SimulatedWorld::with_network(2, settings))
    }

    /// Another loop's share.
    pub fn world(&mut self) -> World {
        match self {
            Backend::Real { first: Some(first), .. } => {
                first.for_thread().and_then(|seed| seed.grow()).expect("descriptors are left")
            }
            Backend::Real { first, .. } => {
                *first = Some(World::real().expect("descriptors are left"));
                self.world()
            }
            Backend::Simulated(simulation) => simulation.world(),
        }
    }

    /// A folder that exists and is empty.
    pub fn folder(&self) -> PathBuf {
        match self {
            Backend::Real { folder, .. } => folder.path().to_owned(),
            Backend::Simulated(simulation) => {
                let folder = PathBuf::from("/state");
                simulation.storage().create_dir(&folder).expect("the root exists");
                folder
            }
        }
    }

    /// Any free port of the loopback.
    pub fn any_port(&self) -> Endpoint {
        Endpoint::Ip("127.0.0.1:0".parse().expect("an address"))
    }

    /// Waits until one of the loops is told something, and answers what; the loops stand in the order of
    /// the answers.
    pub fn wait<const N: usize>(&self, worlds: [&mut World; N]) -> [Vec<Readiness>; N] {
        let mut told = std::array::from_fn(|_| Vec::new());
        match self {
            Backend::Real { .. } => {
                let started = std::time::Instant::now();
                let mut worlds = worlds;
                while told.iter().all(Vec::is_empty) {
                    assert!(started.elapsed() < WATCHDOG, "nothing became ready");
                    for (world, told) in worlds.iter_mut().zip(&mut told) {
                        let short = Some(Duration::from_micros(200));
                        world.net.wait(short, told).expect("the wait works");
                    }
                }
            }
            Backend::Simulated(simulation) => {
                let next = worlds.iter().filter_map(|world| world.simulated_share()?.next_event()).min();
                simulation.clock().set(next.expect("something is under way"));
                for (world, told) in worlds.into_iter().zip(&mut told) {
                    world.net.wait(None, told).expect("the wait works");
                }
                assert!(told.iter().any(|told| !told.is_empty()), "the promised event did not come");
            }
        }
        told
    }

    /// Waits until `done` holds, looking at it after each event of any of the loops.
    pub fn until<const N: usize>(&self, mut worlds: [&mut World; N], mut done: impl FnMut() -> bool) {
        while !done() {
            self.wait(worlds.each_mut().map(|world| &mut **world));
        }
    }

    /// Lets waiting jobs come to their end until `done` holds.
    pub fn work_until(&self, mut done: impl FnMut() -> bool) {
        let started = std::time::Instant::now();
        while !done() {
            match self {
                Backend::Real { .. } => {
                    assert!(started.elapsed() < WATCHDOG, "the work did not end");
                    std::thread::yield_now();
                }
                Backend::Simulated(simulation) => {
                    let due = simulation.worker().next_due().expect("a job waits");
                    simulation.clock().set(due);
                    assert_ne!(simulation.worker().run_due(due), 0, "the promised job did not run");
                }
            }
        }
    }

    pub fn worker(&mut self) -> Arc<dyn Worker> {
        self.world().worker
    }

    pub fn clock(&mut self) -> Arc<dyn Clock> {
        self.world().clock
    }

    pub fn storage(&mut self) -> Arc<dyn Storage> {
        self.world().storage
    }
}

/// Whether `token` was told readable and writable.
pub fn told(ready: &[Readiness], token: Token) -> (bool, bool) {
    let of_token = ready.iter().filter(|ready| ready.token == token);
    of_token.fold((false, false), |(r, w), ready| (r | ready.readable, w | ready.writable))
}

/// Looks once without waiting.
pub fn look(net: &mut dyn Net) -> Vec<Readiness> {
    let mut ready = Vec::new();
    net.wait(Some(Duration::ZERO), &mut ready).expect("the look works");
    ready
}

/// A folder of this test alone, removed with everything in it.
pub struct TempFolder {
    path: PathBuf,
}

impl TempFolder {
    pub fn new() -> TempFolder {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let number = MADE.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("sk-core-test-{}-{number}", std::process::id()));
        // Left by an earlier process of the same number, if at all.
        let _ = fs::remove_dir_all(&path);
        fs::create_dir(&path).expect("the temporary folder can be written");
        TempFolder { path }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for TempFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Makes one test of each contract and backend: `contracts!(net: a, b)` gives `real::a`, `simulated::a` …
#[macro_export]
macro_rules! contracts {
    ($($backend:ident: $($contract:ident),+ $(,)?;)+) => {
        $(mod $backend {
            $(
                #[test]
                fn $contract() {
                    super::$contract($crate::util::Backend::$backend());
                }
            )+
        })+
    };
}
