//! Which connection it is, where it comes from, and why it ended.

use crate::flow::Rights;
use crate::flow::error::{ClosingReason, ProtocolError};
use std::fmt;
use std::net::IpAddr;

/// Identity of a connection: no two live ones share it, and a former one's finds nobody.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ConnectionId {
    pub(super) generation: u32,
    pub(super) index: u32,
}

impl ConnectionId {
    /// The number on the wire, never 0.
    pub const fn wire(self) -> u64 {
        (self.generation as u64) << 32 | self.index as u64
    }

    pub(in super::super) const fn from_wire(wire: u64) -> ConnectionId {
        ConnectionId { generation: (wire >> 32) as u32, index: wire as u32 }
    }
}

impl fmt::Display for ConnectionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.index, self.generation)
    }
}

/// Where a connection comes from, as its transport knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// From this address.
    Network(IpAddr),
    /// Over a Unix socket, from a process of this user.
    Unix {
        /// The user id that the kernel tells.
        uid: u32,
    },
    /// Over a serial line.
    Line,
    /// From inside the hub's own process.
    Inside {
        /// What it may do after `login_peer`.
        rights: Rights,
    },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Origin::Network(address) => write!(f, "{address}"),
            Origin::Unix { uid } => write!(f, "local user {uid}"),
            Origin::Line => f.write_str("a serial line"),
            Origin::Inside { .. } => f.write_str("this process"),
        }
    }
}

/// Why a connection ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The peer or the transport ended it.
    Left,
    /// The hub ended it and said why.
    Closed(ClosingReason),
    /// The peer sent what no honest one sends.
    Spurious(ProtocolError),
}
