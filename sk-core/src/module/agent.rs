//! The far end: what stands for the hub's supervisor on a module's own thread.
//!
//! The agent does what it is told and reports what came of it. It decides nothing: when a module that failed is
//! begun again is the supervisor's business, so that there is one place for it.

use crate::eventloop::Reason;
use crate::flow::{PipeSeed, SkFlowSat};
use crate::module::runner::MODULE_NAME;
use crate::module::{AnyRunner, ModuleClass, ModuleError, ModuleOrder, ModuleSupervisor, Modules};
use crate::object::{Handle, ObjectId};
use crate::thread::{Message, Remote};
use crate::{Cx, attach};
use crossbeam_channel::Sender;
use sk_flat::SkVariant;

/// What an agent tells its supervisor.
pub(super) enum Report {
    /// The module exists.
    Made,
    /// The module runs.
    Started,
    /// It could not be made or started, or died.
    Failed(String),
    /// The answer to a question, and the parameters after it.
    Answered { ticket: u64, answer: Result<SkVariant, ModuleError>, parameters: SkVariant },
    /// The loop has come round.
    Awake,
    /// The loop has ended.
    Ended,
}

/// The way back to the supervisor. The life tells reports of a thread that has ended from those of its successor.
#[derive(Clone)]
pub(super) struct WayBack {
    pub(super) supervisor: Remote<ModuleSupervisor>,
    pub(super) life: u64,
}

impl WayBack {
    pub(super) fn report(&self, report: Report) {
        let (there, life) = (self.supervisor.there(), self.life);
        let id = there.id;
        let work = move |cx: &mut Cx| Handle::<ModuleSupervisor>::new(id).on_report(cx, life, report);
        // A report that is lost would leave the supervisor waiting for ever. There is at most one for each thing
        // it asked, and a hub that has ended needs none.
        let _ = there.mailbox.post_anyway(Message::Run(Box::new(work)));
    }
}

/// Tells the supervisor that the loop has ended, however it ended: by being dropped with it.
pub(super) struct Ending {
    pub(super) back: WayBack,
    /// Who waits for the end without a loop of his own finds this closed.
    pub(super) _open: Sender<()>,
}

impl Drop for Ending {
    fn drop(&mut self) {
        self.back.report(Report::Ended);
    }
}

/// What an agent is made of; sent to the thread.
pub(super) struct Seed {
    pub(super) class: ModuleClass,
    pub(super) name: String,
    pub(super) parameters: SkVariant,
    pub(super) pipe: PipeSeed,
    pub(super) ending: Ending,
}

impl Seed {
    /// On the thread: the satellite, and the agent at `modules/<name>`, so that paths are those of any module.
    pub(super) fn plant(self, cx: &mut Cx) {
        let satellite = SkFlowSat::of_module(cx, self.pipe, &self.name);
        let back = self.ending.back.clone();
        let runner = match self.class.runner(&self.name, satellite.flow(&self.name), &self.parameters) {
            Ok(runner) => runner,
            Err(error) => {
                back.report(Report::Failed(error.to_string()));
                cx.quit();
                return;
            }
        };
        let modules = Modules::spawn(cx);
        let agent = Agent { runner: Some(runner), satellite, ending: self.ending, failed: false };
        if let Err(error) = cx.under(modules).named(&self.name).try_spawn(agent) {
            back.report(Report::Failed(error.to_string()));
            cx.quit();
        }
    }
}

/// Runs one module on its thread.
pub(super) struct Agent {
    /// Away while the module is being called.
    runner: Option<Box<dyn AnyRunner>>,
    satellite: Handle<SkFlowSat>,
    ending: Ending,
    /// The module failed, and the supervisor has not begun it again yet.
    failed: bool,
}

crate::object! { Agent { slots { on_buried(ObjectId, Reason) } hooks { on_destroy } } }

impl Agent {
    fn on_buried(&mut self, cx: &mut Cx, module: ObjectId, reason: Reason) {
        let this = cx.this(self);
        cx.post_own(this, move |cx| this.died(cx, module, reason));
    }

    /// The loop ends: by the supervisor's word, when the module is stopped already, or by the module's own.
    fn on_destroy(&mut self, cx: &mut Cx) {
        if let Some(runner) = &mut self.runner {
            runner.stop(cx);
        }
    }
}

/// The agent of that module on this loop.
pub(super) fn agent(cx: &Cx, name: &str) -> Option<Handle<Agent>> {
    cx.find_as(&format!("modules/{name}"))
}

impl Handle<Agent> {
    fn report(self, cx: &mut Cx, report: Report) {
        // An agent that is gone has reported its end.
        let _ = cx.with(self, |agent, _| {
            agent.failed |= matches!(report, Report::Failed(_));
            agent.ending.back.report(report);
        });
    }

    fn with_runner<R>(
        self,
        cx: &mut Cx,
        f: impl FnOnce(&mut dyn AnyRunner, &mut Cx) -> R,
    ) -> Result<R, ModuleError> {
        let mut runner = cx.with(self, |agent, _| agent.runner.take())?.ok_or(ModuleError::Busy)?;
        let answer = f(&mut *runner, cx);
        cx.with(self, |agent, _| agent.runner = Some(runner))?;
        Ok(answer)
    }

    /// Makes the module if there is none, and starts it if it shall run. After a failure only if it is to be begun
    /// again: the supervisor may have said how far it wants the module before it heard of the failure.
    pub(super) fn bring(self, cx: &mut Cx, run: bool, again: bool) {
        let refused = cx.with(self, |agent, _| {
            agent.failed &= !again;
            agent.failed
        });
        if refused != Ok(false) {
            return;
        }
        // The predecessor has its name until it is buried.
        let module = self.with_runner(cx, |runner, _| runner.module()).ok().flatten();
        let children = cx.children_of(self);
        let has_corpse =
            module.is_none() && children.into_iter().any(|child| cx.name_of(child) == Some(MODULE_NAME));
        if has_corpse {
            cx.post_own(self, move |cx| self.bring(cx, run, again));
            return;
        }
        let report = match self.try_bring(cx, module, run) {
            Ok(()) if run => Report::Started,
            Ok(()) => Report::Made,
            Err(error) => Report::Failed(error.to_string()),
        };
        self.report(cx, report);
    }

    fn try_bring(self, cx: &mut Cx, module: Option<ObjectId>, run: bool) -> Result<(), ModuleError> {
        if module.is_none() {
            let module = self.with_runner(cx, |runner, cx| runner.make(cx, self.id()))??;
            let watch = cx.watch(module);
            attach!(cx, watch.buried => self.on_buried);
        }
        if run {
            self.with_runner(cx, |runner, cx| runner.start(cx))??;
        }
        Ok(())
    }

    pub(super) fn order(self, cx: &mut Cx, ticket: u64, order: &ModuleOrder) {
        let answer = self.with_runner(cx, |runner, cx| order.give(runner, cx));
        let parameters = self.with_runner(cx, |runner, _| runner.parameters());
        let report = Report::Answered {
            ticket,
            answer: answer.and_then(|answer| answer),
            parameters: parameters.unwrap_or_default(),
        };
        self.report(cx, report);
    }

    pub(super) fn awake(self, cx: &mut Cx) {
        self.report(cx, Report::Awake);
    }

    /// Stops the module and ends the loop; the last words of both go out with this round's flush.
    pub(super) fn end(self, cx: &mut Cx) {
        // One that is busy stops its module when it is buried.
        let _ = self.with_runner(cx, |runner, cx| runner.stop(cx));
        if let Ok(satellite) = cx.with(self, |agent, _| agent.satellite) {
            cx.destroy_later(satellite);
        }
        cx.quit();
    }

    fn died(self, cx: &mut Cx, module: ObjectId, reason: Reason) {
        let forgotten = self.with_runner(cx, |runner, cx| {
            let mine = runner.module() == Some(module);
            if mine {
                runner.forget(cx);
            }
            mine
        });
        if forgotten == Ok(true) {
            self.report(cx, Report::Failed(why_buried(reason).to_owned()));
        }
    }
}

/// How a module that was not told to went.
pub(super) fn why_buried(reason: Reason) -> &'static str {
    match reason {
        Reason::Failed => "a slot of it failed",
        _ => "somebody destroyed it",
    }
}
