//! A module as a program of its own: a satellite.

use crate::eventloop::AppError;
use crate::flow::{AddressError, PipeSeed, SkFlowSat};
use crate::module::{AbstractModule, ModuleState, Modules, RestartPolicy, Runner};
use crate::object::{Handle, NameError};
use crate::{Cx, SkApp, TimingMode, attach};

/// Why a satellite does not run, or ran no further.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SatelliteRunError {
    /// The hub's address was not understood.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// There can be no loop.
    #[error(transparent)]
    App(#[from] AppError),
    /// The module's name cannot be that of an object.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The module failed and was given up; carries the reason.
    #[error("the module is given up: {0}")]
    GivenUp(String),
}

/// Ends the program when its one module is given up.
#[derive(Default)]
struct Fate {
    given_up: Option<String>,
}

impl Fate {
    fn on_changed(&mut self, cx: &mut Cx, state: &ModuleState) {
        if let ModuleState::Failed { reason, retry_at: None } = state {
            self.given_up = Some(reason.clone());
            cx.quit();
        }
    }
}

crate::object! { Fate { signals {} slots { on_changed(&ModuleState) } } }

impl SkFlowSat {
    /// A satellite inside the hub's process for a module of this name: its flow is called
    /// `account.modules.NAME`, so that the hub's tools show whose it is.
    pub fn of_module(cx: &mut Cx, seed: PipeSeed, module: &str) -> Handle<SkFlowSat> {
        let satellite = SkFlowSat::inside(cx, seed);
        if let Err(error) = satellite.name_flow(cx, &format!("modules.{module}")) {
            tracing::warn!("the flow of module {module} stays without a name: {error}");
        }
        satellite
    }

    /// Runs a module as a satellite of the hub at that address, with its default parameters, until it quits
    /// the loop or the process is told to end. The same source runs inside a hub. A `unix:` address logs in
    /// by the user id of the process.
    ///
    /// It does not wait for the hub: it connects in the background, and again whenever the hub was lost.
    ///
    /// # Errors
    /// The address is none, or the module failed as often as the default [`RestartPolicy`] lets it.
    pub fn run<M: AbstractModule>(address: &str) -> Result<(), SatelliteRunError> {
        let address = address.parse()?;
        let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
        let cx = app.cx();
        let hub = SkFlowSat::connect(cx, &address);
        let modules = Modules::spawn(cx);
        let runner = Runner::<M>::new(hub.flow(M::NAME), M::Parameters::default());
        let supervisor = modules.add(cx, runner, RestartPolicy::default())?;
        let fate = cx.spawn(Fate::default());
        attach!(cx, supervisor.changed => fate.on_changed);
        modules.start(cx);
        app.run();
        // Nobody destroys it, so it is there.
        let given_up = app.cx().with(fate, |fate, _| fate.given_up.take());
        given_up
            .ok()
            .flatten()
            .map_or(Ok(()), |reason| Err(SatelliteRunError::GivenUp(reason)))
    }
}
