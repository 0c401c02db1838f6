//! Modules: what lives inside a hub, is told what to do by declared parameters, and is kept running.
//!
//! A module is an object that implements [`AbstractModule`]. Its parameters are declared with
//! [`parameters!`](crate::parameters); its way into the network is the [`Flow`] it is given, so the same
//! source runs inside a hub and as a satellite. A [`Runner`] makes it, checks what it is told and contains
//! its errors and panics; a [`ModuleSupervisor`] in the tree, `modules/<name>`, restarts it with back-off.

mod agent;
mod class;
mod error;
mod life;
mod modules;
mod parameter_type;
mod parameters;
mod parameters_macro;
mod restart;
mod runner;
mod satellite;
mod state;
mod supervisor;
mod thread_home;
mod threaded;

pub use crate::flow::Flow;
pub use class::ModuleClass;
pub use error::ModuleError;
pub use modules::Modules;
pub use parameter_type::ParameterType;
pub use parameters::{ParameterError, ParameterInfo, Parameters};
#[doc(hidden)]
pub use parameters::{checked, plain_name};
pub use restart::RestartPolicy;
pub use runner::{AnyRunner, Runner};
pub use satellite::SatelliteRunError;
pub use state::{ModuleState, ModuleStatus};
pub use supervisor::{ModuleOrder, ModuleSupervisor};
pub use thread_home::{ThreadPlace, ThreadedModule};

use crate::object::{Handle, SkObject};
use crate::{Cx, SkVariant};
use std::fmt::Display;

/// What a hub asks of a module.
///
/// **Order.** `new`, then `start` once every module of the hub exists, then any number of `reconfigure` and
/// `control`, at last `stop` and burial; modules stop in the reverse order of their start. A module whose
/// `new` or `start` fails, that panics, or that is buried is begun again from `new` as its
/// [`RestartPolicy`] says; `stop` is not called for it then, `on_destroy` and `Drop` are.
///
/// **Threads.** All of it, the module's slots included, happens on the loop on which the module was made. A
/// module never sees the hub: it talks through its [`Flow`] and its signals. That loop is the hub's, or one on a
/// thread of the module's own ([`ThreadedModule`]); the module's source is the same. On a thread of its own it is
/// made and started beside the others.
///
/// **Time.** None of it may block: the loop of the hub waits meanwhile. Disk, name look-up and long
/// calculations belong on the world's worker or on a thread of the module's own. `stop` is quick: it closes,
/// it does not wait.
///
/// ```
/// use sk_core::{module::*, parameters, prelude::*};
///
/// parameters! {
///     pub struct ClockParameters {
///         /// Time between two readings.
///         period_ms: u64 = 20, 5..=1000, "ms";
///     }
/// }
///
/// pub struct Clock { flow: Flow, timer: Handle<Timer>, parameters: ClockParameters }
/// impl AbstractModule for Clock {
///     const NAME: &'static str = "clock";
///     type Parameters = ClockParameters;
///     type Error = String;
///
///     fn new(cx: &mut Cx, this: Handle<Self>, flow: Flow, parameters: &ClockParameters) -> Result<Self, String> {
///         let timer = cx.under(this).spawn(Timer::default());
///         attach!(cx, timer.timeout => this.read);
///         Ok(Clock { flow, timer, parameters: parameters.clone() })
///     }
///     fn start(&mut self, cx: &mut Cx) -> Result<(), String> {
///         let period = Duration::from_millis(self.parameters.period_ms);
///         self.timer.start(cx, period).map_err(|error| error.to_string())
///     }
///     fn reconfigure(&mut self, cx: &mut Cx, parameters: &ClockParameters) -> Result<(), String> {
///         self.parameters = parameters.clone();
///         self.start(cx)
///     }
/// }
/// impl Clock {
///     fn read(&mut self, cx: &mut Cx) {
///         let now = cx.now();
///         self.flow.publish(cx, "now", now);
///     }
/// }
/// object! { Clock { slots { read() } } }
/// ```
pub trait AbstractModule: SkObject + Sized {
    /// What the module is called where nobody says otherwise: in paths, in the configuration and before the
    /// names of its channels.
    const NAME: &'static str;
    /// What it can be told: made by [`parameters!`](crate::parameters), or `()`.
    type Parameters: Parameters;
    /// What its steps fail with.
    type Error: Display + From<String>;

    /// Makes the module. `this` is its handle already: for links and for children. Other modules need not
    /// exist yet, so nothing is begun here.
    ///
    /// # Errors
    /// The module cannot be. What was made below `this` is buried.
    fn new(
        cx: &mut Cx,
        this: Handle<Self>,
        flow: Flow,
        parameters: &Self::Parameters,
    ) -> Result<Self, Self::Error>;

    /// Begins the work; all modules exist now.
    ///
    /// # Errors
    /// The module cannot work. It is buried.
    fn start(&mut self, _cx: &mut Cx) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Takes over changed parameters while it runs. They are checked against their declaration and differ
    /// from the present ones.
    ///
    /// # Errors
    /// These parameters cannot be had. The module goes on with the old ones, so it must not have taken over
    /// a part of the new ones.
    fn reconfigure(&mut self, cx: &mut Cx, parameters: &Self::Parameters) -> Result<(), Self::Error>;

    /// Does what an operator asks for and answers.
    ///
    /// # Errors
    /// The module refuses, as it does by default: it knows no command.
    fn control(&mut self, _cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, Self::Error> {
        Err(format!("no command {}", parameters::shortened(&command.to_string())).into())
    }

    /// Ends the work, quickly. The module is buried at the end of the round.
    fn stop(&mut self, _cx: &mut Cx) {}
}
