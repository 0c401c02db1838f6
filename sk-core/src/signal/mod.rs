//! Signals, slots and the links between them.

mod by_name;
mod call;
mod link;
mod mode;
#[expect(clippy::module_inception, reason = "the type the folder is about")]
mod signal;
mod slot;
mod topology;

pub use by_name::{Convertible, Crossable, Described, FixedConversion, ObjectInfo, Prepared, Staying};
pub use call::{Bound, Call, Reached, bind_exact, bind_ref, bind_slice, bind_str};
pub(crate) use link::{LinkLosses, Links, OnceCall, QueuedCall};
pub use mode::{AttachMode, Delivery, Direct, Latest, LinkShape, Mode, Once, OneShot, Queued};
pub use signal::{AnySignal, LinkInfo, Signal};
pub(crate) use signal::{Attached, Order};
pub use slot::{IntoOutcome, Outcome, SignalMeta, SignalRef, SlotFor, SlotMeta, SlotRef, SlotTag};
pub(crate) use topology::{LinkKey, Rewire, Wish};
pub use topology::{Target, attach, attach_ignoring, detach};
