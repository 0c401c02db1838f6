//! `sk call`: asks a service, and how other commands do.

use crate::arguments::{Arguments, json as parse};
use crate::names;
use crate::output::{json, print, safe};
use crate::session::{Link, Visit};
use clap::Args;
use sk_core::flow::{Answer, CallError, ChannelKind};
use sk_core::prelude::*;

#[derive(Args, Debug, Clone)]
pub struct Call {
    /// The service, with or without the account
    pub service: String,
    /// What it is asked, as JSON [default: null]
    #[arg(value_parser = parse, allow_hyphen_values = true, value_name = "JSON")]
    pub value: Option<SkVariant>,
    /// How many seconds an answer may take, and each further one of a service that streams
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = seconds)]
    pub within: Duration,
    /// Wait for a service that does not exist yet, as long as for an answer
    #[arg(long)]
    pub wait: bool,
}

pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|error| format!("{error}"))?;
    match Duration::try_from_secs_f64(seconds) {
        Ok(span) if span >= Duration::from_millis(1) && span <= Duration::from_secs(3_600) => Ok(span),
        _ => Err("0.001 to 3600 seconds are possible".to_owned()),
    }
}

type Hear = Box<dyn FnMut(&mut Cx, &Answer)>;

/// Hears the answers of one call.
struct Hearer {
    hear: Hear,
}

object! { Hearer { slots { on_answer(&Answer) } } }

impl Hearer {
    fn on_answer(&mut self, cx: &mut Cx, answer: &Answer) {
        (self.hear)(cx, answer);
    }
}

/// Asks a service by its full name; `hear` is called with each answer.
pub fn ask(
    cx: &mut Cx,
    link: Link,
    service: &str,
    value: SkVariant,
    within: Duration,
    hear: impl FnMut(&mut Cx, &Answer) + 'static,
) {
    let call = link.hub.call_within(cx, service, value, within);
    let hearer = cx.spawn(Hearer { hear: Box::new(hear) });
    attach!(cx, call.answered => hearer.on_answer);
}

pub fn run(arguments: &Arguments, task: &Call) -> Result<(), String> {
    let (task, as_json) = (task.clone(), arguments.json);
    Visit::once(arguments, move |cx, link| {
        let service = match full_name(cx, link, &task) {
            Ok(service) => service,
            Err(failure) => return link.fail(cx, failure),
        };
        let value = task.value.unwrap_or_default();
        ask(cx, link, &service, value, task.within, move |cx, answer| {
            match shown(answer, as_json).and_then(|text| print(cx, &text)) {
                Ok(()) if answer.is_last() => cx.quit(),
                Ok(()) => {}
                Err(failure) => link.fail(cx, failure),
            }
        });
    })
}

/// The service that is meant; one to wait for belongs to this account unless it is named whole.
fn full_name(cx: &mut Cx, link: Link, task: &Call) -> Result<String, String> {
    let mut channels = link.hub.channels(cx);
    let found = names::channel(&channels, &task.service);
    match found {
        Ok(channel) if channel.kind == ChannelKind::Service => Ok(channel.name),
        Ok(channel) => Err(format!("{} is no service but a {} channel", safe(&channel.name), channel.kind)),
        Err(_) if task.wait => {
            let account = names::account(cx, link.hub);
            let whole = task.service.starts_with(&format!("{account}."));
            Ok(if whole { task.service.clone() } else { format!("{account}.{}", task.service) })
        }
        Err(_) => {
            channels.retain(|channel| channel.kind == ChannelKind::Service);
            let services = channels.iter().map(|channel| channel.name.as_str());
            let missing = names::missing("service", &task.service, services, "`sk ls --all` lists them");
            Err(format!("{missing} (--wait waits for it)"))
        }
    }
}

fn shown(answer: &Answer, as_json: bool) -> Result<String, String> {
    let payload = answer.payload().map_err(|error| said(&error, answer.service()))?;
    let value = answer.value().unwrap_or_else(|_| payload.clone().into());
    if as_json {
        return json(&SkVariant::map([("value", value), ("last", answer.is_last().into())]));
    }
    json(&value)
}

/// Why there is no answer; the words of a service may be anything.
pub fn said(error: &CallError, service: &str) -> String {
    match error {
        CallError::Declined(words) => format!("{} declined: {}", safe(service), safe(words)),
        error => format!("{}: {}", safe(service), safe(&error.to_string())),
    }
}
