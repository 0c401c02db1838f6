//! The hub's UDP sockets: datagrams in, never one out.

use super::SkFlowServer;
use crate::Cx;
use crate::flow::HubAddress;
use crate::flow::transport::datagram::DATAGRAM_BYTES_MAX;
use crate::object::{Handle, ObjectId};
use crate::world::Readiness;
use std::io::{self, ErrorKind};
use std::net::SocketAddr;

/// How many datagrams one socket takes in one turn; others have theirs then.
const DATAGRAMS_PER_TURN_MAX: usize = 64;

impl Handle<SkFlowServer> {
    /// Of several sockets each takes the datagrams of all sessions; flows are told the port of the first.
    pub(super) fn listen_for_datagrams(self, cx: &mut Cx, at: SocketAddr) -> io::Result<HubAddress> {
        let token = cx.add_source(self.id(), serve);
        let socket = match cx.world().net.bind(at, token) {
            Ok(socket) => socket,
            Err(error) => {
                cx.remove_source(token);
                return Err(error);
            }
        };
        let local = socket.local();
        let mut secret = [0; 32];
        cx.world().rng.fill(&mut secret);
        let taken = cx.with(self, |server, _| {
            if server.core.udp_port().is_none() {
                server.core.offer_udp(local.port(), secret);
            }
            server.datagrams.insert(token, socket);
        });
        taken.map_err(io::Error::other)?;
        Ok(HubAddress::Udp(local))
    }
}

impl SkFlowServer {
    /// Takes what waits, up to a turn's share. Answers whether more may wait.
    fn take_datagrams(&mut self, cx: &mut Cx, readiness: Readiness) -> bool {
        let now = cx.now();
        let Some(socket) = self.datagrams.get_mut(&readiness.token) else { return false };
        // One byte more than the longest, so that a longer one is seen to be.
        let mut room = [0; DATAGRAM_BYTES_MAX + 1];
        let mut more = true;
        for _ in 0..DATAGRAMS_PER_TURN_MAX {
            match socket.receive(&mut room) {
                Ok((count, _)) => self.core.receive_datagram(&room[..count.min(room.len())], now),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    more = false;
                    break;
                }
                // The report on something else; more may wait behind it.
                Err(_) => {}
            }
        }
        self.after(cx);
        more
    }

    pub(super) fn stop_datagrams(&mut self, cx: &mut Cx) {
        self.core.withdraw_udp();
        for (token, _) in self.datagrams.drain() {
            cx.remove_source(token);
        }
    }
}

/// A socket is ready.
fn serve(cx: &mut Cx, server: ObjectId, readiness: Readiness) -> bool {
    cx.with(Handle::<SkFlowServer>::new(server), |server, cx| server.take_datagrams(cx, readiness))
        .unwrap_or(false)
}
