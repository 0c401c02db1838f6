//! What is looked at from outside: the hubs' books and registries, the loops' counters, the log.

use crate::channels::is_latched;
use crate::ledger;
use crate::log;
use crate::look::channels_of;
use crate::parts::{Part, Parts};
use crate::rule::Rule;
use crate::script::Role;
use crate::stamp::{Origin, channel_name};
use crate::wishes::Wishes;
use sk_core::flow::delivery::DropReason;
use sk_core::flow::server::{ConnectionId, ServerCore};
use sk_core::flow::{ChannelKind, ChannelRef};
use std::collections::{BTreeMap, BTreeSet};

/// More channels than any node has.
const CHANNELS: u8 = 8;

fn complain(rule: Rule, text: String) {
    ledger::with(|ledger| ledger.complain(rule, text));
}

/// What holds at every moment.
pub(crate) fn always(parts: &Parts) {
    for (number, part) in &parts.all {
        if let Some(node) = &part.node
            && let counters = node.inspect(|cx| *cx.counters())
            && counters.failures > 0
        {
            let (failures, panics, last) = (counters.failures, counters.panics, log::last_panic());
            let text =
                format!("n{number}: {failures} slots failed, {panics} of them panicked; the last {last}");
            complain(Rule::Panic, text);
        }
    }
    if let Some(error) = log::first_error() {
        complain(Rule::Honest, format!("the log has an error: {error}"));
    }
    for hub in parts.hubs() {
        let must_not_miss = must_not_miss(parts, hub);
        parts.look_at_hub(hub, |core| {
            books(core);
            policies(core, &must_not_miss);
            rights(core, hub);
        });
    }
}

fn books(core: &ServerCore) {
    let totals = core.totals();
    if !totals.balance() {
        complain(Rule::Books, format!("in total {totals:?}"));
    }
    let mut listeners: BTreeMap<ChannelRef, usize> = BTreeMap::new();
    for (connection, channel, counts) in core.subscriptions() {
        if !counts.balance() {
            complain(Rule::Books, format!("connection {connection}, channel {channel}: {counts:?}"));
        }
        *listeners.entry(channel).or_default() += 1;
    }
    for (channel, said) in core.channels() {
        let found = listeners.remove(&channel.reference).unwrap_or(0);
        if said != found {
            let text = format!("{} has {said} subscribers in the list, {found} that live", channel.name);
            complain(Rule::Reaped, text);
        }
    }
    if let Some((channel, count)) = listeners.first_key_value() {
        complain(Rule::Reaped, format!("{count} subscriptions to channel {channel}, which is gone"));
    }
}

/// Nobody does what he has no right to, as far as the hub's own registries show.
fn rights(core: &ServerCore, hub: u16) {
    if let Some(widened) = core.widened_rights().into_iter().next() {
        complain(Rule::Rights, widened);
    }
    // Those that are not honest call hub 0.
    let wild = if hub == 0 { ledger::with(|ledger| ledger.wild_sent) } else { 0 };
    let spurious = core.spurious();
    if spurious > wild {
        let last = log::last_warning().unwrap_or_default();
        let text = format!("{spurious} connections were killed, {wild} misbehaved; the last: {last}");
        complain(Rule::Honest, text);
    }
    let datagrams = core.datagram_counts();
    if datagrams.malformed + datagrams.forged > 0 {
        complain(
            Rule::Honest,
            format!("nobody sends bad datagrams, and the hub took some for it: {datagrams:?}"),
        );
    }
    let denied = ledger::with(|ledger| ledger.may_not_publish.clone());
    for prefix in denied.into_iter().map(channels_of) {
        if core.channels().any(|(channel, _)| channel.name.as_str().starts_with(&prefix)) {
            complain(Rule::Rights, format!("a channel {prefix}… exists, and its owner may not publish"));
        }
    }
}

/// The subscriptions that must not miss a message, by connection and name.
fn must_not_miss(parts: &Parts, hub: u16) -> Vec<(u64, String)> {
    let hears_all = ledger::with(|ledger| ledger.hears_all.clone());
    let all = hears_all.into_iter().filter(|(_, all)| *all);
    let at_hub = all.filter_map(|((node, name), _)| {
        let wishes = parts.wishes(node).filter(|wishes| wishes.hub == hub)?;
        Some((wishes.connection?, name))
    });
    at_hub.collect()
}

/// What is reliable is dropped only because somebody has gone, and who must not miss any has no gap.
fn policies(core: &ServerCore, must_not_miss: &[(u64, String)]) {
    let channels: BTreeMap<ChannelRef, (&str, bool)> = core
        .channels()
        .map(|(channel, _)| (channel.reference, (channel.name.as_str(), channel.properties.is_reliable())))
        .collect();
    for (connection, channel, counts) in core.subscriptions() {
        let Some((name, reliable)) = channels.get(&channel) else { continue };
        let dropped = |reason: DropReason| counts.dropped[reason as usize] > 0;
        let lossy = [DropReason::Full, DropReason::NewestWins, DropReason::Credit];
        let broken = *reliable && lossy.into_iter().any(dropped);
        let must_not_miss = must_not_miss
            .iter()
            .any(|(id, wanted)| *id == connection.wire() && wanted == name);
        if broken || must_not_miss && dropped(DropReason::NewestWins) {
            let text = format!("connection {connection}, {name} (reliable: {reliable}): {counts:?}");
            complain(Rule::Policies, text);
        }
    }
}

/// What holds when nothing was wrong for long enough.
pub(crate) fn calm(parts: &Parts) {
    let wishes: BTreeMap<u16, Wishes> = parts
        .all
        .keys()
        .filter_map(|number| Some((*number, parts.wishes(*number)?)))
        .collect();
    for (number, wishes) in &wishes {
        if !wishes.ready {
            complain(Rule::Restored, format!("n{number} is not let in though nothing is wrong any more"));
        }
    }
    for hub in parts.hubs() {
        parts.look_at_hub(hub, |core| calm_hub(parts, core, hub, &wishes));
    }
    if let Some(unfinished) = parts.all.keys().find_map(|number| parts.unfinished(*number)) {
        complain(Rule::Kept, unfinished);
    }
    if let Some(key) = ledger::with(|ledger| ledger.endless_call()) {
        complain(Rule::Services, format!("{key:?} has no end"));
    }
    if let Some((published, last)) = parts.pair()
        && last.map_or(0, |last| last + 2) < published
    {
        complain(
            Rule::Bystander,
            format!("{published} messages were published, the last heard was {last:?}"),
        );
    }
}

fn calm_hub(parts: &Parts, core: &ServerCore, hub: u16, wishes: &BTreeMap<u16, Wishes>) {
    let at_hub: BTreeMap<u16, &Wishes> = wishes
        .iter()
        .filter(|(_, wishes)| wishes.hub == hub)
        .map(|(number, wishes)| (*number, wishes))
        .collect();
    for (number, wishes) in &at_hub {
        restored(core, &parts.all[number], *number, wishes);
        seen(core, *number, wishes);
        latched(core, (&parts.all[number], *number), wishes, &at_hub);
    }
    for (connection, channel, counts) in core.subscriptions() {
        // Ticks go on, and only the newest is kept.
        if core
            .channels()
            .any(|(known, _)| known.reference == channel && known.kind == ChannelKind::Sync)
        {
            continue;
        }
        let key = (hub, connection.wire(), channel);
        let received = ledger::with(|ledger| ledger.received.get(&key).copied().unwrap_or_default());
        let known = at_hub.values().any(|wishes| wishes.connection == Some(connection.wire()));
        if counts.queued > 0 {
            let text = format!("connection {connection}, channel {channel}: {} still wait", counts.queued);
            complain(Rule::Books, text);
        }
        if known && !received.muddled && counts.delivered != received.count {
            let text = format!(
                "connection {connection}, channel {channel}: {} delivered, {} received",
                counts.delivered, received.count
            );
            complain(Rule::Books, text);
        }
    }
}

/// Whoever hears a channel with a latch has the last message, however late he came and whatever happened meanwhile.
fn latched(core: &ServerCore, (part, owner): (&Part, u16), own: &Wishes, all: &BTreeMap<u16, &Wishes>) {
    if !matches!(part.role, Role::Satellite(_) | Role::Guest(..) | Role::Inside { .. }) {
        return;
    }
    for channel in (0..CHANNELS).filter(|channel| is_latched(owner, *channel)) {
        let name = channel_name(owner, channel);
        let origin = Origin { node: owner, life: part.life, channel };
        let is_open = core
            .channels()
            .any(|(known, _)| known.name.as_str() == name && Some(known.owner.wire()) == own.connection);
        let (published, is_excused) = ledger::with(|ledger| {
            let repeats = ledger.repeats.iter().any(|(replica, _)| *replica == name);
            // What goes by datagram may be lost.
            (ledger.published_by(origin), repeats || ledger.by_udp.contains(&name))
        });
        let Some(last) = published.checked_sub(1).filter(|_| is_open && !is_excused) else { continue };
        for (listener, wishes) in all.iter().filter(|(_, wishes)| wishes.wanted.contains(&name)) {
            let (may, heard) = ledger::with(|ledger| {
                let life = ledger.life_of(*listener);
                (!ledger.may_not_hear.contains(listener), ledger.last_heard((*listener, life), origin))
            });
            let is_ready = wishes.ready && own.ready && may;
            if is_ready && heard != Some(last) {
                let text =
                    format!("n{listener} hears {name}, whose last message is {last}, and has {heard:?}");
                complain(Rule::Latest, text);
            }
        }
    }
}

/// A satellite was told of all the channels that it may know of, and of no other.
fn seen(core: &ServerCore, number: u16, wishes: &Wishes) {
    let (Some(connection), Some(known)) = (wishes.connection, &wishes.known) else { return };
    let connection = core.connection_ids().find(|id| id.wire() == connection);
    let seen: BTreeSet<ChannelRef> =
        connection.into_iter().flat_map(|id: ConnectionId| core.seen_by(id)).collect();
    if let Some(channel) = known.difference(&seen).next() {
        complain(Rule::Rights, format!("n{number} knows of channel {channel}, and may not"));
    }
    if let Some(channel) = seen.difference(known).next() {
        complain(Rule::Restored, format!("n{number} was not told of channel {channel}"));
    }
}

fn restored(core: &ServerCore, part: &Part, number: u16, wishes: &Wishes) {
    let (publish, subscribe) = match part.role {
        Role::Inside { publish, subscribe, .. } => (publish, subscribe),
        _ => (true, true),
    };
    let excused = ledger::with(|ledger| ledger.without_identifier.contains(&number));
    for name in wishes.own.iter().filter(|_| publish && !excused) {
        let owner = core.channels().find(|(channel, _)| channel.name.as_str() == name);
        let owner = owner.map(|(channel, _)| channel.owner.wire());
        if owner.is_none() || owner != wishes.connection {
            complain(Rule::Restored, format!("n{number} has no channel {name} though it wants one"));
        }
    }
    for name in wishes.wanted.iter().filter(|_| subscribe) {
        let Some((channel, _)) = core.channels().find(|(channel, _)| channel.name.as_str() == name) else {
            continue;
        };
        let there = core.subscriptions().any(|(connection, reference, _)| {
            Some(connection.wire()) == wishes.connection && reference == channel.reference
        });
        if !there {
            complain(Rule::Restored, format!("n{number} does not hear {name} though it wants to"));
        }
    }
}

/// What holds when everybody has left.
pub(crate) fn reaped(parts: &Parts) {
    for hub in parts.hubs() {
        parts.look_at_hub(hub, |core| {
            let (connections, channels) = (core.connections(), core.channels().count());
            let (subscriptions, queued) = (core.subscriptions().count(), core.totals().queued);
            let requests = core.open_requests();
            if connections + channels + subscriptions + requests > 0 || queued > 0 {
                let text = format!(
                    "everybody has left hub {hub}, and there are {connections} connections, {channels} channels, \
                     {subscriptions} subscriptions, {queued} messages, {requests} requests"
                );
                complain(Rule::Reaped, text);
            }
        });
    }
}
