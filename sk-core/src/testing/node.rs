//! Processes of simulated machines: started, commanded, ended and killed while the others run.

use super::Scheduler;
use crate::Cx;
use crate::world::{Death, SimulatedRng, SimulatedWorld, Wake};
use std::cell::RefCell;
use std::rc::Rc;

/// A process of a simulated machine: one loop and the threads it starts, made by
/// [`Simulation::node`](super::Simulation::node).
///
/// ```
/// use sk_core::prelude::*;
/// use sk_core::testing::Simulation;
/// use sk_core::world::Death;
///
/// struct Clerk;
/// object! { Clerk { } }
///
/// let simulation = Simulation::new(7);
/// let machine = simulation.world().machine();
/// let node = simulation.node(&machine, "clerk", |settings| settings.mode = TimingMode::SelectIo);
/// node.with(|cx| {
///     let storage = cx.world().storage.clone();
///     storage.replace("/notes".as_ref(), b"kept").map(|()| cx.spawn(Clerk))
/// })?;
/// simulation.run_for_nodes(Duration::from_secs(1))?;
/// let again = node.die(Death::PowerCut, &mut simulation.world().rng(1 << 33));
/// let node = simulation.node(&again, "clerk", |_| ());
/// assert_eq!(node.with(|cx| cx.world().storage.read("/notes".as_ref(), 9))?, b"kept");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Node {
    scheduler: Rc<Scheduler>,
    machine: SimulatedWorld,
    cx: Rc<RefCell<Cx>>,
}

impl Node {
    pub(super) fn new(scheduler: Rc<Scheduler>, machine: SimulatedWorld, cx: Cx) -> Node {
        scheduler.add_machine(&machine);
        let cx = scheduler.add(cx);
        Node { scheduler, machine, cx }
    }

    /// Does something inside the loop, between two rounds. The next round begins at once.
    ///
    /// # Panics
    /// If a slot of this very loop calls it.
    pub fn with<R>(&self, work: impl FnOnce(&mut Cx) -> R) -> R {
        let mut cx = self.cx.borrow_mut();
        let result = work(&mut cx);
        if let Some(share) = cx.world.simulated_share() {
            share.wake();
        }
        result
    }

    /// As [`with`](Node::with), but the loop is left alone: to look, and to change nothing.
    ///
    /// # Panics
    /// If a slot of this very loop calls it.
    pub fn inspect<R>(&self, look: impl FnOnce(&mut Cx) -> R) -> R {
        look(&mut self.cx.borrow_mut())
    }

    /// The machine it runs on.
    pub fn machine(&self) -> &SimulatedWorld {
        &self.machine
    }

    /// Whether the loop has quit and its objects are buried.
    pub fn has_ended(&self) -> bool {
        self.cx.try_borrow().is_ok_and(|cx| cx.ended)
    }

    /// All processes of its machine end without a word, this one with them. Answers the machine, for the next
    /// process.
    pub fn die(self, death: Death, rng: &mut SimulatedRng) -> SimulatedWorld {
        let Node { scheduler, machine, cx } = self;
        machine.die(death, rng);
        scheduler.drop_machine(&machine);
        drop(cx);
        machine.restarted()
    }

    /// Quits, as a program that was asked to end: what it gave to its worker is done before. Answers the machine, for the next process.
    pub fn quit(self) -> SimulatedWorld {
        let Node { scheduler, machine, cx } = self;
        scheduler.remove(&cx);
        cx.borrow_mut().end();
        machine.finish();
        machine.restarted()
    }
}
