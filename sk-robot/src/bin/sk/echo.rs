//! `sk echo`: what flows on a channel, a line a message.

use crate::arguments::{Arguments, Echo};
use crate::output::{print, safe};
use crate::session::{Session, Visit};
use sk_core::flow::satellite::ChannelInfo;
use sk_core::flow::{FlowMessage, SkFlowSat};
use sk_core::prelude::*;
use std::fmt::Write;
use strsim::damerau_levenshtein;

/// Bytes of a message that is no variant, shown in hex.
const BYTES_SHOWN_MAX: usize = 32;

struct Echoer {
    hub: Handle<SkFlowSat>,
    session: Handle<Session>,
    wanted: String,
    wait: bool,
    found: bool,
    left: Option<u64>,
}

object! { Echoer { slots { on_entered() on_added(&ChannelInfo) on_removed(&ChannelInfo) on_message(&FlowMessage) } } }

pub fn run(arguments: &Arguments, task: &Echo) -> Result<(), String> {
    let mut visit = Visit::begin(arguments)?;
    let (hub, session) = (visit.hub, visit.session);
    let cx = visit.app.cx();
    let echoer = Echoer {
        hub,
        session,
        wanted: task.channel.clone(),
        wait: task.wait,
        found: false,
        left: task.count,
    };
    let echoer = cx.spawn(echoer);
    attach!(cx, session.entered => echoer.on_entered, Queued);
    attach!(cx, hub.channel_added => echoer.on_added);
    attach!(cx, hub.channel_removed => echoer.on_removed);
    attach!(cx, hub.message => echoer.on_message);
    visit.run()
}

/// Whether `wanted` means this channel: its full name, or the name without the account.
fn means(wanted: &str, full_name: &str) -> bool {
    full_name == wanted || full_name.split_once('.').is_some_and(|(_, name)| name == wanted)
}

impl Echoer {
    fn on_entered(&mut self, cx: &mut Cx) -> Result<(), Access> {
        if self.found || self.wait {
            return Ok(());
        }
        let channels = self.hub.channels(cx);
        let wanted = safe(&self.wanted);
        let near = nearest(&self.wanted, &channels);
        let hint =
            near.map_or_else(|| "`sk ls` lists them".to_owned(), |near| format!("did you mean {near}?"));
        let failure = format!("no channel {wanted}: {hint} (--wait waits for it)");
        cx.with(self.session, |session, cx| session.fail(cx, failure))
    }

    fn on_added(&mut self, cx: &mut Cx, channel: &ChannelInfo) -> std::io::Result<()> {
        if self.found || !means(&self.wanted, &channel.name) {
            return Ok(());
        }
        self.found = true;
        self.hub.subscribe(cx, &channel.name)
    }

    fn on_removed(&mut self, cx: &mut Cx, channel: &ChannelInfo) -> Result<(), Access> {
        if !self.found || !means(&self.wanted, &channel.name) || self.wait {
            return Ok(());
        }
        let failure = format!("the channel {} is gone", safe(&channel.name));
        cx.with(self.session, |session, cx| session.fail(cx, failure))
    }

    fn on_message(&mut self, cx: &mut Cx, message: &FlowMessage) -> Result<(), String> {
        if self.left == Some(0) {
            return Ok(());
        }
        print(cx, &shown(message))?;
        if let Some(left) = &mut self.left {
            *left -= 1;
            if *left == 0 {
                cx.quit();
            }
        }
        Ok(())
    }
}

fn shown(message: &FlowMessage) -> String {
    let properties = message.channel().properties.variant();
    let is_variant = properties.get("format").and_then(SkVariant::as_str) == Some("variant");
    if is_variant && let Ok(json) = message.value().and_then(|value| value.to_json()) {
        return safe(&json) + "\n";
    }
    let payload = message.payload();
    let mut line = format!("{} bytes:", payload.len());
    for byte in payload.iter().take(BYTES_SHOWN_MAX) {
        // Writing to a string cannot fail.
        let _ = write!(line, " {byte:02x}");
    }
    line.push_str(if payload.len() > BYTES_SHOWN_MAX { " …\n" } else { "\n" });
    line
}

/// The channel whose name is most like what was typed, if one is.
fn nearest<'a>(wanted: &str, channels: &'a [ChannelInfo]) -> Option<&'a str> {
    let near = |channel: &'a ChannelInfo| {
        let short = channel.name.split_once('.').map_or(&*channel.name, |(_, name)| name);
        let distance = damerau_levenshtein(wanted, &channel.name).min(damerau_levenshtein(wanted, short));
        (distance <= wanted.len() / 3).then_some((distance, &*channel.name))
    };
    channels.iter().filter_map(near).min().map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_is_meant_with_and_without_its_account() {
        assert!(means("robot.host.cpu", "robot.host.cpu") && means("host.cpu", "robot.host.cpu"));
        assert!(!means("cpu", "robot.host.cpu"));
    }
}
