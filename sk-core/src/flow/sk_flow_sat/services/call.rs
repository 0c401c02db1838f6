//! A call of a service and its answers, as the asker sees them.

use super::super::SkFlowSat;
use crate::Cx;
use crate::flow::error::RefusalCode;
use crate::object::Handle;
use crate::signal::Signal;
use bytes::Bytes;
use sk_flat::{SkVariant, VariantError};
use std::rc::Rc;
use thiserror::Error;

/// A call under way, made by `call` of a satellite. [`Service`](crate::flow::Service) has an example. It buries itself
/// after the last answer; `cx.destroy_later(call)` gives it up, and the service hears that nobody waits any more.
pub struct Call {
    satellite: Handle<SkFlowSat>,
    /// An answer, or why there is none. Emitted once, or several times by a service that streams: until
    /// [`Answer::is_last`].
    pub answered: Signal<Answer>,
}

crate::object! { pub Call { signals { answered(&Answer) } hooks { on_destroy } } }

impl Call {
    pub(crate) fn new(satellite: Handle<SkFlowSat>) -> Call {
        Call { satellite, answered: Signal::new() }
    }

    fn on_destroy(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        // A satellite that has gone before has given all its calls up.
        let _ = cx.with(self.satellite, |satellite, cx| satellite.give_up(cx, this));
    }
}

/// What came of a call.
#[derive(Clone, Debug)]
pub struct Answer {
    pub(crate) call: Handle<Call>,
    pub(crate) service: Rc<str>,
    pub(crate) outcome: Result<Bytes, CallError>,
    pub(crate) more: bool,
}

impl Answer {
    /// The full name of the service that was asked.
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Which call this answers.
    pub fn call(&self) -> Handle<Call> {
        self.call
    }

    /// Whether no further answers follow.
    pub fn is_last(&self) -> bool {
        !self.more
    }

    /// The bytes as the service sent them.
    ///
    /// # Errors
    /// Why there is no answer.
    pub fn payload(&self) -> Result<&Bytes, CallError> {
        self.outcome.as_ref().map_err(CallError::clone)
    }

    /// The value, if the service answered with a variant.
    ///
    /// # Errors
    /// Why there is no answer, or that it is no variant.
    pub fn value(&self) -> Result<SkVariant, CallError> {
        Ok(SkVariant::decode_from(self.payload()?)?)
    }
}

/// Why a call has no answer.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum CallError {
    /// No service of this name was there until the deadline.
    #[error("there is no such service")]
    NoSuchService,
    /// The channel of this name is no service.
    #[error("the channel is no service")]
    WrongKind,
    /// The owner of the service went before it answered.
    #[error("the owner of the service went before it answered")]
    OwnerGone,
    /// The service did not answer in time.
    #[error("the service did not answer in time")]
    NoAnswer,
    /// The service will not answer; its own words.
    #[error("the service declined: {0}")]
    Declined(String),
    /// This satellite, or the owner of the service, has as many open requests as it may.
    #[error("too many requests are open")]
    TooManyRequests,
    /// The account has no right to call.
    #[error("the account has no right to call services")]
    Denied,
    /// There was no hub, or it was lost before the answer. Whether the service acted is not known.
    #[error("the hub was lost")]
    HubLost,
    /// The call could not be sent.
    #[error("the call cannot be sent: {0}")]
    NotSent(String),
    /// The hub refused it for another reason.
    #[error("refused: {text}")]
    Refused {
        /// A number of [`RefusalCode`].
        code: u16,
        /// What the hub says.
        text: String,
    },
    /// The answer came, but it is not the value that was expected.
    #[error("the answer is not what was expected: {0}")]
    Value(#[from] VariantError),
}

impl CallError {
    pub(crate) fn of_refusal(code: u16, text: String) -> CallError {
        match RefusalCode::from_code(code) {
            Some(RefusalCode::NoSuchService) => CallError::NoSuchService,
            Some(RefusalCode::WrongKind) => CallError::WrongKind,
            Some(RefusalCode::OwnerGone) => CallError::OwnerGone,
            Some(RefusalCode::NoAnswer) => CallError::NoAnswer,
            Some(RefusalCode::Declined) => CallError::Declined(text),
            Some(RefusalCode::TooManyRequests) => CallError::TooManyRequests,
            Some(RefusalCode::Denied) => CallError::Denied,
            _ => CallError::Refused { code, text },
        }
    }
}
