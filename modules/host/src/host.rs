//! The module: a channel for each sense the machine has, read only while somebody listens.

use crate::channel::{HostChannel, Source};
use crate::pulse::HubPulse;
use crate::sense_source::SenseSource;
use crate::{Kernel, senses};
use sk_core::flow::Flow;
use sk_core::module::AbstractModule;
use sk_core::{parameters, prelude::*};

parameters! {
    /// What the host module can be told.
    pub struct HostParameters {
        /// Every period of the senses is multiplied by this: 0.1 reads ten times as often.
        period_factor: f64 = 1.0, 0.1..=60.0;
        /// Time between two reports of the hub's own ticks.
        pulse_period: f64 = 1.0, 0.1..=60.0, "s";
        /// The senses to publish, by name; all of them if the list is empty.
        senses: Vec<String> = Vec::new();
    }
}

/// The machine's own senses and the loop's own pulse, as channels `host.cpu`, `host.memory` … `host.pulse`.
///
/// Nothing is read while nobody listens.
pub struct Host {
    senses: Vec<Handle<HostChannel>>,
    pulse: Handle<HostChannel>,
    parameters: HostParameters,
}

object! { pub Host {} }

impl AbstractModule for Host {
    const NAME: &'static str = "host";
    type Parameters = HostParameters;
    type Error = String;

    fn new(cx: &mut Cx, this: Handle<Self>, flow: Flow, parameters: &HostParameters) -> Result<Self, String> {
        check_names(&parameters.senses)?;
        let kernel = Kernel::default();
        let wanted = |name: &str| parameters.senses.is_empty() || parameters.senses.iter().any(|n| n == name);
        let mut open = |source: Box<dyn Source>| {
            let name = source.name();
            let make = |cx: &mut Cx, child| HostChannel::open(cx, child, source, flow.clone());
            let channel = cx.under(this).named(name).try_spawn_with(make);
            channel.map_err(|error| format!("channel {name}: {error}"))
        };
        let mut channels = Vec::new();
        for sense in senses() {
            if sense.is_present(&kernel) && wanted(sense.about().name) {
                channels.push(open(Box::new(SenseSource { sense, kernel: kernel.clone() }))?);
            }
        }
        let pulse = open(Box::new(HubPulse))?;
        Ok(Host { senses: channels, pulse, parameters: parameters.clone() })
    }

    fn start(&mut self, cx: &mut Cx) -> Result<(), String> {
        self.apply(cx).map_err(|error| error.to_string())
    }

    fn reconfigure(&mut self, cx: &mut Cx, parameters: &HostParameters) -> Result<(), String> {
        if parameters.senses != self.parameters.senses {
            return Err("which senses are published is decided at start: restart the module".to_owned());
        }
        self.parameters = parameters.clone();
        self.start(cx)
    }
}

impl Host {
    fn apply(&mut self, cx: &mut Cx) -> Result<(), Access> {
        let HostParameters { period_factor, pulse_period, .. } = self.parameters;
        for &channel in &self.senses {
            cx.with(channel, |channel, cx| channel.set_period_factor(cx, period_factor))??;
        }
        cx.with(self.pulse, |pulse, cx| pulse.set_period_factor(cx, pulse_period))?
    }
}

fn check_names(wanted: &[String]) -> Result<(), String> {
    let known: Vec<&str> = senses().iter().map(|sense| sense.about().name).collect();
    match wanted.iter().find(|name| !known.contains(&name.as_str())) {
        Some(name) => Err(format!("there is no sense {name:?}; there are {}", known.join(", "))),
        None => Ok(()),
    }
}
