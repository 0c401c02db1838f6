//! `sk module`: the modules of the hub, by the service that the hub has for them; and a new one.

mod new;

use crate::arguments::{Arguments, json as parse};
use crate::commands::call::{self, ask, said};
use crate::names::missing;
use crate::output::{json, safe};
use crate::session::{Link, Visit};
use crate::table::{facts, table};
use clap::{Args, Subcommand};
use new::ModuleNew;
use sk_core::flow::{Answer, ChannelKind};
use sk_core::prelude::*;
use sk_robot::module_service;

#[derive(Subcommand, Debug)]
pub enum Module {
    /// Write the skeleton of a module: a crate that builds, has a test, and runs in a hub or as a satellite
    New(ModuleNew),
    /// List the hub's modules
    Ls,
    /// Tell of one: how it is, what it has been told, what it can be told
    Info(One),
    /// Change parameters while it runs: NAME VALUE, several in turn; all or none
    Set(Set),
    /// Hand a command to it
    Control(Control),
    /// Start it
    Start(One),
    /// Stop it; it stays stopped until somebody starts it, or the hub is started again
    Stop(One),
    /// Stop it and start it again
    Restart(One),
}

#[derive(Args, Debug, Clone)]
pub struct One {
    /// The module
    pub module: String,
}

#[derive(Args, Debug, Clone)]
pub struct Set {
    /// The module
    pub module: String,
    /// Names of parameters, each followed by its value as JSON
    #[arg(required = true, num_args = 2.., value_names = ["PARAMETER", "JSON"], allow_hyphen_values = true)]
    pub values: Vec<String>,
}

#[derive(Args, Debug, Clone)]
pub struct Control {
    /// The module
    pub module: String,
    /// The command, as JSON; the module's README says which there are
    #[arg(value_parser = parse, value_name = "JSON")]
    pub command: SkVariant,
    /// How many seconds the answer may take
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = call::seconds)]
    pub within: Duration,
}

/// How long the hub may take to answer, unless it is said otherwise.
const WITHIN: Duration = Duration::from_secs(5);

type Shown = fn(&SkVariant) -> String;

pub fn run(arguments: &Arguments, task: &Module) -> Result<(), String> {
    let named = |what: &str, module: &str, more: &[(&str, SkVariant)]| {
        let words = [("do", SkVariant::from(what)), ("module", module.into())];
        SkVariant::map(words.into_iter().chain(more.iter().cloned()))
    };
    let (request, within, shown): (SkVariant, Duration, Shown) = match task {
        Module::New(task) => return new::run(task),
        Module::Ls => (SkVariant::map([("do", "list".into())]), WITHIN, listed),
        Module::Info(one) => (named("info", &one.module, &[]), WITHIN, told),
        Module::Start(one) => (named("start", &one.module, &[]), WITHIN, state),
        Module::Stop(one) => (named("stop", &one.module, &[]), WITHIN, state),
        Module::Restart(one) => (named("restart", &one.module, &[]), WITHIN, state),
        Module::Set(set) => (named("set", &set.module, &[("values", values(&set.values)?)]), WITHIN, silent),
        Module::Control(control) => {
            let command = [("command", control.command.clone())];
            (named("control", &control.module, &command), control.within, silent)
        }
    };
    let as_json = arguments.json;
    Visit::once(arguments, move |cx, link| {
        let Some(service) = service(cx, link) else {
            return link.fail(
                cx,
                missing("service", module_service::NAME, std::iter::empty(), "this hub commands no modules"),
            );
        };
        ask(cx, link, &service, request, within, move |cx, answer| {
            link.end(cx, text(answer, as_json, shown))
        });
    })
}

/// The full name of the hub's own service for modules.
pub fn service(cx: &mut Cx, link: Link) -> Option<String> {
    let ends = format!(".{}", module_service::NAME);
    let channels = link.hub.channels(cx);
    let found = channels.into_iter().find(|channel| {
        channel.owner == 0 && channel.kind == ChannelKind::Service && channel.name.ends_with(&ends)
    });
    found.map(|channel| channel.name)
}

fn text(answer: &Answer, as_json: bool, shown: Shown) -> Result<String, String> {
    let value = answer.value().map_err(|error| match error {
        sk_core::flow::CallError::Declined(words) => safe(&words),
        error => said(&error, answer.service()),
    })?;
    match (as_json, value.as_list()) {
        (true, Some(list)) => list.iter().map(json).collect(),
        (true, None) => json(&value),
        (false, _) => Ok(shown(&value)),
    }
}

/// Pairs of the command line as a map.
fn values(words: &[String]) -> Result<SkVariant, String> {
    let pairs = words.chunks(2).map(|pair| match pair {
        [name, value] => Ok((name.as_str(), parse(value).map_err(|error| format!("{name}: {error}"))?)),
        _ => Err(format!("{} has no value: write NAME VALUE", pair.concat())),
    });
    pairs.collect::<Result<Vec<_>, String>>().map(SkVariant::map)
}

fn word(module: &SkVariant, key: &str) -> String {
    match module.get(key) {
        None | Some(SkVariant::Null) => String::new(),
        Some(value) => safe(&value.as_str().map_or_else(|| value.to_string(), str::to_owned)),
    }
}

fn is_true(module: &SkVariant, key: &str) -> bool {
    module.get(key) == Some(&SkVariant::Bool(true))
}

/// `failed: why`, `running`.
fn condition(module: &SkVariant) -> String {
    let reason = word(module, "reason");
    let state = word(module, "state");
    let state = if reason.is_empty() { state } else { format!("{state}: {reason}") };
    if is_true(module, "silent") { state + " (its thread does not answer)" } else { state }
}

fn listed(list: &SkVariant) -> String {
    let modules = list.as_list().unwrap_or_default();
    if modules.is_empty() {
        return "no modules\n".to_owned();
    }
    let row = |module: &SkVariant| {
        let place = if is_true(module, "thread") { "own thread" } else { "the hub's loop" };
        let count = |key: &str| Some(word(module, key)).filter(|count| count != "0").unwrap_or_default();
        vec![word(module, "name"), condition(module), place.to_owned(), count("restarts"), count("late")]
    };
    let rows: Vec<Vec<String>> = modules.iter().map(row).collect();
    table(&["MODULE", "STATE", "RUNS ON", "RESTARTS", "TOO SLOW"], &rows)
}

fn told(module: &SkVariant) -> String {
    let place = if is_true(module, "thread") { "a thread of its own" } else { "the hub's loop" };
    let mut rows = vec![
        ("module", word(module, "name")),
        ("state", condition(module)),
        ("runs on", place.to_owned()),
        ("restarts", word(module, "restarts")),
        ("too slow", format!("{} times", word(module, "late"))),
    ];
    let error = word(module, "last_error");
    if !error.is_empty() {
        rows.push(("last error", error));
    }
    let mut text = facts(&rows);
    let declared = module.get("declared").and_then(SkVariant::as_list).unwrap_or_default();
    let row = |one: &SkVariant| {
        let name = word(one, "name");
        let now = module.get("parameters").and_then(|all| all.get(&name));
        let now = now.map_or_else(String::new, |value| safe(&value.to_string()));
        vec![name, now, word(one, "takes"), word(one, "default"), word(one, "doc")]
    };
    let rows: Vec<Vec<String>> = declared.iter().map(row).collect();
    if !rows.is_empty() {
        text += "\n";
        text += &table(&["PARAMETER", "IS", "TAKES", "DEFAULT", "MEANING"], &rows);
    }
    text
}

fn state(module: &SkVariant) -> String {
    format!("{} is {}\n", word(module, "name"), condition(module))
}

/// What a module answers is shown; nothing is the answer of a change.
fn silent(answer: &SkVariant) -> String {
    match answer {
        SkVariant::Null => String::new(),
        answer => json(answer).unwrap_or_default(),
    }
}
