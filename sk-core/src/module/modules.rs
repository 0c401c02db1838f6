//! All modules of a loop, in order.

use crate::eventloop::Overload;
use crate::module::supervisor::Home;
use crate::module::thread_home::ThreadHome;
use crate::module::threaded::SLOT_MAX;
use crate::module::{AnyRunner, ModuleState, ModuleStatus, ModuleSupervisor, RestartPolicy, ThreadedModule};
use crate::object::{Access, Handle, NameError};
use crate::signal::Signal;
use crate::{Cx, attach};

/// The modules of one loop: the parent of their supervisors, so that they are found as `modules/<name>`.
///
/// Modules are added, which makes them, then all are started, in this order, and at the end stopped in the
/// reverse one; burying this object stops them too.
///
/// ```
/// use sk_core::flow::{Rights, SkFlowSat, SkFlowServer, server::Settings};
/// use sk_core::{module::*, prelude::*};
///
/// struct Beacon { flow: Flow }
/// impl AbstractModule for Beacon {
///     const NAME: &'static str = "beacon";
///     type Parameters = ();
///     type Error = String;
///     fn new(cx: &mut Cx, this: Handle<Self>, flow: Flow, _: &()) -> Result<Self, String> {
///         attach!(cx, cx.one_sec_zone().pulse => this.blink);
///         Ok(Beacon { flow })
///     }
///     fn reconfigure(&mut self, _cx: &mut Cx, _: &()) -> Result<(), String> { Ok(()) }
/// }
/// impl Beacon {
///     fn blink(&mut self, cx: &mut Cx) { self.flow.publish(cx, "light", true); }
/// }
/// object! { Beacon { slots { blink() } } }
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let cx = app.cx();
/// let settings = Settings { user: "robot".parse()?, token: None, owner_uid: None };
/// let server = SkFlowServer::start(cx, settings);
/// let pipe = server.pipe(cx, Rights::ALL)?;
/// let inside = SkFlowSat::inside(cx, pipe);
///
/// let modules = Modules::spawn(cx);
/// let beacon = modules.add(cx, Runner::<Beacon>::new(inside.flow("beacon"), ()), RestartPolicy::default())?;
/// modules.start(cx);
/// assert_eq!(cx.path_of(beacon), "modules/beacon");
/// assert_eq!(beacon.state(cx)?, ModuleState::Running);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Default)]
pub struct Modules {
    /// After [`stop`](Handle#method.stop): the last one has stopped, or was given up because its thread does not
    /// end.
    pub stopped: Signal<()>,
    order: Vec<Handle<ModuleSupervisor>>,
    /// While they are being stopped: those whose turn has not come.
    ending: Option<Vec<Handle<ModuleSupervisor>>>,
}

crate::object! {
    pub Modules { signals { stopped() } slots { on_overloaded(&Overload) } hooks { on_spawn on_destroy } }
}

impl Modules {
    /// The object named `modules`, without any yet.
    pub fn spawn(cx: &mut Cx) -> Handle<Modules> {
        cx.named("modules").spawn(Modules::default())
    }

    fn on_spawn(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        attach!(cx, cx.event_loop().overloaded => this.on_overloaded);
    }

    /// A module that kept the loop is marked.
    fn on_overloaded(&mut self, cx: &mut Cx, overload: &Overload) {
        let Some(culprit) = overload.culprit.as_ref().filter(|culprit| culprit.time > SLOT_MAX) else {
            return;
        };
        for supervisor in &self.order {
            let path = cx.path_of(*supervisor);
            let is_in = culprit.path.strip_prefix(&path).is_some_and(|rest| rest.starts_with('/'));
            // One that is busy right now is not marked.
            if is_in && cx.with(*supervisor, |supervisor, _| supervisor.late += 1).is_ok() {
                tracing::warn!("{path} kept the loop of the hub for {:?}: {}", culprit.time, culprit.slot);
            }
        }
    }

    fn on_destroy(&mut self, cx: &mut Cx) {
        for supervisor in self.order.iter().rev() {
            stop_one(cx, *supervisor);
            // No round may follow, so a thread is waited for here, one after the other.
            let _ = cx.with(*supervisor, |supervisor, cx| supervisor.end_thread_and_wait(cx));
        }
    }
}

fn stop_one(cx: &mut Cx, supervisor: Handle<ModuleSupervisor>) {
    // One that is gone has stopped its module when it went; one that is busy cannot be reached at all.
    if let Err(error) = supervisor.stop(cx) {
        tracing::debug!("{} was not stopped: {error}", cx.path_of(supervisor));
    }
}

impl Handle<Modules> {
    /// Adds a module and makes it. If it cannot be made that is its supervisor's state, and it is tried again
    /// as the policy says.
    ///
    /// # Errors
    /// The name cannot be or is taken, or the modules are gone.
    pub fn add(
        self,
        cx: &mut Cx,
        runner: impl Into<Box<dyn AnyRunner>>,
        policy: RestartPolicy,
    ) -> Result<Handle<ModuleSupervisor>, NameError> {
        let supervisor = self.add_stopped(cx, runner, policy)?;
        supervisor.make(cx);
        Ok(supervisor)
    }

    /// Adds a module and does not make it: [`start`](Handle#method.start) of its supervisor does.
    ///
    /// # Errors
    /// The name cannot be or is taken, or the modules are gone.
    pub fn add_stopped(
        self,
        cx: &mut Cx,
        runner: impl Into<Box<dyn AnyRunner>>,
        policy: RestartPolicy,
    ) -> Result<Handle<ModuleSupervisor>, NameError> {
        let runner = runner.into();
        let (name, declared, parameters) = (runner.name().to_owned(), runner.describe(), runner.parameters());
        let supervisor = ModuleSupervisor::new(Home::Here(Some(runner)), declared, parameters, policy);
        self.enlist(cx, &name, supervisor)
    }

    /// Adds a module on a thread of its own and begins to make it there. It is made and started beside the
    /// others, which do not wait for it; its state tells how far it is.
    ///
    /// # Errors
    /// The name cannot be or is taken, or the modules are gone.
    pub fn add_on_thread(
        self,
        cx: &mut Cx,
        module: ThreadedModule,
        policy: RestartPolicy,
    ) -> Result<Handle<ModuleSupervisor>, NameError> {
        let supervisor = self.add_on_thread_stopped(cx, module, policy)?;
        supervisor.make(cx);
        Ok(supervisor)
    }

    /// Adds a module that shall live on a thread of its own, and starts neither.
    ///
    /// # Errors
    /// The name cannot be or is taken, or the modules are gone.
    pub fn add_on_thread_stopped(
        self,
        cx: &mut Cx,
        module: ThreadedModule,
        policy: RestartPolicy,
    ) -> Result<Handle<ModuleSupervisor>, NameError> {
        let (name, declared) = (module.name.clone(), module.class.describe());
        let parameters = module.parameters.clone();
        let home = Home::Thread(Box::new(ThreadHome::new(module)));
        self.enlist(cx, &name, ModuleSupervisor::new(home, declared, parameters, policy))
    }

    fn enlist(
        self,
        cx: &mut Cx,
        name: &str,
        supervisor: ModuleSupervisor,
    ) -> Result<Handle<ModuleSupervisor>, NameError> {
        let supervisor = cx.under(self).named(name).try_spawn(supervisor)?;
        // Only one that is busy is not kept: the new one is its child all the same, and stops with it.
        let _ = cx.with(self, |modules, cx| {
            modules.order.retain(|other| cx.is_alive(*other));
            modules.order.push(supervisor);
        });
        Ok(supervisor)
    }

    /// All modules, in the order of their adding.
    ///
    /// # Errors
    /// The modules are gone, or are just being stopped.
    pub fn all(self, cx: &mut Cx) -> Result<Vec<Handle<ModuleSupervisor>>, Access> {
        let order = cx.with(self, |modules, _| modules.order.clone())?;
        Ok(order.into_iter().filter(|supervisor| cx.is_alive(*supervisor)).collect())
    }

    /// The module of that name.
    pub fn find(self, cx: &mut Cx, name: &str) -> Option<Handle<ModuleSupervisor>> {
        let all = self.all(cx).ok()?;
        all.into_iter().find(|supervisor| cx.name_of(*supervisor) == Some(name))
    }

    /// What an operator sees of all modules, in the order of their adding.
    ///
    /// # Errors
    /// The modules are gone, or are just being stopped.
    pub fn list(self, cx: &mut Cx) -> Result<Vec<ModuleStatus>, Access> {
        let all = self.all(cx)?;
        Ok(all.into_iter().filter_map(|supervisor| supervisor.status(cx).ok()).collect())
    }

    /// Starts all modules, in the order of their adding, those left out that were added stopped. Answers those
    /// that do not run, with the reason: the ones that fail now, and the ones that failed before, which are
    /// started when they are tried again. A module on a thread is not waited for.
    pub fn start(self, cx: &mut Cx) -> Vec<(Handle<ModuleSupervisor>, String)> {
        let mut failed = Vec::new();
        for supervisor in self.all(cx).unwrap_or_default() {
            let state = supervisor.state(cx);
            let left_out =
                matches!(state, Ok(ModuleState::Failed { retry_at: None, .. } | ModuleState::Stopped));
            let started = if left_out { Ok(()) } else { supervisor.start(cx) };
            match (started, supervisor.state(cx)) {
                (_, Ok(ModuleState::Failed { reason, .. })) => failed.push((supervisor, reason)),
                (Err(error), _) => failed.push((supervisor, error.to_string())),
                _ => {}
            }
        }
        failed
    }

    /// Stops all modules, in the reverse order, each when its successor has stopped. Those on this loop stop at
    /// once; a thread that does not end in time is given up, and the others go on stopping. When the last one is
    /// through, [`stopped`](Modules::stopped) is emitted, in a later round.
    pub fn stop(self, cx: &mut Cx) {
        let order = self.all(cx).unwrap_or_default();
        // Modules that are gone have stopped when they went.
        let _ = cx.with(self, |modules, _| modules.ending.get_or_insert(order).len());
        self.go_on_stopping(cx);
    }

    /// Stops those whose turn has come.
    pub(super) fn go_on_stopping(self, cx: &mut Cx) {
        while let Ok(Some(last)) = cx.with(self, |modules, _| modules.ending.as_ref()?.last().copied()) {
            // Twice told is once told.
            stop_one(cx, last);
            if last.state(cx) == Ok(ModuleState::Stopping) {
                return;
            }
            let _ = cx.with(self, |modules, _| {
                modules.ending.as_mut().map(|ending| ending.retain(|other| *other != last))
            });
        }
        let through = cx.with(self, |modules, _| {
            let through = modules.ending.as_ref().is_some_and(Vec::is_empty);
            if through {
                modules.ending = None;
            }
            through
        });
        if through == Ok(true) {
            cx.post_own(self, move |cx| cx.emit_own(self, |modules| &modules.stopped, &()));
        }
    }
}
