//! `Cx`: the loop as its objects see it, handed to every slot.

use crate::eventloop::dispatch::{DIRECT_DEPTH_MAX, Frame};
use crate::eventloop::poll::Sources;
use crate::eventloop::queue::{CallQueue, RemoteCall};
use crate::eventloop::sk_event_loop::News;
use crate::eventloop::stats::Measures;
use crate::eventloop::timer::TimerHeap;
use crate::eventloop::wait::Pacing;
use crate::eventloop::{
    Counters, LoopSettings, LoopStats, Pulse, SettingsError, SkEventLoop, TimingMode, Watch, Zone,
};
use crate::object::{Access, AnyNode, Handle, MARKED, NameError, Node, ObjectId, Placement, SkObject, Table};
use crate::signal::{Bound, LinkKey, OnceCall, Rewire};
use crate::thread::{Inbox, Mailbox, RemoteReceive, There};
use crate::world::World;
use rustc_hash::FxHashMap;
use sk_flat::Instant;
use std::any::{Any, TypeId};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// The loop's inside, as a slot gets it: `cx`.
///
/// Through it objects are spawned, found and destroyed, links are asked for and the present is read. There
/// is one per loop, it never leaves its thread, and it owns every object of the loop.
pub struct Cx {
    // The hot part: what an `emit` and a call touch.
    pub(crate) depth: usize,
    /// Beyond this depth `emit` takes the careful path; 0 while calls are being timed.
    pub(crate) depth_max: usize,
    pub(crate) chain: [Frame; Frame::ROOM],
    pub(crate) counters: Counters,
    pub(crate) queue: CallQueue,
    pub(crate) table: Table,
    pub(crate) pulse: Pulse,

    pub(crate) rewires: VecDeque<Rewire>,
    pub(crate) sweeps: Vec<ObjectId>,
    /// The pair whose second attaching was logged last.
    pub(crate) duplicate_told: Option<(ObjectId, u64, LinkKey)>,
    pub(crate) burials: VecDeque<(ObjectId, crate::eventloop::Reason)>,
    pub(crate) parked: FxHashMap<u32, VecDeque<Box<dyn OnceCall>>>,
    pub(crate) shells: u32,
    pub(crate) watches: FxHashMap<ObjectId, Vec<Handle<Watch>>>,
    pub(crate) timers: TimerHeap,
    pub(crate) sources: Sources,
    pub(crate) news: VecDeque<News>,
    pub(crate) measures: Measures,
    pub(crate) timing: crate::eventloop::dispatch::CallTiming,
    pub(crate) log_budget: crate::eventloop::dispatch::LogBudget,

    pub(crate) inbox: Inbox,
    pub(crate) remote_calls: VecDeque<RemoteCall>,
    pub(crate) crossings: FxHashMap<u64, Rc<dyn RemoteReceive>>,
    pub(crate) crossings_to: FxHashMap<ObjectId, Vec<u64>>,

    pub(crate) own: OwnObjects,
    pub(crate) settings: LoopSettings,
    pub(crate) pacing: Pacing,
    pub(crate) name: String,
    pub(crate) quitting: bool,
    pub(crate) ended: bool,
    pub(crate) queue_full_told: bool,
    /// A call was refused since the last account: the episode goes on.
    pub(crate) queue_full_now: bool,
    /// A round is under way, so that its beginning is the present for everybody.
    pub(crate) in_round: bool,
    /// Somebody listens to every burial; looked up once per burial step.
    pub(crate) own_buried_listeners: bool,
    pub(crate) trace: Option<crate::testing::Trace>,
    pub(crate) scheduler: std::rc::Weak<crate::testing::Scheduler>,
    /// The wait under way, in simulation.
    pub(crate) planned: Option<(crate::eventloop::Plan, Instant)>,
    pub(crate) world: World,
}

/// The objects a loop makes for itself.
#[derive(Clone, Copy)]
pub(crate) struct OwnObjects {
    pub event_loop: Handle<SkEventLoop>,
    pub fast_zone: Handle<Zone>,
    pub slow_zone: Handle<Zone>,
    pub one_sec_zone: Handle<Zone>,
}

impl Cx {
    pub(crate) fn new(name: &str, world: World, settings: LoopSettings) -> Cx {
        let (_, inbox) = Mailbox::open(world.net.waker(), settings.mailbox_messages_max);
        let now = world.clock.now();
        let nobody = OwnObjects {
            event_loop: Handle::nobody(),
            fast_zone: Handle::nobody(),
            slow_zone: Handle::nobody(),
            one_sec_zone: Handle::nobody(),
        };
        let mut cx = Cx {
            depth: 0,
            depth_max: DIRECT_DEPTH_MAX,
            chain: [Frame::NOBODY; Frame::ROOM],
            counters: Counters::default(),
            queue: CallQueue::default(),
            table: Table::new(),
            pulse: Pulse::first(now, settings.interval),
            rewires: VecDeque::new(),
            sweeps: Vec::new(),
            duplicate_told: None,
            burials: VecDeque::new(),
            parked: FxHashMap::default(),
            shells: 0,
            watches: FxHashMap::default(),
            timers: TimerHeap::new(),
            sources: Sources::default(),
            news: VecDeque::new(),
            measures: Measures::new(),
            timing: Default::default(),
            log_budget: Default::default(),
            inbox,
            remote_calls: VecDeque::new(),
            crossings: FxHashMap::default(),
            crossings_to: FxHashMap::default(),
            own: nobody,
            settings,
            pacing: Pacing::new(now),
            name: name.to_owned(),
            quitting: false,
            ended: false,
            queue_full_told: false,
            queue_full_now: false,
            in_round: false,
            own_buried_listeners: false,
            trace: None,
            scheduler: std::rc::Weak::new(),
            planned: None,
            world,
        };
        cx.own = OwnObjects {
            event_loop: cx.spawn(SkEventLoop::default()),
            fast_zone: cx.spawn(Zone::default()),
            slow_zone: cx.spawn(Zone::default()),
            one_sec_zone: cx.spawn(Zone::default()),
        };
        cx
    }

    /// Makes an object that has no parent. It lives until `destroy_later` names it or the loop ends.
    pub fn spawn<T: SkObject>(&mut self, object: T) -> Handle<T> {
        self.spawn_placed(Placement::default(), object)
    }

    /// Makes an object without a parent whose constructor needs its own handle: for attaching in the
    /// constructor, and for children. Links made there fire from the next round on.
    ///
    /// ```
    /// use sk_core::prelude::*;
    /// struct Door { timer: Handle<Timer> }
    /// impl Door {
    ///     fn new(cx: &mut Cx, this: Handle<Door>) -> Door {
    ///         let timer = cx.under(this).spawn(Timer::default());
    ///         attach!(cx, timer.timeout => this.close);
    ///         Door { timer }
    ///     }
    ///     fn close(&mut self, _cx: &mut Cx) {}
    /// }
    /// object! { Door { slots { close() } } }
    /// let mut app = SkApp::new();
    /// let door = app.cx().spawn_with(Door::new);
    /// assert!(app.cx().is_alive(door));
    /// ```
    pub fn spawn_with<T: SkObject>(&mut self, make: impl FnOnce(&mut Cx, Handle<T>) -> T) -> Handle<T> {
        Spawner { cx: self, placement: Placement::default() }.spawn_with(make)
    }

    /// As [`spawn_with`](Cx::spawn_with), with a constructor that may fail: then the children it made are
    /// buried at the end of the round, and its error comes back.
    ///
    /// # Errors
    /// The constructor's.
    pub fn try_spawn_with<T: SkObject, E>(
        &mut self,
        make: impl FnOnce(&mut Cx, Handle<T>) -> Result<T, E>,
    ) -> Result<Handle<T>, E> {
        Spawner { cx: self, placement: Placement::default() }.try_spawn_with(make)
    }

    /// The next object becomes a child of `parent`: `cx.under(base).named("left").spawn(x)`. If the parent is
    /// gone the child is made all the same and buried at the end of the round.
    pub fn under(&mut self, parent: impl Into<ObjectId>) -> Spawner<'_> {
        Spawner { cx: self, placement: Placement { parent: Some(parent.into()), name: None } }
    }

    /// The next object gets a name: `cx.named("pid").spawn(x)`.
    pub fn named<'a>(&'a mut self, name: &'a str) -> Spawner<'a> {
        Spawner { cx: self, placement: Placement { parent: None, name: Some(name) } }
    }

    fn spawn_placed<T: SkObject>(&mut self, placement: Placement<'_>, object: T) -> Handle<T> {
        let (id, doomed) = self.place(placement);
        self.fill(id, object, doomed)
    }

    /// A refused name or parent must not lose the object: it is put without the name, or doomed, and said.
    fn place(&mut self, placement: Placement<'_>) -> (ObjectId, bool) {
        match self.table.reserve(placement) {
            Ok(id) => {
                let parent = placement.parent.and_then(|parent| self.table.node(parent));
                let doomed = parent.is_some_and(|parent| parent.header().has(MARKED));
                (id, doomed)
            }
            Err(error) => {
                tracing::error!("{error}");
                let gone = matches!(error, NameError::NoParent(_));
                let parent = placement.parent.filter(|_| !gone);
                match self.table.reserve(Placement { parent, name: None }) {
                    Ok(id) => (id, gone),
                    Err(_) => unreachable!("a place without a name below an existing parent is not refused"),
                }
            }
        }
    }

    fn fill<T: SkObject>(&mut self, id: ObjectId, object: T, doomed: bool) -> Handle<T> {
        let node = Rc::new(Node::new(id, object));
        let hooked = T::CLASS.has_hooks.then(|| node.clone());
        self.table.fill(id, node);
        if doomed {
            self.deny_hooks_below_the_dying(id);
            self.destroy_later(id);
        } else if let Some(node) = hooked {
            self.run_hook(id, &*node, "on_spawn");
        }
        Handle::new(id)
    }

    /// Marks an object and everything below it: they get no further slot call, stay readable to the end of
    /// the round and are buried then, parents' `on_destroy` before their children's. Safe to call twice,
    /// from the object's own slots, and for one that is gone.
    pub fn destroy_later(&mut self, id: impl Into<ObjectId>) {
        self.mark(id.into(), crate::eventloop::Reason::Asked);
    }

    /// Whether the object exists and is not marked for burial.
    pub fn is_alive(&self, id: impl Into<ObjectId>) -> bool {
        let id = id.into();
        self.table.exists(id) && self.table.node(id).is_none_or(|node| !node.header().has(MARKED))
    }

    /// Whether the object can be reached with [`with`](Cx::with): also between `destroy_later` and burial.
    pub fn exists(&self, id: impl Into<ObjectId>) -> bool {
        self.table.exists(id.into())
    }

    /// Runs `f` on an object, leased as in a slot call.
    ///
    /// # Errors
    /// [`Access::Busy`] while one of the object's slots runs; [`Access::Gone`] once it is buried.
    pub fn with<T: SkObject, R>(
        &mut self,
        handle: Handle<T>,
        f: impl FnOnce(&mut T, &mut Cx) -> R,
    ) -> Result<R, Access> {
        let node = self.table.node(handle.id()).ok_or(Access::Gone)?.clone();
        let before = self.chain_top();
        let any: Rc<dyn Any> = node.clone();
        let answer = match any.downcast::<Node<T>>() {
            Ok(node) => {
                let mut object = node.access()?;
                self.enter_access(handle.id());
                Ok(f(&mut object, self))
            }
            Err(_) => self.with_base(handle, &*node, f),
        };
        self.restore_chain_top(before);
        if node.header().has(crate::object::WAITING) {
            self.drain_waiting(node.header());
        }
        answer
    }

    /// The handle may name a base inside the object.
    fn with_base<T: SkObject, R>(
        &mut self,
        handle: Handle<T>,
        node: &dyn AnyNode,
        f: impl FnOnce(&mut T, &mut Cx) -> R,
    ) -> Result<R, Access> {
        let (mut f, mut answer) = (Some(f), None);
        self.enter_access(handle.id());
        node.with_part(TypeId::of::<T>(), self, &mut |part, cx| {
            if let (Some(part), Some(f)) = (part.downcast_mut::<T>(), f.take()) {
                answer = Some(f(part, cx));
            }
        })?;
        answer.ok_or(Access::Gone)
    }

    /// The handle of the object whose slot is running, from inside: `let me = cx.this(self);`. For a base
    /// class it is a handle of the base type. Anywhere else it names nobody.
    pub fn this<T: SkObject>(&self, _me: &T) -> Handle<T> {
        let id = self.running();
        let is_one = self.table.node(id).is_some_and(|node| node.class().is_a(TypeId::of::<T>()));
        if is_one { Handle::new(id) } else { Handle::nobody() }
    }

    /// The object of that path: `base/left`.
    pub fn find(&self, path: &str) -> Option<ObjectId> {
        self.table.find(path)
    }

    /// The typed handle of the object of that path, if it is of that class or extends it.
    pub fn find_as<T: SkObject>(&self, path: &str) -> Option<Handle<T>> {
        let id = self.table.find(path)?;
        self.table.node(id)?.class().is_a(TypeId::of::<T>()).then(|| Handle::new(id))
    }

    /// The object's path: names from the root down; ids stand in for names that were not given.
    pub fn path_of(&self, id: impl Into<ObjectId>) -> String {
        self.table.path(id.into())
    }

    /// The object's own name.
    pub fn name_of(&self, id: impl Into<ObjectId>) -> Option<&str> {
        self.table.name(id.into())
    }

    /// The object's parent.
    pub fn parent_of(&self, id: impl Into<ObjectId>) -> Option<ObjectId> {
        self.table.parent(id.into())
    }

    /// The object's children, in the order of their birth.
    pub fn children_of(&self, id: impl Into<ObjectId>) -> Vec<ObjectId> {
        let first = self.table.first_child(id.into());
        std::iter::successors(first, |&id| self.table.next_sibling(id)).collect()
    }

    /// Tells of one object's burial: `attach!(cx, cx.watch(worker).buried => boss.on_gone)`. For an object
    /// that is gone already it tells at the end of the round, with [`Reason::Asked`](super::Reason::Asked).
    pub fn watch(&mut self, id: impl Into<ObjectId>) -> Handle<Watch> {
        let id = id.into();
        let watch = self.spawn(Watch::default());
        if self.table.exists(id) {
            self.watches.entry(id).or_default().push(watch);
        } else {
            self.news.push_back(News::BuriedBefore(id, watch));
        }
        watch
    }

    /// The clock of the fastest tick.
    pub fn fast_zone(&self) -> Handle<Zone> {
        self.own.fast_zone
    }

    /// The clock of the slow tick: passive, its error is at most one fast interval.
    pub fn slow_zone(&self) -> Handle<Zone> {
        self.own.slow_zone
    }

    /// The clock of one second: passive, its error is at most one fast interval.
    pub fn one_sec_zone(&self) -> Handle<Zone> {
        self.own.one_sec_zone
    }

    /// The loop as an object, with its signals.
    pub fn event_loop(&self) -> Handle<SkEventLoop> {
        self.own.event_loop
    }

    /// This round: its number, when it was due, when it began, the interval. Reads no clock.
    pub fn pulse(&self) -> &Pulse {
        &self.pulse
    }

    /// When this round began: inside a slot no clock is read, and all slots of a round see one instant. Before
    /// and between rounds it is the very present; for that inside a slot ask [`clock_now`](Cx::clock_now).
    pub fn now(&self) -> Instant {
        if self.in_round { self.pulse.now } else { self.world.clock.now() }
    }

    /// Reads the clock: tens of nanoseconds.
    pub fn clock_now(&self) -> Instant {
        self.world.clock.now()
    }

    /// The world of this loop: its clock, storage, randomness.
    pub fn world(&mut self) -> &mut World {
        &mut self.world
    }

    /// The loop's name: that of its thread.
    pub fn loop_name(&self) -> &str {
        &self.name
    }

    /// Ends the loop after this round.
    pub fn quit(&mut self) {
        self.quitting = true;
    }

    /// Whether the loop ends after this round.
    pub fn is_quitting(&self) -> bool {
        self.quitting
    }

    /// How the loop is set.
    pub fn settings(&self) -> &LoopSettings {
        &self.settings
    }

    /// Changes how the loop is set, from the next round on.
    ///
    /// # Errors
    /// If the settings contradict each other: the old ones stay.
    pub fn configure(&mut self, change: impl FnOnce(&mut LoopSettings)) -> Result<(), SettingsError> {
        let mut settings = self.settings;
        change(&mut settings);
        settings.check()?;
        if (settings.mode, settings.interval) != (self.settings.mode, self.settings.interval) {
            self.pacing.changed = true;
            self.pacing.sync_ticked &= settings.mode == TimingMode::Synced;
        }
        self.settings = settings;
        Ok(())
    }

    /// Changes the way of waiting, from the next round on.
    ///
    /// # Errors
    /// None for the modes there are; as [`configure`](Cx::configure).
    pub fn set_mode(&mut self, mode: TimingMode) -> Result<(), SettingsError> {
        self.configure(|settings| settings.mode = mode)
    }

    /// Makes the next round of a [`Synced`](TimingMode::Synced) loop a tick, begun without waiting; twice in a
    /// round it is one tick. In every other mode it does nothing. A satellite calls it for the ticks of the hub;
    /// a driver may for those of a device.
    ///
    /// ```
    /// use sk_core::prelude::*;
    /// let mut app = SkApp::builder().mode(TimingMode::Synced).build()?;
    /// app.cx().sync_tick();
    /// app.pulse();
    /// assert_eq!(app.cx().pulse().number, 1);
    /// # Ok::<(), AppError>(())
    /// ```
    pub fn sync_tick(&mut self) {
        if self.settings.mode == TimingMode::Synced {
            self.pacing.sync_ticked = true;
            // In simulation the wait may have been decided before: this ends it.
            self.planned = None;
        }
    }

    /// Changes the fast interval, from the next round on. A slow interval below it is raised to it.
    ///
    /// # Errors
    /// If it is zero.
    pub fn set_interval(&mut self, interval: Duration) -> Result<(), SettingsError> {
        self.configure(|settings| {
            settings.interval = interval;
            settings.slow_interval = settings.slow_interval.max(interval);
        })
    }

    /// Changes the slow interval, from the next round on.
    ///
    /// # Errors
    /// If it is below the fast one.
    pub fn set_slow_interval(&mut self, interval: Duration) -> Result<(), SettingsError> {
        self.configure(|settings| settings.slow_interval = interval)
    }

    /// What the loop knows of itself. Copies two histograms' figures: some microseconds.
    pub fn stats(&self) -> LoopStats {
        LoopStats {
            name: self.name.clone(),
            mode: self.settings.mode,
            interval: self.settings.interval,
            rounds: self.measures.rounds,
            ticks: self.measures.ticks,
            missed: self.measures.missed,
            overruns: self.measures.overruns,
            mean_interval: self.measures.mean_interval(),
            wake_error: self.measures.wake_error.distribution(),
            job_time: self.measures.job_time.distribution(),
            step_time: self.measures.step_time,
            queue_depth_max: self.measures.queue_depth_max,
            queue_depth: self.queue.len(),
            objects: self.table.living(),
            shells: self.shells,
            counters: self.counters,
            demotions: crate::sys::sched::demotions(),
            refused_wishes: self.pacing.refused.clone(),
        }
    }

    /// What is counted. Costs a copy of a few words.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    pub(crate) fn here(&self, id: ObjectId) -> There {
        There { mailbox: self.inbox.mailbox().clone(), id }
    }

    pub(crate) fn is_mine(&self, there: &There) -> bool {
        Arc::ptr_eq(&there.mailbox, self.inbox.mailbox())
    }

    pub(crate) fn bind(&self, id: ObjectId, slot: u64, args: TypeId) -> Option<Bound> {
        let node = self.table.node(id).filter(|node| !node.header().has(MARKED))?;
        Rc::clone(node).bind(slot, args)
    }
}

/// The place of an object that is about to be made: [`Cx::under`], [`Cx::named`].
pub struct Spawner<'a> {
    cx: &'a mut Cx,
    placement: Placement<'a>,
}

impl<'a> Spawner<'a> {
    /// Gives the object a name, unique among its siblings and without `/`. A name that is refused is
    /// logged, and the object made without it; [`try_spawn`](Spawner::try_spawn) answers the error instead.
    pub fn named<'b>(self, name: &'b str) -> Spawner<'b>
    where
        'a: 'b,
    {
        Spawner { cx: self.cx, placement: Placement { name: Some(name), ..self.placement } }
    }

    /// Makes the object.
    pub fn spawn<T: SkObject>(self, object: T) -> Handle<T> {
        self.cx.spawn_placed(self.placement, object)
    }

    /// Makes the object, or answers why name or parent were refused.
    ///
    /// # Errors
    /// [`NameError`]; the object is dropped.
    pub fn try_spawn<T: SkObject>(self, object: T) -> Result<Handle<T>, NameError> {
        let id = self.cx.table.reserve(self.placement)?;
        let parent = self.placement.parent.and_then(|parent| self.cx.table.node(parent));
        let doomed = parent.is_some_and(|parent| parent.header().has(MARKED));
        Ok(self.cx.fill(id, object, doomed))
    }

    /// Makes the object with a constructor that needs its handle.
    pub fn spawn_with<T: SkObject>(self, make: impl FnOnce(&mut Cx, Handle<T>) -> T) -> Handle<T> {
        match self.try_spawn_with(|cx, this| Ok::<T, std::convert::Infallible>(make(cx, this))) {
            Ok(handle) => handle,
            Err(never) => match never {},
        }
    }

    /// Makes the object with a constructor that may fail.
    ///
    /// # Errors
    /// The constructor's; the children it made are buried at the end of the round.
    pub fn try_spawn_with<T: SkObject, E>(
        self,
        make: impl FnOnce(&mut Cx, Handle<T>) -> Result<T, E>,
    ) -> Result<Handle<T>, E> {
        let (id, doomed) = self.cx.place(self.placement);
        // A constructor that panics leaves children too, and goes on to the guard of the slot it runs in.
        match catch_unwind(AssertUnwindSafe(|| make(self.cx, Handle::new(id)))) {
            Ok(Ok(object)) => Ok(self.cx.fill(id, object, doomed)),
            Ok(Err(error)) => {
                self.cx.destroy_later(id);
                Err(error)
            }
            Err(panic) => {
                self.cx.destroy_later(id);
                resume_unwind(panic)
            }
        }
    }
}
