//! One channel of the module: read at its period, and only while somebody listens.

use crate::SenseError;
use sk_core::flow::Flow;
use sk_core::prelude::*;

/// Where a channel's readings come from.
pub(crate) trait Source {
    fn name(&self) -> &'static str;
    /// One line for people.
    fn doc(&self) -> &'static str;
    /// A map from the key of a part to its unit.
    fn units(&self) -> SkVariant;
    fn period(&self) -> Duration;
    fn read(&mut self, cx: &Cx) -> Result<Option<SkVariant>, SenseError>;
    /// Reading pauses.
    fn forget(&mut self);
}

/// A channel and its source.
pub struct HostChannel {
    source: Box<dyn Source>,
    flow: Flow,
    timer: Handle<Timer>,
    period: Duration,
    failing: bool,
}

object! { pub HostChannel { slots { read() on_listened(&str) on_unheard(&str) on_ready() } } }

impl HostChannel {
    pub(crate) fn open(
        cx: &mut Cx,
        this: Handle<HostChannel>,
        source: Box<dyn Source>,
        flow: Flow,
    ) -> std::io::Result<HostChannel> {
        let period = source.period();
        let properties = SkVariant::map([
            ("format", "variant".into()),
            ("doc", source.doc().into()),
            ("period", period.as_secs_f64().into()),
            ("unit", unit_line(&source.units()).into()),
            ("units", source.units()),
        ]);
        flow.open(cx, source.name(), properties)?;
        let timer = cx.under(this).spawn(Timer::default());
        let satellite = flow.satellite();
        attach!(cx, timer.timeout => this.read);
        attach!(cx, satellite.start_publishing => this.on_listened);
        attach!(cx, satellite.stop_publishing => this.on_unheard);
        attach!(cx, satellite.ready => this.on_ready);
        Ok(HostChannel { source, flow, timer, period, failing: false })
    }

    pub(crate) fn set_period_factor(&mut self, cx: &mut Cx, factor: f64) -> Result<(), Access> {
        self.period = self.source.period().mul_f64(factor);
        if self.timer.is_running(cx)? { self.timer.start(cx, self.period) } else { Ok(()) }
    }

    fn is_mine(&self, channel: &str) -> bool {
        channel == &*self.flow.channel_name(self.source.name())
    }

    /// The first reading comes at once; a rate follows after one period.
    fn on_listened(&mut self, cx: &mut Cx, channel: &str) -> Result<(), Access> {
        if !self.is_mine(channel) {
            return Ok(());
        }
        self.timer.start(cx, self.period)?;
        self.read(cx);
        Ok(())
    }

    fn on_unheard(&mut self, cx: &mut Cx, channel: &str) -> Result<(), Access> {
        if self.is_mine(channel) { self.on_ready(cx) } else { Ok(()) }
    }

    /// After a reconnection nobody listens until the hub says so.
    fn on_ready(&mut self, cx: &mut Cx) -> Result<(), Access> {
        self.source.forget();
        self.timer.stop(cx)
    }

    fn read(&mut self, cx: &mut Cx) {
        let name = self.source.name();
        match self.source.read(cx) {
            Ok(Some(reading)) => {
                self.failing = false;
                self.flow.publish(cx, name, reading);
            }
            Ok(None) => {}
            Err(error) => {
                // A file that has gone away stays away: said once, not at every period.
                if !std::mem::replace(&mut self.failing, true) {
                    tracing::warn!("host.{name}: {error}");
                }
            }
        }
    }
}

/// The units for a narrow column: each once, in the order of their keys.
fn unit_line(units: &SkVariant) -> String {
    let mut seen: Vec<&str> = Vec::new();
    for unit in units
        .as_map()
        .into_iter()
        .flat_map(|map| map.values())
        .filter_map(SkVariant::as_str)
    {
        if !seen.contains(&unit) {
            seen.push(unit);
        }
    }
    seen.join(" ")
}
