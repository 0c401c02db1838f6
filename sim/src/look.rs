//! What those who take part say of themselves when they are asked from outside.

use crate::ledger;
use crate::run::{Actor, Run};
use crate::stamp::{Origin, channel_name};

impl Run<'_> {
    /// What an honest node should find at the hub, and its connection there.
    pub(crate) fn wishes(&self, number: u16) -> Option<Wishes> {
        let part = self.parts.get(&number)?;
        if part.thread.is_some() {
            return None;
        }
        let node = self.node_of(number)?;
        let (ready, connection, (own, wanted)) = node.inspect(|cx| match part.actor? {
            Actor::Member(member) => {
                let found = cx.with(member, |m, cx| (m.ready, m.connection(cx), m.wishes()));
                found.ok()
            }
            Actor::Plain(plain) => cx.with(plain, |p, _| (p.ready, p.connection(), p.wishes())).ok(),
            Actor::Scribe(scribe) => {
                let none = (Vec::new(), Vec::new());
                cx.with(scribe, |s, cx| (s.ready, s.connection(cx), none)).ok()
            }
            Actor::Hub(_) | Actor::Talker(_) | Actor::Wild(_) => None,
        })?;
        Some(Wishes { ready, connection, own, wanted })
    }

    /// What a node that keeps things still waits for.
    pub(crate) fn unfinished(&self, number: u16) -> Option<String> {
        let part = self.parts.get(&number)?;
        let Some(Actor::Scribe(scribe)) = part.actor else { return None };
        let looked = part
            .node
            .as_ref()?
            .inspect(|cx| cx.with(scribe, |scribe, _| scribe.unfinished()));
        looked.ok().flatten()
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

/// What an honest node should find at the hub.
pub(crate) struct Wishes {
    pub(crate) ready: bool,
    pub(crate) connection: Option<u64>,
    pub(crate) own: Vec<String>,
    pub(crate) wanted: Vec<String>,
}

/// The name of every channel that a node without the right to publish would have.
pub(crate) fn channels_of(node: u16) -> String {
    let first = channel_name(node, 0);
    first.trim_end_matches('0').to_owned()
}
