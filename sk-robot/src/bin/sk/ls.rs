//! `sk ls`: the channels.

use crate::arguments::{Arguments, Ls};
use crate::output::{print, safe};
use crate::session::{Session, Visit};
use sk_core::flow::SkFlowSat;
use sk_core::flow::satellite::ChannelInfo;
use sk_core::prelude::*;

struct Lister {
    hub: Handle<SkFlowSat>,
    part: String,
    json: bool,
}

object! { Lister { slots { on_entered() } } }

pub fn run(arguments: &Arguments, task: &Ls) -> Result<(), String> {
    let mut visit = Visit::begin(arguments)?;
    let (hub, session): (_, Handle<Session>) = (visit.hub, visit.session);
    let part = task.part.clone().unwrap_or_default();
    let cx = visit.app.cx();
    let lister = cx.spawn(Lister { hub, part, json: task.json });
    attach!(cx, session.entered => lister.on_entered);
    visit.run()
}

impl Lister {
    fn on_entered(&mut self, cx: &mut Cx) -> Result<(), String> {
        let mut channels = self.hub.channels(cx);
        channels.retain(|channel| channel.name.contains(&self.part));
        let text = if self.json { as_json(&channels)? } else { as_table(&channels) };
        cx.quit();
        print(cx, &text)
    }
}

fn property(channel: &ChannelInfo, key: &str) -> String {
    let properties = channel.properties.variant();
    match properties.get(key) {
        None => String::new(),
        Some(value) => safe(&value.as_str().map_or_else(|| value.to_string(), str::to_owned)),
    }
}

fn as_table(channels: &[ChannelInfo]) -> String {
    if channels.is_empty() {
        return "no channels\n".to_owned();
    }
    let rows: Vec<[String; 3]> = channels
        .iter()
        .map(|channel| [safe(&channel.name), property(channel, "unit"), property(channel, "doc")])
        .collect();
    let head = ["CHANNEL", "UNIT", "WHAT"].map(str::to_owned);
    let width = |column: usize| {
        rows.iter()
            .chain([&head])
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let (name_width, unit_width) = (width(0), width(1));
    let line = |row: &[String; 3]| {
        let [name, unit, what] = row;
        let line = format!("{name:name_width$}  {unit:unit_width$}  {what}");
        format!("{}\n", line.trim_end())
    };
    std::iter::once(&head).chain(&rows).map(line).collect()
}

fn as_json(channels: &[ChannelInfo]) -> Result<String, String> {
    let line = |channel: &ChannelInfo| {
        let object = SkVariant::map([
            ("name", SkVariant::from(channel.name.as_str())),
            ("id", SkVariant::from(channel.channel.id)),
            ("properties", channel.properties.variant()),
        ]);
        object.to_json().map(|json| json + "\n").map_err(|error| error.to_string())
    };
    channels.iter().map(line).collect()
}
