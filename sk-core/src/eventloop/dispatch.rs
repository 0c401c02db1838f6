//! Calls from the loop's side: who is running, guards against panics, calls that wait for a busy object.

use crate::Cx;
use crate::eventloop::sk_event_loop::{Culprit, News};
use crate::eventloop::{AfterFailure, Failure, Reason};
use crate::object::{AnyNode, DEFERRED, DRAINING, Handle, Header, ObjectId, SkObject, TO_SWEEP, WAITING};
use crate::signal::{Call, Links, OnceCall, Signal, SlotMeta};
use sk_flat::{Instant, SkElapsedTime};
use std::any::TypeId;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::time::Duration;

/// How deep direct calls nest; beyond, they are queued.
pub(crate) const DIRECT_DEPTH_MAX: usize = 64;
/// How many failures are logged a second; the rest are counted.
const FAILURES_LOGGED_PER_SECOND_MAX: u32 = 10;

thread_local! {
    /// Slots of nested emissions that a panic on its way to its guard has skipped. It is set while the stack
    /// unwinds, when nothing else can be reached, and taken by that guard.
    static SKIPPED: Cell<u64> = const { Cell::new(0) };
}

#[cold]
pub(crate) fn note_skipped(slots: usize) {
    SKIPPED.set(SKIPPED.get() + slots as u64);
}

/// One level of nested calls: whose slot runs. 16 bytes, as every call writes one: the object is of this loop,
/// so the loop's number is left out.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    index: u32,
    generation: u32,
    slot: Option<&'static SlotMeta>,
}

impl Frame {
    /// Twice the depth limit, so that an index can be masked instead of checked.
    pub(crate) const ROOM: usize = (DIRECT_DEPTH_MAX * 2).next_power_of_two();
    pub(crate) const NOBODY: Frame = Frame::access(ObjectId::NOBODY);

    const fn access(object: ObjectId) -> Frame {
        Frame { index: object.index, generation: object.generation, slot: None }
    }
}

/// Times single calls, for one second after a step was too long, to find the culprit.
#[derive(Default)]
pub(crate) struct CallTiming {
    pub until: Instant,
    pub on: bool,
    /// Time of the calls nested in the one being timed.
    nested: Duration,
    pub slowest: Option<(Duration, ObjectId, &'static SlotMeta)>,
}

/// Stands where a slot would, for the work of framework objects that no slot of theirs does.
static OWN_WORK: SlotMeta = SlotMeta {
    name: "(its sockets)",
    class: "",
    args: "",
    uid: 0,
    args_type: || TypeId::of::<()>(),
    prepare: |_, _| Err("this is no slot".to_owned()),
};

/// Keeps a failing slot from flooding the log.
#[derive(Default)]
pub(crate) struct LogBudget {
    second: SkElapsedTime,
    used: u32,
    suppressed: u64,
}

impl Cx {
    #[inline(always)]
    pub(crate) fn enter(&mut self, object: ObjectId, slot: &'static SlotMeta) {
        self.restore_chain_top(Frame { slot: Some(slot), ..Frame::access(object) });
    }

    /// An access that is not a slot call.
    pub(crate) fn enter_access(&mut self, object: ObjectId) {
        self.restore_chain_top(Frame::access(object));
    }

    /// The object whose slot runs.
    pub(crate) fn running(&self) -> ObjectId {
        self.object_of(&self.chain_top())
    }

    fn object_of(&self, frame: &Frame) -> ObjectId {
        if frame.index == ObjectId::NOBODY.index {
            return ObjectId::NOBODY;
        }
        let loop_number = self.table.loop_number();
        ObjectId { loop_number, index: frame.index, generation: frame.generation }
    }

    pub(crate) fn chain_top(&self) -> Frame {
        self.chain[self.depth & (Frame::ROOM - 1)]
    }

    #[inline(always)]
    pub(crate) fn restore_chain_top(&mut self, frame: Frame) {
        self.chain[self.depth & (Frame::ROOM - 1)] = frame;
    }

    pub(crate) fn is_too_deep(&self) -> bool {
        self.depth >= DIRECT_DEPTH_MAX
    }

    /// The signal being emitted has a link that is spent or dead: sweep it at the next rewire.
    pub(crate) fn note_dead_link(&mut self) {
        let emitter = self.object_of(&self.chain[self.depth.saturating_sub(1) & (Frame::ROOM - 1)]);
        if let Some(node) = self.table.node(emitter)
            && !node.header().has(TO_SWEEP)
        {
            node.header().set(TO_SWEEP);
            self.sweeps.push(emitter);
        }
    }

    pub(crate) fn note_spent_link(&mut self) {
        self.note_dead_link();
    }

    /// Calls a slot at once, from a top-level dispatch.
    pub(crate) fn call_slot<A: ?Sized + ToOwned + 'static>(&mut self, id: ObjectId, slot: u64, args: &A) {
        let bound = self.bind(id, slot, TypeId::of::<A>());
        let Some(Ok(call)) = bound.map(|bound| bound.downcast::<Rc<dyn Call<A>>>()) else {
            self.counters.gone += 1;
            return;
        };
        if call.call(self, args, WAITING) != crate::signal::Reached::Ran {
            self.counters.gone += 1;
        }
    }

    // ---- calls that wait for a busy object ----

    /// Keeps a direct call until the lease of its object ends. Answers `false` if too many wait for it.
    pub(crate) fn park(&mut self, header: &Header, call: impl FnOnce() -> Box<dyn OnceCall>) -> bool {
        let waiting = self.parked.entry(header.id.index).or_default();
        if waiting.len() >= self.settings.queue_calls_max {
            self.refused_full();
            return false;
        }
        self.counters.parked += 1;
        waiting.push_back(call());
        header.set(WAITING);
        true
    }

    /// A lease has ended and calls wait: they run now, before anybody else reaches the object. What is
    /// parked meanwhile goes to the next round, so that two objects cannot keep each other busy for ever.
    #[cold]
    #[inline(never)]
    pub(crate) fn drain_waiting(&mut self, header: &Header) {
        if !header.has(DEFERRED | DRAINING) {
            self.drain(header);
        }
    }

    pub(crate) fn drain_deferred(&mut self, id: ObjectId) {
        let Some(node) = self.table.node(id).cloned() else {
            let lost = self.parked.remove(&id.index).map_or(0, |waiting| waiting.len());
            self.counters.gone += lost as u64;
            return;
        };
        self.drain(node.header());
    }

    fn drain(&mut self, header: &Header) {
        let index = header.id.index;
        let count = self.parked.get(&index).map_or(0, |waiting| waiting.len());
        header.unset(DEFERRED);
        header.set(DRAINING);
        for _ in 0..count {
            let Some(call) = self.parked.get_mut(&index).and_then(|waiting| waiting.pop_front()) else {
                break;
            };
            call.run(self);
        }
        header.unset(DRAINING);
        if self.parked.get(&index).is_some_and(|waiting| !waiting.is_empty()) {
            header.set(DEFERRED);
            self.queue.push_drain(header.id);
        } else {
            self.parked.remove(&index);
            header.unset(WAITING);
        }
    }

    // ---- guards ----

    /// A dispatch from the loop itself: timed if calls are being timed, traced if the run is, and guarded.
    pub(crate) fn top_level(&mut self, f: impl FnOnce(&mut Cx)) {
        if self.timing.on {
            let before = self.world.clock.now();
            self.guarded(f);
            self.note_call_time(before);
        } else {
            self.guarded(f);
        }
        if self.trace.is_some() {
            self.trace_dispatch();
        }
        self.nobody_runs();
    }

    /// Whether every dispatch is looked at by itself: timed or traced.
    pub(crate) fn is_observed(&self) -> bool {
        self.timing.on || self.trace.is_some()
    }

    /// A dispatch has ended.
    pub(crate) fn nobody_runs(&mut self) {
        self.restore_chain_top(Frame::NOBODY);
    }

    /// Runs `f`; a panic in it ends here and is treated by the loop's policy.
    pub(crate) fn guarded(&mut self, f: impl FnOnce(&mut Cx)) {
        let depth = self.depth;
        if let Err(payload) = catch_unwind(AssertUnwindSafe(|| f(self))) {
            self.caught(depth, None, &*payload);
        }
    }

    /// A panic has reached its guard; `worker` is the framework object that did its own work, if that was it.
    #[cold]
    fn caught(&mut self, depth: usize, worker: Option<Frame>, payload: &(dyn std::any::Any + Send)) {
        let message = payload
            .downcast_ref::<&str>()
            .map(|text| (*text).to_owned())
            .or_else(|| payload.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "a panic without a message".to_owned());
        let reached = self.depth.min(Frame::ROOM - 1);
        let mut frames: Vec<Frame> = self.chain[depth.min(reached)..=reached].to_vec();
        if let (Some(worker), Some(first)) = (worker, frames.first())
            && self.object_of(first) != self.object_of(&worker)
        {
            frames.insert(0, worker);
        }
        self.depth = depth;
        self.timing.nested = Duration::ZERO;
        let innermost = *frames.last().unwrap_or(&Frame::NOBODY);
        let skipped = SKIPPED.take();
        let chain = frames.iter().map(|frame| self.frame_name(frame)).collect();
        self.put_off_all_waiting();
        self.counters.panics += 1;
        self.counters.skipped += skipped;
        self.record_failure(innermost, message, Some((chain, skipped)));
    }

    /// After a panic the leases are gone but what waited for them is not. Whose they were is not all in the
    /// chain: an access stands there in the place of the slot that made it.
    fn put_off_all_waiting(&mut self) {
        let mut indices: Vec<u32> = self.parked.keys().copied().collect();
        indices.sort_unstable();
        for id in indices
            .into_iter()
            .filter_map(|index| self.table.id_at(index))
            .collect::<Vec<_>>()
        {
            if self.table.node(id).is_some_and(|node| !node.is_leased()) {
                self.put_off_waiting(id);
            }
        }
    }

    fn put_off_waiting(&mut self, id: ObjectId) {
        let Some(node) = self.table.node(id) else { return };
        let header = node.header();
        // The panic may have come out of a call that had waited.
        header.unset(DRAINING);
        if header.has(WAITING) && !header.has(DEFERRED) {
            header.set(DEFERRED);
            self.queue.push_drain(id);
        }
    }

    fn frame_name(&self, frame: &Frame) -> String {
        format!(
            "{}.{}",
            self.path_of(self.object_of(frame)),
            frame.slot.map_or("(access)", |slot| slot.name)
        )
    }

    /// A slot answered `Err`.
    #[cold]
    #[inline(never)]
    pub(crate) fn slot_failed(&mut self, message: Box<str>) {
        let frame = self.chain_top();
        self.record_failure(frame, message.into(), None);
    }

    fn record_failure(&mut self, frame: Frame, message: String, panic: Option<(Vec<String>, u64)>) {
        self.counters.failures += 1;
        let panicked = panic.is_some();
        let object = self.object_of(&frame);
        let (chain, skipped) = panic.unwrap_or_default();
        let failure = Failure {
            object,
            path: self.path_of(object),
            class: self.class_of(object).map_or("(nobody)", |class| class.name),
            slot: frame.slot.map_or("(access)", |slot| slot.name),
            message,
            panicked,
            chain,
            skipped,
        };
        if self.may_log() {
            let Failure { path, class, slot, message, .. } = &failure;
            let how = if panicked { "panicked" } else { "failed" };
            tracing::error!(
                suppressed = self.log_budget.suppressed,
                "{class} {path}: slot {slot} {how}: {message}"
            );
        }
        if self.news.len() < self.settings.queue_calls_max {
            self.news.push_back(News::SlotFailed(failure));
        }
        self.treat(object, if panicked { self.settings.after_panic } else { self.settings.after_error });
    }

    fn treat(&mut self, object: ObjectId, policy: AfterFailure) {
        match policy {
            AfterFailure::GoOn => {}
            AfterFailure::Destroy => self.mark(object, Reason::Failed),
            AfterFailure::Stop => self.quit(),
        }
    }

    /// Whether another line may be logged this second.
    pub(crate) fn may_log(&mut self) -> bool {
        let budget = &mut self.log_budget;
        if budget.second.restart_if_passed(self.pulse.now, Duration::from_secs(1)) {
            budget.used = 0;
            budget.suppressed = 0;
        }
        budget.used += 1;
        let may = budget.used <= FAILURES_LOGGED_PER_SECOND_MAX;
        budget.suppressed += u64::from(!may);
        may
    }

    pub(crate) fn run_hook(&mut self, id: ObjectId, node: &dyn AnyNode, hook: &'static str) {
        let before = self.chain_top();
        self.enter_access(id);
        self.guarded(|cx| match hook {
            "on_spawn" => node.spawned(cx),
            _ => node.destroying(cx),
        });
        self.restore_chain_top(before);
        if node.header().has(WAITING) {
            self.drain_waiting(node.header());
        }
    }

    // ---- signals of the loop's own objects ----

    /// Emits a signal of a framework object without leasing it while the slots run, so that they can command
    /// the object that called them.
    pub(crate) fn emit_own<T: SkObject, A: ?Sized + ToOwned + 'static>(
        &mut self,
        emitter: Handle<T>,
        signal: impl FnOnce(&T) -> &Signal<A>,
        args: &A,
    ) {
        let links = self.with(emitter, |object, _| signal(object).frozen());
        if let Ok(Some(links)) = links {
            self.fire_own(emitter.id(), &links, args);
        }
    }

    pub(crate) fn fire_own<A: ?Sized + ToOwned + 'static>(
        &mut self,
        emitter: ObjectId,
        links: &Links<A>,
        args: &A,
    ) {
        let before = self.chain_top();
        self.enter_access(emitter);
        if self.depth == 0 {
            links.fire_guarded(self, args);
            if self.trace.is_some() {
                self.trace_dispatch();
            }
        } else {
            links.fire(self, args);
        }
        self.restore_chain_top(before);
    }

    fn trace_dispatch(&mut self) {
        let frame = self.chain[(self.depth + 1).min(Frame::ROOM - 1)];
        let top = self.chain_top();
        if let Some(trace) = &self.trace {
            let object = |frame: &Frame| u64::from(frame.index) << 32 | u64::from(frame.generation);
            let slot = |frame: &Frame| frame.slot.map_or(0, |slot| slot.uid);
            trace.call(object(&top), slot(&top), self.counters.queued_calls);
            trace.call(object(&frame), slot(&frame), self.counters.messages);
        }
    }

    // ---- timing of single calls ----

    /// Runs one call and notes its own time.
    pub(crate) fn timed(&mut self, f: impl FnOnce(&mut Cx)) {
        let before = self.world.clock.now();
        let outer_nested = std::mem::take(&mut self.timing.nested);
        f(self);
        let nested = std::mem::replace(&mut self.timing.nested, outer_nested);
        let spent = self.world.clock.now().since(before);
        self.timing.nested += spent;
        self.note_own_time(spent.saturating_sub(nested));
    }

    /// What the loop does for a framework object of its own accord: serving its socket, writing what it has
    /// gathered. While calls are timed its time, without that of the slots it called, stands beside theirs.
    ///
    /// A panic in it ends here. Its object was left in the middle of something, so it is treated by the policy for
    /// panics even if an object that it reached is the one that panicked. The answer is then that of no work.
    pub(crate) fn as_own_work<R: Default>(&mut self, owner: ObjectId, work: impl FnOnce(&mut Cx) -> R) -> R {
        let before = self.timing.on.then(|| {
            self.timing.nested = Duration::ZERO;
            self.world.clock.now()
        });
        self.enter(owner, &OWN_WORK);
        let (depth, worker) = (self.depth, self.chain_top());
        let done = catch_unwind(AssertUnwindSafe(|| work(self)));
        let done = done.unwrap_or_else(|payload| {
            self.caught(depth, Some(worker), &*payload);
            self.treat(owner, self.settings.after_panic);
            R::default()
        });
        if let Some(before) = before {
            self.enter(owner, &OWN_WORK);
            self.note_call_time(before);
        }
        self.restore_chain_top(Frame::NOBODY);
        done
    }

    fn note_call_time(&mut self, before: Instant) {
        let nested = std::mem::take(&mut self.timing.nested);
        let spent = self.world.clock.now().since(before);
        self.note_own_time(spent.saturating_sub(nested));
    }

    fn note_own_time(&mut self, own: Duration) {
        let frame = self.chain_top();
        if let Some(slot) = frame.slot
            && self.timing.slowest.is_none_or(|(slowest, ..)| own > slowest)
        {
            self.timing.slowest = Some((own, self.object_of(&frame), slot));
        }
    }

    pub(crate) fn culprit(&self) -> Option<Culprit> {
        let (time, object, slot) = self.timing.slowest?;
        let class = self.class_of(object).map_or(slot.class, |class| class.name);
        let (path, slot) = (self.path_of(object), format!("{class}.{}", slot.name));
        Some(Culprit { object, path, slot, time })
    }
}

#[cfg(test)]
mod tests {
    use crate::eventloop::{Failure, Overload};
    use crate::testing::Simulation;
    use crate::world::Readiness;
    use crate::{Cx, ObjectId, attach, object};
    use std::time::Duration;

    #[derive(Default)]
    struct Guard {
        seen: Vec<String>,
    }
    impl Guard {
        fn overloaded(&mut self, _cx: &mut Cx, overload: &Overload) {
            let culprit = overload.culprit.as_ref();
            self.seen
                .push(culprit.map_or("nobody".to_owned(), |c| format!("{} of {}", c.slot, c.path)));
        }
    }
    object! { Guard { slots { overloaded(&Overload) } } }

    fn slow_source(cx: &mut Cx, _owner: ObjectId, _readiness: Readiness) -> bool {
        cx.world().clock.sleep(Duration::from_millis(9));
        true
    }

    #[test]
    fn the_work_of_a_framework_object_is_a_culprit_too() {
        let simulation = Simulation::new(1);
        let mut app = simulation.app();
        let cx = app.cx();
        let server = cx.named("server").spawn(Guard::default());
        attach!(cx, cx.event_loop().overloaded => server.overloaded);
        let token = cx.add_source(server.id(), slow_source);
        cx.offer_source(token);
        simulation.run_for(&mut app, Duration::from_millis(200));
        let seen = app.cx().with(server, |guard, _| guard.seen.clone());
        assert_eq!(seen, Ok(vec!["Guard.(its sockets) of server".to_owned()]));
    }

    /// Panics when it is served, inside an object it has reached.
    fn failing_source(cx: &mut Cx, owner: ObjectId, _readiness: Readiness) -> bool {
        assert!(cx.is_alive(owner), "a source is served while its object lives");
        if let Some(reached) = cx.find_as::<Guard>("reached") {
            let _ = cx.with(reached, |_, _| panic!("in the middle of it"));
        }
        panic!("it has to reach somebody");
    }

    fn failing_flush(_: &mut Cx, _owner: ObjectId) {
        panic!("while writing");
    }

    #[derive(Default)]
    struct Clerk {
        failures: Vec<(String, String)>,
    }
    impl Clerk {
        fn failed(&mut self, _cx: &mut Cx, failure: &Failure) {
            self.failures.push((failure.chain.join(" "), failure.message.clone()));
        }
    }
    object! { Clerk { slots { failed(&Failure) } } }

    /// The loop goes on, both failures are told, and neither object stays behind in the middle of its work.
    #[test]
    fn a_panic_in_the_work_of_a_framework_object_ends_that_object_alone() {
        let simulation = Simulation::new(1);
        let mut app = simulation.app();
        let cx = app.cx();
        let clerk = cx.spawn(Clerk::default());
        attach!(cx, cx.event_loop().slot_failed => clerk.failed);
        simulation.run_for(&mut app, Duration::from_millis(20));
        let cx = app.cx();
        let server = cx.named("server").spawn(Guard::default());
        let reached = cx.named("reached").spawn(Guard::default());
        let writer = cx.named("writer").spawn(Guard::default());
        let token = cx.add_source(server.id(), failing_source);
        cx.offer_source(token);
        cx.write_later(writer.id(), failing_flush);
        simulation.run_for(&mut app, Duration::from_millis(100));
        let cx = app.cx();
        assert!(![server.id(), reached.id(), writer.id()].into_iter().any(|id| cx.is_alive(id)));
        let failures = cx.with(clerk, |clerk, _| clerk.failures.clone()).expect("it lives");
        let told: Vec<(&str, &str)> = failures.iter().map(|(chain, text)| (&chain[..], &text[..])).collect();
        let reading = ("server.(its sockets) reached.(access)", "in the middle of it");
        assert_eq!(told, [("writer.(its sockets)", "while writing"), reading]);
        assert_eq!(cx.counters().panics, 2);
    }
}
