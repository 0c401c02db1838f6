//! The order in which the loops of a simulation are stepped.

use super::Trace;
use crate::Cx;
use crate::eventloop::{Plan, step};
use crate::world::{Clock, Rng, SimulatedRng, SimulatedWorker, SimulatedWorld};
use sk_flat::Instant;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// The random stream that breaks ties, apart from those of loops.
const TIES_STREAM: u64 = 1 << 40;

/// The loops of a simulation and the order in which they are stepped.
pub(crate) struct Scheduler {
    world: SimulatedWorld,
    /// The machines whose workers are looked at, in the order in which their processes were started.
    machines: RefCell<Vec<SimulatedWorld>>,
    loops: RefCell<Vec<Rc<RefCell<Cx>>>>,
    ties: RefCell<SimulatedRng>,
    hash: Rc<Cell<u64>>,
    ordinals: Cell<u64>,
    own: std::rc::Weak<Scheduler>,
}

impl Scheduler {
    pub(super) fn new(world: SimulatedWorld) -> Rc<Scheduler> {
        Rc::new_cyclic(|own| Scheduler {
            ties: RefCell::new(world.rng(TIES_STREAM)),
            machines: RefCell::new(vec![world.clone()]),
            world,
            loops: RefCell::default(),
            hash: Rc::new(Cell::new(0xcbf2_9ce4_8422_2325)),
            ordinals: Cell::new(0),
            own: own.clone(),
        })
    }

    pub(super) fn world(&self) -> &SimulatedWorld {
        &self.world
    }

    pub(super) fn trace_hash(&self) -> u64 {
        self.hash.get()
    }

    /// A machine's worker is looked at from now on.
    pub(super) fn add_machine(&self, machine: &SimulatedWorld) {
        let mut machines = self.machines.borrow_mut();
        if !machines.iter().any(|known| Arc::ptr_eq(known.worker(), machine.worker())) {
            machines.push(machine.clone());
        }
    }

    /// Drops every loop of a machine whose processes have died.
    pub(super) fn drop_machine(&self, machine: &SimulatedWorld) {
        self.machines
            .borrow_mut()
            .retain(|known| !Arc::ptr_eq(known.worker(), machine.worker()));
        let number = machine.machine_number();
        let theirs = |cx: &Rc<RefCell<Cx>>| {
            let share = cx.try_borrow().ok().and_then(|cx| cx.world.simulated_share().cloned());
            share.is_some_and(|share| share.machine() == number)
        };
        let dead: Vec<_> = self.loops.borrow_mut().extract_if(.., |cx| theirs(cx)).collect();
        drop(dead);
    }

    pub(super) fn enroll(&self, cx: &mut Cx) {
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
    pub(super) fn step_until(&self, app: &mut Cx, until: Instant) -> bool {
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
        let next = self.next_loop();
        if let Some((due, worker)) = self.next_work().filter(|(due, _)| *due <= own_due) {
            let others_first = next.as_ref().is_some_and(|(first, _)| *first < due);
            if !others_first {
                self.pass_to(due);
                worker.run_due(due);
                return true;
            }
        }
        let Some((due, cx)) = next else { return false };
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

    /// Steps whatever is due next, unless that is after `until`.
    pub(super) fn step_other(&self, until: Instant) -> bool {
        self.step_one_before(until + Duration::from_nanos(1))
    }

    fn next_work(&self) -> Option<(Instant, Arc<SimulatedWorker>)> {
        let machines = self.machines.borrow();
        let due = machines
            .iter()
            .filter_map(|machine| Some((machine.worker().next_due()?, machine)));
        let (due, machine) = due.min_by_key(|(due, _)| *due)?;
        Some((due, machine.worker().clone()))
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

    pub(super) fn pass_to(&self, due: Instant) {
        let clock = self.world.clock();
        if due > clock.now() {
            clock.set(due);
        }
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
