//! A module whose source does not know where it runs: `12_module_in_a_hub` has it inside a hub,
//! `13_module_as_satellite` as a program of its own.

use sk_core::flow::Flow;
use sk_core::module::AbstractModule;
use sk_core::{parameters, prelude::*};

parameters! {
    /// What the battery watch can be told.
    pub struct BatteryParameters {
        /// Time between two readings.
        period_ms: u64 = 20, 5..=1000, "ms";
        /// Below this the battery counts as empty.
        low: f64 = 11.0, 9.0..=13.0, "V";
    }
}

/// Reads the voltage, publishes it, and says when it is low.
pub struct Battery {
    flow: Flow,
    timer: Handle<Timer>,
    parameters: BatteryParameters,
    volts: f64,
}

impl AbstractModule for Battery {
    const NAME: &'static str = "battery";
    type Parameters = BatteryParameters;
    type Error = String;

    fn new(
        cx: &mut Cx,
        this: Handle<Self>,
        flow: Flow,
        parameters: &BatteryParameters,
    ) -> Result<Self, String> {
        let timer = cx.under(this).spawn(Timer::default());
        attach!(cx, timer.timeout => this.read);
        Ok(Battery { flow, timer, parameters: parameters.clone(), volts: 13.0 })
    }

    fn start(&mut self, cx: &mut Cx) -> Result<(), String> {
        let properties = SkVariant::map([("format", "variant".into()), ("unit", "V".into())]);
        self.flow.open(cx, "volts", properties).map_err(|error| error.to_string())?;
        let period = Duration::from_millis(self.parameters.period_ms);
        self.timer.start(cx, period).map_err(|error| error.to_string())
    }

    fn reconfigure(&mut self, cx: &mut Cx, parameters: &BatteryParameters) -> Result<(), String> {
        self.parameters = parameters.clone();
        self.start(cx)
    }

    fn control(&mut self, _cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, String> {
        match command.as_str() {
            Some("charge") => {
                self.volts = 13.0;
                Ok(self.volts.into())
            }
            _ => Err(format!("no command {command}; there is \"charge\"")),
        }
    }
}

impl Battery {
    fn read(&mut self, cx: &mut Cx) {
        // A stand-in for the reading of a device.
        self.volts -= 0.01;
        self.flow.publish(cx, "volts", self.volts);
        self.flow.publish(cx, "low", self.volts < self.parameters.low);
    }
}

object! { pub Battery { slots { read() } } }
