//! A module's life on the loop of its supervisor: brought up, failed, begun again.

use crate::eventloop::Reason;
use crate::module::agent::why_buried;
use crate::module::runner::MODULE_NAME;
use crate::module::supervisor::{Home, Wanted};
use crate::module::{AnyRunner, ModuleError, ModuleState, ModuleSupervisor, Modules};
use crate::object::{Handle, ObjectId};
use crate::{Cx, attach};

impl Handle<ModuleSupervisor> {
    /// Makes the module for the first time.
    pub(super) fn make(self, cx: &mut Cx) {
        self.bring_up_if_wanted(cx);
    }

    /// Lends the runner. It is out of its object meanwhile, so that the module's code finds the supervisor
    /// free.
    pub(super) fn with_runner<R>(
        self,
        cx: &mut Cx,
        f: impl FnOnce(&mut dyn AnyRunner, &mut Cx) -> R,
    ) -> Result<R, ModuleError> {
        let mut runner = cx.with(self, |supervisor, _| match &mut supervisor.home {
            Home::Here(runner) => runner.take().ok_or(ModuleError::Busy),
            Home::Thread(_) => Err(ModuleError::OnThread),
        })??;
        let answer = f(&mut *runner, cx);
        cx.with(self, |supervisor, _| supervisor.home = Home::Here(Some(runner)))?;
        Ok(answer)
    }

    /// Brings the module as far as it is wanted.
    pub(super) fn bring_up(self, cx: &mut Cx) -> Result<(), ModuleError> {
        if cx.with(self, |supervisor, _| matches!(supervisor.home, Home::Thread(_)))? {
            return self.bring_up_there(cx);
        }
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

    pub(super) fn or_fail<R>(self, cx: &mut Cx, answer: Result<R, ModuleError>) -> Result<R, ModuleError> {
        if let Err(error) = &answer {
            self.fail(cx, error.to_string());
        }
        answer
    }

    pub(super) fn fail(self, cx: &mut Cx, reason: String) {
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
            ModuleState::Failed { retry_at: Some(at), .. } => supervisor.alarm.start_once(cx, at.since(now)),
            // It counts the time its thread has to end.
            ModuleState::Stopping => Ok(()),
            _ => supervisor.alarm.stop(cx),
        });
    }

    pub(super) fn died(self, cx: &mut Cx, module: ObjectId, reason: Reason) {
        if self.module(cx) != Some(module) {
            return;
        }
        // It was there a line ago, and nobody can be in its module: it is buried.
        let _ = self.with_runner(cx, |runner, cx| runner.forget(cx));
        self.fail(cx, why_buried(reason).to_owned());
    }

    /// The wait for the next try is over, or that for the end of a thread.
    pub(super) fn alarmed(self, cx: &mut Cx) {
        if self.state(cx) == Ok(ModuleState::Stopping) {
            self.give_up_waiting(cx);
            return;
        }
        let counted = cx.with(self, |supervisor, _| {
            let waits = matches!(supervisor.state, ModuleState::Failed { retry_at: Some(_), .. });
            supervisor.restarts += u64::from(waits);
            waits
        });
        if counted == Ok(true) {
            self.bring_up_if_wanted(cx);
        }
    }

    pub(super) fn bring_up_if_wanted(self, cx: &mut Cx) {
        if cx.with(self, |supervisor, _| supervisor.wanted != Wanted::Stopped) == Ok(true) {
            // What went wrong is the state, and was reported.
            let _ = self.bring_up(cx);
        }
    }

    pub(super) fn tell(self, cx: &mut Cx) {
        if let Ok(state) = self.state(cx) {
            cx.emit_own(self, |supervisor| &supervisor.changed, &state);
            if matches!(state, ModuleState::Stopped | ModuleState::Stuck)
                && let Some(modules) = cx.parent_of(self)
            {
                Handle::<Modules>::new(modules).go_on_stopping(cx);
            }
        }
    }
}
