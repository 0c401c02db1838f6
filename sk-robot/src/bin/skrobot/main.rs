//! `skrobot`: the hub.
#![forbid(unsafe_code)]

mod arguments;
mod greeting;
mod keeper;

use arguments::Arguments;
use clap::Parser;
use greeting::{greeting, say};
use keeper::Keeper;
use sk_core::module::{ModuleState, ModuleStatus, Modules};
use sk_core::prelude::*;
use sk_core::world::World;
use sk_robot::notify::ServiceManager;
use sk_robot::places::Places;
use sk_robot::supervise::{self, EXIT_MISTOLD, EXIT_REFUSED};
use sk_robot::{FREED_BYTES_KEPT, Hub, HubBuilder, logging, registry};
use std::path::Path;
use std::process::ExitCode;

/// Rounds, of the hub and of the threads of modules, in which the modules' channels come to be before the hub says
/// what there is.
const ROUNDS_BEFORE_GREETING: u32 = 8;
/// A module that takes longer to begin is not waited for.
const GREETING_WITHIN: Duration = Duration::from_secs(1);

/// Why the hub does not run.
enum Refusal {
    /// It was told something that cannot be.
    Mistold(String),
    /// What it was told cannot be done here.
    CannotRun(String),
}

fn cannot_run(error: impl std::fmt::Display) -> Refusal {
    Refusal::CannotRun(error.to_string())
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = if arguments.supervise { supervised(&arguments) } else { run(arguments) };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(Refusal::Mistold(error)) => {
            eprintln!("skrobot: {error}");
            ExitCode::from(EXIT_MISTOLD)
        }
        Err(Refusal::CannotRun(error)) => {
            eprintln!("skrobot: {error}");
            ExitCode::from(EXIT_REFUSED)
        }
    }
}

/// The parent's part.
fn supervised(arguments: &Arguments) -> Result<u8, Refusal> {
    let filter = arguments.log.as_deref().unwrap_or("info");
    logging::to_stderr(filter).map_err(|error| Refusal::Mistold(format!("--log {filter:?}: {error}")))?;
    supervise::run(arguments::child)
        .map_err(|error| cannot_run(format!("the hub cannot be supervised: {error}")))
}

fn run(arguments: Arguments) -> Result<u8, Refusal> {
    let world = World::real().map_err(cannot_run)?;
    let builder = registry::builtin(Hub::builder());
    let config = arguments
        .config(&*world.storage, &builder.classes())
        .map_err(Refusal::Mistold)?;
    if arguments.print_config {
        let shown = config.to_variant().to_json_pretty().map_err(cannot_run)?;
        say(&(shown + "\n"));
        return Ok(0);
    }
    logging::to_stderr(&config.hub.log)
        .map_err(|error| Refusal::Mistold(format!("log {:?}: {error}", config.hub.log)))?;
    let restarts = supervise::tie_to_supervisor().unwrap_or(0);
    let app = SkApp::builder().name("hub").world(world).keep_freed_memory(FREED_BYTES_KEPT);
    let mut app = app
        .configure(|settings| config.event_loop.apply(settings))
        .build()
        .map_err(cannot_run)?;

    // The user's own, because his programs come in by it.
    let configured = config.hub.state_dir.as_deref().map(Path::new);
    let places = Places::find(arguments.state_dir.as_deref().or(configured)).map_err(cannot_run)?;
    let uid = nix::unistd::geteuid().as_raw();
    places.check_owner(&*app.cx().world().storage, uid).map_err(cannot_run)?;

    let classes = builder.classes();
    let mut builder: HubBuilder = builder.configure(&config);
    if let Some(state_dir) = &arguments.state_dir {
        builder = builder.state_dir(state_dir);
    }
    let hub = builder.start(app.cx()).map_err(cannot_run)?;
    let manager = ServiceManager::from_environment()
        .inspect_err(|error| tracing::error!("the service manager cannot be told: {error}"))
        .unwrap_or_default();
    let modules = hub.modules;
    let keeper = Keeper::spawn(app.cx(), hub, arguments, classes, manager);
    wait_for_modules(&mut app, modules);
    let mut text = greeting(app.cx(), keeper).map_err(cannot_run)?;
    if restarts > 0 {
        text.push_str(&format!("  restarted   {restarts} times after a crash\n"));
    }
    say(&text);
    Keeper::ready(app.cx(), keeper);
    app.run();
    say("\nskrobot has ended\n");
    Ok(0)
}

/// Pulses until the modules have begun and their channels are there, but not for ever.
fn wait_for_modules(app: &mut SkApp, modules: Handle<Modules>) {
    let begun = app.cx().now();
    let (mut rounds, mut settled) = (0, begun);
    while rounds < ROUNDS_BEFORE_GREETING || app.cx().now() < settled {
        app.pulse();
        let now = app.cx().now();
        if now.since(begun) > GREETING_WITHIN {
            return;
        }
        let list = modules.list(app.cx()).unwrap_or_default();
        let begins =
            |module: &ModuleStatus| matches!(module.state, ModuleState::Beginning | ModuleState::Made);
        if list.iter().any(begins) {
            rounds = 0;
            let slowest = list.iter().filter_map(|module| module.thread).map(|place| place.interval).max();
            settled = now + slowest.unwrap_or_default() * ROUNDS_BEFORE_GREETING;
        } else {
            rounds += 1;
        }
    }
}
