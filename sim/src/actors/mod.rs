//! Those who take part in a run.

mod member;
mod plain;
mod scribe;
mod talker;
mod wild;

pub(crate) use member::Member;
pub(crate) use plain::Plain;
pub(crate) use scribe::Scribe;
pub(crate) use talker::{SERVICE, Talker};
pub(crate) use wild::Wild;

use crate::script::Way;
use sk_core::flow::HubAddress;
use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::Credentials;
use sk_flat::SkVariant;
use std::net::{Ipv4Addr, SocketAddr};

/// Which life of which node an actor is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub(crate) node: u16,
    pub(crate) life: u16,
}

/// Whether a node's channel is reliable: some are, so that both kinds meet every fault.
pub(crate) fn is_reliable(node: u16, channel: u8) -> bool {
    (node + u16::from(channel)) % 3 == 2
}

/// What a node's channel says about itself.
pub(crate) fn properties_of(node: u16, channel: u8) -> SkVariant {
    let format = ("format", SkVariant::from("stamp"));
    if is_reliable(node, channel) {
        SkVariant::map([format, ("delivery", SkVariant::from("reliable"))])
    } else {
        SkVariant::map([format])
    }
}

/// The owner's token of every hub in a box.
pub(crate) const TOKEN: [u8; 32] = [7; 32];
const PORT: u16 = 4141;

impl Way {
    /// Where the hub is reached.
    pub(crate) fn address(self) -> HubAddress {
        match self {
            Way::Tcp => HubAddress::Tcp(SocketAddr::new(Ipv4Addr::LOCALHOST.into(), PORT)),
            Way::Unix => HubAddress::Unix("/run/hub.sock".into()),
        }
    }

    pub(crate) fn credentials(self) -> Credentials {
        match self {
            Way::Tcp => Credentials::Token(OwnerToken::new(TOKEN)),
            Way::Unix => Credentials::Peer,
        }
    }
}
