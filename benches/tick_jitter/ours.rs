//! Our loop: a slot at the tick reads the clock.

use crate::{Arguments, PRIORITY, PolicyName};
use sk_benches::{BenchError, Sheet};
use sk_core::eventloop::{RealtimeWishes, SchedulingPolicy};
use sk_core::prelude::*;

/// Notes how late each tick is when its first slot runs.
struct Watch {
    ticks_left: u64,
    schedule: bool,
    /// Set back at the first tick, against the loop's own choice.
    slack_ns: Option<u32>,
    refused: Option<String>,
    late_ns: Vec<u64>,
    first: Option<(Instant, u64, u64)>,
    last: Option<(Instant, u64, u64)>,
}

impl Watch {
    fn on_tick(&mut self, cx: &mut Cx) {
        let now = cx.clock_now();
        if let Some(slack_ns) = self.slack_ns.take()
            && let Err(error) = nix::sys::prctl::set_timerslack(slack_ns.into())
        {
            self.refused = Some(format!("a timer slack of {slack_ns} ns: {error}"));
        }
        let pulse = *cx.pulse();
        let tick = (now, pulse.number, pulse.missed);
        let before = self.last.replace(tick);
        self.first.get_or_insert(tick);
        // With a schedule the loop itself says when the tick was due; without one it is due an interval
        // after the one before it.
        let due = match before {
            _ if self.schedule => pulse.due,
            Some((before, _, _)) => before + pulse.interval,
            None => return,
        };
        self.late_ns.push(now.since(due).as_nanos() as u64);
        self.ticks_left -= 1;
        if self.ticks_left == 0 {
            cx.quit();
        }
    }
}
object! { Watch { slots { on_tick() } } }

/// What our loop asks of the operating system.
#[derive(Clone, Copy, Default)]
pub(crate) struct Asked {
    pub(crate) realtime: RealtimeWishes,
    /// The loop takes 1 ns; this takes its place.
    pub(crate) slack_ns: Option<u32>,
}

/// One run as the options say.
pub(crate) fn measure(sheet: &mut Sheet, arguments: &Arguments) -> Result<(), BenchError> {
    // cyclictest is started with its own `--mlockall`.
    let mut realtime = RealtimeWishes { cpu: arguments.cpu, lock_memory: true, ..RealtimeWishes::default() };
    if arguments.policy == PolicyName::Fifo {
        realtime.policy = SchedulingPolicy::Fifo(PRIORITY);
    }
    tick(sheet, arguments, &arguments.case(), Asked { realtime, slack_ns: None })
}

/// One run.
pub(crate) fn tick(
    sheet: &mut Sheet,
    arguments: &Arguments,
    case: &str,
    asked: Asked,
) -> Result<(), BenchError> {
    let interval = Duration::from_micros(arguments.interval_us);
    let ticks = arguments.ticks();
    let ours = |error: &dyn std::fmt::Display| BenchError::Ours(error.to_string());
    let app = SkApp::builder()
        .mode(arguments.mode())
        .interval(interval)
        .configure(|settings| settings.realtime = asked.realtime);
    let mut app = app.build().map_err(|error| ours(&error))?;
    let cx = app.cx();
    let watch = cx.spawn(Watch {
        ticks_left: ticks,
        schedule: arguments.mode() == TimingMode::Realtime,
        slack_ns: asked.slack_ns,
        refused: None,
        late_ns: Vec::with_capacity(ticks as usize),
        first: None,
        last: None,
    });
    attach!(cx, cx.fast_zone().pulse => watch.on_tick);
    app.run();
    for refused in &app.cx().stats().refused_wishes {
        sheet.note(&format!("refused {refused}"));
    }
    let told = app.cx().with(watch, |watch, _| {
        if let Some(refused) = &watch.refused {
            sheet.note(&format!("refused {refused}"));
        }
        watch.late_ns.iter().for_each(|ns| sheet.sample(case, "wake_error", *ns, 1));
        watch.first.zip(watch.last)
    });
    if let Some(((began, first, missed_before), (ended, last, missed))) =
        told.map_err(|error| ours(&error))?
    {
        let missed = missed - missed_before;
        // Over the intervals that passed, those of missed ticks included.
        let periods = (last - first + missed).max(1) as f64;
        let mean_ns = ended.since(began).as_nanos() as f64 / periods;
        sheet.figure(case, "drift", "ppm", (mean_ns / interval.as_nanos() as f64 - 1.0) * 1e6);
        sheet.figure(case, "missed", "1", missed as f64);
    }
    Ok(())
}
