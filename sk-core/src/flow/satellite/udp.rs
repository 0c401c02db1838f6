//! Publishing by datagrams, seen from a satellite: what is lost on the way is lost.

use super::super::fragment::cut;
use super::super::limits::{CONNECTION_BYTES_MAX, ITEM_OVERHEAD_BYTES};
use super::super::transport::datagram::{DATAGRAM_FRAME_BYTES_MAX, DatagramKey, DatagramWriter};
use super::super::{ChannelRef, Command, Flags, Message as _};
use super::{SatelliteCore, SatelliteError, SatelliteEvent};
use bytes::Bytes;
use std::collections::VecDeque;

/// A flow's session for datagrams.
#[derive(Debug, Default)]
pub(super) struct Udp {
    /// None before the hub has opened it.
    writer: Option<DatagramWriter>,
    waiting: VecDeque<Vec<u8>>,
    /// What waits, each datagram with its overhead.
    bytes: usize,
}

impl SatelliteCore {
    /// Asks for a session for datagrams; `UdpOpened` or `Refused` with the tag answers.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn open_udp(&mut self) -> Result<u32, SatelliteError> {
        self.need_flow("udp_open")?;
        self.command(&Command::UdpOpen {})
    }

    /// Gives the session up: what follows goes over the connection. What waits is dropped.
    pub fn close_udp(&mut self) {
        self.udp = Udp::default();
    }

    /// Whether there is a session for datagrams.
    pub fn is_udp_open(&self) -> bool {
        self.udp.writer.is_some()
    }

    pub(super) fn udp_opened(&mut self, tag: u32, session: u64, key: [u8; 32], port: u16) {
        // What was sealed for a former session is worth nothing any more.
        self.close_udp();
        self.udp.writer = Some(DatagramWriter::new(session, DatagramKey::new(key)));
        self.events.push_back(SatelliteEvent::UdpOpened { tag, port });
    }

    /// As [`publish`](SatelliteCore::publish), in datagrams, which may be lost and are not missed by anybody then.
    /// While there is no session, and on a reliable channel always, the message goes over the connection.
    ///
    /// # Errors
    /// As [`publish`](SatelliteCore::publish).
    pub fn publish_by_udp(&mut self, channel: ChannelRef, payload: Bytes) -> Result<bool, SatelliteError> {
        let max = self.inbound.message_bytes_max();
        let own = self.own.get_mut(&channel).ok_or(SatelliteError::NotOwn(channel))?;
        let Some(writer) = self.udp.writer.as_mut().filter(|_| own.credit.is_none()) else {
            return self.publish(channel, payload);
        };
        if payload.len() > max {
            return Err(SatelliteError::TooLong { length: payload.len(), max });
        }
        if !own.listened && !own.latched {
            return Ok(false);
        }
        let message = own.next_message;
        let frame = |payload, flags| Command::Publish { channel, message, payload }.encode(0, flags);
        let overhead = frame(Bytes::new(), Flags::NONE).len();
        let piece_bytes = (DATAGRAM_FRAME_BYTES_MAX - overhead).min(self.outbox.fragment_bytes_max);
        let count = payload.len().div_ceil(piece_bytes).max(1);
        let charge = payload.len() + count * charge_of(overhead);
        if self.udp.bytes + charge > CONNECTION_BYTES_MAX {
            return Err(SatelliteError::Full);
        }
        own.next_message = own.next_message.wrapping_add(1);
        // One behind the other: the hub takes a message only if its datagrams follow each other.
        for (flags, piece) in cut(payload, piece_bytes) {
            let sealed = writer.seal(&frame(piece, flags).to_vec()).map_err(|_| SatelliteError::Full)?;
            self.udp.bytes += charge_of(sealed.len());
            self.udp.waiting.push_back(sealed);
        }
        Ok(true)
    }

    /// The next datagram for the hub, to be sent to the port of [`UdpOpened`](SatelliteEvent::UdpOpened).
    pub fn datagram(&self) -> Option<&[u8]> {
        self.udp.waiting.front().map(Vec::as_slice)
    }

    /// Notes that the next datagram was sent, or given up.
    pub fn datagram_sent(&mut self) {
        if let Some(sent) = self.udp.waiting.pop_front() {
            self.udp.bytes -= charge_of(sent.len());
        }
    }
}

fn charge_of(datagram_bytes: usize) -> usize {
    datagram_bytes + ITEM_OVERHEAD_BYTES
}
