//! The hub's own pulse as a channel: how regular its ticks are and how much of them its work takes.

use crate::SenseError;
use crate::channel::Source;
use sk_core::eventloop::Distribution;
use sk_core::prelude::*;

/// The keys of a report with their units; `1` is a count.
const UNITS: [(&str, &str); 21] = [
    ("interval", "s"),
    ("mean_interval", "s"),
    ("ticks", "1"),
    ("rounds", "1"),
    ("missed", "1"),
    ("overruns", "1"),
    ("wake_error.p50", "s"),
    ("wake_error.p99", "s"),
    ("wake_error.max", "s"),
    ("job_time.p50", "s"),
    ("job_time.p99", "s"),
    ("job_time.max", "s"),
    ("objects", "1"),
    ("queue_depth", "1"),
    ("queue_depth_max", "1"),
    ("calls", "1"),
    ("messages", "1"),
    ("timers", "1"),
    ("parked", "1"),
    ("failures", "1"),
    ("refused_full", "1"),
];

/// The pulse of the loop that the module lives on.
pub(crate) struct HubPulse;

impl Source for HubPulse {
    fn name(&self) -> &'static str {
        "pulse"
    }
    fn doc(&self) -> &'static str {
        "How regular the hub's own ticks are, and what its loop does"
    }
    fn units(&self) -> SkVariant {
        SkVariant::map(UNITS.map(|(key, unit)| (key, unit.into())))
    }
    fn period(&self) -> Duration {
        Duration::from_secs(1)
    }
    fn read(&mut self, cx: &Cx) -> Result<Option<SkVariant>, SenseError> {
        let stats = cx.stats();
        let report = SkVariant::map([
            ("interval", stats.interval.as_secs_f64().into()),
            ("mean_interval", stats.mean_interval.as_secs_f64().into()),
            ("ticks", stats.ticks.into()),
            ("rounds", stats.rounds.into()),
            ("missed", stats.missed.into()),
            ("overruns", stats.overruns.into()),
            ("wake_error", figures(&stats.wake_error)),
            ("job_time", figures(&stats.job_time)),
            ("objects", stats.objects.into()),
            ("queue_depth", stats.queue_depth.into()),
            ("queue_depth_max", stats.queue_depth_max.into()),
            ("calls", stats.counters.queued_calls.into()),
            ("messages", stats.counters.messages.into()),
            ("timers", stats.counters.timers_fired.into()),
            ("parked", stats.counters.parked.into()),
            ("failures", stats.counters.failures.into()),
            ("refused_full", stats.counters.refused_full.into()),
        ]);
        Ok(Some(report))
    }
    fn forget(&mut self) {}
}

/// A loop that promises no moment has no wake errors: then there are no figures.
fn figures(distribution: &Distribution) -> SkVariant {
    if distribution.count == 0 {
        return SkVariant::Null;
    }
    SkVariant::map([
        ("p50", distribution.p50.as_secs_f64().into()),
        ("p99", distribution.p99.as_secs_f64().into()),
        ("max", distribution.max.as_secs_f64().into()),
    ])
}
