//! SpecialK's framework: event loops that pulse, objects in trees, signals and slots.
//!
//! One [`SkEventLoop`] per thread pulses three ticks. Objects are plain structs that live in trees owned by
//! their loop, are named by [`Handle`]s and die by [`Cx::destroy_later`]. They talk through signals and
//! slots, linked with [`attach!`] and [`detach!`]: directly, queued, or to another thread. There is no
//! mutex in user code.
//!
//! ```
//! use sk_core::prelude::*;
//!
//! #[derive(Default)]
//! struct Counter { ticks: u64, third: Signal<u64> }
//! impl Counter {
//!     fn on_tick(&mut self, cx: &mut Cx) {
//!         self.ticks += 1;
//!         if self.ticks.is_multiple_of(3) { self.third.emit(cx, self.ticks) }
//!     }
//! }
//! object! { Counter { signals { third(u64) } slots { on_tick() } } }
//!
//! struct Printer;
//! impl Printer {
//!     fn show(&mut self, cx: &mut Cx, n: u64) { println!("{n} ticks"); cx.quit() }
//! }
//! object! { Printer { slots { show(u64) } } }
//!
//! let mut app = SkApp::builder().interval(Duration::from_millis(1)).build()?;
//! let cx = app.cx();
//! let counter = cx.spawn(Counter::default());
//! let printer = cx.spawn(Printer);
//! attach!(cx, cx.fast_zone().pulse => counter.on_tick);
//! attach!(cx, counter.third => printer.show, Queued);
//! app.run();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![deny(unsafe_code)]

pub mod eventloop;
pub mod flow;
pub mod module;
pub mod net;
pub mod object;
pub mod signal;
mod sys;
pub mod testing;
pub mod thread;
pub mod world;

pub use eventloop::{Cx, SkApp, SkEventLoop, Timer, TimingMode};
pub use flow::{SkFlowSat, SkFlowServer};
pub use net::{CloseReason, Datagrams, Listener, Socket, WriteError};
pub use object::{Access, Address, Handle, MetaError, ObjectId, SkObject};
pub use signal::{Mode, Signal};
pub use sk_flat::{Instant, SkElapsedTime, SkVariant};
pub use thread::{Remote, SkThread};

/// Everything a program needs: `use sk_core::prelude::*;`.
pub mod prelude {
    pub use crate::eventloop::{
        AppError, Cx, LoopSettings, Pulse, Run, SkApp, SkEventLoop, Sketch, Timer, TimingMode,
    };
    pub use crate::net::{CloseReason, Datagrams, Listener, Socket, WriteError};
    pub use crate::object::{Access, Address, Handle, MetaError, ObjectId, SkObject};
    pub use crate::signal::{Direct, Latest, Mode, OneShot, Queued, Signal};
    pub use crate::thread::{Remote, SkThread, ThreadError};
    pub use crate::world::Endpoint;
    pub use crate::{attach, detach, object};
    pub use sk_flat::{Instant, SkElapsedTime, SkVariant};
    pub use std::rc::Rc;
    pub use std::time::Duration;
}

/// What the macros expand to; not for use by hand.
#[doc(hidden)]
pub mod macro_support {
    pub use crate::module::{checked, plain_name};
    pub use crate::object::{
        Extends, Itself, Node, Project, Through, assert_distinct, has_hooks, member_uid,
    };
    pub use crate::signal::{
        AnySignal, Bound, Convertible, Crossable, Described, FixedConversion, IntoOutcome, Outcome,
        SignalMeta, SignalRef, SlotFor, SlotMeta, SlotRef, SlotTag, Staying, attach, attach_ignoring,
        bind_exact, bind_ref, bind_slice, bind_str, detach,
    };
    pub use sk_flat::IntoVariant;
}

/// Runs the programs of the guide.
#[cfg(doctest)]
#[doc = include_str!("../../docs/guide/objects.md")]
struct Guide;

/// Runs the program of the page on timing.
#[cfg(doctest)]
#[doc = include_str!("../../docs/guide/timing.md")]
struct Timing;
