//! What is looked at from outside: the hub's books and registries, the loops' counters, the log.

use crate::ledger::{self, Rule};
use crate::look::{Wishes, channels_of};
use crate::run::{Part, Run};
use crate::{log, script::Role};
use sk_core::flow::delivery::DropReason;
use sk_core::flow::server::ServerCore;
use sk_core::flow::{ChannelKind, ChannelRef};
use std::collections::BTreeMap;

fn complain(rule: Rule, text: String) {
    ledger::with(|ledger| ledger.complain(rule, text));
}

/// What holds at every moment.
pub(crate) fn always(run: &Run<'_>) {
    for (number, part) in &run.parts {
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
    let must_not_miss = must_not_miss(run);
    look_at_hub(run, |core| {
        let totals = core.totals();
        if !totals.balance() {
            complain(Rule::Books, format!("in total {totals:?}"));
        }
        for (connection, channel, counts) in core.subscriptions() {
            if !counts.balance() {
                complain(Rule::Books, format!("connection {connection}, channel {channel}: {counts:?}"));
            }
        }
        let mut listeners: BTreeMap<ChannelRef, usize> = BTreeMap::new();
        for (_, channel, _) in core.subscriptions() {
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
        policies(core, &must_not_miss);
        let (spurious, wild) = (core.spurious(), ledger::with(|ledger| ledger.wild_sent));
        if spurious > wild {
            let last = log::last_warning().unwrap_or_default();
            let text = format!("{spurious} connections were killed, {wild} misbehaved; the last: {last}");
            complain(Rule::Honest, text);
        }
        let denied = ledger::with(|ledger| ledger.may_not_publish.clone());
        for prefix in denied.into_iter().map(channels_of) {
            if core.channels().any(|(channel, _)| channel.name.as_str().starts_with(&prefix)) {
                complain(Rule::Rights, format!("a channel {prefix}… exists, and its owner may not publish"));
            }
        }
    });
}

/// The subscriptions that must not miss a message, by connection and name.
fn must_not_miss(run: &Run<'_>) -> Vec<(u64, String)> {
    let hears_all = ledger::with(|ledger| ledger.hears_all.clone());
    let all = hears_all.into_iter().filter(|(_, all)| *all);
    all.filter_map(|((node, name), _)| Some((run.wishes(node)?.connection?, name)))
        .collect()
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

fn look_at_hub(run: &Run<'_>, look: impl FnOnce(&ServerCore)) {
    if let Some((node, server)) = run.hub() {
        node.inspect(|cx| {
            // Between rounds it is not leased.
            let _ = cx.with(server, |server, _| look(server.core()));
        });
    }
}

/// What holds when nothing was wrong for long enough.
pub(crate) fn calm(run: &Run<'_>) {
    let wishes: BTreeMap<u16, Wishes> = run
        .parts
        .keys()
        .filter_map(|number| Some((*number, run.wishes(*number)?)))
        .collect();
    for (number, wishes) in &wishes {
        if !wishes.ready {
            complain(Rule::Restored, format!("n{number} is not let in though nothing is wrong any more"));
        }
    }
    look_at_hub(run, |core| {
        for (number, wishes) in &wishes {
            restored(core, &run.parts[number], *number, wishes);
        }
        for (connection, channel, counts) in core.subscriptions() {
            // Ticks go on, and only the newest is kept.
            if core
                .channels()
                .any(|(known, _)| known.reference == channel && known.kind == ChannelKind::Sync)
            {
                continue;
            }
            let key = (connection.wire(), channel);
            let received = ledger::with(|ledger| ledger.received.get(&key).copied().unwrap_or_default());
            let known = wishes.values().any(|wishes| wishes.connection == Some(key.0));
            if counts.queued > 0 {
                let text =
                    format!("connection {connection}, channel {channel}: {} still wait", counts.queued);
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
    });
    if let Some(unfinished) = run.parts.keys().find_map(|number| run.unfinished(*number)) {
        complain(Rule::Kept, unfinished);
    }
    if let Some(key) = ledger::with(|ledger| ledger.endless_call()) {
        complain(Rule::Services, format!("{key:?} has no end"));
    }
    if let Some((published, last)) = run.pair()
        && last.map_or(0, |last| last + 2) < published
    {
        complain(
            Rule::Bystander,
            format!("{published} messages were published, the last heard was {last:?}"),
        );
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
pub(crate) fn reaped(run: &Run<'_>) {
    look_at_hub(run, |core| {
        let (connections, channels) = (core.connections(), core.channels().count());
        let (subscriptions, queued) = (core.subscriptions().count(), core.totals().queued);
        let requests = core.open_requests();
        if connections + channels + subscriptions + requests > 0 || queued > 0 {
            let text = format!(
                "everybody has left, and there are {connections} connections, {channels} channels, \
                 {subscriptions} subscriptions, {queued} messages, {requests} requests"
            );
            complain(Rule::Reaped, text);
        }
    });
}
