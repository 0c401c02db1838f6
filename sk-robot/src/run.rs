//! A whole program that is a hub: started, run until it is told to end, and ended in good order.

use crate::hub::{Hub, HubBuilder, HubError};
use sk_core::prelude::*;
use sk_core::world::OsSignal;

/// How much freed memory stays with the process of a hub: what streams have under way comes and goes many times a second,
/// and should find its pages again. See [`keep_freed_memory`](sk_core::eventloop::SkAppBuilder::keep_freed_memory).
pub const FREED_BYTES_KEPT: usize = 16 * 1024 * 1024;

/// Why a hub did not run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// There can be no loop.
    #[error(transparent)]
    App(#[from] AppError),
    /// The hub could not be started.
    #[error(transparent)]
    Hub(#[from] HubError),
}

/// Ends the hub in good order at the first signal of the operating system. The second one ends the process.
struct Farewell {
    hub: Hub,
}

object! { Farewell { slots { on_signal(OsSignal) on_ended() } } }

impl Farewell {
    fn on_signal(&mut self, cx: &mut Cx, signal: OsSignal) -> std::io::Result<()> {
        tracing::info!(?signal, "ending; a second signal ends at once");
        // First, so that a module that hangs while it stops cannot hold it up.
        let released = cx.world().net.release_os_signals();
        if !self.hub.stop(cx) {
            cx.quit();
        }
        released
    }

    fn on_ended(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}

impl HubBuilder {
    /// Starts the hub and runs it until Ctrl-C or SIGTERM: a `main` of one line. A second signal ends the process
    /// at once.
    ///
    /// ```no_run
    /// use sk_robot::{Hub, registry};
    /// registry::builtin(Hub::builder()).run()?;
    /// # Ok::<(), sk_robot::RunError>(())
    /// ```
    ///
    /// # Errors
    /// If there can be no loop, or as [`start`](HubBuilder::start).
    pub fn run(self) -> Result<(), RunError> {
        let event_loop = self.config().event_loop.clone();
        let app = SkApp::builder().name("hub").keep_freed_memory(FREED_BYTES_KEPT);
        let mut app = app.configure(|settings| event_loop.apply(settings)).build()?;
        let hub = self.start(app.cx())?;
        for address in hub.addresses() {
            tracing::info!("the hub listens on {address}");
        }
        let server = hub.server;
        app.cx().spawn_with(|cx, this: Handle<Farewell>| {
            attach!(cx, cx.event_loop().os_signal => this.on_signal);
            attach!(cx, server.ended => this.on_ended);
            let watch = cx.watch(server);
            attach!(cx, watch.buried => this.on_ended());
            Farewell { hub }
        });
        app.run();
        Ok(())
    }
}
