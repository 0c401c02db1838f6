//! Of which kind the channels of nodes are, and what they say about themselves.
//!
//! A channel's numbers decide, so that every kind meets every fault and everybody knows what to expect.

use sk_flat::SkVariant;

/// The first node whose channels are of different kinds; those of the undisturbed pair are plain.
const FIRST_NODE: u16 = 3;

/// Whether nothing that is published there may be dropped for want of room.
pub(crate) fn is_reliable(node: u16, channel: u8) -> bool {
    node >= FIRST_NODE && kind(node, channel) == 2
}

/// Whether the hub keeps the last message for those who come later.
pub(crate) fn is_latched(node: u16, channel: u8) -> bool {
    node >= FIRST_NODE && kind(node, channel) == 1
}

fn kind(node: u16, channel: u8) -> u16 {
    (node + u16::from(channel)) % 3
}

/// What a node's channel says about itself.
pub(crate) fn properties_of(node: u16, channel: u8) -> SkVariant {
    let mut properties = vec![("format", SkVariant::from("stamp"))];
    if is_reliable(node, channel) {
        properties.push(("delivery", SkVariant::from("reliable")));
    }
    if is_latched(node, channel) {
        properties.push(("latch", SkVariant::from(true)));
    }
    SkVariant::map(properties)
}
