//! The supervisor: a module's place in the tree, which outlives the module and begins it again.

use crate::eventloop::{Reason, Timer};
use crate::module::runner::MODULE_NAME;
use crate::module::{AbstractModule, AnyRunner, ModuleError, ParameterInfo, RestartPolicy};
use crate::object::{Access, Handle, ObjectId};
use crate::signal::Signal;
use crate::{Cx, attach};
use sk_flat::{Instant, SkVariant};
use std::fmt;
use std::time::Duration;

/// Where a module is in its life.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModuleState {
    /// It exists and was not started yet.
    Made,
    /// It was started.
    Running,
    /// It could not be made or started, or it died.
    Failed {
        /// Why.
        reason: String,
        /// When it is begun again; never, if there is none.
        retry_at: Option<Instant>,
    },
    /// It was stopped, or was never made.
    Stopped,
}

impl fmt::Display for ModuleState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ModuleState::Made => f.write_str("made"),
            ModuleState::Running => f.write_str("running"),
            ModuleState::Failed { reason, retry_at: Some(_) } => write!(f, "failed, tried again: {reason}"),
            ModuleState::Failed { reason, retry_at: None } => write!(f, "failed, given up: {reason}"),
            ModuleState::Stopped => f.write_str("stopped"),
        }
    }
}

/// How far the module shall be brought.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wanted {
    Made,
    Running,
    Stopped,
}

/// Watches over one module: `modules/<name>` in the tree, with the module itself as its child.
///
/// It is commanded by methods on its handle, and holds no lease while the module's code runs: that code may
/// ask for its own supervisor's state, and what it changes by it is answered
/// [`Busy`](ModuleError::Busy).
pub struct ModuleSupervisor {
    /// The module's state is another one.
    pub changed: Signal<ModuleState>,
    /// Away while the module is being called.
    runner: Option<Box<dyn AnyRunner>>,
    state: ModuleState,
    wanted: Wanted,
    policy: RestartPolicy,
    /// In a row.
    failures: u32,
    restarts: u64,
    running_since: Option<Instant>,
    retry: Handle<Timer>,
}

crate::object! {
    pub ModuleSupervisor {
        signals { changed(&ModuleState) }
        slots { on_buried(ObjectId, Reason) on_retry() }
        hooks { on_spawn on_destroy }
    }
}

impl ModuleSupervisor {
    pub(super) fn new(runner: Box<dyn AnyRunner>, policy: RestartPolicy) -> ModuleSupervisor {
        ModuleSupervisor {
            changed: Signal::new(),
            runner: Some(runner),
            state: ModuleState::Stopped,
            wanted: Wanted::Made,
            policy,
            failures: 0,
            restarts: 0,
            running_since: None,
            retry: Handle::nobody(),
        }
    }

    fn on_spawn(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        self.retry = cx.under(this).named("retry").spawn(Timer::default());
        attach!(cx, self.retry.timeout => this.on_retry);
    }

    /// The module still lives: its parent's hook comes first.
    fn on_destroy(&mut self, cx: &mut Cx) {
        if let Some(runner) = &mut self.runner {
            runner.stop(cx);
        }
        self.state = ModuleState::Stopped;
    }

    // Both only pass it on, so that the module's code runs while the supervisor is not leased.

    fn on_buried(&mut self, cx: &mut Cx, module: ObjectId, reason: Reason) {
        let this = cx.this(self);
        cx.post_own(this, move |cx| this.died(cx, module, reason));
    }

    fn on_retry(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        cx.post_own(this, move |cx| this.again(cx));
    }

    /// Notes a failure and answers how long to wait for the next try.
    fn fail(&mut self, now: Instant, reason: String) -> Option<Duration> {
        let since = self.running_since.take();
        if since.is_some_and(|since| now.since(since) >= self.policy.max) {
            self.failures = 0;
        }
        self.failures = self.failures.saturating_add(1);
        let wait = self.policy.wait_after(self.failures);
        self.state = ModuleState::Failed { reason, retry_at: wait.map(|wait| now + wait) };
        wait
    }
}

impl Handle<ModuleSupervisor> {
    /// Where the module is in its life.
    ///
    /// # Errors
    /// The supervisor is gone.
    pub fn state(self, cx: &mut Cx) -> Result<ModuleState, Access> {
        cx.with(self, |supervisor, _| supervisor.state.clone())
    }

    /// How often the module was begun again after a failure.
    ///
    /// # Errors
    /// The supervisor is gone.
    pub fn restarts(self, cx: &mut Cx) -> Result<u64, Access> {
        cx.with(self, |supervisor, _| supervisor.restarts)
    }

    /// The module, while there is one. After a restart it is another object.
    pub fn module(self, cx: &mut Cx) -> Option<ObjectId> {
        cx.with(self, |supervisor, _| supervisor.runner.as_ref()?.module()).ok()?
    }

    /// The module with its type, if it is of that class.
    pub fn module_as<M: AbstractModule>(self, cx: &mut Cx) -> Option<Handle<M>> {
        let id = self.module(cx)?;
        let class = cx.class_of(id)?;
        (class.type_id == std::any::TypeId::of::<M>()).then(|| Handle::new(id))
    }

    /// What the module can be told.
    ///
    /// # Errors
    /// The supervisor is gone, or the module's own code asks.
    pub fn describe(self, cx: &mut Cx) -> Result<&'static [ParameterInfo], ModuleError> {
        self.with_runner(cx, |runner, _| runner.describe())
    }

    /// What the module has been told, as a map.
    ///
    /// # Errors
    /// The supervisor is gone, or the module's own code asks.
    pub fn parameters(self, cx: &mut Cx) -> Result<SkVariant, ModuleError> {
        self.with_runner(cx, |runner, _| runner.parameters())
    }

    /// Changes one parameter while the module runs; one of a module that is stopped or failed takes effect
    /// when it is begun again.
    ///
    /// # Errors
    /// The value was refused, by the declaration or by the module: everything stays as it was.
    pub fn set(self, cx: &mut Cx, name: &str, value: &SkVariant) -> Result<(), ModuleError> {
        self.change(cx, &SkVariant::map([(name, value.clone())]))
    }

    /// Changes several parameters, a map, all or none; as [`set`](Handle::set).
    ///
    /// # Errors
    /// A value was refused, by the declaration or by the module: everything stays as it was.
    pub fn change(self, cx: &mut Cx, values: &SkVariant) -> Result<(), ModuleError> {
        self.with_runner(cx, |runner, cx| runner.change(cx, values))?
    }

    /// Hands a command to the module and answers what it answers.
    ///
    /// # Errors
    /// The module refuses, or does not run.
    pub fn control(self, cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, ModuleError> {
        self.with_runner(cx, |runner, cx| runner.control(cx, command))?
    }

    /// Starts the module; makes it first if it was stopped or given up. One that waits for its next try, or
    /// whose predecessor is not buried yet, is started as soon as it is made.
    ///
    /// # Errors
    /// The module cannot be made or started. It is tried again as its policy says.
    pub fn start(self, cx: &mut Cx) -> Result<(), ModuleError> {
        let state = cx.with(self, |supervisor, _| {
            supervisor.wanted = Wanted::Running;
            supervisor.state.clone()
        })?;
        match state {
            ModuleState::Running | ModuleState::Failed { retry_at: Some(_), .. } => Ok(()),
            ModuleState::Made => self.bring_up(cx),
            ModuleState::Stopped | ModuleState::Failed { retry_at: None, .. } => {
                cx.with(self, |supervisor, _| supervisor.failures = 0)?;
                self.bring_up(cx)
            }
        }
    }

    /// Stops the module and buries it. It stays stopped until somebody starts it.
    ///
    /// # Errors
    /// The supervisor is gone, or the module's own code asks.
    pub fn stop(self, cx: &mut Cx) -> Result<(), ModuleError> {
        self.with_runner(cx, |runner, cx| runner.stop(cx))?;
        let (was, retry) = cx.with(self, |supervisor, _| {
            supervisor.wanted = Wanted::Stopped;
            supervisor.running_since = None;
            let was = std::mem::replace(&mut supervisor.state, ModuleState::Stopped);
            (was, supervisor.retry)
        })?;
        retry.stop(cx)?;
        if was != ModuleState::Stopped {
            self.tell(cx);
        }
        Ok(())
    }

    /// Makes the module for the first time.
    pub(super) fn make(self, cx: &mut Cx) {
        self.bring_up_if_wanted(cx);
    }

    /// Lends the runner. It is out of its object meanwhile, so that the module's code finds the supervisor
    /// free.
    fn with_runner<R>(
        self,
        cx: &mut Cx,
        f: impl FnOnce(&mut dyn AnyRunner, &mut Cx) -> R,
    ) -> Result<R, ModuleError> {
        let mut runner = cx
            .with(self, |supervisor, _| supervisor.runner.take())?
            .ok_or(ModuleError::Busy)?;
        let answer = f(&mut *runner, cx);
        cx.with(self, |supervisor, _| supervisor.runner = Some(runner))?;
        Ok(answer)
    }

    /// Brings the module as far as it is wanted.
    fn bring_up(self, cx: &mut Cx) -> Result<(), ModuleError> {
        if self.module(cx).is_none() {
            if self.has_corpse(cx) {
                cx.post_own(self, move |cx| self.bring_up_if_wanted(cx));
                return Ok(());
            }
            let made = self.with_runner(cx, |runner, cx| runner.make(cx, self.id()))?;
            let module = self.or_fail(cx, made)?;
            let watch = cx.watch(module);
            attach!(cx, watch.buried => self.on_buried);
            cx.with(self, |supervisor, _| supervisor.state = ModuleState::Made)?;
        }
        if cx.with(self, |supervisor, _| supervisor.wanted)? == Wanted::Running {
            let started = self.with_runner(cx, |runner, cx| runner.start(cx))?;
            self.or_fail(cx, started)?;
            let now = cx.now();
            cx.with(self, |supervisor, _| {
                supervisor.state = ModuleState::Running;
                supervisor.running_since = Some(now);
            })?;
        }
        self.tell(cx);
        Ok(())
    }

    /// Whether the module's predecessor still has its name.
    fn has_corpse(self, cx: &Cx) -> bool {
        let children = cx.children_of(self);
        children.into_iter().any(|child| cx.name_of(child) == Some(MODULE_NAME))
    }

    fn or_fail<R>(self, cx: &mut Cx, answer: Result<R, ModuleError>) -> Result<R, ModuleError> {
        if let Err(error) = &answer {
            self.fail(cx, error.to_string());
        }
        answer
    }

    fn fail(self, cx: &mut Cx, reason: String) {
        let now = cx.now();
        let path = cx.path_of(self);
        let noted = cx.with(self, |supervisor, _| supervisor.fail(now, reason.clone()));
        // In the next round, because a timer that is due before its link is made is not heard.
        cx.post_own(self, move |cx| self.arm(cx));
        match noted {
            Ok(Some(wait)) => tracing::warn!("{path} failed and is begun again in {wait:?}: {reason}"),
            _ => tracing::error!("{path} failed and is left out: {reason}"),
        }
        self.tell(cx);
    }

    /// Sets the timer to the next try, if there shall be one.
    fn arm(self, cx: &mut Cx) {
        let now = cx.now();
        // The timer is a child and lives as long as this.
        let _ = cx.with(self, |supervisor, cx| match supervisor.state {
            ModuleState::Failed { retry_at: Some(at), .. } => supervisor.retry.start_once(cx, at.since(now)),
            _ => supervisor.retry.stop(cx),
        });
    }

    fn died(self, cx: &mut Cx, module: ObjectId, reason: Reason) {
        if self.module(cx) != Some(module) {
            return;
        }
        // It was there a line ago, and nobody can be in its module: it is buried.
        let _ = self.with_runner(cx, |runner, cx| runner.forget(cx));
        let reason = match reason {
            Reason::Failed => "a slot of it failed",
            _ => "somebody destroyed it",
        };
        self.fail(cx, reason.to_owned());
    }

    fn again(self, cx: &mut Cx) {
        let counted = cx.with(self, |supervisor, _| {
            let waits = matches!(supervisor.state, ModuleState::Failed { retry_at: Some(_), .. });
            supervisor.restarts += u64::from(waits);
            waits
        });
        if counted == Ok(true) {
            self.bring_up_if_wanted(cx);
        }
    }

    fn bring_up_if_wanted(self, cx: &mut Cx) {
        if cx.with(self, |supervisor, _| supervisor.wanted != Wanted::Stopped) == Ok(true) {
            // What went wrong is the state, and was reported.
            let _ = self.bring_up(cx);
        }
    }

    fn tell(self, cx: &mut Cx) {
        if let Ok(state) = self.state(cx) {
            cx.emit_own(self, |supervisor| &supervisor.changed, &state);
        }
    }
}
