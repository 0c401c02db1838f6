//! What an honest node should find at its hub.

use sk_core::flow::ChannelRef;
use std::collections::BTreeSet;

/// What an honest node should find at its hub.
#[derive(Clone, Debug, Default)]
pub(crate) struct Wishes {
    /// Which hub that is.
    pub(crate) hub: u16,
    /// It was let in.
    pub(crate) ready: bool,
    pub(crate) connection: Option<u64>,
    /// Names of channels that it wants to have.
    pub(crate) own: Vec<String>,
    /// Names of channels that it wants to hear.
    pub(crate) wanted: Vec<String>,
    /// The channels that exist, as it was told.
    pub(crate) known: Option<BTreeSet<ChannelRef>>,
}
