//! A configuration that is read again while the hub runs.

use crate::config::{Config, ModuleConfig};
use crate::hub::Hub;
use sk_core::module::{ModuleOrder, ModuleState, ModuleSupervisor, Parameters};
use sk_core::prelude::*;

impl Hub {
    /// Takes over what can change while the hub runs: the loop's mode and intervals, and of each module whether it
    /// runs, its parameters and its restarts. Answers the keys of what cannot: they take effect when the hub is
    /// started again. A module that refuses its parameters keeps those it has; that is logged, and so is what was
    /// taken over.
    pub fn reconfigure(&mut self, cx: &mut Cx, next: &Config) -> Vec<String> {
        let mut later = Vec::new();
        let now = self.config.clone();
        differing("", &now.hub, &next.hub, &mut later);
        differing("listen.", &now.listen, &next.listen, &mut later);
        if now.event_loop != next.event_loop {
            match cx.configure(|settings| next.event_loop.apply(settings)) {
                Ok(()) => tracing::info!("the loop keeps time anew: {:?}", next.event_loop),
                // The file was checked for what could contradict itself.
                Err(error) => tracing::error!("loop: {error}"),
            }
            self.config.event_loop = next.event_loop.clone();
        }
        for (name, wanted) in &next.modules {
            let Some(module) = self.module(cx, name) else { continue };
            let Some(present) = self.config.modules.get_mut(name) else { continue };
            if present.thread != wanted.thread {
                later.push(format!("modules.{name}.thread"));
            }
            *present = ModuleConfig { thread: present.thread.clone(), ..wanted.clone() };
            if let Err(error) = change(cx, name, module, wanted) {
                tracing::error!("module {name}: {error}");
            }
        }
        later
    }
}

/// The names of the parameters in which two sets differ.
fn differing<P: Parameters>(prefix: &str, now: &P, next: &P, names: &mut Vec<String>) {
    let changed = P::describe().iter().filter(|info| now.get(info.name) != next.get(info.name));
    names.extend(changed.map(|info| format!("{prefix}{}", info.name)));
}

fn change(
    cx: &mut Cx,
    name: &str,
    module: Handle<ModuleSupervisor>,
    wanted: &ModuleConfig,
) -> Result<(), sk_core::module::ModuleError> {
    module.set_policy(cx, wanted.restart.policy())?;
    let state = module.state(cx)?;
    let runs = !matches!(state, ModuleState::Stopped | ModuleState::Stopping | ModuleState::Stuck);
    if runs && !wanted.enabled {
        tracing::info!("module {name} is stopped");
        module.stop(cx)?;
    }
    // What it has been told by others since counts, not what the file said before.
    if module.parameters(cx)? != wanted.parameters {
        let own_name = name.to_owned();
        module.ask(cx, ModuleOrder::Change(wanted.parameters.clone()), move |_, answer| match answer {
            Ok(_) => tracing::info!("module {own_name} has taken its parameters over"),
            Err(error) => tracing::error!("module {own_name} keeps its parameters: {error}"),
        });
    }
    if !runs && wanted.enabled {
        tracing::info!("module {name} is started");
        module.start(cx)?;
    }
    Ok(())
}
