//! Timers as objects, and the heap that knows which is due.

use crate::Cx;
use crate::object::{Access, Handle, MARKED, ObjectId};
use crate::signal::Signal;
use sk_flat::Instant;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

/// A timer: started by methods on its handle, it emits `timeout` in step 5 of the first round at or after
/// the moment it is due. Its precision is that of its loop's ticks. Starting and stopping cost O(log n).
///
/// ```
/// use sk_core::prelude::*;
///
/// struct Bell { rung: u32 }
/// impl Bell {
///     fn ring(&mut self, cx: &mut Cx) { self.rung += 1; if self.rung == 3 { cx.quit() } }
/// }
/// object! { Bell { slots { ring() } } }
///
/// let mut app = SkApp::new();
/// let cx = app.cx();
/// let bell = cx.spawn(Bell { rung: 0 });
/// let timer = cx.under(bell).spawn(Timer::default());
/// attach!(cx, timer.timeout => bell.ring);
/// timer.start(cx, Duration::from_millis(2))?;
/// app.run();
/// assert_eq!(app.cx().with(bell, |b, _| b.rung)?, 3);
/// # Ok::<(), Access>(())
/// ```
#[derive(Debug, Default)]
pub struct Timer {
    /// The time is up.
    pub timeout: Signal<()>,
    /// `Some` while it repeats.
    period: Option<Duration>,
    /// Entries of the heap with an older number are void.
    armed: u64,
    running: bool,
}

crate::object! { pub Timer { signals { timeout() } hooks { on_destroy } } }

impl Timer {
    /// Its entry stays in the heap and must be counted as void there.
    fn on_destroy(&mut self, cx: &mut Cx) {
        if std::mem::replace(&mut self.running, false) {
            cx.timers.voided();
        }
    }
}

impl Handle<Timer> {
    /// Fires every `period` from now on; a period below the loop's interval fires once a round. If it runs
    /// already it begins anew. A timer that comes late keeps its phase and leaves out what it missed.
    ///
    /// # Errors
    /// [`Access::Gone`] if the timer was buried.
    pub fn start(self, cx: &mut Cx, period: Duration) -> Result<(), Access> {
        self.arm(cx, period, Some(period))
    }

    /// Fires once, `after` from now. If it runs already it begins anew.
    ///
    /// # Errors
    /// [`Access::Gone`] if the timer was buried.
    pub fn start_once(self, cx: &mut Cx, after: Duration) -> Result<(), Access> {
        self.arm(cx, after, None)
    }

    /// Fires no more. No error if it does not run.
    ///
    /// # Errors
    /// [`Access::Gone`] if the timer was buried.
    pub fn stop(self, cx: &mut Cx) -> Result<(), Access> {
        let stopped = cx.with(self, |timer, _| std::mem::replace(&mut timer.running, false))?;
        if stopped {
            cx.timers.voided();
            cx.drop_void_timers();
        }
        Ok(())
    }

    /// Whether it will fire.
    ///
    /// # Errors
    /// [`Access::Gone`] if the timer was buried.
    pub fn is_running(self, cx: &mut Cx) -> Result<bool, Access> {
        cx.with(self, |timer, _| timer.running)
    }

    fn arm(self, cx: &mut Cx, after: Duration, period: Option<Duration>) -> Result<(), Access> {
        let number = cx.timers.next_number();
        let was_running = cx.with(self, |timer, _| {
            timer.period = period;
            timer.armed = number;
            std::mem::replace(&mut timer.running, true)
        })?;
        if was_running {
            cx.timers.voided();
        }
        let due = cx.now() + after;
        cx.timers.push(due, number, self.id());
        cx.drop_void_timers();
        Ok(())
    }
}

/// Due times, soonest first; equal ones in the order they were armed.
pub(crate) struct TimerHeap {
    heap: BinaryHeap<Reverse<(Instant, u64, ObjectId)>>,
    numbers: u64,
    /// Entries whose timer was stopped or armed anew; they are thrown out when they are most of the heap.
    void: usize,
}

impl TimerHeap {
    pub(crate) fn new() -> TimerHeap {
        TimerHeap { heap: BinaryHeap::new(), numbers: 0, void: 0 }
    }

    fn next_number(&mut self) -> u64 {
        self.numbers += 1;
        self.numbers
    }

    fn push(&mut self, due: Instant, number: u64, timer: ObjectId) {
        self.heap.push(Reverse((due, number, timer)));
    }

    fn voided(&mut self) {
        self.void += 1;
    }

    /// When the next entry is due; it may be void, then the loop wakes for nothing.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.heap.peek().map(|Reverse((due, ..))| *due)
    }

    fn pop_due(&mut self, now: Instant) -> Option<(Instant, u64, ObjectId)> {
        if self.next_due()? > now {
            return None;
        }
        self.heap.pop().map(|Reverse(entry)| entry)
    }
}

impl Cx {
    /// Step 5. A timer armed while these fire, however short, waits for the next round.
    pub(crate) fn fire_timers(&mut self, now: Instant) -> bool {
        let last_number = self.timers.numbers;
        let mut fired = false;
        let mut later = Vec::new();
        while let Some((due, number, id)) = self.timers.pop_due(now) {
            if number > last_number {
                later.push((due, number, id));
                continue;
            }
            fired |= self.fire_timer(Handle::new(id), now, due, number);
        }
        for (due, number, id) in later {
            self.timers.push(due, number, id);
        }
        self.drop_void_timers();
        fired
    }

    fn fire_timer(&mut self, timer: Handle<Timer>, now: Instant, due: Instant, number: u64) -> bool {
        let current = self.with(timer, |timer, _| timer.running && timer.armed == number) == Ok(true);
        if !current {
            self.timers.void = self.timers.void.saturating_sub(1);
            return false;
        }
        if self.table.node(timer.id()).is_none_or(|node| node.header().has(MARKED)) {
            // Its entry is gone now, so its burial has nothing to count.
            let _ = self.with(timer, |timer, _| timer.running = false);
            return false;
        }
        let period = self.with(timer, |timer, _| {
            timer.running = timer.period.is_some();
            timer.period
        });
        if let Ok(Some(period)) = period {
            // Armed before the slots run, so that they can stop or restart it.
            let number = self.timers.next_number();
            let _ = self.with(timer, |timer, _| timer.armed = number);
            self.timers.push(next_in_phase(due, period, now), number, timer.id());
        }
        self.counters.timers_fired += 1;
        self.emit_own(timer, |timer| &timer.timeout, &());
        true
    }

    fn drop_void_timers(&mut self) {
        if self.timers.void <= 64 || self.timers.void * 2 <= self.timers.heap.len() {
            return;
        }
        let entries = std::mem::take(&mut self.timers.heap).into_vec();
        let kept: Vec<_> = entries
            .into_iter()
            .filter(|Reverse((_, number, id))| {
                let timer = Handle::<Timer>::new(*id);
                self.with(timer, |timer, _| timer.running && timer.armed == *number) == Ok(true)
            })
            .collect();
        self.timers.heap = BinaryHeap::from(kept);
        self.timers.void = 0;
    }
}

/// The first moment after `now` that is a whole number of periods after `due`.
fn next_in_phase(due: Instant, period: Duration, now: Instant) -> Instant {
    let next = due + period;
    if next > now {
        return next;
    }
    let period = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX).max(1);
    let behind = now.as_nanos() - due.as_nanos();
    Instant::from_nanos(due.as_nanos() + (behind / period + 1) * period)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_timer_keeps_its_phase() {
        let at = |ms: u64| Instant::from_nanos(ms * 1_000_000);
        let ms = Duration::from_millis;
        assert_eq!(next_in_phase(at(10), ms(5), at(11)), at(15));
        assert_eq!(next_in_phase(at(10), ms(5), at(26)), at(30));
        assert_eq!(next_in_phase(at(10), ms(5), at(30)), at(35));
        assert!(next_in_phase(at(10), Duration::ZERO, at(30)) > at(30));
    }
}
