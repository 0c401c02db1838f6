//! What comes in over a connection and is not finished: messages in pieces, and calls.

use super::super::services::requests::RequestId;
use crate::flow::ChannelRef;

/// What an unfinished message of a client's is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(in super::super) enum Incoming {
    /// Of a channel of its own.
    Publish(ChannelRef),
    /// The call with this tag.
    Call(u32),
    /// The answer to this request.
    Answer(u64),
    /// The piece of an upload with this tag.
    Upload(u32),
}

/// How far a call has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Call {
    /// Its fragments come in.
    Begun,
    /// The owner of the service has it.
    Open(RequestId),
}
