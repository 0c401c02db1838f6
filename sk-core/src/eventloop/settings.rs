//! How a loop keeps time and what it does when things go wrong.

pub use crate::sys::sched::Policy as SchedulingPolicy;
use std::time::Duration;

/// The interval of the fast tick unless told otherwise.
pub const INTERVAL_DEFAULT: Duration = Duration::from_millis(10);
/// The interval of the slow tick unless told otherwise.
pub const SLOW_INTERVAL_DEFAULT: Duration = Duration::from_millis(250);

/// How a loop waits between ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TimingMode {
    /// A relative sleep of one interval, as the papers' `usleep`: lightest, and it loses time, because the
    /// job's own time and the kernel's delay come on top of every interval.
    #[default]
    Coarse,
    /// An absolute schedule, start + k · interval: sleep until shortly before, then spin to the deadline.
    /// No drift, microsecond precision, some per cent of a core.
    Realtime,
    /// Sleep until a socket is ready, a message of another thread arrives or a timer is due, and one
    /// interval at most. Traffic makes it pulse earlier.
    SelectIo,
    /// As `SelectIo`, but a round is a tick only when a sync source says so: the interval is the source's, not the
    /// loop's own. A sync tick that comes in makes the next round a tick, begun without waiting; every other
    /// round has none. Four intervals without one are counted as `sync_lost`. A satellite goes into this mode
    /// and back by itself; see [`sync_to`](crate::object::Handle#method.sync_to).
    Synced,
    /// No wait: a blocking call of the user's own sets the pace. Without one the loop spins.
    NoTiming,
}

/// What a loop with an absolute schedule does when a round took longer than an interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Overrun {
    /// Leave out the ticks that were missed, count them, and keep the phase.
    #[default]
    Skip,
    /// Make up for missed ticks without a wait between them, up to this many at a time.
    CatchUp(u32),
}

/// What happens to an object whose slot failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AfterFailure {
    /// Go on as if nothing had happened; the failure is counted, logged and signalled all the same.
    GoOn,
    /// `destroy_later` the object.
    Destroy,
    /// End the loop.
    Stop,
}

/// What a `Realtime` loop asks of the operating system. What is refused is logged at start and shows in the
/// statistics; the loop runs all the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RealtimeWishes {
    /// How the kernel shall choose this thread among others. A real-time class needs CAP_SYS_NICE or an
    /// rtprio limit; a thread that then runs for half a second without a sleep is put back into the normal
    /// class, so that it cannot hang the machine.
    pub policy: SchedulingPolicy,
    /// Run on this CPU only.
    pub cpu: Option<usize>,
    /// Lock all memory (`mlockall`), so that no page fault delays a tick.
    pub lock_memory: bool,
    /// Hold `/dev/cpu_dma_latency` at 0 so that idle CPUs wake at once. Needs write access to it, costs power.
    pub no_cpu_sleep: bool,
}

/// Everything a loop can be told. Mode and intervals can be changed while it runs; from the next round on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoopSettings {
    /// How it waits.
    pub mode: TimingMode,
    /// The interval of the fast tick.
    pub interval: Duration,
    /// The interval of the slow tick; never below the fast one.
    pub slow_interval: Duration,
    /// What happens after a round that was too long.
    pub overrun: Overrun,
    /// How long `Realtime` spins at most before each deadline. The spin follows the wake errors it sees, up to
    /// this: what lies beyond is lateness of the tick. `None`: a sixteenth of the interval or 64 µs, whichever is
    /// longer, so that precision costs some per cent of a core even on a noisy machine. Never more than half the
    /// interval; zero is no spin at all.
    pub spin_max: Option<Duration>,
    /// What `Realtime` asks of the operating system.
    pub realtime: RealtimeWishes,
    /// After a slot answered `Err`.
    pub after_error: AfterFailure,
    /// After a slot panicked: the innermost object of the chain.
    pub after_panic: AfterFailure,
    /// How many calls the local queue holds.
    pub queue_calls_max: usize,
    /// How many messages of other threads wait at most; and as many answers that were asked for.
    pub mailbox_messages_max: usize,
    /// How many requests to attach or detach wait for the end of a round.
    pub rewires_max: usize,
}

/// How many requests to attach or detach a loop keeps unless told otherwise: enough to build a program of a
/// million objects in one go.
const REWIRES_MAX: usize = 1 << 22;

impl Default for LoopSettings {
    fn default() -> Self {
        LoopSettings {
            mode: TimingMode::default(),
            interval: INTERVAL_DEFAULT,
            slow_interval: SLOW_INTERVAL_DEFAULT,
            overrun: Overrun::default(),
            spin_max: None,
            realtime: RealtimeWishes::default(),
            after_error: AfterFailure::GoOn,
            after_panic: AfterFailure::Destroy,
            queue_calls_max: 65_536,
            mailbox_messages_max: crate::thread::MAILBOX_MESSAGES_MAX,
            rewires_max: REWIRES_MAX,
        }
    }
}

impl LoopSettings {
    /// Checks the relations between the settings.
    pub(crate) fn check(&self) -> Result<(), SettingsError> {
        if self.interval.is_zero() {
            return Err(SettingsError::ZeroInterval);
        }
        if self.slow_interval < self.interval {
            return Err(SettingsError::SlowBelowFast { slow: self.slow_interval, fast: self.interval });
        }
        Ok(())
    }
}

/// Why settings were refused. The loop goes on with the old ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// A loop has to know how long to wait.
    #[error("the interval is zero: take TimingMode::NoTiming for a loop that never waits")]
    ZeroInterval,
    /// The slow tick is derived from the fast one and cannot be faster.
    #[error("the slow interval ({slow:?}) is below the fast one ({fast:?})")]
    SlowBelowFast {
        /// What was asked for.
        slow: Duration,
        /// The fast interval.
        fast: Duration,
    },
}
