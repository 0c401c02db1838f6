//! The round: one pass of the steps, in their order.

use crate::Cx;
use crate::eventloop::sk_event_loop::{News, Overload};
use crate::eventloop::{Overrun, Step, TimingMode};
use crate::signal::Links;
use sk_flat::Instant;
use std::time::Duration;

/// A step that takes more than this share of the interval has its calls timed.
const STEP_SHARE_SUSPECT: u32 = 2;
/// How many receivers of a tick are brought near before it: as many as cannot make it late by that.
const REHEARSED_LINKS_MAX: usize = 8;
/// How long single calls are timed after that.
const CALL_TIMING_SPAN: Duration = Duration::from_secs(1);

/// What is known of the present round. A copy of it costs nothing and no clock is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// The number of the last tick, from 1 on.
    pub number: u64,
    /// The number of this round, from 1 on.
    pub round: u64,
    /// When the wait of this round should have ended.
    pub due: Instant,
    /// When it did.
    pub now: Instant,
    /// The interval asked for.
    pub interval: Duration,
    /// Ticks missed since the loop began.
    pub missed: u64,
}

impl Pulse {
    pub(crate) fn first(now: Instant, interval: Duration) -> Pulse {
        Pulse { number: 0, round: 0, due: now, now, interval, missed: 0 }
    }
}

/// Where the time of a round went.
struct Laps {
    last: Instant,
    longest: (Duration, Step),
}

impl Cx {
    /// One round after its wait: steps 2 to 10. `due`: when the wait should have ended, where it promised to.
    pub(crate) fn round(&mut self, tick: bool, due: Option<Instant>) {
        self.round_from(self.world.clock.now(), tick, due);
    }

    /// As `round`, after a wait that has read the clock at its end.
    pub(crate) fn round_from(&mut self, began: Instant, tick: bool, due: Option<Instant>) {
        self.in_round = true;
        self.pulse.round += 1;
        self.pulse.now = began;
        self.pulse.due = due.unwrap_or(began);
        self.pulse.interval = self.settings.interval;
        self.measures.rounds += 1;
        if self.settings.mode == TimingMode::Synced {
            self.note_sync(tick, began);
        }
        let mut laps = Laps { last: began, longest: (Duration::ZERO, Step::Tick) };
        let queued_before = self.queue.len();
        if tick && self.tick(began) {
            self.lap(&mut laps, Step::Tick);
        }
        // Behind the tick: what is noted for the statistics must not make it late.
        if let Some(due) = due.filter(|_| tick) {
            self.measures.wake_error.record(began.since(due));
        }
        self.measures.queue_depth_max = self.measures.queue_depth_max.max(queued_before);
        if self.take_messages() {
            self.lap(&mut laps, Step::Inbox);
        }
        if self.serve_sources(began) {
            self.lap(&mut laps, Step::Io);
        }
        if self.timers.next_due().is_some_and(|due| due <= began) && self.fire_timers(began) {
            self.lap(&mut laps, Step::Timers);
        }
        if queued_before > 0 || !self.remote_calls.is_empty() {
            self.run_queue(queued_before);
            self.run_remote_calls();
            self.lap(&mut laps, Step::Queued);
        }
        if self.flush_sources() {
            self.lap(&mut laps, Step::Flush);
        }
        if !(self.rewires.is_empty() && self.sweeps.is_empty()) {
            self.rewire();
            self.lap(&mut laps, Step::Rewire);
        }
        self.sources.pass_rewire_step();
        if !self.burials.is_empty() {
            self.bury_some();
            self.lap(&mut laps, Step::Bury);
        }
        self.account(began, &laps);
        self.in_round = false;
    }

    /// Step 2. The fast pulse comes directly after the wait, so that its jitter is the wait's alone.
    fn tick(&mut self, now: Instant) -> bool {
        self.pulse.number += 1;
        self.measures.ticks += 1;
        self.measures.first_tick.get_or_insert(now);
        self.measures.last_tick = now;
        self.pacing.last_tick = now;
        let mut emitted = self.pulse_zone(self.own.fast_zone);
        if self.pacing.slow.restart_if_passed(now, self.settings.slow_interval) {
            emitted |= self.pulse_zone(self.own.slow_zone);
        }
        if self.pacing.one_sec.restart_if_passed(now, Duration::from_secs(1)) {
            emitted |= self.pulse_zone(self.own.one_sec_zone);
        }
        emitted
    }

    /// Brings near what the next tick will touch, while there is time: on a busy machine others have filled the
    /// caches during the sleep, and each line that is fetched behind the deadline is jitter. It has no other
    /// effect.
    pub(crate) fn rehearse_tick(&mut self) {
        let zone = self.own.fast_zone;
        if let Ok(Some(links)) = self.with(zone, |zone, _| zone.pulse.frozen()) {
            // Each link looks at its receiver. The first are enough: the later ones wait for those before.
            let first = links.as_slice().iter().take(REHEARSED_LINKS_MAX);
            std::hint::black_box(first.filter(|link| link.is_dead()).count());
        }
        self.fire_own(zone.id(), &Links::Many(Vec::new()), &());
        let Pulse { number, due, .. } = self.pulse;
        std::hint::black_box((number, due, self.queue.len(), self.measures.ticks, self.pacing.last_tick));
    }

    fn pulse_zone(&mut self, zone: crate::object::Handle<crate::eventloop::Zone>) -> bool {
        match self.with(zone, |zone, _| zone.pulse.frozen()) {
            Ok(Some(links)) => {
                self.fire_own(zone.id(), &links, &());
                true
            }
            _ => false,
        }
    }

    fn lap(&mut self, laps: &mut Laps, step: Step) {
        let now = self.world.clock.now();
        let spent = now.since(laps.last);
        laps.last = now;
        self.measures.step_time[step as usize] += spent;
        if spent > laps.longest.0 {
            laps.longest = (spent, step);
        }
    }

    /// Step 10.
    fn account(&mut self, began: Instant, laps: &Laps) {
        let job_time = laps.last.since(began);
        let interval = self.settings.interval;
        self.measures.job_time.record(job_time);
        if self.settings.mode != TimingMode::NoTiming {
            if laps.longest.0 * STEP_SHARE_SUSPECT > interval {
                self.time_calls_from(laps.last);
            }
            let missed = self.missed_ticks(laps.last, job_time);
            if missed > 0 || job_time > interval {
                self.measures.overruns += 1;
                self.measures.missed += missed;
                self.pulse.missed += missed;
                self.news.push_back(News::Overrun(missed));
            }
            self.watch_load(job_time, laps);
        }
        self.watch_room();
        if !self.news.is_empty() {
            self.tell_news();
        }
        if let Some(trace) = &self.trace {
            trace.round(self.pulse.now, self.pulse.round, self.pulse.number);
        }
    }

    /// How many ticks are left out after this round.
    fn missed_ticks(&mut self, ended: Instant, job_time: Duration) -> u64 {
        match self.settings.mode {
            TimingMode::Realtime => self.skip_to_schedule(ended),
            // Without a schedule a tick is not late, but the time of those that fitted in is gone.
            _ => (job_time.as_nanos() / self.settings.interval.as_nanos().max(1)) as u64,
        }
    }

    /// Leaves out ticks whose moment has passed, so that the phase is kept. Answers how many.
    fn skip_to_schedule(&mut self, ended: Instant) -> u64 {
        let interval = self.settings.interval;
        let next = self.pacing.next_due + interval;
        if ended < next {
            return 0;
        }
        let passed = (ended.since(next).as_nanos() / interval.as_nanos().max(1)) as u64 + 1;
        let skipped = match self.settings.overrun {
            Overrun::Skip => passed,
            Overrun::CatchUp(most) => passed.saturating_sub(u64::from(most)),
        };
        self.pacing.next_due += Duration::from_nanos(skipped.saturating_mul(interval.as_nanos() as u64));
        skipped
    }

    // ---- overload and its culprit ----

    fn time_calls_from(&mut self, now: Instant) {
        if !self.timing.on {
            self.timing.on = true;
            self.timing.slowest = None;
            self.depth_max = 0;
        }
        self.timing.until = now + CALL_TIMING_SPAN;
    }

    fn watch_load(&mut self, job_time: Duration, laps: &Laps) {
        let interval = self.settings.interval;
        let now = laps.last;
        let overloaded = job_time * 5 >= interval * 4;
        if overloaded {
            let had_timing = self.timing.on && self.timing.slowest.is_some();
            self.time_calls_from(now);
            self.pacing.overload_quiet_at = now + CALL_TIMING_SPAN;
            if !self.pacing.overload_told && (had_timing || self.pacing.overload.is_none()) {
                self.pacing.overload =
                    Some(Overload { job_time, interval, step: laps.longest.1, culprit: self.culprit() });
            }
            if !self.pacing.overload_told && had_timing {
                self.tell_overload();
            }
        } else if self.timing.on && now >= self.timing.until {
            // Nobody was caught in the act: the episode is told without a name.
            if !self.pacing.overload_told && self.pacing.overload.is_some() {
                self.tell_overload();
            }
            self.timing.on = false;
            self.depth_max = crate::eventloop::dispatch::DIRECT_DEPTH_MAX;
        }
        if self.pacing.overload_told && now >= self.pacing.overload_quiet_at {
            self.pacing.overload_told = false;
            self.pacing.overload = None;
        }
    }

    fn tell_overload(&mut self) {
        if let Some(overload) = self.pacing.overload.take() {
            self.pacing.overload_told = true;
            tracing::warn!("{overload}");
            self.news.push_back(News::Overloaded(overload));
        }
    }
}
