//! What a connection takes in: from received bytes to typed commands or events that its state admits.

use super::super::limits::{FRAGMENT_BYTES_MAX, MESSAGE_BYTES_MAX};
use super::error::ProtocolError;
use super::frame::{FrameBuffer, HEADER_BYTES, Header};
use super::state::State;
use super::table::definition::{Encoded, Message, Tagged};

/// The receiving half of a connection: of a hub with `M` = [`Command`](super::super::Command), of a satellite
/// with `M` = [`Event`](super::super::Event).
///
/// ```
/// use sk_core::flow::{Command, Flags, Inbound, Message, State};
///
/// let mut hub: Inbound<Command> = Inbound::new();
/// hub.advance(); // the greeting is over
/// hub.advance(); // and so is the login
/// assert_eq!(hub.state(), State::Synchronous);
/// hub.feed(&Command::Ping {}.encode(7, Flags::NONE).to_vec());
/// let received = hub.next()?.expect("a whole frame");
/// assert_eq!((received.tag, received.message), (7, Command::Ping {}));
/// # Ok::<(), sk_core::flow::ProtocolError>(())
/// ```
#[derive(Debug)]
pub struct Inbound<M> {
    state: State,
    buffer: FrameBuffer,
    fragment_bytes_max: usize,
    message_bytes_max: usize,
    kind: std::marker::PhantomData<fn() -> M>,
}

impl<M: Message> Inbound<M> {
    /// A half in the state `Greeting` with this build's own limits.
    pub fn new() -> Inbound<M> {
        Inbound {
            state: State::Greeting,
            buffer: FrameBuffer::default(),
            fragment_bytes_max: FRAGMENT_BYTES_MAX,
            message_bytes_max: MESSAGE_BYTES_MAX,
            kind: std::marker::PhantomData,
        }
    }

    /// The present state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Goes to the next state. Frames already received are read in the new one.
    pub fn advance(&mut self) {
        self.state = self.state.next();
    }

    /// Sets the limits that both sides agreed on; never above this build's own.
    pub fn agree(&mut self, fragment_bytes_max: u32, message_bytes_max: u32) {
        self.fragment_bytes_max = FRAGMENT_BYTES_MAX.min(fragment_bytes_max as usize);
        self.message_bytes_max = MESSAGE_BYTES_MAX.min(message_bytes_max as usize);
    }

    /// The agreed longest payload of a fragment.
    pub fn fragment_bytes_max(&self) -> usize {
        self.fragment_bytes_max
    }

    /// The agreed longest message.
    pub fn message_bytes_max(&self) -> usize {
        self.message_bytes_max
    }

    /// Adds received bytes.
    pub fn feed(&mut self, received: &[u8]) {
        self.buffer.feed(received);
    }

    /// How many bytes wait for the rest of their frame, or to be taken.
    pub fn pending(&self) -> usize {
        self.buffer.pending()
    }

    /// The next command or event, `None` if its frame is not whole yet.
    ///
    /// # Errors
    /// What no honest peer sends. The connection is then of no more use.
    #[expect(clippy::should_implement_trait, reason = "an error ends it and it may go on after `None`")]
    pub fn next(&mut self) -> Result<Option<Tagged<M>>, ProtocolError> {
        let (state, fragment) = (self.state, self.fragment_bytes_max);
        let Some(frame) = self.buffer.next(|header| admit::<M>(header, state, fragment))? else {
            return Ok(None);
        };
        M::decode(frame.header, frame.body, bytes::Bytes::new()).map(Some)
    }

    /// A frame that comes in parts, from inside the process; the payload is not copied.
    ///
    /// # Errors
    /// As [`next`](Inbound::next).
    pub fn accept(&self, frame: Encoded) -> Result<Tagged<M>, ProtocolError> {
        let kind = "frame";
        let header = Header::parse(&frame.head).ok_or(ProtocolError::BadFlags { kind, flags: 0 })?;
        self.admit(header)?;
        M::decode(header, frame.head.slice(HEADER_BYTES..), frame.payload)
    }

    fn admit(&self, header: Header) -> Result<(), ProtocolError> {
        admit::<M>(header, self.state, self.fragment_bytes_max)
    }
}

impl<M: Message> Default for Inbound<M> {
    fn default() -> Self {
        Inbound::new()
    }
}

fn admit<M: Message>(header: Header, state: State, fragment_bytes_max: usize) -> Result<(), ProtocolError> {
    let definition = M::find(header.kind).ok_or(ProtocolError::UnknownKind(header.kind))?;
    definition.admit(header, state, fragment_bytes_max)
}
