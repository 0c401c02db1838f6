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

/// Satellites in other languages tell the same.
fn statistics(cx: &Cx) -> SkVariant {
    let measures = &cx.measures;
    SkVariant::map([
        ("ticks", measures.ticks.into()),
        ("missed", measures.missed.into()),
        ("overruns", measures.overruns.into()),
        ("sync_lost", cx.counters().sync_lost.into()),
        ("wake_error", figures(&measures.wake_error)),
        ("job_time", figures(&measures.job_time)),
    ])
}

fn figures(spans: &Histogram) -> SkVariant {
    let quantile_ns = |share| u64::try_from(spans.quantile(share).as_nanos()).unwrap_or(u64::MAX).into();
    SkVariant::map([
        ("p50_ns", quantile_ns(0.5)),
        ("p99_ns", quantile_ns(0.99)),
        ("max_ns", quantile_ns(1.0)),
    ])
}
