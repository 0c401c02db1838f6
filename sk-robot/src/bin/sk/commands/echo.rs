//! `sk echo`: what flows on channels, a line a message.

use crate::arguments::Arguments;
use crate::names::{self, means};
use crate::output::{json, print, safe};
use crate::session::{Link, Visit};
use crate::table::bytes;
use clap::Args;
use sk_core::flow::FlowMessage;
use sk_core::flow::satellite::ChannelInfo;
use sk_core::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Bytes of a message that is no variant, shown in hex unless all are asked for.
const BYTES_SHOWN_MAX: usize = 32;

#[derive(Args, Debug, Clone)]
pub struct Echo {
    /// The channels, with or without the account: robot.host.cpu or host.cpu
    #[arg(required = true, value_name = "CHANNEL")]
    pub channels: Vec<String>,
    /// End after this many messages
    #[arg(short = 'n', long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Wait for channels that do not exist yet
    #[arg(long)]
    pub wait: bool,
    /// All bytes of every message in hex
    #[arg(long, conflicts_with = "save")]
    pub hex: bool,
    /// Write each message to a file of its own in this folder: images and whatever else is no variant
    #[arg(long, value_name = "DIR")]
    pub save: Option<PathBuf>,
}

struct Echoer {
    link: Link,
    task: Echo,
    as_json: bool,
    /// The full names of what is heard.
    heard: Vec<String>,
    left: Option<u64>,
    /// How many files were written, by channel.
    saved: BTreeMap<String, u64>,
}

object! { Echoer { slots { on_entered() on_added(&ChannelInfo) on_removed(&ChannelInfo) on_message(&FlowMessage) } } }

pub fn run(arguments: &Arguments, task: &Echo) -> Result<(), String> {
    if let Some(folder) = &task.save
        && !folder.is_dir()
    {
        return Err(format!("{} is no folder: make it first", folder.display()));
    }
    let mut visit = Visit::begin(arguments)?;
    let link = visit.link();
    let cx = visit.app.cx();
    let echoer = Echoer {
        link,
        task: task.clone(),
        as_json: arguments.json,
        heard: Vec::new(),
        left: task.count,
        saved: BTreeMap::new(),
    };
    let echoer = cx.spawn(echoer);
    attach!(cx, link.session.entered => echoer.on_entered, Queued);
    attach!(cx, link.hub.channel_added => echoer.on_added);
    attach!(cx, link.hub.channel_removed => echoer.on_removed);
    attach!(cx, link.hub.message => echoer.on_message);
    visit.run()
}

impl Echoer {
    fn on_entered(&mut self, cx: &mut Cx) {
        if self.task.wait {
            return;
        }
        let channels = self.link.hub.channels(cx);
        for wanted in &self.task.channels {
            if let Err(missing) = names::channel(&channels, wanted) {
                return self.link.fail(cx, format!("{missing} (--wait waits for it)"));
            }
        }
    }

    fn on_added(&mut self, cx: &mut Cx, channel: &ChannelInfo) -> std::io::Result<()> {
        let is_wanted = self.task.channels.iter().any(|wanted| means(wanted, &channel.name));
        if !is_wanted || self.heard.contains(&channel.name) {
            return Ok(());
        }
        self.heard.push(channel.name.clone());
        self.link.hub.subscribe(cx, &channel.name)
    }

    fn on_removed(&mut self, cx: &mut Cx, channel: &ChannelInfo) {
        if !self.heard.contains(&channel.name) || self.task.wait {
            return;
        }
        self.link.fail(cx, format!("the channel {} is gone", safe(&channel.name)));
    }

    fn on_message(&mut self, cx: &mut Cx, message: &FlowMessage) {
        if self.left == Some(0) {
            return;
        }
        if let Err(failure) = self.shown(message).and_then(|line| print(cx, &line)) {
            return self.link.fail(cx, failure);
        }
        if let Some(left) = &mut self.left {
            *left -= 1;
            if *left == 0 {
                cx.quit();
            }
        }
    }

    fn shown(&mut self, message: &FlowMessage) -> Result<String, String> {
        let value = variant_of(message);
        let file = match (&self.task.save, &value) {
            (Some(folder), None) => Some(self.save(&folder.clone(), message)?),
            _ => None,
        };
        if self.as_json {
            let what = match (&file, value) {
                (Some(file), _) => ("file", SkVariant::from(file.display().to_string())),
                (None, Some(value)) => ("value", value),
                // Bytes go into JSON as base64.
                (None, None) => ("value", message.payload().clone().into()),
            };
            return json(&SkVariant::map([("channel", message.name().into()), what]));
        }
        let before = match self.task.channels.len() {
            1 if !self.task.wait => String::new(),
            _ if self.heard.len() < 2 => String::new(),
            _ => format!("{}: ", safe(message.name())),
        };
        let length = bytes(message.payload().len() as f64);
        Ok(match (file, value) {
            (Some(file), _) => format!("{before}{} ({length})\n", file.display()),
            _ if self.task.hex => format!("{before}{}\n", hex(message.payload(), usize::MAX)),
            (None, Some(value)) => before + &json(&value)?,
            (None, None) => {
                let mime = mime_of(message).map_or_else(String::new, |mime| format!("{} ", safe(&mime)));
                let shown = hex(message.payload(), BYTES_SHOWN_MAX);
                format!("{before}{mime}{} bytes: {shown}\n", message.payload().len())
            }
        })
    }

    /// Writes the message to `FOLDER/channel-000001.ending`.
    fn save(&mut self, folder: &Path, message: &FlowMessage) -> Result<PathBuf, String> {
        let number = self.saved.entry(message.name().to_owned()).or_default();
        *number += 1;
        let ending = ending_of(message);
        // The alphabet of channels' names leads out of no folder, but for two dots alone.
        let file = folder.join(format!("{}-{number:06}.{ending}", message.name()));
        std::fs::write(&file, message.payload()).map_err(|error| format!("{}: {error}", file.display()))?;
        Ok(file)
    }
}

/// The value, if the channel says that it carries variants.
fn variant_of(message: &FlowMessage) -> Option<SkVariant> {
    let properties = message.channel().properties.variant();
    let is_variant = properties.get("format").and_then(SkVariant::as_str) == Some("variant");
    message.value().ok().filter(|_| is_variant)
}

fn mime_of(message: &FlowMessage) -> Option<String> {
    let properties = message.channel().properties.variant();
    properties.get("mime").and_then(SkVariant::as_str).map(str::to_owned)
}

/// What the file's name ends with: by what the channel says, else by how the bytes begin.
fn ending_of(message: &FlowMessage) -> &'static str {
    let properties = message.channel().properties.variant();
    let said =
        ["mime", "format"].map(|key| properties.get(key).and_then(SkVariant::as_str).unwrap_or_default());
    let known = [
        ("jpeg", "jpg", &b"\xff\xd8\xff"[..]),
        ("jpg", "jpg", b"\xff\xd8\xff"),
        ("png", "png", b"\x89PNG\r\n"),
        ("gif", "gif", b"GIF8"),
        ("webp", "webp", b"RIFF"),
        ("bmp", "bmp", b"BM"),
        ("pgm", "pgm", b"P5"),
        ("ppm", "ppm", b"P6"),
        ("wav", "wav", b"RIFF"),
        ("json", "json", b"{"),
    ];
    let by_word = known
        .iter()
        .find(|(word, ..)| said.iter().any(|said| said.rsplit('/').next() == Some(*word)));
    let by_bytes = || {
        known
            .iter()
            .find(|(_, _, magic)| message.payload().starts_with(magic) && magic.len() > 2)
    };
    match by_word.or_else(by_bytes) {
        Some((_, ending, _)) => ending,
        None if said.iter().any(|said| said.starts_with("text/")) => "txt",
        None => "bin",
    }
}

fn hex(payload: &[u8], bytes_max: usize) -> String {
    let mut text = String::with_capacity(3 * payload.len().min(bytes_max));
    for byte in payload.iter().take(bytes_max) {
        // Writing to a string cannot fail.
        let _ = write!(text, "{}{byte:02x}", if text.is_empty() { "" } else { " " });
    }
    text + if payload.len() > bytes_max { " …" } else { "" }
}
