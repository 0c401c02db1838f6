//! The supervisor: a module's place in the tree, which outlives the module and begins it again.

use crate::Cx;
use crate::attach;
use crate::eventloop::{Reason, Timer};
use crate::module::thread_home::ThreadHome;
use crate::module::{
    AbstractModule, AnyRunner, ModuleError, ModuleState, ModuleStatus, ParameterInfo, RestartPolicy,
};
use crate::object::{Access, Handle, ObjectId};
use crate::signal::Signal;
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

/// How far the module shall be brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    Made,
    Running,
    Stopped,
}

/// Where the module lives.
pub(super) enum Home {
    /// On this loop. The runner is away while the module is being called.
    Here(Option<Box<dyn AnyRunner>>),
    /// On a thread of its own.
    Thread(Box<ThreadHome>),
}

/// What a running module can be told.
#[derive(Clone, Debug, PartialEq)]
pub enum ModuleOrder {
    /// A map of the parameters that change; all or none.
    Change(SkVariant),
    /// A command of the module's own.
    Control(SkVariant),
}

impl ModuleOrder {
    /// Hands it to the module, on the module's loop.
    pub(super) fn give(&self, runner: &mut dyn AnyRunner, cx: &mut Cx) -> Result<SkVariant, ModuleError> {
        match self {
            ModuleOrder::Change(values) => runner.change(cx, values).map(|()| SkVariant::Null),
            ModuleOrder::Control(command) => runner.control(cx, command),
        }
    }
}

/// Watches over one module: `modules/<name>` in the tree, with the module itself as its child unless that lives
/// on a thread of its own.
///
/// It is commanded by methods on its handle, and holds no lease while the module's code runs: that code may
/// ask for its own supervisor's state, and what it changes by it is answered
/// [`Busy`](ModuleError::Busy).
pub struct ModuleSupervisor {
    /// The module's state is another one.
    pub changed: Signal<ModuleState>,
    pub(super) home: Home,
    pub(super) state: ModuleState,
    pub(super) wanted: Wanted,
    pub(super) policy: RestartPolicy,
    /// In a row.
    pub(super) failures: u32,
    pub(super) restarts: u64,
    pub(super) last_error: Option<String>,
    pub(super) late: u64,
    pub(super) running_since: Option<Instant>,
    declared: &'static [ParameterInfo],
    pub(super) parameters: SkVariant,
    /// When the module is begun again, or given up because its thread does not end.
    pub(super) alarm: Handle<Timer>,
    /// Looks whether a thread still answers.
    pub(super) watch: Handle<Timer>,
}

crate::object! {
    pub ModuleSupervisor {
        signals { changed(&ModuleState) }
        slots { on_buried(ObjectId, Reason) on_alarm() on_watch() }
        hooks { on_spawn on_destroy }
    }
}

impl ModuleSupervisor {
    pub(super) fn new(
        home: Home,
        declared: &'static [ParameterInfo],
        parameters: SkVariant,
        policy: RestartPolicy,
    ) -> ModuleSupervisor {
        ModuleSupervisor {
            changed: Signal::new(),
            home,
            state: ModuleState::Stopped,
            wanted: Wanted::Made,
            policy,
            failures: 0,
            restarts: 0,
            last_error: None,
            late: 0,
            running_since: None,
            declared,
            parameters,
            alarm: Handle::nobody(),
            watch: Handle::nobody(),
        }
    }

    fn on_spawn(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        self.alarm = cx.under(this).named("alarm").spawn(Timer::default());
        attach!(cx, self.alarm.timeout => this.on_alarm);
        if matches!(self.home, Home::Thread(_)) {
            self.watch = cx.under(this).named("watch").spawn(Timer::default());
            attach!(cx, self.watch.timeout => this.on_watch);
        }
    }

    /// The module still lives: its parent's hook comes first.
    fn on_destroy(&mut self, cx: &mut Cx) {
        if let Home::Here(Some(runner)) = &mut self.home {
            runner.stop(cx);
        }
        self.end_thread_and_wait(cx);
        self.state = ModuleState::Stopped;
    }

    /// For the end of the loop; nothing for a module that lives here.
    pub(super) fn end_thread_and_wait(&mut self, cx: &mut Cx) {
        if let Home::Thread(home) = &mut self.home {
            home.end_and_wait(cx);
        }
    }

    // These only pass it on, so that the module's code runs while the supervisor is not leased.

    fn on_buried(&mut self, cx: &mut Cx, module: ObjectId, reason: Reason) {
        let this = cx.this(self);
        cx.post_own(this, move |cx| this.died(cx, module, reason));
    }

    fn on_alarm(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        cx.post_own(this, move |cx| this.alarmed(cx));
    }

    fn on_watch(&mut self, cx: &mut Cx) {
        let now = cx.now();
        let path = cx.path_of(cx.this(self));
        if let Home::Thread(home) = &mut self.home
            && home.look(&path, now)
        {
            self.late += 1;
        }
    }

    /// Notes a failure and answers how long to wait for the next try.
    pub(super) fn fail(&mut self, now: Instant, reason: String) -> Option<Duration> {
        let since = self.running_since.take();
        if since.is_some_and(|since| now.since(since) >= self.policy.max) {
            self.failures = 0;
        }
        self.failures = self.failures.saturating_add(1);
        let wait = self.policy.wait_after(self.failures);
        self.last_error = Some(reason.clone());
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

    /// All that an operator sees.
    ///
    /// # Errors
    /// The supervisor is gone.
    pub fn status(self, cx: &mut Cx) -> Result<ModuleStatus, Access> {
        let name = cx.name_of(self).unwrap_or_default().to_owned();
        cx.with(self, |supervisor, _| {
            let home = match &supervisor.home {
                Home::Here(_) => None,
                Home::Thread(home) => Some(home),
            };
            ModuleStatus {
                name,
                state: supervisor.state.clone(),
                thread: home.map(|home| home.place()),
                restarts: supervisor.restarts,
                last_error: supervisor.last_error.clone(),
                late: supervisor.late,
                silent: home.is_some_and(|home| home.is_silent()),
                parameters: supervisor.parameters.clone(),
                declared: supervisor.declared,
            }
        })
    }

    /// How often the module was begun again after a failure.
    ///
    /// # Errors
    /// The supervisor is gone.
    pub fn restarts(self, cx: &mut Cx) -> Result<u64, Access> {
        cx.with(self, |supervisor, _| supervisor.restarts)
    }

    /// The module, while there is one on this loop. After a restart it is another object: who has links with it
    /// attaches them anew when [`changed`](ModuleSupervisor::changed) says `Running`.
    pub fn module(self, cx: &mut Cx) -> Option<ObjectId> {
        let module = cx.with(self, |supervisor, _| match &supervisor.home {
            Home::Here(runner) => runner.as_ref()?.module(),
            Home::Thread(_) => None,
        });
        module.ok()?
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
    /// The supervisor is gone.
    pub fn describe(self, cx: &mut Cx) -> Result<&'static [ParameterInfo], ModuleError> {
        Ok(cx.with(self, |supervisor, _| supervisor.declared)?)
    }

    /// What the module has been told, as a map.
    ///
    /// # Errors
    /// The supervisor is gone.
    pub fn parameters(self, cx: &mut Cx) -> Result<SkVariant, ModuleError> {
        Ok(cx.with(self, |supervisor, _| supervisor.parameters.clone())?)
    }

    /// How the module is begun again after its next failure.
    ///
    /// # Errors
    /// The supervisor is gone.
    pub fn set_policy(self, cx: &mut Cx, policy: RestartPolicy) -> Result<(), Access> {
        cx.with(self, |supervisor, _| supervisor.policy = policy)
    }

    /// Tells the module something, wherever it lives. The answer is a call of `answer`: for a module on this loop
    /// before this returns, for one on a thread in a later round. Parameters are checked against their
    /// declaration before the module hears of them; those of one that is stopped or failed take effect when it is
    /// begun again. What was refused has changed nothing.
    pub fn ask(
        self,
        cx: &mut Cx,
        order: ModuleOrder,
        answer: impl FnOnce(&mut Cx, Result<SkVariant, ModuleError>) + 'static,
    ) {
        let threaded = cx.with(self, |supervisor, _| matches!(supervisor.home, Home::Thread(_)));
        match threaded {
            Ok(true) => self.ask_there(cx, order, Box::new(answer)),
            Ok(false) => {
                let given = self.give(cx, &order);
                answer(cx, given);
            }
            Err(error) => answer(cx, Err(error.into())),
        }
    }

    /// Changes one parameter of a module on this loop while it runs; one of a module that is stopped or failed
    /// takes effect when it is begun again. For any module: [`ask`](Handle#method.ask).
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
        self.give(cx, &ModuleOrder::Change(values.clone())).map(|_| ())
    }

    /// Hands a command to a module on this loop and answers what it answers. For any module:
    /// [`ask`](Handle#method.ask).
    ///
    /// # Errors
    /// The module refuses, or does not run.
    pub fn control(self, cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, ModuleError> {
        self.give(cx, &ModuleOrder::Control(command.clone()))
    }

    fn give(self, cx: &mut Cx, order: &ModuleOrder) -> Result<SkVariant, ModuleError> {
        let given = self.with_runner(cx, |runner, cx| {
            let answer = order.give(runner, cx);
            let changed = matches!(order, ModuleOrder::Change(_)) && answer.is_ok();
            (answer, changed.then(|| runner.parameters()))
        });
        let (answer, parameters) = given?;
        if let Some(parameters) = parameters {
            cx.with(self, |supervisor, _| supervisor.parameters = parameters)?;
        }
        answer
    }

    /// Starts the module; makes it first if it was stopped or given up. One that waits for its next try, or
    /// whose predecessor is not buried yet, is started as soon as it is made; one on a thread says by its state
    /// when it runs.
    ///
    /// # Errors
    /// The module cannot be made or started. It is tried again as its policy says.
    pub fn start(self, cx: &mut Cx) -> Result<(), ModuleError> {
        let state = cx.with(self, |supervisor, _| {
            supervisor.wanted = Wanted::Running;
            supervisor.state.clone()
        })?;
        match state {
            // A thread that ends, or hangs, is waited for.
            ModuleState::Running
            | ModuleState::Failed { retry_at: Some(_), .. }
            | ModuleState::Stopping
            | ModuleState::Stuck => Ok(()),
            ModuleState::Made | ModuleState::Beginning => self.bring_up(cx),
            ModuleState::Stopped | ModuleState::Failed { retry_at: None, .. } => {
                cx.with(self, |supervisor, _| supervisor.failures = 0)?;
                self.bring_up(cx)
            }
        }
    }

    /// Stops the module and buries it. It stays stopped until somebody starts it. One on a thread is
    /// [`Stopping`](ModuleState::Stopping) until the thread has ended.
    ///
    /// # Errors
    /// The supervisor is gone, or the module's own code asks.
    pub fn stop(self, cx: &mut Cx) -> Result<(), ModuleError> {
        if cx.with(self, |supervisor, _| matches!(supervisor.home, Home::Thread(_)))? {
            return self.stop_there(cx);
        }
        self.with_runner(cx, |runner, cx| runner.stop(cx))?;
        let (was, alarm) = cx.with(self, |supervisor, _| {
            supervisor.wanted = Wanted::Stopped;
            supervisor.running_since = None;
            let was = std::mem::replace(&mut supervisor.state, ModuleState::Stopped);
            (was, supervisor.alarm)
        })?;
        alarm.stop(cx)?;
        if was != ModuleState::Stopped {
            self.tell(cx);
        }
        Ok(())
    }

    /// Stops the module and starts it again, with the parameters it has.
    ///
    /// # Errors
    /// Those of [`stop`](Handle#method.stop) and of [`start`](Handle#method.start).
    pub fn restart(self, cx: &mut Cx) -> Result<(), ModuleError> {
        self.stop(cx)?;
        self.start(cx)
    }
}
