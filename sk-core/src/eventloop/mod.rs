//! The event loop: one per thread, pulsing.

mod app;
mod burial;
mod cx;
mod dispatch;
mod histogram;
mod messages;
mod poll;
mod pulse;
mod queue;
mod settings;
mod sk_event_loop;
mod sketch;
mod stats;
mod timer;
mod wait;
mod work;
mod zone;

pub(crate) use app::step;
pub use app::{AppError, Run, SkApp, SkAppBuilder};
pub use cx::{Cx, Spawner};
pub(crate) use dispatch::note_skipped;
pub use histogram::{Distribution, Histogram};
pub(crate) use poll::{Dispatch, OS_SIGNALS_TOKEN};
pub use pulse::Pulse;
pub use settings::{
    AfterFailure, INTERVAL_DEFAULT, LoopSettings, Overrun, RealtimeWishes, SLOW_INTERVAL_DEFAULT,
    SchedulingPolicy, SettingsError, TimingMode,
};
pub use sk_event_loop::{Failure, Overload, Reason, Refusal, SkEventLoop, Watch};
pub use sketch::{Sketch, SketchObject};
pub use stats::{Counters, LoopStats, Step};
pub use timer::Timer;
pub use wait::Plan;
pub use work::WorkError;
pub use zone::Zone;
