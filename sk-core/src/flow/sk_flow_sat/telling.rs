//! What a satellite tells of its loop, in its flow's own database, where the hub's tools find it.

use super::SkFlowSat;
use crate::Cx;
use crate::eventloop::Histogram;
use sk_flat::SkVariant;

impl SkFlowSat {
    /// Slot of the zone of one second. Nothing is sent that the hub has already.
    pub(super) fn on_second(&mut self, cx: &mut Cx) {
        for (key, value) in of_pulse(cx) {
            self.clerk.tell(self.core.as_mut(), key, &value);
        }
        self.flush_later(cx);
    }

    /// The same for a hub that is new.
    pub(super) fn introduce_pulse(&mut self, cx: &Cx) {
        for (key, value) in of_pulse(cx) {
            self.clerk.introduce(key, &value);
        }
    }
}

fn of_pulse(cx: &Cx) -> [(&'static str, SkVariant); 3] {
    let settings = cx.settings();
    [
        ("pulse.interval_ms", (settings.interval.as_secs_f64() * 1000.0).into()),
        ("pulse.mode", format!("{:?}", settings.mode).into()),
        ("pulse.statistics", statistics(cx)),
    ]
}

/// With the names and units of the hub's own channel `host.pulse`; satellites in other languages tell the same.
fn statistics(cx: &Cx) -> SkVariant {
    let measures = &cx.measures;
    SkVariant::map([
        ("interval", cx.settings().interval.as_secs_f64().into()),
        ("mean_interval", measures.mean_interval().as_secs_f64().into()),
        ("ticks", measures.ticks.into()),
        ("missed", measures.missed.into()),
        ("overruns", measures.overruns.into()),
        ("sync_lost", cx.counters().sync_lost.into()),
        ("wake_error", figures(&measures.wake_error)),
        ("job_time", figures(&measures.job_time)),
    ])
}

/// A loop that promises no moment has no wake errors: then there are no figures.
fn figures(spans: &Histogram) -> SkVariant {
    if spans.count() == 0 {
        return SkVariant::Null;
    }
    let quantile = |share| spans.quantile(share).as_secs_f64().into();
    SkVariant::map([("p50", quantile(0.5)), ("p99", quantile(0.99)), ("max", quantile(1.0))])
}
