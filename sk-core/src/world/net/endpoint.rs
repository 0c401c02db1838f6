//! Endpoints as simulated sockets see them.

use super::Endpoint;
use std::net::SocketAddr;

pub(super) fn address(at: &Endpoint) -> Option<SocketAddr> {
    match at {
        Endpoint::Ip(at) => Some(*at),
        Endpoint::Unix(_) | Endpoint::Tty { .. } => None,
    }
}

/// What the server sees of a client: the address that it reached, with the client's port.
pub(super) fn client_name(to: &Endpoint, port: u16) -> Option<Endpoint> {
    address(to).map(|at| Endpoint::Ip(SocketAddr::new(at.ip(), port)))
}
