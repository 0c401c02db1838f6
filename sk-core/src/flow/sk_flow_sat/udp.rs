//! A satellite's UDP socket: channels that are published by datagrams, as far as the hub offers it.

use super::{SkFlowSat, Way};
use crate::Cx;
use crate::flow::satellite::SatelliteError;
use crate::object::{Handle, ObjectId};
use crate::world::{Datagram, Endpoint, Readiness, Token};
use std::io::{self, ErrorKind};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

/// How many datagrams are sent before others have their turn.
const DATAGRAMS_PER_TURN_MAX: usize = 64;
/// When a system without room for a datagram is asked again.
const SEND_AGAIN_AFTER: Duration = Duration::from_millis(1);

/// The session of this link, as far as it has come.
#[derive(Default)]
pub(super) struct Udp {
    asked: bool,
    socket: Option<Socket>,
}

struct Socket {
    datagrams: Box<dyn Datagram>,
    token: Token,
    to: SocketAddr,
}

impl SkFlowSat {
    pub(super) fn publish_by_udp(&mut self, cx: &mut Cx, name: &str) -> Result<(), SatelliteError> {
        let own = self.own.get_mut(name).ok_or_else(|| SatelliteError::NotOpen(name.to_owned()))?;
        own.by_udp = true;
        self.ask_for_udp(cx);
        Ok(())
    }

    /// Once for each link, if any channel wants it.
    pub(super) fn ask_for_udp(&mut self, cx: &mut Cx) {
        if self.udp.asked || self.hub_at().is_none() || !self.own.values().any(|own| own.by_udp) {
            return;
        }
        let Some(core) = self.core.as_mut().filter(|core| core.is_ready()) else { return };
        match core.open_udp() {
            Ok(_) => self.udp.asked = true,
            Err(error) => tracing::error!("no datagrams can be sent: {error}"),
        }
        self.flush_later(cx);
    }

    /// Where the hub's UDP port is, but for the port. A hub on this machine is taken to listen on the loopback;
    /// one at the other end of a serial line cannot be reached.
    fn hub_at(&self) -> Option<SocketAddr> {
        let Way::Address { to, .. } = &self.way else { return Some((Ipv4Addr::LOCALHOST, 0).into()) };
        match to.address.endpoint() {
            Endpoint::Ip(at) => Some(at),
            Endpoint::Unix(_) => Some((Ipv4Addr::LOCALHOST, 0).into()),
            _ => None,
        }
    }

    /// The hub has opened the session.
    pub(super) fn udp_opened(&mut self, cx: &mut Cx, port: u16) {
        self.close_udp(cx);
        self.udp.asked = true;
        let Some(mut to) = self.hub_at() else { return };
        to.set_port(port);
        match bind_towards(cx, cx.this(self), to) {
            Ok(socket) => self.udp.socket = Some(socket),
            Err(error) => {
                tracing::error!("publishing goes over the connection, for no UDP socket can be had: {error}");
                if let Some(core) = &mut self.core {
                    core.close_udp();
                }
            }
        }
        self.flush_later(cx);
    }

    /// The link is over, and the session with it.
    pub(super) fn close_udp(&mut self, cx: &mut Cx) {
        if let Some(socket) = std::mem::take(&mut self.udp).socket {
            cx.remove_source(socket.token);
        }
    }

    pub(super) fn has_datagrams(&self) -> bool {
        self.udp.socket.is_some() && self.core.as_ref().is_some_and(|core| core.datagram().is_some())
    }

    /// Sends what waits, up to a turn's share. What the system refuses is lost like what the network loses.
    pub(super) fn send_datagrams(&mut self, cx: &mut Cx) {
        let (Some(core), Some(socket)) = (&mut self.core, &mut self.udp.socket) else { return };
        for _ in 0..DATAGRAMS_PER_TURN_MAX {
            let Some(datagram) = core.datagram() else { return };
            if let Err(error) = socket.datagrams.send(socket.to, datagram)
                && error.kind() == ErrorKind::WouldBlock
            {
                return cx.offer_source_after(socket.token, SEND_AGAIN_AFTER);
            }
            core.datagram_sent();
        }
        cx.offer_source(socket.token);
    }
}

/// A socket from which `to` is reached.
fn bind_towards(cx: &mut Cx, satellite: Handle<SkFlowSat>, to: SocketAddr) -> io::Result<Socket> {
    let from = match to.ip() {
        ip if ip.is_loopback() => ip,
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let token = cx.add_source(satellite.id(), serve);
    match cx.world().net.bind(SocketAddr::new(from, 0), token) {
        Ok(datagrams) => Ok(Socket { datagrams, token, to }),
        Err(error) => {
            cx.remove_source(token);
            Err(error)
        }
    }
}

/// More waits to be sent, and others have had their turn. Nothing is ever received.
fn serve(cx: &mut Cx, satellite: ObjectId, _readiness: Readiness) -> bool {
    // One that was buried has nothing to send.
    let _ = cx.with(Handle::<SkFlowSat>::new(satellite), |satellite, cx| satellite.send_datagrams(cx));
    false
}
