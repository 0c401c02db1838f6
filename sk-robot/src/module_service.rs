//! The modules of a hub, told what to do by a service of its own: `account.modules`.
//!
//! A request is a map: `do` says what, `module` to whom. `list` answers all modules, `info` one with its declared
//! parameters; `set` changes parameters (`values`, a map), `control` hands `command` to the module, and `start`,
//! `stop` and `restart` do what they say. What is refused is declined in words. A module is commanded by who may
//! administer `account.modules.NAME`; `list` answers those that the asker may command.

use crate::hint::hint;
use sk_core::flow::{Request, Right, SkFlowServer};
use sk_core::module::{
    ModuleError, ModuleOrder, ModuleState, ModuleStatus, ModuleSupervisor, Modules, ParameterInfo,
};
use sk_core::prelude::*;
use std::io;

/// The service's name within the account.
pub const NAME: &str = "modules";

/// What can be asked, for the hint after a wrong word.
const ORDERS: [&str; 7] = ["list", "info", "set", "control", "start", "stop", "restart"];

struct ModuleService {
    server: Handle<SkFlowServer>,
    modules: Handle<Modules>,
    /// The service's full name.
    name: String,
    /// Those who wait until a module has come to where they want it: a thread takes its time, and one that is begun
    /// again waits until its predecessor is buried.
    waiting: Vec<Waiting>,
}

struct Waiting {
    module: Handle<ModuleSupervisor>,
    shall_run: bool,
    request: Request,
}

object! { ModuleService { slots { on_request(&Request) on_changed() } } }

/// Offers the service, as long as the server lives.
pub(crate) fn offer(
    cx: &mut Cx,
    server: Handle<SkFlowServer>,
    modules: Handle<Modules>,
    account: &str,
) -> io::Result<()> {
    let doc = "The hub's modules: {do: list | info | set | control | start | stop | restart, module, values, command}";
    let name = format!("{account}.{NAME}");
    let service = server.serve(cx, &name, doc)?;
    let answerer = cx
        .under(server)
        .spawn(ModuleService { server, modules, name, waiting: Vec::new() });
    attach!(cx, service.request => answerer.on_request);
    Ok(())
}

impl ModuleService {
    fn on_request(&mut self, cx: &mut Cx, request: &Request) {
        if let Err(why) = self.obey(cx, request) {
            request.decline(cx, &why);
        }
    }

    /// Answers the request, now or when the module has; what cannot be is an error.
    fn obey(&mut self, cx: &mut Cx, request: &Request) -> Result<(), String> {
        let order = request.value().map_err(|error| format!("the request is no value: {error}"))?;
        let word = |key: &str| order.get(key).and_then(SkVariant::as_str);
        let what = word("do").ok_or_else(|| format!("say what to `do`: {}", ORDERS.join(", ")))?;
        if what == "list" {
            let mut list = self.modules.list(cx).map_err(|error| error.to_string())?;
            let all = list.len();
            list.retain(|module| self.may(cx, request, &module.name));
            if list.is_empty() && all > 0 {
                return Err(self.denied("*"));
            }
            let list = SkVariant::list(list.iter().map(|module| told(cx, module)));
            request.answer(cx, list);
            return Ok(());
        }
        if !ORDERS.contains(&what) {
            return Err(format!("nobody can {what:?} a module; {}", hint(what, ORDERS)));
        }
        let name = word("module").unwrap_or_default();
        if !self.may(cx, request, name) {
            // Who may not command it does not learn whether it is there either.
            return Err(self.denied(name));
        }
        let module = self.find(cx, name)?;
        let refused = |error: ModuleError| error.to_string();
        match what {
            "set" => {
                let values = order.get("values").ok_or("say which `values`, a map")?.clone();
                give(cx, module, ModuleOrder::Change(values), request);
                return Ok(());
            }
            "control" => {
                let command = order.get("command").cloned().unwrap_or_default();
                give(cx, module, ModuleOrder::Control(command), request);
                return Ok(());
            }
            "start" => module.start(cx).map_err(refused)?,
            "stop" => module.stop(cx).map_err(refused)?,
            "restart" => module.restart(cx).map_err(refused)?,
            _ => {
                let status = module.status(cx).map_err(|error| error.to_string())?;
                let mut told = told(cx, &status);
                if let Some(map) = told.as_map_mut() {
                    map.insert("declared".to_owned(), SkVariant::list(status.declared.iter().map(declared)));
                }
                request.answer(cx, told);
                return Ok(());
            }
        }
        let this = cx.this(self);
        // Linked once, however often it is asked for.
        attach!(cx, module.changed => this.on_changed(), Queued);
        self.waiting
            .push(Waiting { module, shall_run: what != "stop", request: request.clone() });
        self.on_changed(cx);
        Ok(())
    }

    /// A module's state is another one.
    fn on_changed(&mut self, cx: &mut Cx) {
        self.waiting.retain(|waiting| {
            let Ok(status) = waiting.module.status(cx) else { return false };
            let has_come = match status.state {
                ModuleState::Running => waiting.shall_run,
                ModuleState::Stopped => !waiting.shall_run,
                ModuleState::Failed { .. } | ModuleState::Stuck => true,
                _ => false,
            };
            if has_come {
                let told = told(cx, &status);
                waiting.request.answer(cx, told);
            }
            !has_come && waiting.request.is_open(cx)
        });
    }

    /// Who asks may command a module if he may administer it, by its name below that of the service.
    fn may(&self, cx: &mut Cx, request: &Request, module: &str) -> bool {
        let name = format!("{}.{module}", self.name);
        self.server.may(cx, request.asker(), Right::Administer, &name)
    }

    fn denied(&self, module: &str) -> String {
        format!("that takes the right to administer {}.{module}", self.name)
    }

    fn find(&self, cx: &mut Cx, name: &str) -> Result<Handle<ModuleSupervisor>, String> {
        if let Some(module) = self.modules.find(cx, name) {
            return Ok(module);
        }
        let list = self.modules.list(cx).unwrap_or_default();
        let known = list.iter().map(|module| module.name.as_str());
        Err(format!("there is no module {name:?}; {}", hint(name, known)))
    }
}

/// Hands an order to the module, whose answer may come in a later round.
fn give(cx: &mut Cx, module: Handle<ModuleSupervisor>, order: ModuleOrder, request: &Request) {
    let request = request.clone();
    module.ask(cx, order, move |cx, answer| match answer {
        Ok(answer) => drop(request.answer(cx, answer)),
        Err(error) => drop(request.decline(cx, &error.to_string())),
    });
}

fn told(cx: &mut Cx, module: &ModuleStatus) -> SkVariant {
    let (state, reason, retry_at) = match &module.state {
        ModuleState::Failed { reason, retry_at } => ("failed".to_owned(), Some(reason), *retry_at),
        state => (state.to_string(), None, None),
    };
    let retry_in = retry_at.map(|at| at.since(cx.now()).as_secs_f64());
    let text = |text: Option<&String>| text.map_or(SkVariant::Null, |text| text.as_str().into());
    SkVariant::map([
        ("name", module.name.as_str().into()),
        ("state", state.into()),
        ("reason", text(reason)),
        ("retry_in", retry_in.map_or(SkVariant::Null, SkVariant::from)),
        ("thread", module.thread.is_some().into()),
        ("restarts", module.restarts.into()),
        ("last_error", text(module.last_error.as_ref())),
        ("late", module.late.into()),
        ("silent", module.silent.into()),
        ("parameters", module.parameters.clone()),
    ])
}

fn declared(parameter: &ParameterInfo) -> SkVariant {
    SkVariant::map([
        ("name", parameter.name.into()),
        ("takes", parameter.to_string().into()),
        ("default", parameter.default.clone()),
        ("doc", parameter.doc.as_str().into()),
    ])
}
