//! Services: calls in, requests to the owner, answers back, and exactly one end for every call.

pub(super) mod requests;

use super::super::channel::{Channel, Owner};
use super::super::error::{ProtocolError, RefusalCode};
use super::super::fragment::{Gathered, Pieces, cut, joined};
use super::super::limits::{
    DEADLINE_DEFAULT, DEADLINE_MAX, FRAGMENT_BYTES_MAX, ITEM_OVERHEAD_BYTES, MESSAGE_BYTES_MAX,
    REQUESTS_PER_ASKER_MAX, REQUESTS_PER_OWNER_MAX, TEXT_BYTES_MAX,
};
use super::super::{ChannelKind, ChannelRef, Event, Flags, Message as _, Properties, Right};
use super::connection::incoming::{Call, Incoming};
use super::connection::talk::{Kind, Talk, TalkKey};
use super::{ConnectionId, Notice, ServerCore, owning_flow};
use crate::testing::{Bug, is_planted};
use bytes::Bytes;
use requests::{Request, RequestId};
use sk_flat::{Instant, Name};
use std::time::Duration;

/// The fields of a `call`.
pub(super) struct CallPiece {
    pub(super) channel: ChannelRef,
    pub(super) deadline_ms: u32,
    pub(super) payload: Bytes,
}

/// The fields of an `answer`.
pub(super) struct AnswerPiece {
    pub(super) request: u64,
    pub(super) more: u8,
    pub(super) payload: Bytes,
}

impl ServerCore {
    /// One fragment of a call. A call that is refused at its first fragment leaves no trace: what follows of it
    /// is dropped and counted.
    pub(super) fn call(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        piece: CallPiece,
    ) -> Result<(), ProtocolError> {
        let CallPiece { channel, deadline_ms, payload } = piece;
        if Duration::from_millis(deadline_ms.into()) > DEADLINE_MAX {
            let value = deadline_ms.into();
            return Err(ProtocolError::BadValue { kind: "call", field: "deadline_ms", value });
        }
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        match connection.calls.get(&tag) {
            Some(Call::Open(_)) if flags.has(Flags::FIRST) => {
                return Err(ProtocolError::BadValue { kind: "call", field: "tag", value: tag.into() });
            }
            None if flags.has(Flags::FIRST) => {
                if let Err(code) = self.may_call(id, channel) {
                    self.refuse(id, tag, code);
                    self.late_fragments += u64::from(!flags.has(Flags::LAST));
                    return Ok(());
                }
                if let Some(connection) = self.connections.get_mut(id) {
                    connection.calls.insert(tag, Call::Begun);
                }
            }
            Some(Call::Begun) => {}
            // The rest of a call that was refused, cancelled or given up.
            Some(Call::Open(_)) | None => {
                self.late_fragments += 1;
                return Ok(());
            }
        }
        self.gather_call(id, tag, flags, CallPiece { channel, deadline_ms, payload })
    }

    fn gather_call(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        piece: CallPiece,
    ) -> Result<(), ProtocolError> {
        self.make_room_for_fragment(id, flags, piece.payload.len());
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        let bytes_max = connection.inbound.message_bytes_max();
        // A tag has one message at a time, so the message's id is the tag.
        match connection
            .gathering
            .take(Incoming::Call(tag), tag, flags, piece.payload, bytes_max)?
        {
            Gathered::More | Gathered::Ignored => {}
            Gathered::Whole(pieces) => {
                connection.calls.remove(&tag);
                let opened = self.open_request(id, tag, piece.channel, piece.deadline_ms, pieces);
                if let Err(code) = opened {
                    self.refuse(id, tag, code);
                }
            }
            Gathered::Aborted => {
                connection.calls.remove(&tag);
            }
            Gathered::Overfull => self.give_up_call(id, tag),
        }
        Ok(())
    }

    /// There is no room for a call that is coming in.
    pub(super) fn give_up_call(&mut self, id: ConnectionId, tag: u32) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.gathering.forget(Incoming::Call(tag));
        connection.calls.remove(&tag);
        self.refuse(id, tag, RefusalCode::Full);
    }

    /// What can be said against a call when it begins.
    fn may_call(&self, id: ConnectionId, channel: ChannelRef) -> Result<(), RefusalCode> {
        let (known, _) = self.channels.get(channel).ok_or(RefusalCode::NoSuchService)?;
        self.check_call(id, known)?;
        let calls = self.connections.get(id).map_or(0, |connection| connection.calls.len());
        if calls >= REQUESTS_PER_ASKER_MAX {
            return Err(RefusalCode::TooManyRequests);
        }
        self.owner_has_room(known.owner)
    }

    fn check_call(&self, id: ConnectionId, service: &Channel) -> Result<(), RefusalCode> {
        if !self.is_allowed(id, Right::Call, service.name.as_str()) {
            return Err(RefusalCode::Denied);
        }
        if service.kind == ChannelKind::Service { Ok(()) } else { Err(RefusalCode::WrongKind) }
    }

    fn owner_has_room(&self, owner: Owner) -> Result<(), RefusalCode> {
        let open = match owner {
            Owner::Hub => self.serving.len(),
            Owner::Flow(_) => {
                let owner = owning_flow(&self.connections, owner).ok_or(RefusalCode::OwnerGone)?;
                self.connections.get(owner).map_or(0, |connection| connection.serving.len())
            }
        };
        if open < REQUESTS_PER_OWNER_MAX { Ok(()) } else { Err(RefusalCode::TooManyRequests) }
    }

    /// The call is whole: its owner gets it.
    fn open_request(
        &mut self,
        id: ConnectionId,
        tag: u32,
        channel: ChannelRef,
        deadline_ms: u32,
        pieces: Pieces,
    ) -> Result<(), RefusalCode> {
        // It was there when the call began.
        let (known, _) = self.channels.get(channel).ok_or(RefusalCode::OwnerGone)?;
        // And the right to call it may have gone since.
        self.check_call(id, known)?;
        let owner = known.owner;
        self.owner_has_room(owner)?;
        let span = match deadline_ms {
            0 => DEADLINE_DEFAULT,
            ms => Duration::from_millis(ms.into()),
        };
        let owner = owning_flow(&self.connections, owner);
        let request =
            self.requests
                .add(Request { channel, asker: id, tag, owner, span, deadline: self.now + span });
        if let Err(code) = self.deliver_request(channel, request, id, owner, pieces) {
            self.requests.remove(request);
            return Err(code);
        }
        if let Some(connection) = self.connections.get_mut(id) {
            connection.calls.insert(tag, Call::Open(request));
        }
        Ok(())
    }

    fn deliver_request(
        &mut self,
        channel: ChannelRef,
        request: RequestId,
        asker: ConnectionId,
        owner: Option<ConnectionId>,
        pieces: Pieces,
    ) -> Result<(), RefusalCode> {
        let Some(owner) = owner else {
            let charged = self.budget.charge(length(&pieces) + ITEM_OVERHEAD_BYTES);
            if self.budget.is_over() {
                return Err(RefusalCode::TooManyRequests);
            }
            // It is held until it is answered.
            self.serving.insert(request, charged);
            let payload = joined(pieces);
            self.notices.push_back(Notice::Request { channel, request, asker, payload });
            return Ok(());
        };
        let connection = self.connections.get_mut(owner).ok_or(RefusalCode::OwnerGone)?;
        if length(&pieces) > connection.inbound.message_bytes_max() {
            return Err(RefusalCode::TooLong);
        }
        let kind = Kind::Request { channel, request: request.wire(), asker: asker.wire() };
        if !connection.output.talk(Talk::new(kind, pieces, &self.budget)) {
            return Err(RefusalCode::TooManyRequests);
        }
        connection.serving.insert(request);
        self.mark_dirty(owner);
        Ok(())
    }

    /// One fragment of an answer. An answer to a request that is over, or that this connection was never asked,
    /// is dropped and counted: the deadline may just have passed.
    pub(super) fn answer_request(
        &mut self,
        id: ConnectionId,
        flags: Flags,
        piece: AnswerPiece,
    ) -> Result<(), ProtocolError> {
        let AnswerPiece { request: wire, more, payload } = piece;
        if more > 1 {
            return Err(ProtocolError::BadValue { kind: "answer", field: "more", value: more.into() });
        }
        let request = RequestId::from_wire(wire);
        self.make_room_for_fragment(id, flags, payload.len());
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        if !connection.serving.contains(&request) {
            self.unmatched_answers += u64::from(flags.has(Flags::LAST));
            return Ok(());
        }
        let bytes_max = connection.inbound.message_bytes_max();
        // A request has one answer under way at a time; the low half of its id tells them apart well enough.
        match connection
            .gathering
            .take(Incoming::Answer(wire), wire as u32, flags, payload, bytes_max)?
        {
            Gathered::More | Gathered::Ignored | Gathered::Aborted => {}
            Gathered::Whole(pieces) => self.reply(request, pieces, more == 1),
            Gathered::Overfull => self.end_request(request, Some((RefusalCode::Full, None))),
        }
        Ok(())
    }

    /// The owner of a service will not answer.
    pub(super) fn decline(&mut self, id: ConnectionId, request: u64, text: String) {
        let request = RequestId::from_wire(request);
        let own = self.connections.get(id).is_some_and(|owner| owner.serving.contains(&request));
        if own {
            let text = Some(text).filter(|text| !text.is_empty());
            self.end_request(request, Some((RefusalCode::Declined, text)));
        } else {
            self.unmatched_answers += 1;
        }
    }

    /// The asker gives a call up. It may be over already.
    pub(super) fn cancel(&mut self, id: ConnectionId, tag: u32) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        match connection.calls.get(&tag) {
            Some(Call::Begun) => {
                connection.calls.remove(&tag);
                connection.gathering.forget(Incoming::Call(tag));
            }
            Some(Call::Open(request)) => {
                let request = *request;
                self.end_request(request, None);
            }
            None => {}
        }
        // What waits of the answers goes no more; a rest of one that was begun is not missed.
        if let Some(connection) = self.connections.get_mut(id) {
            connection.output.end_talk(TalkKey::Reply(tag));
        }
    }

    /// A whole answer goes to its asker.
    fn reply(&mut self, id: RequestId, pieces: Pieces, more: bool) {
        let Some(Request { asker, tag, .. }) = self.requests.get(id).copied() else { return };
        let Some(connection) = self.connections.get_mut(asker) else { return };
        if length(&pieces) > connection.inbound.message_bytes_max() {
            return self.end_request(id, Some((RefusalCode::TooLong, None)));
        }
        if !connection
            .output
            .talk(Talk::new(Kind::Reply { tag, more }, pieces, &self.budget))
        {
            // An answer that found no room must not be missing in silence.
            return self.end_request(id, Some((RefusalCode::Full, None)));
        }
        self.mark_dirty(asker);
        if more || is_planted(Bug::AnswerKeepsRequest) {
            self.requests.refresh(id, self.now);
        } else {
            self.forget_request(id);
        }
    }

    /// Takes a request out of all books. Answers what it was.
    fn forget_request(&mut self, id: RequestId) -> Option<Request> {
        let request = self.requests.remove(id)?;
        if let Some(asker) = self.connections.get_mut(request.asker) {
            asker.calls.remove(&request.tag);
        }
        match request.owner {
            None => {
                self.serving.remove(&id);
            }
            Some(owner) => {
                if let Some(owner) = self.connections.get_mut(owner) {
                    owner.serving.remove(&id);
                    owner.gathering.forget(Incoming::Answer(id.wire()));
                }
            }
        }
        Some(request)
    }

    /// Ends a request before its last answer: the asker hears why, unless it has gone or given it up; the owner
    /// hears that it is over, if it has heard of it at all.
    pub(super) fn end_request(&mut self, id: RequestId, refusal: Option<(RefusalCode, Option<String>)>) {
        let Some(request) = self.forget_request(id) else { return };
        let declined = matches!(refusal, Some((RefusalCode::Declined, _)));
        if let Some((code, text)) = refusal {
            let text = text.unwrap_or_else(|| code.to_string());
            self.refuse_after_replies(request.asker, request.tag, code, text);
        }
        match request.owner {
            None if declined => {}
            None => self.notices.push_back(Notice::RequestOver { request: id }),
            Some(owner) => {
                let Some(connection) = self.connections.get_mut(owner) else { return };
                let heard = connection.output.end_talk(TalkKey::Request(id.wire()));
                if heard && !declined {
                    self.answer(owner, 0, &Event::RequestOver { request: id.wire() });
                }
            }
        }
        self.resume(request.asker);
    }

    /// The refusal of a call must not overtake the answers before it.
    fn refuse_after_replies(&mut self, id: ConnectionId, tag: u32, code: RefusalCode, text: String) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        if connection.closing.is_some() {
            return;
        }
        let frame = Event::Refused { code: code.code(), text }.encode(tag, Flags::NONE);
        if !connection.output.control_after(TalkKey::Reply(tag), frame) {
            self.to_close.push_back((id, super::ClosingReason::ControlFull));
        }
        self.mark_dirty(id);
    }

    /// A synchronous connection whose call is over may have sent more meanwhile.
    pub(super) fn resume(&mut self, id: ConnectionId) {
        if self
            .connections
            .get(id)
            .is_some_and(|found| found.has_input() && !found.is_held())
        {
            self.enqueue(id);
        }
    }

    /// A service is gone: everybody who waits for it is told now.
    pub(super) fn end_requests_to(&mut self, channel: ChannelRef, owner: Owner) {
        let open: Vec<RequestId> = match owning_flow(&self.connections, owner) {
            Some(owner) => {
                let serving = self.connections.get(owner).map(|owner| &owner.serving);
                serving.into_iter().flatten().copied().collect()
            }
            None => self.serving.keys().copied().collect(),
        };
        for request in open {
            if self.requests.get(request).is_some_and(|open| open.channel == channel) {
                let told = !is_planted(Bug::OwnerGoneUntold);
                self.end_request(request, told.then_some((RefusalCode::OwnerGone, None)));
            }
        }
    }

    /// Ends a request whose asker has no right to call its service any more.
    pub(super) fn end_request_without_right(&mut self, asker: ConnectionId, request: RequestId) {
        if let Some(open) = self.requests.get(request)
            && !self.is_allowed_on(asker, Right::Call, open.channel)
        {
            self.end_request(request, Some((RefusalCode::Denied, None)));
        }
    }

    /// A connection ends: nobody waits for the answers to its calls any more.
    pub(super) fn end_calls_of(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        for call in std::mem::take(&mut connection.calls).into_values() {
            if let Call::Open(request) = call {
                self.end_request(request, None);
            }
        }
    }

    /// Ends the requests whose deadline has passed.
    pub(super) fn end_late_requests(&mut self) {
        while let Some(request) = self.requests.next_late(self.now) {
            self.end_request(request, Some((RefusalCode::NoAnswer, None)));
        }
    }

    // ---- services of the hub's own ----

    /// Opens a service of the hub's own; [`Notice::Request`] tells of each request.
    ///
    /// # Errors
    /// `Exists`, `NoFreeChannel`, or `BadProperties` if they are not a map.
    pub fn open_service(&mut self, name: Name, properties: Properties) -> Result<ChannelRef, RefusalCode> {
        self.open_own(ChannelKind::Service, name, properties)
    }

    /// Answers a request to a service of the hub's own. With `more` the request stays open and its deadline
    /// begins anew. Answers `false` if nobody waits any more: that is counted.
    ///
    /// # Errors
    /// `Full` if the answer is longer than 16 MiB; the request stays open.
    pub fn answer_own(
        &mut self,
        request: RequestId,
        payload: Bytes,
        more: bool,
    ) -> Result<bool, RefusalCode> {
        if payload.len() > MESSAGE_BYTES_MAX {
            return Err(RefusalCode::Full);
        }
        if !self.serving.contains_key(&request) {
            self.unmatched_answers += 1;
            return Ok(false);
        }
        self.reply(request, cut(payload, FRAGMENT_BYTES_MAX).map(|(_, piece)| piece).collect(), more);
        self.settle();
        Ok(true)
    }

    /// Declines a request to a service of the hub's own; the text, up to 255 bytes of it, goes to the asker.
    /// Answers `false` if nobody waits any more.
    pub fn decline_own(&mut self, request: RequestId, text: &str) -> bool {
        if !self.serving.contains_key(&request) {
            self.unmatched_answers += 1;
            return false;
        }
        let end = text.floor_char_boundary(TEXT_BYTES_MAX);
        let text = Some(text[..end].to_owned()).filter(|text| !text.is_empty());
        self.end_request(request, Some((RefusalCode::Declined, text)));
        self.settle();
        true
    }

    /// Whether a request to a service of the hub's own waits for its answer.
    pub fn is_asked(&self, request: RequestId) -> bool {
        self.serving.contains_key(&request)
    }

    /// The first deadline of an open request.
    pub fn next_request_deadline(&self) -> Option<Instant> {
        self.requests.next_deadline()
    }

    /// How many requests are open.
    pub fn open_requests(&self) -> usize {
        self.requests.len()
    }

    /// How many answers and declines came for requests that were over, and were dropped.
    pub fn unmatched_answers(&self) -> u64 {
        self.unmatched_answers
    }
}

fn length(pieces: &Pieces) -> usize {
    pieces.iter().map(Bytes::len).sum()
}
