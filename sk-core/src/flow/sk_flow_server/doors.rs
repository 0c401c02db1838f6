//! Where satellites come in: listeners of every kind, and connections that upgraded elsewhere.

use super::{SkFlowServer, serve};
use crate::Cx;
use crate::flow::HubAddress;
use crate::flow::server::Origin;
use crate::flow::transport::tty::{Opening, SerialLine};
#[cfg(not(all(feature = "tls", feature = "websocket")))]
use crate::flow::transport::unsupported;
#[cfg(feature = "tls")]
use crate::flow::transport::{TlsIdentity, TlsStream};
#[cfg(feature = "websocket")]
use crate::flow::transport::{WebSocketStream, agree};
#[cfg(feature = "http")]
use crate::net::http::{HttpServer, HttpSettings};
#[cfg(feature = "websocket")]
use crate::net::http::{Upgrade, Upgraded};
use crate::net::{Door, Wrap};
use crate::object::Handle;
use std::io;
use std::rc::Rc;

impl Handle<SkFlowServer> {
    /// Listens at an address; answers where, with the port that was chosen for port 0. A Unix socket's file
    /// is only the owner's. At a WebSocket address it listens through its [HTTP server](Handle::http). At a
    /// UDP address it takes what flows publish by datagrams, and answers nothing.
    ///
    /// # Errors
    /// If the address is taken or may not be used, needs a certificate, or the server is gone. `Unsupported`
    /// if this program was built without what the address needs.
    pub fn listen(self, cx: &mut Cx, at: &HubAddress) -> io::Result<HubAddress> {
        self.refuse_at_end(cx)?;
        match at {
            HubAddress::Tcp(_) | HubAddress::Unix(_) => self.listen_for_streams(cx, at, None),
            #[cfg(feature = "websocket")]
            HubAddress::WebSocket { path, .. } => self.listen_for_upgrades(cx, at, path, None),
            HubAddress::Tty { .. } => self.listen_on_line(cx, at),
            HubAddress::Udp(at) => self.listen_for_datagrams(cx, *at),
            #[cfg(feature = "tls")]
            HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. } => {
                let what = format!("to listen at {at} a certificate is needed: use `listen_secured`");
                Err(io::Error::new(io::ErrorKind::InvalidInput, what))
            }
            #[cfg(not(all(feature = "tls", feature = "websocket")))]
            _ => Err(unsupported(at)),
        }
    }

    /// As [`listen`](Handle::listen), at a `tls:` or `wss:` address: whoever connects is shown this certificate.
    ///
    /// # Errors
    /// As [`listen`](Handle::listen), and `InvalidInput` for an address without TLS.
    #[cfg(feature = "tls")]
    pub fn listen_secured(
        self,
        cx: &mut Cx,
        at: &HubAddress,
        identity: TlsIdentity,
    ) -> io::Result<HubAddress> {
        self.refuse_at_end(cx)?;
        let wrap: Wrap = Rc::new(move |stream| Ok(Box::new(TlsStream::accepted(stream, &identity)?)));
        match at {
            HubAddress::Tls(_) => self.listen_for_streams(cx, at, Some(wrap)),
            #[cfg(feature = "websocket")]
            HubAddress::SecureWebSocket { path, .. } => self.listen_for_upgrades(cx, at, path, Some(wrap)),
            #[cfg(not(feature = "websocket"))]
            HubAddress::SecureWebSocket { .. } => Err(unsupported(at)),
            _ => {
                let what = format!("{at} has no TLS: write `tls:` or `wss:`");
                Err(io::Error::new(io::ErrorKind::InvalidInput, what))
            }
        }
    }

    fn listen_for_streams(self, cx: &mut Cx, at: &HubAddress, wrap: Option<Wrap>) -> io::Result<HubAddress> {
        let token = cx.add_source(self.id(), serve);
        let listener = match cx.world().net.listen(&at.endpoint(), token) {
            Ok(listener) => listener,
            Err(error) => {
                cx.remove_source(token);
                return Err(error);
            }
        };
        let door = Door::new(listener, wrap);
        let local = at.listening_at(&door.local());
        cx.with(self, |server, _| server.doors.insert(token, door))
            .map_err(io::Error::other)?;
        Ok(local)
    }

    fn listen_on_line(self, cx: &mut Cx, at: &HubAddress) -> io::Result<HubAddress> {
        let take = Rc::new(move |cx: &mut Cx, opening: Opening| self.take_opening(cx, opening));
        SerialLine::listen(cx, self.id(), &at.endpoint(), take)?;
        Ok(at.clone())
    }

    fn take_opening(self, cx: &mut Cx, opening: Opening) {
        if self.refuse_at_end(cx).is_err() {
            return;
        }
        let token = cx.add_source(self.id(), serve);
        let Some(link) = opening.accept(token) else { return cx.remove_source(token) };
        let now = cx.now();
        let taken = cx.with(self, |server, cx| server.take_link(cx, token, link, Origin::Line, now));
        match taken {
            // Its first bytes may have come with the opening.
            Ok(()) => cx.offer_source(token),
            Err(_) => cx.remove_source(token),
        }
    }

    #[cfg(feature = "websocket")]
    fn listen_for_upgrades(
        self,
        cx: &mut Cx,
        at: &HubAddress,
        path: &str,
        wrap: Option<Wrap>,
    ) -> io::Result<HubAddress> {
        let http = self.http(cx)?;
        let local = http.listen_through(cx, &at.endpoint(), wrap)?;
        self.serve_websocket(cx, http, path)?;
        Ok(at.listening_at(&local))
    }

    /// The server's own HTTP server, made when it is first asked for: it listens at the WebSocket addresses, and
    /// whoever has pages to show may add them there.
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    #[cfg(feature = "http")]
    pub fn http(self, cx: &mut Cx) -> io::Result<Handle<HttpServer>> {
        let made = cx.with(self, |server, _| server.http).map_err(io::Error::other)?;
        if let Some(http) = made {
            return Ok(http);
        }
        let http = HttpServer::placed(cx.under(self).named("http"), HttpSettings::default());
        cx.with(self, |server, _| server.http = Some(http)).map_err(io::Error::other)?;
        Ok(http)
    }

    /// Takes in satellites that come by WebSocket to a path of any HTTP server on this loop.
    ///
    /// # Errors
    /// If either server is gone, or one of its slots is running.
    #[cfg(feature = "websocket")]
    pub fn serve_websocket(self, cx: &mut Cx, http: Handle<HttpServer>, path: &str) -> io::Result<()> {
        let take = Rc::new(move |cx: &mut Cx, upgraded: Upgraded| self.take_upgraded(cx, upgraded));
        http.upgrade_at(cx, path, Upgrade { agree, take }).map_err(io::Error::other)
    }

    #[cfg(feature = "websocket")]
    fn take_upgraded(self, cx: &mut Cx, upgraded: Upgraded) {
        let Upgraded { stream, token, answer, leftover, begun } = upgraded;
        if self.refuse_at_end(cx).is_err() {
            return cx.remove_source(token);
        }
        cx.pass_source(token, self.id(), serve);
        let stream = Box::new(WebSocketStream::accepted(stream, answer, leftover));
        let taken = cx.with(self, |server, cx| server.take_in(cx, token, stream, begun));
        if taken.is_err() {
            return cx.remove_source(token);
        }
        // The answer goes out, and what came with the request is read.
        cx.offer_source(token);
    }
}
