//! The newest messages that were heard: who asks for a channel's newest message afterwards must be told none that is
//! older.

use crate::stamp::{Origin, Stamp};
use sk_core::flow::ChannelRef;
use sk_flat::Instant;
use std::collections::BTreeMap;

/// The newest message of each channel that anybody heard.
#[derive(Debug, Default)]
pub(crate) struct Latest {
    /// By hub and reference.
    heard: BTreeMap<(u16, ChannelRef), Stamp>,
}

impl Latest {
    /// A message of its publisher's own channel was heard.
    pub(crate) fn was_heard(&mut self, hub: u16, reference: ChannelRef, stamp: &Stamp) {
        let newest = self.heard.entry((hub, reference)).or_insert(*stamp);
        if newest.origin != stamp.origin || newest.sequence < stamp.sequence {
            *newest = *stamp;
        }
    }

    /// A hub ends: the next one gives out the same references.
    pub(crate) fn hub_ends(&mut self, hub: u16) {
        self.heard.retain(|(of, _), _| *of != hub);
    }

    /// What the hub has for sure, for one for whom it keeps the newest message since that moment.
    pub(crate) fn floor(&self, hub: u16, reference: ChannelRef, since: Instant) -> Option<(Origin, u64)> {
        let stamp = self.heard.get(&(hub, reference))?;
        (stamp.at_ns > since.as_nanos()).then_some((stamp.origin, stamp.sequence))
    }
}
