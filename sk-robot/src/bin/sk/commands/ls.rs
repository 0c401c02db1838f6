//! `sk ls`: the channels.

use crate::arguments::Arguments;
use crate::output::{json, safe};
use crate::session::{Link, Visit};
use crate::table::table;
use clap::Args;
use sk_core::flow::ChannelKind;
use sk_core::flow::report::{GraphChannel, GraphReport};
use sk_core::flow::satellite::ChannelInfo;
use sk_core::prelude::*;
use sk_flat::FromVariant;
use std::collections::BTreeMap;

#[derive(Args, Debug, Clone)]
pub struct Ls {
    /// Only channels whose name contains this
    pub part: Option<String>,
    /// Also the services of the hub's own
    #[arg(long)]
    pub all: bool,
}

pub fn run(arguments: &Arguments, task: &Ls) -> Result<(), String> {
    let (task, as_json) = (task.clone(), arguments.json);
    Visit::once(arguments, move |cx, link| {
        link.hub.inspect(cx, "graph", move |cx, told| {
            // Who has no right to list sees all the same what he may use, if not who owns it.
            let graph = told.map_or_else(
                |_| Ok(GraphReport::default()),
                |told| GraphReport::from_variant(&told).map_err(|error| error.to_string()),
            );
            let text = graph.and_then(|graph| listed(cx, link, &graph, &task, as_json));
            link.end(cx, text);
        });
    })
}

fn listed(cx: &mut Cx, link: Link, graph: &GraphReport, task: &Ls, as_json: bool) -> Result<String, String> {
    let known: BTreeMap<&str, &GraphChannel> =
        graph.channels.iter().map(|channel| (channel.name.as_str(), channel)).collect();
    let part = task.part.as_deref().unwrap_or_default();
    let is_hubs_own = |channel: &ChannelInfo| channel.owner == 0 && channel.kind == ChannelKind::Service;
    let mut channels = link.hub.channels(cx);
    channels.retain(|channel| channel.name.contains(part) && (task.all || !is_hubs_own(channel)));
    if as_json {
        return channels.iter().map(|channel| json(&as_object(channel, &known))).collect();
    }
    if channels.is_empty() {
        return Ok("no channels\n".to_owned());
    }
    let row = |channel: &ChannelInfo| {
        let graph = known.get(channel.name.as_str());
        let owner = graph.map_or("?", |graph| graph.owner.as_str());
        let heard = graph.map_or(0, |graph| graph.subscribers.len());
        vec![
            safe(&channel.name),
            channel.kind.to_string(),
            safe(owner),
            if heard == 0 { String::new() } else { heard.to_string() },
            property(channel, "rate"),
            property(channel, "unit"),
            property(channel, "doc"),
        ]
    };
    let rows: Vec<Vec<String>> = channels.iter().map(row).collect();
    Ok(table(&["CHANNEL", "KIND", "OWNER", "HEARD BY", "RATE", "UNIT", "WHAT"], &rows))
}

fn property(channel: &ChannelInfo, key: &str) -> String {
    let properties = channel.properties.variant();
    match properties.get(key) {
        None => String::new(),
        Some(value) => safe(&value.as_str().map_or_else(|| value.to_string(), str::to_owned)),
    }
}

fn as_object(channel: &ChannelInfo, known: &BTreeMap<&str, &GraphChannel>) -> SkVariant {
    let graph = known.get(channel.name.as_str());
    let names = graph.map_or(&[][..], |graph| &graph.subscribers);
    SkVariant::map([
        ("name", channel.name.as_str().into()),
        ("id", channel.channel.id.into()),
        ("kind", channel.kind.to_string().into()),
        ("owner", graph.map_or(SkVariant::Null, |graph| graph.owner.as_str().into())),
        ("subscribers", SkVariant::list(names.iter().map(String::as_str))),
        ("properties", channel.properties.variant()),
    ])
}
