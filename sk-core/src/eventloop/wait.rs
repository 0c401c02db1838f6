//! Step 1: how long to wait for the next round, and the wait itself.

use crate::Cx;
use crate::eventloop::{Overload, TimingMode};
use crate::sys::{self, sched::Policy};
use sk_flat::{Instant, SkElapsedTime};
use std::time::Duration;

/// The spin before a deadline is never shorter than this.
const MARGIN_MIN: Duration = Duration::from_micros(20);
/// What it is before anything was measured.
const MARGIN_FIRST: Duration = Duration::from_micros(100);
/// A spin is this part of the interval at most, unless the settings say otherwise: some per cent of a core are
/// what precision costs, and on a host with heavy outliers their percentile would cost far more.
const SPIN_SHARE: u32 = 16;
/// The least that limit is: below an interval of a millisecond a share would be shorter than common wake errors.
const SPIN_MAX_LEAST: Duration = Duration::from_micros(64);
/// How many wake errors the margin follows.
const ERRORS_KEPT: usize = 256;
/// After how many new ones it is computed anew.
const ERRORS_PER_UPDATE: u32 = 64;
/// A real-time thread that runs this long without a sleep is put back into the normal class.
const REALTIME_RUN_MAX: Duration = Duration::from_millis(500);
/// How often a spinning loop looks into its inbox: a look takes the cache lines that a sender is writing.
const LOOK_EVERY: Duration = Duration::from_micros(2);
/// From here to the deadline nothing is done but looking at the clock.
const LAST_STRETCH: Duration = Duration::from_nanos(500);
/// How often a loop that does not sleep in a poll looks for POSIX signals.
const OS_SIGNALS_EVERY: Duration = Duration::from_millis(50);

/// After how many intervals without a tick the source of a `Synced` loop counts as lost.
const SYNC_TIMEOUT_INTERVALS: u32 = 4;

/// What the next wait is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// None: work is left over, or the mode never waits.
    Now {
        /// Whether the round is a tick.
        tick: bool,
    },
    /// A relative sleep.
    Sleep(Duration),
    /// An absolute moment of the schedule.
    At(Instant),
    /// Readiness, a message, or this moment.
    Io(Instant),
}

/// The state of a loop's timekeeping.
pub(crate) struct Pacing {
    pub next_due: Instant,
    pub last_tick: Instant,
    pub slow: SkElapsedTime,
    pub one_sec: SkElapsedTime,
    /// Mode or interval were changed: the schedule begins anew.
    pub changed: bool,
    pub refused: Vec<String>,
    pub overload: Option<Overload>,
    pub overload_told: bool,
    pub overload_quiet_at: Instant,
    /// A sync tick came in: the next round of a `Synced` loop is a tick.
    pub sync_ticked: bool,
    /// The last sync tick, or when the wait for one began anew.
    sync_since: Instant,
    margin: Margin,
    prepared_for: Option<TimingMode>,
    /// Held as long as the loop lives.
    wake_latency: Option<sys::latency::WakeLatencyHeld>,
    os_signals_looked: SkElapsedTime,
    pub os_signals: Option<Box<dyn crate::world::OsSignals>>,
}

impl Pacing {
    pub(crate) fn new(now: Instant) -> Pacing {
        Pacing {
            next_due: now,
            last_tick: now,
            slow: SkElapsedTime::started(now),
            one_sec: SkElapsedTime::started(now),
            changed: true,
            refused: Vec::new(),
            overload: None,
            overload_told: false,
            overload_quiet_at: now,
            sync_ticked: false,
            sync_since: now,
            margin: Margin::new(),
            prepared_for: None,
            wake_latency: None,
            os_signals_looked: SkElapsedTime::started(now),
            os_signals: None,
        }
    }
}

/// How long before a deadline the sleep ends and the spin begins: the 99th percentile of the recent wake
/// errors, so that rare outliers do not burn the processor, within the limits of [`spin_max`].
struct Margin {
    errors_ns: [u32; ERRORS_KEPT],
    count: u32,
    span: Duration,
}

impl Margin {
    fn new() -> Margin {
        Margin { errors_ns: [0; ERRORS_KEPT], count: 0, span: MARGIN_FIRST }
    }

    fn note(&mut self, error: Duration) {
        let ns = u32::try_from(error.as_nanos()).unwrap_or(u32::MAX);
        self.errors_ns[self.count as usize % ERRORS_KEPT] = ns;
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(ERRORS_PER_UPDATE) {
            let known = ERRORS_KEPT.min(self.count as usize);
            let mut sorted = self.errors_ns;
            let (_, p99, _) = sorted[..known].select_nth_unstable((known * 99) / 100);
            self.span = (Duration::from_nanos(u64::from(*p99)) + MARGIN_MIN / 2).max(MARGIN_MIN);
        }
    }

    fn within(&self, limit: Duration) -> Duration {
        self.span.min(limit)
    }
}

/// How long a loop spins at most before a deadline: what it was told or a share of the interval, and never more
/// than half of it.
fn spin_max(told: Option<Duration>, interval: Duration) -> Duration {
    told.unwrap_or_else(|| (interval / SPIN_SHARE).max(SPIN_MAX_LEAST))
        .min(interval / 2)
}

impl Cx {
    /// What the next wait is. The schedule of a new mode or interval begins here.
    pub(crate) fn plan(&mut self) -> Plan {
        let interval = self.settings.interval;
        if self.pacing.changed {
            self.pacing.changed = false;
            self.pacing.next_due = self.world.clock.now();
            self.pacing.sync_since = self.pacing.next_due;
            self.measures.restart();
        }
        match self.settings.mode {
            TimingMode::NoTiming => Plan::Now { tick: true },
            TimingMode::Coarse => Plan::Sleep(interval),
            TimingMode::Realtime => {
                self.pacing.next_due += interval;
                Plan::At(self.pacing.next_due)
            }
            TimingMode::SelectIo => self.plan_io(interval),
            TimingMode::Synced => self.plan_synced(interval),
        }
    }

    fn plan_synced(&mut self, interval: Duration) -> Plan {
        if std::mem::take(&mut self.pacing.sync_ticked) {
            return Plan::Now { tick: true };
        }
        if self.has_work_left() {
            return Plan::Now { tick: false };
        }
        let lost_at = self.pacing.sync_since + interval * SYNC_TIMEOUT_INTERVALS;
        Plan::Io(self.timers.next_due().map_or(lost_at, |timer| timer.min(lost_at)))
    }

    /// Whether a round after a wait for readiness is a tick.
    pub(crate) fn ticks_after_io(&self) -> bool {
        self.settings.mode != TimingMode::Synced
    }

    /// At the beginning of each round of a `Synced` loop.
    pub(crate) fn note_sync(&mut self, tick: bool, now: Instant) {
        if tick {
            self.pacing.sync_since = now;
        } else if now.since(self.pacing.sync_since) >= self.settings.interval * SYNC_TIMEOUT_INTERVALS {
            self.pacing.sync_since = now;
            self.counters.sync_lost += 1;
            self.news.push_back(crate::eventloop::sk_event_loop::News::SyncLost);
        }
    }

    fn plan_io(&self, interval: Duration) -> Plan {
        let tick_due = self.pacing.last_tick + interval;
        if self.has_work_left() && self.pulse.now < tick_due {
            return Plan::Now { tick: false };
        }
        let due = self.timers.next_due().map_or(tick_due, |timer| timer.min(tick_due));
        // With work left over this looks at the sockets without waiting, and is a tick: an interval is over.
        Plan::Io(if self.has_work_left() { self.pulse.now } else { due })
    }

    /// Something must happen next round, without anything coming from outside.
    pub(crate) fn has_work_left(&self) -> bool {
        !(self.queue.is_empty()
            && self.remote_calls.is_empty()
            && self.rewires.is_empty()
            && self.burials.is_empty()
            && self.news.is_empty()
            && self.sources.none_ready())
            || self.quitting
    }

    /// One whole round: the wait and what follows it.
    pub(crate) fn pulse_once(&mut self) {
        let plan = self.plan();
        match plan {
            Plan::Now { tick } => self.round(tick, None),
            Plan::Sleep(span) => {
                let due = self.world.clock.now() + span;
                self.world.clock.sleep(span);
                self.round(true, Some(due));
            }
            Plan::At(due) => {
                let ended = self.wait_precisely(due);
                self.round_from(ended, true, Some(due));
            }
            Plan::Io(due) => {
                let tick = self.wait_for_io(due) && self.ticks_after_io();
                self.round(tick, None);
            }
        }
    }

    /// Sleeps until shortly before the deadline, then spins. Messages that come meanwhile are taken, so that
    /// their senders need no system call; their calls run in their step, after the tick. Answers the moment at
    /// which the wait ended.
    fn wait_precisely(&mut self, due: Instant) -> Instant {
        let limit = spin_max(self.settings.spin_max, self.settings.interval);
        let wake_at = due - self.pacing.margin.within(limit);
        let mut now = self.world.clock.now();
        if now < wake_at {
            self.world.clock.sleep_until(wake_at);
            now = self.world.clock.now();
            self.pacing.margin.note(now.since(wake_at));
        }
        let mut look_at = now;
        while now < due {
            if now + LAST_STRETCH < due {
                if look_at <= now {
                    self.take_messages();
                    self.rehearse_tick();
                    look_at = now + LOOK_EVERY;
                }
                std::hint::spin_loop();
            }
            now = self.world.clock.now();
        }
        now
    }

    /// Answers whether the round after it is a tick: something came, or it is due.
    fn wait_for_io(&mut self, due: Instant) -> bool {
        let span = due.since(self.world.clock.now());
        // A sender that sees the loop asleep writes to its waker; one that does not needs no system call.
        let waits = span.is_zero() || self.inbox.fall_asleep();
        self.look_at_sources(Some(if waits { span } else { Duration::ZERO }));
        self.inbox.wake_up();
        // A sender interrupted in the middle keeps the loop from its sleep, but nothing has come of it yet.
        waits
            || self.inbox.holds_any()
            || !self.sources.none_ready()
            || self.world.clock.now() >= self.pacing.last_tick + self.settings.interval
    }

    // ---- what the operating system is asked for ----

    /// Asks for what the mode needs of the calling thread, and says what was refused.
    pub(crate) fn prepare_thread(&mut self) {
        let mode = self.settings.mode;
        if self.pacing.prepared_for == Some(mode) || self.trace.is_some() {
            return;
        }
        let before = self.pacing.prepared_for.replace(mode);
        if mode != TimingMode::Realtime {
            if before == Some(TimingMode::Realtime) {
                self.give_back_realtime();
            }
            return;
        }
        let wishes = self.settings.realtime;
        self.wish("a timer slack of 1 ns", sys::timer::set_slack_ns(1));
        if wishes.policy != Policy::Other {
            let outcome = sys::sched::set_policy(wishes.policy, REALTIME_RUN_MAX);
            self.wish(&format!("the scheduling class {:?}", wishes.policy), outcome);
        }
        if let Some(cpu) = wishes.cpu {
            self.wish(&format!("CPU {cpu} alone"), sys::sched::set_affinity(&[cpu]));
        }
        if wishes.lock_memory {
            self.wish("locked memory", sys::memory::lock_all());
        }
        if wishes.no_cpu_sleep {
            let held = sys::latency::WakeLatencyHeld::zero();
            let outcome = held.map(|held| self.pacing.wake_latency = Some(held));
            self.wish("/dev/cpu_dma_latency at 0", outcome);
        }
    }

    /// The loop waits in another way now: a class that runs before all others is no more its due.
    fn give_back_realtime(&mut self) {
        self.pacing.wake_latency = None;
        if self.settings.realtime.policy != Policy::Other {
            self.wish("the normal scheduling class", sys::sched::set_policy(Policy::Other, REALTIME_RUN_MAX));
        }
    }

    fn wish(&mut self, what: &str, outcome: std::io::Result<()>) {
        match outcome {
            Ok(()) => tracing::info!(name = self.name, "realtime: got {what}"),
            Err(error) => {
                tracing::warn!(name = self.name, "realtime: refused {what}: {error}");
                self.pacing.refused.push(format!("{what}: {error}"));
            }
        }
    }

    pub(crate) fn listen_for_os_signals(&mut self) {
        match self.world.net.watch_os_signals(crate::eventloop::OS_SIGNALS_TOKEN) {
            Ok(signals) => self.pacing.os_signals = Some(signals),
            Err(error) => tracing::error!("POSIX signals cannot be heard: {error}"),
        }
    }

    /// Takes POSIX signals, where this loop is the one that hears them.
    pub(crate) fn hear_os_signals(&mut self, ready: bool) {
        let now = self.pulse.now;
        if self.pacing.os_signals.is_none()
            || !(self.pacing.os_signals_looked.restart_if_passed(now, OS_SIGNALS_EVERY) || ready)
        {
            return;
        }
        while let Some(signals) = &mut self.pacing.os_signals
            && let Ok(Some(signal)) = signals.take()
        {
            self.news.push_back(crate::eventloop::sk_event_loop::News::OsSignal(signal));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eventloop::SkApp;
    use crate::thread::Message;

    #[test]
    fn a_message_that_is_only_announced_is_no_tick() {
        let mut app = SkApp::builder()
            .mode(TimingMode::SelectIo)
            .interval(Duration::from_secs(3600))
            .build()
            .unwrap();
        let mailbox = app.cx().own_mailbox();
        mailbox.announce();
        for _ in 0..10 {
            app.pulse();
        }
        let stats = app.cx().stats();
        assert_eq!((stats.rounds, stats.ticks), (10, 0));
        mailbox.put_in_announced(Message::Run(Box::new(|_| ())));
        app.pulse();
        assert_eq!(app.cx().stats().ticks, 1, "the message itself is one");
    }

    #[test]
    fn the_margin_follows_the_99th_percentile_not_the_outliers() {
        let mut margin = Margin::new();
        let limit = Duration::from_micros(500);
        for i in 0..1024u32 {
            let error = if i % 200 == 0 { Duration::from_millis(3) } else { Duration::from_micros(45) };
            margin.note(error);
        }
        assert_eq!(margin.within(limit), Duration::from_micros(55));
        for _ in 0..1024 {
            margin.note(Duration::from_millis(3));
        }
        assert_eq!(margin.within(limit), limit, "never more than the limit");
    }

    #[test]
    fn a_spin_is_limited_by_a_share_of_the_interval_or_by_what_the_loop_was_told() {
        let us = Duration::from_micros;
        assert_eq!(spin_max(None, us(16_000)), us(1_000));
        assert_eq!(spin_max(None, us(1_000)), us(64), "a share would be shorter than common wake errors");
        assert_eq!(spin_max(None, us(100)), us(50), "never more than half");
        assert_eq!(spin_max(Some(us(300)), us(1_000)), us(300));
        assert_eq!(spin_max(Some(us(900)), us(1_000)), us(500), "never more than half");
        assert_eq!(spin_max(Some(us(0)), us(1_000)), us(0), "no spin at all");
    }
}
