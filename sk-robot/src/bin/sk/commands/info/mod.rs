//! `sk info`: the hub, a channel, or a flow.

mod pulse;

use crate::arguments::Arguments;
use crate::names::{meant, missing};
use crate::output::{json, safe};
use crate::session::{Link, Visit};
use crate::table::{bytes, facts, span, table};
use clap::Args;
use sk_core::flow::report::{
    ChannelReport, CountsReport, DatagramsReport, FlowReport, FlowsReport, GraphReport, HubReport,
    SubscriberReport,
};
use sk_core::prelude::*;
use sk_flat::{FromVariant, IntoVariant, VariantError};

#[derive(Args, Debug, Clone)]
pub struct Info {
    /// A channel, a flow, or `hub`; channels and flows with or without the account
    #[arg(default_value = "hub", value_name = "hub | CHANNEL | FLOW")]
    pub what: String,
}

pub fn run(arguments: &Arguments, task: &Info) -> Result<(), String> {
    let (what, as_json) = (task.what.clone(), arguments.json);
    Visit::once(arguments, move |cx, link| {
        if what == "hub" {
            return ask(cx, link, "hub", as_json, of_hub);
        }
        let channels = link.hub.channels(cx);
        match meant(&what, channels.iter().map(|channel| channel.name.as_str())) {
            Some(name) => ask(cx, link, &format!("channel {name}"), as_json, of_channel),
            None => {
                let names: Vec<String> = channels.into_iter().map(|channel| channel.name).collect();
                flow(cx, link, what, names, as_json);
            }
        }
    })
}

fn ask(
    cx: &mut Cx,
    link: Link,
    subject: &str,
    as_json: bool,
    shown: fn(&SkVariant) -> Result<String, VariantError>,
) {
    link.hub.inspect(cx, subject, move |cx, told| {
        let text = told.and_then(|told| match as_json {
            true => json(&told),
            false => shown(&told).map_err(|error| error.to_string()),
        });
        link.end(cx, text);
    });
}

/// A flow is told by two answers: what it is, and what it has to do with channels.
fn flow(cx: &mut Cx, link: Link, what: String, channels: Vec<String>, as_json: bool) {
    link.hub.inspect(cx, "flows", move |cx, told| {
        let flows = told.and_then(|told| FlowsReport::from_variant(&told).map_err(|error| error.to_string()));
        let flows = match flows {
            Ok(flows) => flows.flows,
            Err(failure) => return link.fail(cx, failure),
        };
        let names = || flows.iter().filter_map(|flow| flow.flow.as_deref());
        let Some(name) = meant(&what, names()).map(str::to_owned) else {
            let all = channels.iter().map(String::as_str).chain(names());
            return link.fail(cx, missing("channel or flow", &what, all, "`sk ls` and `sk graph` list them"));
        };
        let Some(flow) = flows.into_iter().find(|flow| flow.flow.as_ref() == Some(&name)) else { return };
        link.hub.inspect(cx, "graph", move |cx, told| {
            let graph =
                told.and_then(|told| GraphReport::from_variant(&told).map_err(|error| error.to_string()));
            with_pulse(cx, link, &name.clone(), move |cx, pulse| {
                link.end(cx, graph.and_then(|graph| of_flow(&flow, &name, &graph, &pulse, as_json)));
            });
        });
    });
}

/// What a flow tells of its own pulse. Who may not read its database sees the rest.
fn with_pulse(
    cx: &mut Cx,
    link: Link,
    flow: &str,
    then: impl FnOnce(&mut Cx, Vec<(String, SkVariant)>) + 'static,
) {
    match link.hub.database(cx, &format!("flow:{flow}")) {
        Ok(database) => database.all(cx, pulse::PREFIX, |cx, told| then(cx, told.unwrap_or_default())),
        Err(_) => then(cx, Vec::new()),
    }
}

fn of_hub(told: &SkVariant) -> Result<String, VariantError> {
    let hub = HubReport::from_variant(told)?;
    let mut rows = vec![
        ("version", format!("{}, protocol {}", safe(&hub.version), hub.protocol)),
        ("up", span(hub.up)),
        ("connections", format!("{}, of them {} flows", hub.connections, hub.flows)),
        ("channels", hub.channels.to_string()),
        ("subscriptions", hub.subscriptions.to_string()),
        ("messages", counts(&hub.counts)),
        ("waiting", bytes(hub.bytes_waiting as f64)),
        ("kept", format!("{} for late joiners and who polls", bytes(hub.bytes_kept as f64))),
    ];
    if hub.spurious > 0 {
        rows.push(("spurious", format!("{} connections were ended for what they sent", hub.spurious)));
    }
    if let Some(datagrams) = &hub.datagrams {
        rows.push(("datagrams", datagram_counts(datagrams)));
    }
    Ok(facts(&rows))
}

fn datagram_counts(datagrams: &DatagramsReport) -> String {
    let mut text = format!("at port {}: {} taken", datagrams.port, datagrams.taken);
    let refused = [
        (datagrams.unknown, "of no session"),
        (datagrams.forged, "forged"),
        (datagrams.replayed, "replayed"),
        (datagrams.malformed, "malformed"),
    ];
    for (count, what) in refused.into_iter().filter(|(count, _)| *count > 0) {
        text += &format!(", {count} {what}");
    }
    text
}

fn counts(counts: &CountsReport) -> String {
    let mut text = format!("{} offered, {} delivered", counts.offered, counts.delivered);
    if counts.queued > 0 {
        text += &format!(", {} wait", counts.queued);
    }
    let dropped: Vec<String> = counts
        .dropped
        .iter()
        .map(|(reason, count)| format!("{count} ({})", safe(reason)))
        .collect();
    if !dropped.is_empty() {
        text += &format!(", dropped {}", dropped.join(", "));
    }
    text
}

fn of_channel(told: &SkVariant) -> Result<String, VariantError> {
    let channel = ChannelReport::from_variant(told)?;
    let last = channel
        .last
        .map_or_else(String::new, |last| format!(", the last {} ago", span(last)));
    let mut rows = vec![
        ("channel", safe(&channel.name)),
        ("kind", safe(&channel.kind)),
        ("owner", safe(&channel.owner)),
        ("published", format!("{} messages{last}", channel.published)),
    ];
    if channel.latch {
        rows.push(("latch", format!("the last message is kept, {}", bytes(channel.bytes_latched as f64))));
    }
    if let Some(credit) = channel.credit {
        let left = credit.granted.saturating_sub(credit.used);
        rows.push(("reliable", format!("its owner may publish {} more", bytes(left as f64))));
    }
    if let Some(source) = &channel.repeats {
        rows.push(("repeats", safe(source)));
    }
    if !channel.repeated_by.is_empty() {
        rows.push(("repeated by", safe(&channel.repeated_by.join(", "))));
    }
    if channel.pollers > 0 {
        rows.push(("polled by", format!("{} connections", channel.pollers)));
    }
    for (key, value) in channel.properties.as_map().into_iter().flatten() {
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        rows.push(("says", format!("{}: {}", safe(key), safe(&value))));
    }
    let mut text = facts(&rows);
    if !channel.subscribers.is_empty() {
        let row = |one: &SubscriberReport| {
            let depth = one.depth.map_or_else(|| "reliable".to_owned(), |depth| depth.to_string());
            let policy = format!("{} {depth}", safe(&one.policy));
            vec![safe(&one.flow), policy, counts(&one.counts), bytes(one.bytes_waiting as f64)]
        };
        let rows: Vec<Vec<String>> = channel.subscribers.iter().map(row).collect();
        text += "\n";
        text += &table(&["HEARD BY", "POLICY", "MESSAGES", "WAITING"], &rows);
    }
    if channel.left_out > 0 {
        text += &format!("and {} more\n", channel.left_out);
    }
    Ok(text)
}

fn of_flow(
    flow: &FlowReport,
    name: &str,
    graph: &GraphReport,
    pulse: &[(String, SkVariant)],
    as_json: bool,
) -> Result<String, String> {
    let channels = graph.channels.iter();
    let owns: Vec<&str> = channels
        .clone()
        .filter(|one| one.owner == name)
        .map(|one| one.name.as_str())
        .collect();
    let hears = channels.filter(|one| one.subscribers.iter().any(|who| who == name));
    let hears: Vec<&str> = hears.map(|one| one.name.as_str()).collect();
    if as_json {
        let mut object = flow.clone().into_variant();
        if let Some(map) = object.as_map_mut() {
            map.insert("owns".to_owned(), SkVariant::list(owns));
            map.insert("hears".to_owned(), SkVariant::list(hears));
            map.extend(pulse.iter().cloned());
        }
        return json(&object);
    }
    let account = flow.account.as_deref().unwrap_or("nobody");
    let mut rows = vec![
        ("flow", safe(name)),
        ("account", safe(account)),
        ("comes from", safe(&flow.origin)),
        ("state", format!("{} for {}", safe(&flow.state), span(flow.since))),
        ("waiting", bytes(flow.bytes_waiting as f64)),
        ("owns", if owns.is_empty() { "no channel".to_owned() } else { safe(&owns.join(", ")) }),
        ("hears", if hears.is_empty() { "nothing".to_owned() } else { safe(&hears.join(", ")) }),
    ];
    rows.extend(pulse::rows(pulse));
    Ok(facts(&rows))
}
