//! The way from an address to a link: which layers stand over which stream.

use super::HubAddress;
use super::link::Link;
use super::stream_link::StreamLink;
#[cfg(feature = "websocket")]
use super::websocket::WebSocketStream;
use crate::Cx;
use crate::world::{Stream, Token};
use std::io::{self, ErrorKind};

/// Begins a link to a hub; what becomes of it is reported with `token`.
///
/// # Errors
/// What is known at once, as [`Net::connect`](crate::world::Net::connect) says, and `Unsupported` for a
/// transport that this program was built without.
pub(crate) fn dial(cx: &mut Cx, to: &HubAddress, token: Token) -> io::Result<Box<dyn Link>> {
    Ok(StreamLink::new(stream_to(cx, to, token)?))
}

fn stream_to(cx: &mut Cx, to: &HubAddress, token: Token) -> io::Result<Box<dyn Stream>> {
    match to {
        HubAddress::Tcp(_) | HubAddress::Unix(_) => cx.world().net.connect(&to.endpoint(), token),
        #[cfg(feature = "websocket")]
        HubAddress::WebSocket { at, path } => {
            let stream = cx.world().net.connect(&to.endpoint(), token)?;
            Ok(Box::new(WebSocketStream::connect(stream, *at, path, &mut *cx.world().rng)))
        }
        _ => Err(unsupported(to)),
    }
}

/// What is answered for an address whose transport was left out when this program was built.
pub(crate) fn unsupported(address: &HubAddress) -> io::Error {
    io::Error::new(ErrorKind::Unsupported, format!("this program was built without what {address} needs"))
}
