//! Publishing by datagrams: sessions, proofs, and what is made of fragments that may come late, twice or never.
//!
//! Nothing is ever answered by datagram. What a proven fragment does is what it would do on its flow, but for two
//! things: what is missing cannot be waited for, and no datagram ends a connection.

use super::super::{ConnectionId, ServerCore};
use super::publish::Piece;
use crate::flow::channel::Owner;
use crate::flow::definition::{Encoded, Tagged};
use crate::flow::delivery::DropReason;
use crate::flow::error::RefusalCode;
use crate::flow::fragment::{Gathered, Gathering};
use crate::flow::frame::{HEADER_BYTES, Header};
use crate::flow::transport::datagram::{DatagramError, DatagramKey, DatagramReader, session_of};
use crate::flow::{ChannelKind, ChannelRef, Command, Event, Flags, Message as _};
use crate::testing::{Bug, is_planted};
use bytes::Bytes;
use rustc_hash::FxHashMap;
use sha2::{Digest, Sha256};
use sk_flat::Instant;

/// What became of the datagrams that a hub received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DatagramCounts {
    /// Proven, new, and a `publish`.
    pub taken: u64,
    /// For a session that there is not, or no datagram of a session at all.
    pub unknown: u64,
    /// With a wrong proof.
    pub forged: u64,
    /// With a counter that came before, or too late to tell.
    pub replayed: u64,
    /// Proven, but not what the protocol allows a datagram to hold.
    pub malformed: u64,
}

/// Publishing by UDP, as far as it concerns all of a hub.
#[derive(Debug, Default)]
pub(in super::super) struct Udp {
    offer: Option<Offer>,
    sessions: FxHashMap<u64, ConnectionId>,
    /// How many sessions there have been: no two get the same key.
    opened: u64,
    counts: DatagramCounts,
}

#[derive(Debug)]
struct Offer {
    port: u16,
    secret: [u8; 32],
}

/// The session of one flow.
#[derive(Debug)]
pub(in super::super) struct UdpSession {
    session: u64,
    reader: DatagramReader,
    gathering: Gathering,
    lanes: FxHashMap<ChannelRef, Lane>,
}

impl UdpSession {
    /// The channel is gone.
    pub(in super::super) fn forget(&mut self, channel: ChannelRef) {
        self.gathering.forget(channel);
        self.lanes.remove(&channel);
    }

    /// Whether a whole message may be passed on: not if a newer one of its channel was, that overtook it on the other way.
    /// A channel that no datagram came for is only on one way.
    pub(super) fn takes(&mut self, channel: ChannelRef, message: u32) -> bool {
        let Some(lane) = self.lanes.get_mut(&channel) else { return true };
        let is_older = lane.taken.is_some_and(|taken| (message.wrapping_sub(taken) as i32) < 0);
        if !is_older {
            lane.taken = Some(message);
        }
        !is_older
    }

    /// What is held of unfinished messages.
    pub(in super::super) fn bytes(&self) -> usize {
        self.gathering.bytes()
    }

    /// Gives all of them up; answers their channels.
    pub(in super::super) fn give_up(&mut self) -> Vec<ChannelRef> {
        self.gathering.give_up()
    }

    /// The place of a fragment in its channel. A message that is given up holds no bytes any more.
    fn place(&mut self, channel: ChannelRef, counter: u64, flags: Flags, message: u32) -> Place {
        let lane = self.lanes.entry(channel).or_default();
        let place = lane.place(counter, flags, message);
        let continues = place.fits && !flags.has(Flags::FIRST);
        if lane.newest == counter && !continues {
            self.gathering.forget(channel);
        }
        place
    }
}

/// How far the fragments of one channel have come. A channel's messages never go back: what is older than
/// something that was taken is lost.
#[derive(Debug, Default)]
struct Lane {
    /// The counter of the newest fragment.
    newest: u64,
    /// The message that goes on with the next counter.
    open: Option<u32>,
    /// The newest message that was passed on, on whichever way it came.
    taken: Option<u32>,
    /// The last message that was counted as given up, so that each is counted once.
    given_up: Option<u32>,
}

/// What follows from the place of a fragment among the others of its channel.
#[derive(Debug, PartialEq, Eq)]
struct Place {
    /// How many messages are lost by it.
    given_up: u32,
    /// It begins a message or continues the open one.
    fits: bool,
}

impl Lane {
    fn place(&mut self, counter: u64, flags: Flags, message: u32) -> Place {
        let begins = flags.has(Flags::FIRST);
        if counter < self.newest {
            let given_up = if begins { self.give_up(message) } else { 0 };
            return Place { given_up, fits: false };
        }
        let next = counter == self.newest + 1 || is_planted(Bug::GapJoined);
        let follows = next && self.open == Some(message);
        self.newest = counter;
        let ends = flags.has(Flags::LAST) || flags == Flags::ABORT;
        if follows && !begins {
            self.open = self.open.filter(|_| !ends);
            return Place { given_up: 0, fits: true };
        }
        let mut given_up = self.open.take().map_or(0, |open| self.give_up(open));
        if begins {
            self.given_up = None;
            self.open = (!ends).then_some(message);
        } else {
            given_up += self.give_up(message);
        }
        Place { given_up, fits: begins }
    }

    fn give_up(&mut self, message: u32) -> u32 {
        u32::from(self.given_up.replace(message) != Some(message))
    }
}

impl ServerCore {
    /// From now on flows may open sessions for datagrams to this port of the hub. `secret` are 32 bytes from the
    /// world's `Rng`; all keys are derived from them.
    pub fn offer_udp(&mut self, port: u16, secret: [u8; 32]) {
        self.udp.offer = Some(Offer { port, secret });
    }

    /// No further sessions are opened.
    pub fn withdraw_udp(&mut self) {
        self.udp.offer = None;
    }

    /// The port that flows are told for their datagrams, if there is one.
    pub fn udp_port(&self) -> Option<u16> {
        self.udp.offer.as_ref().map(|offer| offer.port)
    }

    /// What became of the datagrams received so far.
    pub fn datagram_counts(&self) -> DatagramCounts {
        self.udp.counts
    }

    /// Takes a datagram from anybody. It never leads to another one, and unless it is proven, to nothing at all but
    /// a count.
    pub fn receive_datagram(&mut self, datagram: &[u8], now: Instant) {
        self.now = now;
        let found = session_of(datagram)
            .and_then(|session| self.udp.sessions.get(&session))
            .copied();
        let Some(id) = found else {
            self.udp.counts.unknown += 1;
            return;
        };
        let opened = self.udp_session(id).map(|udp| udp.reader.open_counted(datagram));
        match opened {
            Some(Ok((counter, frame))) => self.take_proven(id, counter, frame),
            Some(Err(DatagramError::Forged)) => self.udp.counts.forged += 1,
            Some(Err(DatagramError::Replayed(_))) => self.udp.counts.replayed += 1,
            Some(Err(_)) | None => self.udp.counts.unknown += 1,
        }
        self.settle();
    }

    fn udp_session(&mut self, id: ConnectionId) -> Option<&mut UdpSession> {
        self.connections.get_mut(id)?.udp.as_deref_mut()
    }

    fn take_proven(&mut self, id: ConnectionId, counter: u64, frame: &[u8]) {
        let Some(connection) = self.connections.get(id) else { return };
        let is_whole = |header: Header| header.length as usize + HEADER_BYTES == frame.len();
        let read = Header::parse(frame).filter(|header| is_whole(*header)).and_then(|_| {
            let whole = Encoded { head: Bytes::copy_from_slice(frame), payload: Bytes::new() };
            connection.inbound.accept(whole).ok()
        });
        let Some(Tagged { tag, flags, message: command @ Command::Publish { .. } }) = read else {
            self.udp.counts.malformed += 1;
            return;
        };
        self.udp.counts.taken += 1;
        // Rights may have changed since the session was opened.
        let may = connection.rights.has(command.definition().right);
        let Command::Publish { channel, message, payload } = command else { return };
        if may {
            self.publish_datagram(id, tag, (counter, flags), Piece { channel, message, payload });
        } else if flags.has(Flags::FIRST) {
            self.refuse(id, tag, RefusalCode::Denied);
        }
    }

    fn publish_datagram(&mut self, id: ConnectionId, tag: u32, place: (u64, Flags), piece: Piece) {
        let (counter, flags) = place;
        let Piece { channel, message, payload } = piece;
        let found = self.channels.get(channel);
        let known = found.map(|(known, beside)| (known.owner, known.kind, beside.is_reliable()));
        match known {
            Some((owner, ChannelKind::Stream, false)) if owner == Owner::Flow(id.wire()) => {}
            Some((owner, ChannelKind::Stream, true)) if owner == Owner::Flow(id.wire()) => {
                // What must not be missed cannot come by a way that loses.
                if flags.has(Flags::FIRST) {
                    self.refuse(id, tag, RefusalCode::NotOffered);
                }
                return;
            }
            _ => return self.turn_away(id, tag, flags, known.map(|(owner, kind, _)| (owner, kind))),
        }
        self.make_room_for_fragment(id, flags, payload.len());
        let Some(connection) = self.connections.get_mut(id) else { return };
        let bytes_max = connection.inbound.message_bytes_max();
        let Some(udp) = connection.udp.as_deref_mut() else { return };
        let place = udp.place(channel, counter, flags, message);
        let gathered = place
            .fits
            .then(|| udp.gathering.take(channel, message, flags, payload, bytes_max));
        let is_bad = matches!(gathered, Some(Err(_)));
        if is_bad {
            udp.gathering.forget(channel);
            let lane = udp.lanes.entry(channel).or_default();
            lane.open = None;
            lane.given_up = Some(message);
            self.udp.counts.malformed += 1;
        }
        let is_overtaken = matches!(gathered, Some(Ok(Gathered::Whole(_)))) && !udp.takes(channel, message);
        for _ in 0..place.given_up + u32::from(is_bad) + u32::from(is_overtaken) {
            self.drop_for_all(channel, DropReason::Aborted);
        }
        if let Some(Ok(gathered)) = gathered.filter(|_| !is_overtaken) {
            self.gathered(id, tag, (channel, message), gathered);
        }
    }

    /// A flow wants to publish by datagrams. Its former session, if it had one, is over.
    pub(in super::super) fn udp_open(&mut self, id: ConnectionId, tag: u32) {
        let Some(offer) = &self.udp.offer else { return self.refuse(id, tag, RefusalCode::NotOffered) };
        let port = offer.port;
        let Some(connection) = self.connections.get(id) else { return };
        let (session, key) = loop {
            self.udp.opened += 1;
            let derive = |label: &[u8]| -> [u8; 32] {
                let known = Sha256::new().chain_update(label).chain_update(offer.secret);
                let made = known
                    .chain_update(connection.hub_nonce)
                    .chain_update(self.udp.opened.to_le_bytes());
                made.finalize().into()
            };
            let [a, b, c, d, e, f, g, h, ..] = derive(b"SpecialK flow 1 datagram session");
            let session = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
            if !self.udp.sessions.contains_key(&session) {
                break (session, derive(b"SpecialK flow 1 datagram key"));
            }
        };
        self.end_udp_session(id);
        self.udp.sessions.insert(session, id);
        if let Some(connection) = self.connections.get_mut(id) {
            connection.udp = Some(Box::new(UdpSession {
                session,
                reader: DatagramReader::new(session, DatagramKey::new(key)),
                gathering: Gathering::charged_to(self.unfinished.clone()),
                lanes: FxHashMap::default(),
            }));
        }
        self.answer(id, tag, &Event::UdpOpened { session, key, port });
    }

    /// A session is over, with its flow or because there is a new one. What it had begun will not be whole.
    pub(in super::super) fn end_udp_session(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let Some(ended) = connection.udp.take() else { return };
        self.udp.sessions.remove(&ended.session);
        for (channel, lane) in ended.lanes {
            if lane.open.is_some() {
                self.drop_for_all(channel, DropReason::Aborted);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The places of fragments, each a counter, flags and a message.
    fn places(fragments: &[(u64, Flags, u32)]) -> Vec<(u32, bool)> {
        let mut lane = Lane::default();
        let mut place = |&(counter, flags, message): &(u64, Flags, u32)| {
            let Place { given_up, fits } = lane.place(counter, flags, message);
            (given_up, fits)
        };
        fragments.iter().map(&mut place).collect()
    }

    #[test]
    fn a_lost_or_swapped_fragment_gives_its_message_up_once() {
        let (first, middle, last, whole) = (Flags::FIRST, Flags::NONE, Flags::LAST, Flags::WHOLE);
        let good = places(&[(1, first, 0), (2, middle, 0), (3, last, 0), (7, whole, 1)]);
        assert_eq!(good, [(0, true); 4]);
        let lost_middle = places(&[(1, first, 0), (3, last, 0), (4, whole, 1)]);
        assert_eq!(lost_middle, [(0, true), (1, false), (0, true)]);
        let lost_last = places(&[(1, first, 0), (2, middle, 0), (4, whole, 1)]);
        assert_eq!(lost_last, [(0, true), (0, true), (1, true)]);
        let lost_first = places(&[(2, middle, 0), (3, last, 0), (4, whole, 1)]);
        assert_eq!(lost_first, [(1, false), (0, false), (0, true)]);
        let swapped = places(&[(1, first, 0), (3, last, 0), (2, middle, 0)]);
        assert_eq!(swapped, [(0, true), (1, false), (0, false)]);
        let begun_late = places(&[(2, last, 0), (1, first, 0)]);
        assert_eq!(begun_late, [(1, false), (0, false)]);
        let two_at_once = places(&[(1, first, 0), (4, last, 1)]);
        assert_eq!(two_at_once, [(0, true), (2, false)]);
    }

    #[test]
    fn a_message_older_than_one_that_was_taken_is_given_up() {
        let (whole, first) = (Flags::WHOLE, Flags::FIRST);
        assert_eq!(
            places(&[(2, whole, 1), (1, whole, 0), (3, whole, 2)]),
            [(0, true), (1, false), (0, true)]
        );
        // The open message is not harmed by one that is late.
        let open = places(&[(2, first, 1), (1, whole, 0), (3, Flags::LAST, 1)]);
        assert_eq!(open, [(0, true), (1, false), (0, true)]);
    }
}
