//! The test kit: whole programs, several loops included, in a simulated world.
//!
//! All loops run on one thread in order of due time, ties broken by the seed. Time passes only between
//! rounds, and inside a slot by [`Simulation::clock`]'s `advance`. The same seed gives the same
//! [`trace_hash`](Simulation::trace_hash).
//!
//! ```
//! use sk_core::prelude::*;
//! use sk_core::testing::Simulation;
//!
//! #[derive(Default)]
//! struct Counter { ticks: u64 }
//! impl Counter {
//!     fn on_tick(&mut self, _cx: &mut Cx) { self.ticks += 1 }
//! }
//! object! { Counter { slots { on_tick() } } }
//!
//! let run = |seed| {
//!     let simulation = Simulation::new(seed);
//!     let mut app = simulation.app();
//!     let cx = app.cx();
//!     let counter = cx.spawn(Counter::default());
//!     attach!(cx, cx.fast_zone().pulse => counter.on_tick);
//!     simulation.run_for(&mut app, Duration::from_secs(1));
//!     (app.cx().with(counter, |c, _| c.ticks), simulation.trace_hash())
//! };
//! let (ticks, hash) = run(7);
//! assert_eq!(ticks, Ok(99), "10 ms each, and a link made at 0 first fires in the second round");
//! assert_eq!(hash, run(7).1);
//! ```

mod node;
mod planted;
mod scheduler;
mod trace;

pub use crate::sys::heap::CountingAllocator;
pub use node::Node;
pub use planted::Bug;
pub(crate) use planted::is_planted;
#[cfg(feature = "planted-bugs")]
pub use planted::plant;
pub(crate) use scheduler::Scheduler;
pub(crate) use trace::Trace;

use crate::Cx;
use crate::eventloop::{LoopSettings, SkApp};
use crate::world::{Clock, OsSignal, SimulatedClock, SimulatedWorld};
use sk_flat::Instant;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// The user id that every process of a simulated world has.
pub const USER_ID: u32 = crate::world::net::SIMULATED_UID;

/// How many rounds and jobs of all loops together may come at one moment of virtual time.
const STEPS_AT_ONE_MOMENT_MAX: u32 = 100_000;

/// The loops of a simulation find no end at this moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("virtual time stands still at {0}: the loops always find something to do at once")]
pub struct Livelock(pub Instant);

/// A simulated world with the loops that live in it.
pub struct Simulation {
    scheduler: Rc<Scheduler>,
}

impl Simulation {
    /// A world at virtual time zero. Everything random in it follows from the seed.
    pub fn new(seed: u64) -> Simulation {
        Simulation::in_world(SimulatedWorld::new(seed))
    }

    /// As [`new`](Simulation::new), in a world made before.
    pub fn in_world(world: SimulatedWorld) -> Simulation {
        Simulation { scheduler: Scheduler::new(world) }
    }

    /// An application in this world, with default settings. Threads it starts are loops of this world too.
    pub fn app(&self) -> SkApp {
        self.app_with(|_| {})
    }

    /// An application with settings of its own.
    pub fn app_with(&self, change: impl FnOnce(&mut LoopSettings)) -> SkApp {
        let mut settings = LoopSettings::default();
        change(&mut settings);
        let mut cx = Cx::new("main", self.scheduler.world().world(), settings);
        self.scheduler.enroll(&mut cx);
        cx.listen_for_os_signals();
        SkApp::assemble(cx, Some(self.scheduler.clone()))
    }

    /// Runs everything for `span` of virtual time, or until the application quits.
    pub fn run_for(&self, app: &mut SkApp, span: Duration) {
        let until = self.clock().now() + span;
        while !app.cx().is_quitting() && self.scheduler.step_until(app.cx(), until) {}
        self.scheduler.pass_to(until);
    }

    /// Starts a process on a machine of this world: one loop, and the threads it starts. Its settings are the
    /// default ones, changed.
    pub fn node(&self, machine: &SimulatedWorld, name: &str, change: impl FnOnce(&mut LoopSettings)) -> Node {
        let mut settings = LoopSettings::default();
        change(&mut settings);
        let cx = Cx::new(name, machine.world(), settings);
        Node::new(self.scheduler.clone(), machine.clone(), cx)
    }

    /// Runs all nodes, and no application, up to that moment.
    ///
    /// # Errors
    /// If the loops go round and round at one moment, so that it is never over.
    pub fn run_until(&self, until: Instant) -> Result<(), Livelock> {
        let (mut at, mut steps) = (self.clock().now(), 0_u32);
        while self.scheduler.step_other(until) {
            let now = self.clock().now();
            steps = if now == at { steps + 1 } else { 0 };
            at = now;
            if steps == STEPS_AT_ONE_MOMENT_MAX {
                return Err(Livelock(now));
            }
        }
        self.scheduler.pass_to(until);
        Ok(())
    }

    /// The same, for `span` of virtual time.
    ///
    /// # Errors
    /// As [`run_until`](Simulation::run_until).
    pub fn run_for_nodes(&self, span: Duration) -> Result<(), Livelock> {
        self.run_until(self.clock().now() + span)
    }

    /// The virtual clock. `advance` inside a slot makes that slot take time.
    pub fn clock(&self) -> Arc<SimulatedClock> {
        self.scheduler.world().clock().clone()
    }

    /// The world: its disk, its network, its workers.
    pub fn world(&self) -> &SimulatedWorld {
        self.scheduler.world()
    }

    /// Sends the application a POSIX signal.
    pub fn raise(&self, signal: OsSignal) {
        self.scheduler.world().raise(signal);
    }

    /// Tells two runs apart: rounds with their times and calls with their objects, in order, of all loops.
    pub fn trace_hash(&self) -> u64 {
        self.scheduler.trace_hash()
    }
}
