//! SkRobot: the hub, assembled from modules.
//!
//! The binary `skrobot` is this library with a command line. A program that wants a hub of its own inside
//! builds one with [`Hub::builder`], with modules of its own beside the built-in ones:
//!
//! ```
//! use sk_core::flow::Flow;
//! use sk_core::module::AbstractModule;
//! use sk_core::prelude::*;
//! use sk_robot::{Hub, registry};
//!
//! struct Beacon { flow: Flow, on: bool }
//! impl AbstractModule for Beacon {
//!     const NAME: &'static str = "beacon";
//!     type Parameters = ();
//!     type Error = String;
//!     fn new(cx: &mut Cx, this: Handle<Self>, flow: Flow, _: &()) -> Result<Self, String> {
//!         attach!(cx, cx.one_sec_zone().pulse => this.blink);
//!         Ok(Beacon { flow, on: false })
//!     }
//!     fn reconfigure(&mut self, _cx: &mut Cx, _: &()) -> Result<(), String> { Ok(()) }
//! }
//! impl Beacon {
//!     fn blink(&mut self, cx: &mut Cx) {
//!         self.on = !self.on;
//!         self.flow.publish(cx, "light", self.on);
//!     }
//! }
//! object! { Beacon { slots { blink() } } }
//!
//! let folder = std::env::temp_dir().join(format!("skrobot-lib-doc-{}", std::process::id()));
//! let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
//! let hub = registry::builtin(Hub::builder()).module::<Beacon>().state_dir(&folder).no_tcp();
//! let hub = hub.start(app.cx())?;
//! assert!(hub.failures().is_empty());
//! // app.run() would pulse until Ctrl-C.
//! hub.stop(app.cx());
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod config;
mod hint;
pub mod hub;
mod hub_error;
mod listening;
pub mod logging;
pub mod module_service;
pub mod notify;
pub mod owner;
pub mod places;
pub mod registry;
mod reload;
mod run;
pub mod supervise;

pub use hub::{Hub, HubBuilder, HubError};
pub use run::{FREED_BYTES_KEPT, RunError};

/// Runs the programs of the guide.
#[cfg(doctest)]
#[doc = include_str!("../../docs/guide/hub.md")]
struct Guide;

/// Runs the programs of the page on modules.
#[cfg(doctest)]
#[doc = include_str!("../../docs/guide/modules.md")]
struct Modules;
