//! The runner: makes one module, checks what it is told, contains its errors and panics.

use crate::Cx;
use crate::flow::Flow;
use crate::module::{AbstractModule, ModuleError, ParameterInfo, Parameters};
use crate::object::{Access, Handle, ObjectId};
use sk_flat::SkVariant;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// The module's name below its supervisor.
pub(super) const MODULE_NAME: &str = "module";

/// A runner of a module whose type its holder does not know: what a registry lists.
///
/// No panic of the module leaves these methods.
pub trait AnyRunner {
    /// What the module is called here.
    fn name(&self) -> &str;
    /// What it can be told.
    fn describe(&self) -> &'static [ParameterInfo];
    /// What it has been told, as a map; also what the next life of the module begins with.
    fn parameters(&self) -> SkVariant;
    /// The module, while there is one.
    fn module(&self) -> Option<ObjectId>;

    /// Makes the module, as a child of `parent`.
    ///
    /// # Errors
    /// The module's own, or that it panicked.
    fn make(&mut self, cx: &mut Cx, parent: ObjectId) -> Result<ObjectId, ModuleError>;

    /// Starts the module; nothing if it runs.
    ///
    /// # Errors
    /// The module's own, or that it panicked. It is buried then.
    fn start(&mut self, cx: &mut Cx) -> Result<(), ModuleError>;

    /// Changes parameters: a map of those that change. All are checked first, and either all are taken over
    /// or none. While there is no module they are kept for its next life.
    ///
    /// # Errors
    /// A parameter was refused, the module refused the set, or it was not started yet.
    fn change(&mut self, cx: &mut Cx, values: &SkVariant) -> Result<(), ModuleError>;

    /// Hands a command to the module.
    ///
    /// # Errors
    /// The module's own, that it panicked, or that it does not run.
    fn control(&mut self, cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, ModuleError>;

    /// Stops the module, if it runs, and buries it, if there is one.
    fn stop(&mut self, cx: &mut Cx);

    /// The module is buried, or shall be as it is.
    fn forget(&mut self, cx: &mut Cx);
}

/// Makes and runs one module of class `M`; see [`Modules`](crate::module::Modules) for its use.
pub struct Runner<M: AbstractModule> {
    name: String,
    flow: Flow,
    parameters: M::Parameters,
    module: Option<Handle<M>>,
    started: bool,
}

impl<M: AbstractModule> Runner<M> {
    /// A runner for a module that will live on `flow` and begin with these parameters.
    pub fn new(flow: Flow, parameters: M::Parameters) -> Runner<M> {
        Runner { name: M::NAME.to_owned(), flow, parameters, module: None, started: false }
    }

    /// As [`new`](Runner::new), with parameters from outside: a map of those that are not the default.
    ///
    /// # Errors
    /// A parameter is unknown, of another type or out of range.
    pub fn configured(flow: Flow, parameters: &SkVariant) -> Result<Runner<M>, ModuleError> {
        Ok(Runner::new(flow, M::Parameters::from_variant(parameters)?))
    }

    /// Calls the module something else than its class does: for a second one of the class.
    #[must_use]
    pub fn named(self, name: &str) -> Runner<M> {
        Runner { name: name.to_owned(), ..self }
    }

    /// Calls one of the running module's methods.
    fn ask<R>(
        &self,
        cx: &mut Cx,
        step: &'static str,
        f: impl FnOnce(&mut M, &mut Cx) -> Result<R, M::Error>,
    ) -> Result<R, ModuleError> {
        let module = self.module.ok_or(ModuleError::NotRunning)?;
        contained(cx, step, |cx| {
            let answer = cx.with(module, |module, cx| f(module, cx));
            match answer {
                Ok(answer) => answer.map_err(|error| failed(step, &error)),
                Err(Access::Busy) => Err(ModuleError::Busy),
                Err(Access::Gone) => Err(ModuleError::NotRunning),
            }
        })
    }
}

impl<M: AbstractModule> AnyRunner for Runner<M> {
    fn name(&self) -> &str {
        &self.name
    }

    fn describe(&self) -> &'static [ParameterInfo] {
        M::Parameters::describe()
    }

    fn parameters(&self) -> SkVariant {
        self.parameters.to_variant()
    }

    fn module(&self) -> Option<ObjectId> {
        self.module.map(Handle::id)
    }

    fn make(&mut self, cx: &mut Cx, parent: ObjectId) -> Result<ObjectId, ModuleError> {
        let (flow, parameters) = (self.flow.clone(), &self.parameters);
        let mut id = ObjectId::NOBODY;
        let made = contained(cx, "new", |cx| {
            let new = |cx: &mut Cx, this: Handle<M>| {
                id = this.id();
                // So that a panic is the module's and not that of whoever asked for it.
                cx.enter_access(id);
                M::new(cx, this, flow, parameters)
            };
            let made = cx.under(parent).named(MODULE_NAME).try_spawn_with(new);
            made.map_err(|error| failed("new", &error))
        });
        match made {
            Ok(module) => {
                self.module = Some(module);
                self.started = false;
                Ok(id)
            }
            Err(error) => {
                // After a panic the place of the module and its children are still there.
                cx.destroy_later(id);
                Err(error)
            }
        }
    }

    fn start(&mut self, cx: &mut Cx) -> Result<(), ModuleError> {
        if self.started {
            return Ok(());
        }
        let started = self.ask(cx, "start", |module, cx| module.start(cx));
        match started {
            Ok(()) => self.started = true,
            Err(_) => self.forget(cx),
        }
        started
    }

    fn change(&mut self, cx: &mut Cx, values: &SkVariant) -> Result<(), ModuleError> {
        let mut next = self.parameters.clone();
        let map = values
            .as_map()
            .ok_or(crate::module::ParameterError::NotAMap { found: values.kind() })?;
        for (name, value) in map {
            next.set(name, value)?;
        }
        if next == self.parameters {
            return Ok(());
        }
        if self.module.is_some() {
            if !self.started {
                return Err(ModuleError::NotRunning);
            }
            self.ask(cx, "reconfigure", |module, cx| module.reconfigure(cx, &next))?;
        }
        self.parameters = next;
        Ok(())
    }

    fn control(&mut self, cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, ModuleError> {
        if !self.started {
            return Err(ModuleError::NotRunning);
        }
        self.ask(cx, "control", |module, cx| module.control(cx, command))
    }

    fn stop(&mut self, cx: &mut Cx) {
        if self.started {
            // A module that panics while it stops is reported by the guard, and buried like any other.
            let stopped = self.ask(cx, "stop", |module, cx| {
                module.stop(cx);
                Ok(())
            });
            if stopped == Err(ModuleError::Busy) {
                tracing::warn!(module = self.name, "stopped from within its own slot: `stop` was left out");
            }
        }
        self.forget(cx);
    }

    fn forget(&mut self, cx: &mut Cx) {
        if let Some(module) = self.module.take() {
            cx.destroy_later(module);
        }
        self.started = false;
    }
}

impl<M: AbstractModule> From<Runner<M>> for Box<dyn AnyRunner> {
    fn from(runner: Runner<M>) -> Box<dyn AnyRunner> {
        Box::new(runner)
    }
}

fn failed(step: &'static str, error: &dyn Display) -> ModuleError {
    ModuleError::Failed { step, message: error.to_string() }
}

/// Runs a step of a module. A panic in it is reported like that of a slot and ends here.
fn contained<R>(
    cx: &mut Cx,
    step: &'static str,
    f: impl FnOnce(&mut Cx) -> Result<R, ModuleError>,
) -> Result<R, ModuleError> {
    let mut answer = Err(ModuleError::NotRunning);
    let before = cx.chain_top();
    cx.guarded(|cx| match catch_unwind(AssertUnwindSafe(|| f(cx))) {
        Ok(done) => answer = done,
        Err(payload) => {
            let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
            answer = Err(ModuleError::Panicked { step, message: text.unwrap_or_default() });
            // On to the loop's own guard, which names the object and applies the policy.
            resume_unwind(payload)
        }
    });
    cx.restore_chain_top(before);
    answer
}
