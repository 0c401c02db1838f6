//! Keeps the hub: hears the operating system, reads the configuration again, tells the service manager.

use crate::arguments::Arguments;
use sk_core::module::ModuleClass;
use sk_core::prelude::*;
use sk_core::world::OsSignal;
use sk_robot::Hub;
use sk_robot::config::Config;
use sk_robot::notify::{self, ServiceManager};
use std::io::IsTerminal;

/// A configuration that was read again, or why not.
#[derive(Clone)]
pub struct Loaded(Result<Config, String>);

/// The hub's own program around the hub.
pub struct Keeper {
    hub: Hub,
    arguments: Arguments,
    classes: Vec<ModuleClass>,
    manager: Option<ServiceManager>,
    sign: Handle<Timer>,
    /// A worker reads the configuration.
    reading: bool,
    /// It was asked for again meanwhile: what the worker reads may be old already.
    read_again: bool,
    /// It was started from a terminal, whose end is also told by SIGHUP.
    had_terminal: bool,
}

object! {
    pub Keeper { slots { on_signal(OsSignal) on_loaded(&Loaded) on_sign() on_ended() } }
}

impl Keeper {
    pub fn spawn(
        cx: &mut Cx,
        hub: Hub,
        arguments: Arguments,
        classes: Vec<ModuleClass>,
        manager: Option<ServiceManager>,
    ) -> Handle<Keeper> {
        let server = hub.server;
        cx.spawn_with(|cx, this: Handle<Keeper>| {
            attach!(cx, cx.event_loop().os_signal => this.on_signal);
            attach!(cx, server.ended => this.on_ended);
            let watch = cx.watch(server);
            attach!(cx, watch.buried => this.on_ended());
            let sign = cx.under(this).spawn(Timer::default());
            attach!(cx, sign.timeout => this.on_sign);
            let had_terminal = std::io::stdin().is_terminal();
            let (reading, read_again) = (false, false);
            Keeper { hub, arguments, classes, manager, sign, reading, read_again, had_terminal }
        })
    }

    pub fn hub(&self) -> &Hub {
        &self.hub
    }

    /// The hub serves: the service manager is told, and from now on hears signs of life if it wants them.
    pub fn ready(cx: &mut Cx, keeper: Handle<Keeper>) {
        // It is spawned and nobody destroys it.
        let _ = cx.with(keeper, |keeper, cx| {
            keeper.tell("READY=1\nSTATUS=pulsing");
            match notify::watchdog_period().filter(|_| keeper.manager.is_some()) {
                Some(period) => keeper.sign.start(cx, period / 2),
                None => Ok(()),
            }
        });
    }

    fn tell(&self, lines: &str) {
        if let Some(manager) = &self.manager
            && let Err(error) = manager.tell(lines)
        {
            tracing::warn!("the service manager was not told {lines:?}: {error}");
        }
    }

    fn on_signal(&mut self, cx: &mut Cx, signal: OsSignal) -> std::io::Result<()> {
        let terminal_is_gone = self.had_terminal && !std::io::stdin().is_terminal();
        if signal == OsSignal::HangUp && !terminal_is_gone {
            self.reload(cx);
            return Ok(());
        }
        tracing::info!(?signal, "ending; a second signal ends at once");
        self.tell("STOPPING=1\nSTATUS=ending");
        // First, so that a module that hangs while it stops cannot hold it up.
        let released = cx.world().net.release_os_signals();
        if !self.hub.stop(cx) {
            cx.quit();
        }
        released
    }

    /// The file is read away from the loop, by one worker at a time: two could end in any order.
    fn reload(&mut self, cx: &mut Cx) {
        if self.reading {
            self.read_again = true;
            return;
        }
        tracing::info!("reading the configuration again");
        let (arguments, classes) = (self.arguments.clone(), self.classes.clone());
        let storage = cx.world().storage.clone();
        let job = move || Loaded(arguments.config(&*storage, &classes));
        let this = cx.this(self);
        match cx.work(job, this.slots().on_loaded()) {
            Ok(()) => self.reading = true,
            Err(error) => tracing::error!("the configuration stays as it is: {error}"),
        }
    }

    fn on_loaded(&mut self, cx: &mut Cx, loaded: &Loaded) {
        self.reading = false;
        if std::mem::take(&mut self.read_again) {
            self.reload(cx);
            return;
        }
        match &loaded.0 {
            Err(error) => tracing::error!("the configuration stays as it is:\n{error}"),
            Ok(config) => {
                let later = self.hub.reconfigure(cx, config);
                if later.is_empty() {
                    tracing::info!("the configuration is taken over");
                } else {
                    let later = later.join(", ");
                    tracing::warn!(
                        "the configuration is taken over; what changes when the hub is started again: {later}"
                    );
                }
            }
        }
    }

    fn on_sign(&mut self, _cx: &mut Cx) {
        self.tell("WATCHDOG=1");
    }

    fn on_ended(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}
