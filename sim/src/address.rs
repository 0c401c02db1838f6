//! Where the hubs of a box are reached, and how one logs in there.

use crate::script::Way;
use sk_core::flow::HubAddress;
use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::Credentials;
use std::net::{Ipv4Addr, SocketAddr};

/// The first port of hub 0; each further one has its own ten.
const PORTS_FROM: u16 = 4141;
const PORTS_PER_HUB: u16 = 10;

/// The owner's token of a hub.
pub(crate) fn token_of(hub: u16) -> OwnerToken {
    OwnerToken::new([7 + hub as u8; 32])
}

fn port(hub: u16, which: u16) -> SocketAddr {
    let port = PORTS_FROM.wrapping_add(hub.wrapping_mul(PORTS_PER_HUB)).wrapping_add(which);
    SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port)
}

/// Where a hub takes datagrams.
pub(crate) fn datagrams_of(hub: u16) -> HubAddress {
    HubAddress::Udp(port(hub, 2))
}

impl Way {
    /// All of them.
    pub(crate) const ALL: [Way; 3] = [Way::Tcp, Way::Unix, Way::Web];

    /// Where a hub is reached on this way.
    pub(crate) fn address(self, hub: u16) -> HubAddress {
        match self {
            Way::Tcp => HubAddress::Tcp(port(hub, 0)),
            Way::Web => HubAddress::WebSocket { at: port(hub, 1), path: "/flow".to_owned() },
            Way::Unix => HubAddress::Unix(format!("/run/hub{hub}.sock").into()),
        }
    }

    /// What a hub's own satellites log in with.
    pub(crate) fn credentials(self, hub: u16) -> Credentials {
        match self {
            Way::Tcp | Way::Web => Credentials::Token(token_of(hub)),
            Way::Unix => Credentials::Peer,
        }
    }

    /// Whether a satellite of one hub is let in by another one that it calls by mistake: the user id is the same
    /// everywhere, the token is not.
    pub(crate) fn opens_any_hub(self) -> bool {
        self == Way::Unix
    }
}
