//! The way from an address to a link: which layers stand over which stream.

use super::HubAddress;
use super::link::Link;
use super::stream_link::StreamLink;
#[cfg(feature = "tls")]
use super::tls::{TlsStream, TlsTrust};
use super::tty::SerialLine;
#[cfg(feature = "websocket")]
use super::websocket::WebSocketStream;
use crate::Cx;
#[cfg(any(feature = "tls", feature = "websocket"))]
use crate::world::Endpoint;
use crate::world::{Stream, Token};
use std::io::{self, ErrorKind};

/// A hub's address, and which certificate it must show.
#[derive(Clone, Debug)]
pub(crate) struct Destination {
    pub(crate) address: HubAddress,
    #[cfg(feature = "tls")]
    pub(crate) trust: Option<TlsTrust>,
}

impl From<&HubAddress> for Destination {
    fn from(address: &HubAddress) -> Destination {
        Destination {
            address: address.clone(),
            #[cfg(feature = "tls")]
            trust: None,
        }
    }
}

/// Begins a link to a hub; what becomes of it is reported with `token`.
///
/// # Errors
/// What is known at once, as [`Net::connect`](crate::world::Net::connect) says, and `Unsupported` for a
/// transport that this program was built without.
pub(crate) fn dial(cx: &mut Cx, to: &Destination, token: Token) -> io::Result<Box<dyn Link>> {
    let endpoint = to.address.endpoint();
    if let HubAddress::Tty { .. } = to.address {
        return SerialLine::call(cx, &endpoint, token);
    }
    check(to)?;
    let stream = cx.world().net.connect(&endpoint, token)?;
    Ok(Box::new(StreamLink::new(layers_over(cx, to, stream)?)))
}

/// Finds out before anything is opened what cannot be.
fn check(to: &Destination) -> io::Result<()> {
    match &to.address {
        HubAddress::Udp(_) => {
            let what = format!("nobody logs in at {}: connect to another address of the hub", to.address);
            Err(io::Error::new(ErrorKind::InvalidInput, what))
        }
        HubAddress::WebSocket { .. } if !cfg!(feature = "websocket") => Err(unsupported(&to.address)),
        HubAddress::SecureWebSocket { .. } if !cfg!(feature = "websocket") => Err(unsupported(&to.address)),
        HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. } if !cfg!(feature = "tls") => {
            Err(unsupported(&to.address))
        }
        #[cfg(feature = "tls")]
        HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. } if to.trust.is_none() => {
            let what = format!("{} cannot be reached without knowing which certificate to trust", to.address);
            Err(io::Error::new(ErrorKind::InvalidInput, what))
        }
        _ => Ok(()),
    }
}

#[cfg_attr(not(feature = "websocket"), expect(unused_variables))]
fn layers_over(cx: &mut Cx, to: &Destination, stream: Box<dyn Stream>) -> io::Result<Box<dyn Stream>> {
    #[cfg(feature = "tls")]
    let stream = match (&to.trust, &to.address, to.address.endpoint()) {
        (Some(trust), HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. }, Endpoint::Ip(at)) => {
            Box::new(TlsStream::connect(stream, at.ip(), trust)?) as Box<dyn Stream>
        }
        _ => stream,
    };
    #[cfg(feature = "websocket")]
    let stream = match (&to.address, to.address.endpoint()) {
        (HubAddress::WebSocket { path, .. } | HubAddress::SecureWebSocket { path, .. }, Endpoint::Ip(at)) => {
            Box::new(WebSocketStream::connect(stream, at, path, &mut *cx.world().rng)) as Box<dyn Stream>
        }
        _ => stream,
    };
    Ok(stream)
}

/// What is answered for an address whose transport was left out when this program was built.
pub(crate) fn unsupported(address: &HubAddress) -> io::Error {
    io::Error::new(ErrorKind::Unsupported, format!("this program was built without what {address} needs"))
}
