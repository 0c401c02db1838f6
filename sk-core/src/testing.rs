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

pub use crate::sys::heap::CountingAllocator;

use crate::Cx;
use crate::eventloop::{LoopSettings, Plan, SkApp, step};
use crate::world::{Clock, OsSignal, Rng, SimulatedClock, SimulatedRng, SimulatedWorld};
use sk_flat::Instant;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// The user id that every process of a simulated world has.
pub const USER_ID: u32 = crate::world::net::SIMULATED_UID;

/// The random stream that breaks ties, apart from those of loops.
const TIES_STREAM: u64 = 1 << 40;

/// A folded record of everything the loops of a simulation did.
#[derive(Clone)]
pub(crate) struct Trace {
    hash: Rc<Cell<u64>>,
    ordinal: u64,
}

impl Trace {
    fn note(&self, parts: [u64; 4]) {
        // FNV-1a over words: it need only tell two runs apart.
        let mut hash = self.hash.get() ^ self.ordinal;
        for part in parts {
            hash = (hash ^ part).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
        }
        self.hash.set(hash);
    }

    pub(crate) fn round(&self, now: Instant, round: u64, tick: u64) {
        self.note([1, now.as_nanos(), round, tick]);
    }

    pub(crate) fn call(&self, object: u64, slot: u64, calls: u64) {
        self.note([2, object, slot, calls]);
    }
}

/// The loops of a simulation and the order in which they are stepped.
pub(crate) struct Scheduler {
    world: SimulatedWorld,
    loops: RefCell<Vec<Rc<RefCell<Cx>>>>,
    ties: RefCell<SimulatedRng>,
    hash: Rc<Cell<u64>>,
    ordinals: Cell<u64>,
    own: std::rc::Weak<Scheduler>,
}

impl Scheduler {
    fn enroll(&self, cx: &mut Cx) {
        let ordinal = self.ordinals.get();
        self.ordinals.set(ordinal + 1);
        cx.trace = Some(Trace { hash: self.hash.clone(), ordinal });
        cx.set_scheduler(self.own.clone());
    }

    /// A further loop.
    pub(crate) fn add(&self, mut cx: Cx) -> Rc<RefCell<Cx>> {
        self.enroll(&mut cx);
        let cx = Rc::new(RefCell::new(cx));
        self.loops.borrow_mut().push(cx.clone());
        cx
    }

    pub(crate) fn remove(&self, cx: &Rc<RefCell<Cx>>) {
        self.loops.borrow_mut().retain(|other| !Rc::ptr_eq(other, cx));
    }

    /// Steps other loops until `app` is due, and then `app`.
    pub(crate) fn pulse_app(&self, app: &mut Cx) -> bool {
        loop {
            let own_due = app.due();
            if self.step_one_before(own_due) {
                continue;
            }
            self.pass_to(own_due);
            return step(app, Cx::pulse_simulated).is_some();
        }
    }

    /// Steps whatever is due next, `app` included, unless that is after `until`.
    fn step_until(&self, app: &mut Cx, until: Instant) -> bool {
        let own_due = app.due();
        if self.step_one_before(own_due.min(until + Duration::from_nanos(1))) {
            return true;
        }
        if own_due > until {
            return false;
        }
        self.pass_to(own_due);
        step(app, Cx::pulse_simulated);
        true
    }

    /// Steps one loop, or completes blocking work, that is due before `own_due`; at the same moment the
    /// seed decides.
    fn step_one_before(&self, own_due: Instant) -> bool {
        if let Some(due) = self.world.worker().next_due().filter(|due| *due <= own_due) {
            let others_first = self.loops.borrow().iter().any(|cx| Self::due_of(cx) < due);
            if !others_first {
                self.pass_to(due);
                self.world.worker().run_due(due);
                return true;
            }
        }
        let Some((due, cx)) = self.next_loop() else { return false };
        let first = due < own_due || (due == own_due && self.ties.borrow_mut().next_u64() & 1 == 0);
        if !first {
            return false;
        }
        self.pass_to(due);
        let quitting = {
            let Ok(mut cx) = cx.try_borrow_mut() else { return false };
            step(&mut cx, Cx::pulse_simulated);
            cx.quitting
        };
        if quitting {
            self.remove(&cx);
            cx.borrow_mut().end();
        }
        true
    }

    fn due_of(cx: &RefCell<Cx>) -> Instant {
        cx.try_borrow_mut().map_or(Instant::FAR, |mut cx| cx.due())
    }

    fn next_loop(&self) -> Option<(Instant, Rc<RefCell<Cx>>)> {
        let loops = self.loops.borrow();
        let dues: Vec<Instant> = loops.iter().map(|cx| Self::due_of(cx)).collect();
        let soonest = *dues.iter().min()?;
        let tied: Vec<usize> = (0..dues.len()).filter(|&i| dues[i] == soonest).collect();
        let pick = match tied.len() {
            1 => tied[0],
            n => tied[(self.ties.borrow_mut().next_u64() % n as u64) as usize],
        };
        (soonest < Instant::FAR).then(|| (soonest, loops[pick].clone()))
    }

    fn pass_to(&self, due: Instant) {
        let clock = self.world.clock();
        if due > clock.now() {
            clock.set(due);
        }
    }
}

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
        let scheduler = Rc::new_cyclic(|own| Scheduler {
            ties: RefCell::new(world.rng(TIES_STREAM)),
            world,
            loops: RefCell::default(),
            hash: Rc::new(Cell::new(0xcbf2_9ce4_8422_2325)),
            ordinals: Cell::new(0),
            own: own.clone(),
        });
        Simulation { scheduler }
    }

    /// An application in this world, with default settings. Threads it starts are loops of this world too.
    pub fn app(&self) -> SkApp {
        self.app_with(|_| {})
    }

    /// An application with settings of its own.
    pub fn app_with(&self, change: impl FnOnce(&mut LoopSettings)) -> SkApp {
        let mut settings = LoopSettings::default();
        change(&mut settings);
        let mut cx = Cx::new("main", self.scheduler.world.world(), settings);
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

    /// The virtual clock. `advance` inside a slot makes that slot take time.
    pub fn clock(&self) -> Arc<SimulatedClock> {
        self.scheduler.world.clock().clone()
    }

    /// The world: its disk, its network, its workers.
    pub fn world(&self) -> &SimulatedWorld {
        &self.scheduler.world
    }

    /// Sends the application a POSIX signal.
    pub fn raise(&self, signal: OsSignal) {
        self.scheduler.world.raise(signal);
    }

    /// Tells two runs apart: rounds with their times and calls with their objects, in order, of all loops.
    pub fn trace_hash(&self) -> u64 {
        self.scheduler.hash.get()
    }
}

impl Cx {
    fn set_scheduler(&mut self, scheduler: std::rc::Weak<Scheduler>) {
        self.scheduler = scheduler;
    }

    /// The simulation this loop is part of.
    pub(crate) fn scheduler(&self) -> Option<Rc<Scheduler>> {
        self.scheduler.upgrade()
    }

    /// When the next round begins, in virtual time. What the wait is, is decided once per round; messages
    /// and readiness may end it sooner.
    fn due(&mut self) -> Instant {
        let plan = match self.planned {
            Some(planned) => planned,
            None => {
                let now = self.world.clock.now();
                let plan = match self.plan() {
                    Plan::Now { tick } if self.settings.mode == crate::eventloop::TimingMode::NoTiming => {
                        // Without any wait virtual time would stand still.
                        (Plan::Now { tick }, now + self.settings.interval)
                    }
                    Plan::Now { tick } => (Plan::Now { tick }, now),
                    Plan::Sleep(span) => (Plan::Sleep(span), now + span),
                    Plan::At(due) => (Plan::At(due), due),
                    Plan::Io(due) => (Plan::Io(due), due),
                };
                self.planned = Some(plan);
                plan
            }
        };
        let (plan, due) = plan;
        if !matches!(plan, Plan::Io(_)) {
            return due;
        }
        if self.inbox.mailbox().waiting() > 0 {
            return self.pulse.now;
        }
        let event = self.world.simulated_share().and_then(|share| share.next_event());
        event.map_or(due, |event| event.min(due))
    }

    /// One round at the present virtual time.
    fn pulse_simulated(&mut self) {
        self.due();
        let Some((plan, due)) = self.planned.take() else { return };
        match plan {
            Plan::Now { tick } => self.round(tick, None),
            Plan::Sleep(_) | Plan::At(_) => self.round(true, Some(due)),
            Plan::Io(_) => {
                self.look_at_sources(Some(Duration::ZERO));
                self.round(self.ticks_after_io(), None);
            }
        }
    }
}
