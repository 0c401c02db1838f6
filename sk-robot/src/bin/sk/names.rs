//! What is meant by a name as people type it.

use crate::output::safe;
use sk_core::flow::SkFlowSat;
use sk_core::flow::satellite::{ChannelInfo, SatelliteCore};
use sk_core::prelude::*;
use strsim::damerau_levenshtein;

/// Whether `wanted` means this channel or flow: its full name, or the name without the account.
pub fn means(wanted: &str, full_name: &str) -> bool {
    full_name == wanted || full_name.split_once('.').is_some_and(|(_, name)| name == wanted)
}

/// The first of these that is meant: one of exactly this name before one of another account.
pub fn meant<'a>(wanted: &str, names: impl Iterator<Item = &'a str> + Clone) -> Option<&'a str> {
    let exact = names.clone().find(|name| *name == wanted);
    exact.or_else(|| names.into_iter().find(|name| means(wanted, name)))
}

/// The name that is most like what was typed, if one is.
pub fn nearest<'a>(wanted: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let near = |name: &'a str| {
        let short = name.split_once('.').map_or(name, |(_, short)| short);
        let distance = damerau_levenshtein(wanted, name).min(damerau_levenshtein(wanted, short));
        (distance <= wanted.chars().count().div_ceil(3)).then_some((distance, name))
    };
    names.filter_map(near).min().map(|(_, name)| name)
}

/// `no channel NAME: did you mean OTHER?`
pub fn missing<'a>(
    what: &str,
    wanted: &str,
    names: impl Iterator<Item = &'a str>,
    otherwise: &str,
) -> String {
    let hint = match nearest(wanted, names) {
        Some(near) => format!("did you mean {}?", safe(near)),
        None => otherwise.to_owned(),
    };
    format!("no {what} {}: {hint}", safe(wanted))
}

/// The channel that is meant, or a sentence with the one that may be.
pub fn channel(channels: &[ChannelInfo], wanted: &str) -> Result<ChannelInfo, String> {
    let names = || channels.iter().map(|channel| channel.name.as_str());
    let found = meant(wanted, names()).and_then(|name| channels.iter().find(|channel| channel.name == name));
    let failure = || missing("channel", wanted, names(), "`sk ls --all` lists them");
    found.cloned().ok_or_else(failure)
}

/// The name of this visit's own flow.
pub fn own_flow(cx: &mut Cx, hub: Handle<SkFlowSat>) -> String {
    of_core(cx, hub, |core| core.flow_name().map(str::to_owned))
}

/// The account as which we are let in.
pub fn account(cx: &mut Cx, hub: Handle<SkFlowSat>) -> String {
    of_core(cx, hub, |core| core.user().map(ToString::to_string))
}

fn of_core(
    cx: &mut Cx,
    hub: Handle<SkFlowSat>,
    what: impl FnOnce(&SatelliteCore) -> Option<String>,
) -> String {
    let found = cx.with(hub, |hub, _| hub.core().and_then(what));
    found.ok().flatten().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_is_meant_with_and_without_its_account() {
        assert!(means("robot.host.cpu", "robot.host.cpu") && means("host.cpu", "robot.host.cpu"));
        assert!(!means("cpu", "robot.host.cpu"));
        let names = ["a.b.c", "b.c"];
        assert_eq!(meant("b.c", names.into_iter()), Some("b.c"), "the exact name goes before");
        assert_eq!(meant("c", names.into_iter()), Some("b.c"));
    }

    #[test]
    fn a_slip_is_understood_and_another_word_is_not() {
        let names = ["robot.host.cpu", "robot.host.disk"];
        assert_eq!(nearest("host.cup", names.into_iter()), Some("robot.host.cpu"));
        assert_eq!(nearest("gripper", names.into_iter()), None);
    }
}
