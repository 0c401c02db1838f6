//! What those who take part say of themselves when they are asked from outside.

use crate::ledger;
use crate::parts::{Actor, Parts};
use crate::stamp::{Origin, channel_name};
use crate::wishes::Wishes;
use sk_core::flow::server::ServerCore;

impl Parts {
    /// Looks at a hub, if it runs.
    pub(crate) fn look_at_hub(&self, number: u16, look: impl FnOnce(&ServerCore)) {
        if let Some((node, server)) = self.hub(number) {
            node.inspect(|cx| {
                // Between rounds it is not leased.
                let _ = cx.with(server, |server, _| look(server.core()));
            });
        }
    }

    /// What an honest node should find at its hub, and its connection there.
    pub(crate) fn wishes(&self, number: u16) -> Option<Wishes> {
        let part = self.all.get(&number)?;
        if part.thread.is_some() {
            return None;
        }
        let wishes = self.node_of(number)?.inspect(|cx| match part.actor? {
            Actor::Member(member) => cx.with(member, |member, cx| member.wishes(cx)).ok(),
            Actor::Plain(plain) => cx.with(plain, |plain, _| plain.wishes()).ok(),
            Actor::Scribe(scribe) => cx.with(scribe, |scribe, cx| scribe.wishes(cx)).ok(),
            Actor::Follower(follower) => cx.with(follower, |follower, _| follower.wishes()).ok(),
            Actor::Poller(poller) => cx.with(poller, |poller, _| poller.wishes()).ok(),
            Actor::Filer(filer) => cx.with(filer, |filer, cx| filer.wishes(cx)).ok(),
            Actor::Hub(_) | Actor::Talker(_) | Actor::Wild(_) => None,
        })?;
        Some(Wishes { hub: part.hub(), ..wishes })
    }

    /// What a node that keeps things still waits for.
    pub(crate) fn unfinished(&self, number: u16) -> Option<String> {
        let part = self.all.get(&number)?;
        part.node.as_ref()?.inspect(|cx| match part.actor? {
            Actor::Scribe(scribe) => cx.with(scribe, |scribe, _| scribe.unfinished()).ok()?,
            Actor::Filer(filer) => cx.with(filer, |filer, _| filer.unfinished()).ok()?,
            _ => None,
        })
    }

    /// The last message of the undisturbed pair: how many were published, and the last that was heard.
    pub(crate) fn pair(&self) -> Option<(u64, Option<u64>)> {
        let (listener, speaker) = ledger::with(|ledger| ledger.pair)?;
        let origin = Origin { node: speaker, life: 0, channel: 0 };
        Some(ledger::with(|ledger| {
            (ledger.published_by(origin), ledger.last_heard((listener, 0), origin))
        }))
    }
}

/// The name of every channel that a node without the right to publish would have.
pub(crate) fn channels_of(node: u16) -> String {
    let first = channel_name(node, 0);
    first.trim_end_matches('0').to_owned()
}
