//! What a loop knows of itself: always on, read as a snapshot.

use crate::eventloop::{Distribution, Histogram, TimingMode};
use sk_flat::Instant;
use std::time::Duration;

/// The steps of a round that do work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Step {
    /// 2: the pulses of the zones.
    Tick,
    /// 3: messages of other threads.
    Inbox,
    /// 4: ready sockets.
    Io,
    /// 5: timers.
    Timers,
    /// 6: queued calls.
    Queued,
    /// 7: what is to be written is written.
    Flush,
    /// 8: attach and detach.
    Rewire,
    /// 9: what was destroyed is buried.
    Bury,
}

impl Step {
    /// All of them, in the order of the round.
    pub const ALL: [Step; 8] = [
        Step::Tick,
        Step::Inbox,
        Step::Io,
        Step::Timers,
        Step::Queued,
        Step::Flush,
        Step::Rewire,
        Step::Bury,
    ];
}

/// What is counted, since the loop began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counters {
    /// Direct calls that waited because their object was busy.
    pub parked: u64,
    /// Direct calls that were queued because emits were nested too deep.
    pub deepened: u64,
    /// Calls to objects that were marked or buried.
    pub gone: u64,
    /// Attach requests for a pair that was linked already.
    pub duplicates: u64,
    /// Calls of `Latest` links that a newer one replaced.
    pub replaced: u64,
    /// Calls refused because a queue or a mailbox was full.
    pub refused_full: u64,
    /// Links made.
    pub links_made: u64,
    /// Requests that could not be carried out: an end was gone, the types differ, or too many requests
    /// waited here or at the loop of the signal.
    pub links_refused: u64,
    /// Requests by name of other threads that were wrong.
    pub refused_by_name: u64,
    /// Slots that answered `Err` or panicked.
    pub failures: u64,
    /// Slots that panicked.
    pub panics: u64,
    /// Slots that did not run because one before them in the same `emit` panicked.
    pub skipped: u64,
    /// Messages taken from other threads.
    pub messages: u64,
    /// Queued calls that ran.
    pub queued_calls: u64,
    /// Timers that fired.
    pub timers_fired: u64,
    /// Objects buried.
    pub buried: u64,
    /// How often a `Synced` loop waited four intervals for a tick of its source that did not come.
    pub sync_lost: u64,
}

/// A snapshot of a loop's statistics.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LoopStats {
    /// The loop's name.
    pub name: String,
    /// How it waits.
    pub mode: TimingMode,
    /// The interval asked for.
    pub interval: Duration,
    /// Rounds since the beginning.
    pub rounds: u64,
    /// Rounds that were ticks.
    pub ticks: u64,
    /// Ticks left out because a round took too long.
    pub missed: u64,
    /// Rounds that took longer than an interval.
    pub overruns: u64,
    /// Mean time between ticks.
    pub mean_interval: Duration,
    /// How late ticks came. Empty in `SelectIo` and `NoTiming`, which promise no moment.
    pub wake_error: Distribution,
    /// How long the work of a round took.
    pub job_time: Distribution,
    /// Time spent in each step, in the order of [`Step::ALL`].
    pub step_time: [Duration; Step::ALL.len()],
    /// Most calls that ever waited in the local queue.
    pub queue_depth_max: usize,
    /// Calls that wait now.
    pub queue_depth: usize,
    /// Objects that live, those of the loop itself included.
    pub objects: u32,
    /// Buried objects whose shells are still held by links.
    pub shells: u32,
    /// What was counted.
    pub counters: Counters,
    /// How often a real-time thread of this process ran too long without a sleep and was put back into the
    /// normal class.
    pub demotions: u64,
    /// What a `Realtime` loop asked of the operating system and was refused.
    pub refused_wishes: Vec<String>,
}

/// The running sums behind [`LoopStats`].
pub(crate) struct Measures {
    pub wake_error: Histogram,
    pub job_time: Histogram,
    pub step_time: [Duration; Step::ALL.len()],
    pub first_tick: Option<Instant>,
    pub last_tick: Instant,
    pub rounds: u64,
    pub ticks: u64,
    pub missed: u64,
    pub overruns: u64,
    pub queue_depth_max: usize,
}

impl Measures {
    pub(crate) fn new() -> Measures {
        Measures {
            wake_error: Histogram::new(),
            job_time: Histogram::new(),
            step_time: Default::default(),
            first_tick: None,
            last_tick: Instant::ZERO,
            rounds: 0,
            ticks: 0,
            missed: 0,
            overruns: 0,
            queue_depth_max: 0,
        }
    }

    pub(crate) fn mean_interval(&self) -> Duration {
        match (self.first_tick, self.ticks) {
            (Some(first), 2..) => {
                let gaps = u32::try_from(self.ticks - 1).unwrap_or(u32::MAX);
                self.last_tick.since(first) / gaps
            }
            _ => Duration::ZERO,
        }
    }

    /// Begins anew, when mode or interval have changed.
    pub(crate) fn restart(&mut self) {
        let (rounds, ticks) = (self.rounds, self.ticks);
        self.wake_error.clear();
        self.job_time.clear();
        self.first_tick = None;
        self.rounds = rounds;
        self.ticks = ticks;
    }
}
