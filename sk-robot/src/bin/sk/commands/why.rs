//! `sk why A B`: whether data of A reaches B, one line for each hop.

use crate::arguments::Arguments;
use crate::names::meant;
use crate::output::{json, print, safe};
use crate::session::{Link, Visit};
use clap::Args;
use sk_core::flow::report::{FlowsReport, Hop, WhyReport};
use sk_core::prelude::*;
use sk_flat::FromVariant;

#[derive(Args, Debug, Clone)]
pub struct Why {
    /// A channel, or the flow that publishes
    pub from: String,
    /// The flow that data should reach; `sk graph` shows the names
    pub to: String,
}

pub fn run(arguments: &Arguments, task: &Why) -> Result<(), String> {
    let (task, as_json) = (task.clone(), arguments.json);
    Visit::once(arguments, move |cx, link| {
        link.hub.inspect(cx, "flows", move |cx, told| {
            let flows =
                told.and_then(|told| FlowsReport::from_variant(&told).map_err(|error| error.to_string()));
            match flows {
                Ok(flows) => ask(cx, link, &task, &flows, as_json),
                Err(failure) => link.fail(cx, failure),
            }
        });
    })
}

fn ask(cx: &mut Cx, link: Link, task: &Why, flows: &FlowsReport, as_json: bool) {
    let channels = link.hub.channels(cx);
    let flows = flows.flows.iter().filter_map(|flow| flow.flow.as_deref());
    let channels = channels.iter().map(|channel| channel.name.as_str());
    // What nobody is called goes to the hub as it is: the hub says so.
    let from = meant(&task.from, channels.chain(flows.clone())).unwrap_or(&task.from);
    let to = meant(&task.to, flows).unwrap_or(&task.to);
    if from.contains(char::is_whitespace) || to.contains(char::is_whitespace) {
        return link.fail(cx, "a name has no spaces");
    }
    link.hub.inspect(cx, &format!("why {from} {to}"), move |cx, told| {
        match told.and_then(|told| shown(&told, as_json)) {
            // The answer is an answer; that data does not pass is told by the exit code.
            Ok((text, passes, from, to)) => match print(cx, &text) {
                Ok(()) if passes => cx.quit(),
                Ok(()) => link.fail(cx, format!("data of {from} does not reach {to}")),
                Err(failure) => link.fail(cx, failure),
            },
            Err(failure) => link.fail(cx, failure),
        }
    });
}

fn shown(told: &SkVariant, as_json: bool) -> Result<(String, bool, String, String), String> {
    let report = WhyReport::from_variant(told).map_err(|error| error.to_string())?;
    let line = |hop: &Hop| {
        let mark = if hop.passes { "ok  " } else { "ends" };
        format!("{mark}  {}: {}\n", safe(&hop.at), safe(&hop.says))
    };
    let text = if as_json { json(told)? } else { report.hops.iter().map(line).collect() };
    Ok((text, report.passes, safe(&report.from), safe(&report.to)))
}
