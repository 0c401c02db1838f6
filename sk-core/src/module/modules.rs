//! All modules of a loop, in order.

use crate::Cx;
use crate::module::{AnyRunner, ModuleState, ModuleSupervisor, RestartPolicy};
use crate::object::{Access, Handle, NameError};

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
    order: Vec<Handle<ModuleSupervisor>>,
}

crate::object! { pub Modules { signals {} slots {} hooks { on_destroy } } }

impl Modules {
    /// The object named `modules`, without any yet.
    pub fn spawn(cx: &mut Cx) -> Handle<Modules> {
        cx.named("modules").spawn(Modules::default())
    }

    fn on_destroy(&mut self, cx: &mut Cx) {
        stop(cx, &self.order);
    }
}

fn stop(cx: &mut Cx, order: &[Handle<ModuleSupervisor>]) {
    for supervisor in order.iter().rev() {
        // One that is gone has stopped its module when it went; one that is busy cannot be reached at all.
        if let Err(error) = supervisor.stop(cx) {
            tracing::debug!("{} was not stopped: {error}", cx.path_of(*supervisor));
        }
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
        let runner = runner.into();
        let name = runner.name().to_owned();
        let supervisor = cx.under(self).named(&name).try_spawn(ModuleSupervisor::new(runner, policy))?;
        // Only one that is busy is not kept: the new one is its child all the same, and stops with it.
        let _ = cx.with(self, |modules, _| modules.order.push(supervisor));
        supervisor.make(cx);
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

    /// Starts all modules, in the order of their adding. Answers those that do not run, with the reason: the
    /// ones that fail now, and the ones that failed before, which are started when they are tried again.
    pub fn start(self, cx: &mut Cx) -> Vec<(Handle<ModuleSupervisor>, String)> {
        let mut failed = Vec::new();
        for supervisor in self.all(cx).unwrap_or_default() {
            let given_up = matches!(supervisor.state(cx), Ok(ModuleState::Failed { retry_at: None, .. }));
            let started = if given_up { Ok(()) } else { supervisor.start(cx) };
            match (started, supervisor.state(cx)) {
                (_, Ok(ModuleState::Failed { reason, .. })) => failed.push((supervisor, reason)),
                (Err(error), _) => failed.push((supervisor, error.to_string())),
                _ => {}
            }
        }
        failed
    }

    /// Stops all modules, in the reverse order.
    pub fn stop(self, cx: &mut Cx) {
        let order = self.all(cx).unwrap_or_default();
        stop(cx, &order);
    }
}
