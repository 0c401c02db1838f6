//! Services, from both ends: asking them, and being one.

use super::super::error::{ProtocolError, RefusalCode};
use super::super::fragment::{Gathered, joined};
use super::super::limits::{DEADLINE_MAX, TEXT_BYTES_MAX};
use super::super::{ChannelRef, Command, Flags};
use super::sending::{Kind, Stream};
use super::{SatelliteCore, SatelliteError, SatelliteEvent};
use bytes::Bytes;
use sk_flat::SkVariant;
use std::time::Duration;

/// What an unfinished message of the hub's is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Incoming {
    /// Of a channel that is subscribed to.
    Data(ChannelRef),
    /// The reply to the call with this tag.
    Reply(u32),
    /// The request with this id.
    Request(u64),
}

/// The fields of a `request` but for its bytes.
#[derive(Clone, Copy)]
pub(super) struct Asked {
    pub(super) channel: ChannelRef,
    pub(super) request: u64,
    pub(super) asker: u64,
}

impl SatelliteCore {
    /// Asks for a service channel; `Created` or `Refused` with the tag answers. Then each `Request` is to be
    /// answered, declined, or left to its deadline.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the connection is no ready flow.
    pub fn create_service(&mut self, name: &str, properties: &SkVariant) -> Result<u32, SatelliteError> {
        let service = |name, properties| Command::CreateService { name, properties };
        self.create_as("create_service", service, name, properties)
    }

    /// Asks a service. `Reply` events with the tag bring the answers, or `Refused` says why there is none. A
    /// deadline of zero is the hub's default of five seconds; beyond an hour it is an hour.
    ///
    /// # Errors
    /// If the connection is not ready, the request is too long, or too much waits to be sent.
    pub fn call(
        &mut self,
        channel: ChannelRef,
        deadline: Duration,
        payload: Bytes,
    ) -> Result<u32, SatelliteError> {
        if !self.is_ready() {
            return Err(SatelliteError::State("call"));
        }
        self.check_length(&payload)?;
        // Less than a millisecond is not nothing.
        let deadline_ms = deadline.min(DEADLINE_MAX).as_nanos().div_ceil(1_000_000) as u32;
        let tag = self.tag();
        if !self.outbox.message(Kind::Call { tag, channel, deadline_ms }, payload) {
            return Err(SatelliteError::Full);
        }
        self.calls.insert(tag);
        Ok(tag)
    }

    /// Gives a call up; nothing with its tag comes any more. One that is over is left as it is.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn cancel(&mut self, tag: u32) -> Result<(), SatelliteError> {
        self.need_flow("cancel")?;
        if self.calls.contains(&tag) {
            self.on_call_over(tag);
            self.command(&Command::Cancel { call: tag })?;
        }
        Ok(())
    }

    /// Whether a call has had no end yet.
    pub fn is_calling(&self, tag: u32) -> bool {
        self.calls.contains(&tag)
    }

    /// Answers a request; with `more` it stays open for further answers.
    ///
    /// # Errors
    /// If nobody waits for it any more, the answer is too long, or too much waits to be sent.
    pub fn answer(&mut self, request: u64, payload: Bytes, more: bool) -> Result<(), SatelliteError> {
        if !self.requests.contains(&request) {
            return Err(SatelliteError::NoRequest(request));
        }
        self.check_length(&payload)?;
        if !self.outbox.message(Kind::Answer { request, more }, payload) {
            return Err(SatelliteError::Full);
        }
        if !more {
            self.requests.remove(&request);
        }
        Ok(())
    }

    /// Declines a request; the asker hears the text, up to 255 bytes of it.
    ///
    /// # Errors
    /// If nobody waits for it any more, or too much waits to be sent.
    pub fn decline(&mut self, request: u64, text: &str) -> Result<(), SatelliteError> {
        if !self.requests.contains(&request) {
            return Err(SatelliteError::NoRequest(request));
        }
        let text = text[..text.floor_char_boundary(TEXT_BYTES_MAX)].to_owned();
        let tag = self.tag();
        let decline = Command::Decline { request, text };
        if !self.outbox.command_after(Stream::Answer(request), &decline, tag) {
            return Err(SatelliteError::Full);
        }
        self.requests.remove(&request);
        Ok(())
    }

    /// Whether somebody waits for an answer of this satellite's to a request.
    pub fn is_asked(&self, request: u64) -> bool {
        self.requests.contains(&request)
    }

    fn check_length(&self, payload: &Bytes) -> Result<(), SatelliteError> {
        let (length, max) = (payload.len(), self.inbound.message_bytes_max());
        if length > max { Err(SatelliteError::TooLong { length, max }) } else { Ok(()) }
    }

    pub(super) fn on_request(
        &mut self,
        flags: Flags,
        asked: Asked,
        payload: Bytes,
    ) -> Result<(), ProtocolError> {
        let Asked { channel, request, asker } = asked;
        let max = self.inbound.message_bytes_max();
        match self
            .gathering
            .take(Incoming::Request(request), request as u32, flags, payload, max)?
        {
            Gathered::More | Gathered::Ignored | Gathered::Aborted => {}
            // The asker is not left waiting for the deadline.
            Gathered::Overfull => {
                self.requests.insert(request);
                let _ = self.decline(request, "too many unfinished requests");
            }
            Gathered::Whole(pieces) => {
                self.requests.insert(request);
                let payload = joined(pieces);
                self.events
                    .push_back(SatelliteEvent::Request { channel, request, asker, payload });
            }
        }
        Ok(())
    }

    pub(super) fn on_request_over(&mut self, request: u64) {
        self.gathering.forget(Incoming::Request(request));
        self.outbox.forget(Stream::Answer(request));
        if self.requests.remove(&request) {
            self.events.push_back(SatelliteEvent::RequestOver { request });
        }
    }

    pub(super) fn on_reply(
        &mut self,
        tag: u32,
        flags: Flags,
        more: u8,
        payload: Bytes,
    ) -> Result<(), ProtocolError> {
        if !self.calls.contains(&tag) {
            // It was on its way when the call was given up.
            return Ok(());
        }
        let max = self.inbound.message_bytes_max();
        match self.gathering.take(Incoming::Reply(tag), tag, flags, payload, max)? {
            Gathered::More | Gathered::Ignored | Gathered::Aborted => {}
            Gathered::Overfull => self.give_up_unfinished(tag),
            Gathered::Whole(pieces) => {
                let more = more != 0;
                if !more {
                    self.on_call_over(tag);
                }
                self.events
                    .push_back(SatelliteEvent::Reply { tag, more, payload: joined(pieces) });
            }
        }
        Ok(())
    }

    /// There is no room for the answer: that is the end of the call, and it must not be silent.
    fn give_up_unfinished(&mut self, tag: u32) {
        self.lost += 1;
        self.on_call_over(tag);
        if self.is_flow() {
            self.send(&Command::Cancel { call: tag });
        }
        let code = RefusalCode::Full;
        let text = code.to_string();
        self.events.push_back(SatelliteEvent::Refused { tag, code: code.code(), text });
    }

    /// The call has had its end: nothing of it is kept or sent.
    pub(super) fn on_call_over(&mut self, tag: u32) {
        if self.calls.remove(&tag) {
            self.outbox.forget(Stream::Call(tag));
            self.gathering.forget(Incoming::Reply(tag));
        }
    }
}
