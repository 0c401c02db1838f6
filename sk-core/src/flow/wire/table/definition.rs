//! What one line of the command table says, and the macro that makes types and code of the lines.

use super::super::codec::Writer;
use super::super::error::ProtocolError;
use super::super::frame::{Flags, HEADER_BYTES, Header};
use super::super::state::State;
use crate::flow::limits::{BODY_BYTES_MAX_BEFORE_LOGIN, FRAGMENT_BYTES_MAX};
use bytes::{BufMut, Bytes, BytesMut};
use std::fmt;

/// The bytes of the tag that begins every body.
pub const TAG_BYTES: usize = 4;

/// Which way a kind travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// A command.
    ClientToHub,
    /// An event.
    HubToClient,
}

/// A set of states.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct States(u8);

impl States {
    /// The set of the states listed.
    pub const fn of(states: &[State]) -> States {
        let mut bits = 0;
        let mut index = 0;
        while index < states.len() {
            bits |= 1 << states[index] as u8;
            index += 1;
        }
        States(bits)
    }

    /// Whether `state` is in the set.
    pub const fn has(self, state: State) -> bool {
        self.0 & 1 << state as u8 != 0
    }

    /// The states of the set, in their order.
    pub fn iter(self) -> impl Iterator<Item = State> {
        State::ALL.into_iter().filter(move |state| self.has(*state))
    }
}

impl fmt::Debug for States {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

/// A right that an account may have. What a kind needs stands in the table; who has it is decided at
/// login, and for names it applies to by pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Right {
    /// None: the kind serves the connection itself, or what it already owns.
    Nothing,
    /// To see which channels, users and databases there are, and how the hub fares.
    List,
    /// To own streaming and sync channels and publish on them.
    Publish,
    /// To receive what others publish.
    Subscribe,
    /// To own service channels and answer requests.
    Serve,
    /// To send requests to services.
    Call,
    /// To list and download what blob channels hold.
    BlobRead,
    /// To own blob channels and change what they hold.
    BlobWrite,
    /// To read databases.
    DatabaseRead,
    /// To create, change and remove databases.
    DatabaseWrite,
    /// To do what only the owner may, on anybody's channel and the hub's, and to change users.
    Administer,
}

impl Right {
    /// All that can be given.
    pub const ALL: [Right; 10] = [
        Right::List,
        Right::Publish,
        Right::Subscribe,
        Right::Serve,
        Right::Call,
        Right::BlobRead,
        Right::BlobWrite,
        Right::DatabaseRead,
        Right::DatabaseWrite,
        Right::Administer,
    ];
}

/// The rights of an account.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rights(u16);

impl Rights {
    /// None at all: a connection before its login.
    pub const NONE: Rights = Rights(0);
    /// All: the account that owns the hub.
    pub const ALL: Rights = Rights(u16::MAX);

    /// These rights and one more.
    pub const fn with(self, right: Right) -> Rights {
        Rights(self.0 | 1 << right as u16)
    }

    /// Whether `right` is among them. `Nothing` always is.
    pub const fn has(self, right: Right) -> bool {
        matches!(right, Right::Nothing) || self.0 & 1 << right as u16 != 0
    }
}

/// One field of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// The type of the wire that it has.
    pub wire: &'static str,
    /// The most bytes it takes.
    pub bytes_max: usize,
    /// What it means.
    pub meaning: &'static str,
}

/// One line of the command table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Definition {
    /// The kind, as the frame's first byte has it.
    pub id: u8,
    /// Its name.
    pub name: &'static str,
    /// Which way it travels.
    pub direction: Direction,
    /// The states in which it is legal.
    pub states: States,
    /// The right it needs.
    pub right: Right,
    /// What its handling costs, against the turn's budget of a connection.
    pub cost: u32,
    /// Whether it is a fragment: then it has flags, and its last field is the payload.
    pub fragment: bool,
    /// The fields of the body after the tag.
    pub fields: &'static [Field],
    /// What it does.
    pub meaning: &'static str,
}

impl Definition {
    /// The longest body that it can have: the tag and every field at its longest.
    pub const fn bytes_max(&self) -> usize {
        let mut sum = TAG_BYTES;
        let mut index = 0;
        while index < self.fields.len() {
            sum += self.fields[index].bytes_max;
            index += 1;
        }
        sum
    }

    /// The longest body that is admitted in `state` with the negotiated fragment size.
    pub fn bytes_max_in(&self, state: State, fragment_bytes_max: usize) -> usize {
        let max = match state {
            State::Greeting | State::Login => self.bytes_max().min(BODY_BYTES_MAX_BEFORE_LOGIN),
            State::Synchronous | State::Flow => self.bytes_max(),
        };
        if self.fragment {
            max - FRAGMENT_BYTES_MAX + fragment_bytes_max.min(FRAGMENT_BYTES_MAX)
        } else {
            max
        }
    }

    /// Whether a frame with this header may come now.
    ///
    /// # Errors
    /// If state, flags or length forbid it.
    pub fn admit(
        &self,
        header: Header,
        state: State,
        fragment_bytes_max: usize,
    ) -> Result<(), ProtocolError> {
        let kind = self.name;
        if !self.states.has(state) {
            return Err(ProtocolError::WrongState { kind, state });
        }
        let max = self.bytes_max_in(state, fragment_bytes_max) as u32;
        if header.length > max {
            return Err(ProtocolError::TooLong { kind, length: header.length, max });
        }
        match Flags::from_bits(header.flags) {
            Some(flags) if self.fragment || flags == Flags::NONE => Ok(()),
            _ => Err(ProtocolError::BadFlags { kind, flags: header.flags }),
        }
    }
}

/// A frame ready for the transport: all but the payload in one buffer, the payload shared.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Encoded {
    /// Header, tag and fields.
    pub head: Bytes,
    /// The payload, empty for kinds that have none.
    pub payload: Bytes,
}

impl Encoded {
    /// Puts the header before what the fields wrote.
    pub(super) fn from_writer(kind: u8, flags: Flags, writer: Writer) -> Encoded {
        let length = (writer.head.len() - HEADER_BYTES + writer.payload.len()) as u32;
        let mut head = writer.head;
        head[..HEADER_BYTES].copy_from_slice(&Header { kind, flags: flags.bits(), length }.to_bytes());
        Encoded { head: head.freeze(), payload: writer.payload }
    }

    /// A writer with room for the header and the tag in it.
    pub(super) fn writer(tag: u32) -> Writer {
        let mut writer = Writer { head: BytesMut::with_capacity(64), payload: Bytes::new() };
        writer.head.put_bytes(0, HEADER_BYTES);
        writer.head.put_u32_le(tag);
        writer
    }

    /// The length of the frame.
    pub fn len(&self) -> usize {
        self.head.len() + self.payload.len()
    }

    /// Whether there is nothing, not even a header.
    pub fn is_empty(&self) -> bool {
        self.head.is_empty() && self.payload.is_empty()
    }

    /// The frame in one piece.
    pub fn to_vec(&self) -> Vec<u8> {
        [&self.head[..], &self.payload[..]].concat()
    }
}

/// A command or event with what every frame carries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tagged<M> {
    /// Chosen by the client, repeated in the answer; 0 in what is no answer.
    pub tag: u32,
    /// Flags of a fragment.
    pub flags: Flags,
    /// The command or event.
    pub message: M,
}

/// What the table makes of each direction: [`Command`](crate::flow::Command) and [`Event`](crate::flow::Event).
pub trait Message: Sized + fmt::Debug {
    /// The lines of the table for this direction.
    const TABLE: &'static [Definition];

    /// The line of a kind; `None` means that this direction does not have it.
    fn find(kind: u8) -> Option<&'static Definition>;

    /// The line of this value.
    fn definition(&self) -> &'static Definition;

    /// Reads the body of a frame of this kind. The payload may lie in a buffer of its own.
    ///
    /// # Errors
    /// If the kind is unknown or the body does not follow its layout.
    fn decode(header: Header, body: Bytes, payload: Bytes) -> Result<Tagged<Self>, ProtocolError>;

    /// Writes a frame.
    fn encode(&self, tag: u32, flags: Flags) -> Encoded;
}

/// Makes of the lines of one direction: the enum, its list of definitions, look-up, decoder and encoder.
macro_rules! flow_table {
    (
        $(#[$doc:meta])*
        $Enum:ident: $direction:ident
        $(
            $(#[doc = $meaning:literal])+
            $id:literal $name:ident $Kind:ident [$($state:ident)+] $right:ident $cost:literal $shape:ident {
                $( $field:ident: $Type:ty = $says:literal, )*
            }
        )+
    ) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Eq)]
        pub enum $Enum {
            $(
                $(#[doc = $meaning])+
                $Kind { $( #[doc = $says] $field: $Type, )* },
            )+
        }

        impl Message for $Enum {
            const TABLE: &'static [Definition] = &[ $(
                Definition {
                    id: $id,
                    name: stringify!($name),
                    direction: Direction::$direction,
                    states: States::of(&[$(State::$state),+]),
                    right: Right::$right,
                    cost: $cost,
                    fragment: flow_table!(@shape $shape),
                    fields: &[ $( Field {
                        name: stringify!($field),
                        wire: <$Type as Wire>::NAME,
                        bytes_max: <$Type as Wire>::BYTES_MAX,
                        meaning: $says,
                    }, )* ],
                    meaning: concat!($($meaning),+),
                },
            )+ ];

            fn find(kind: u8) -> Option<&'static Definition> {
                // The position of each kind in the list, worked out by the compiler.
                const PLACES: [u8; 256] = {
                    let mut places = [u8::MAX; 256];
                    let mut index = 0;
                    while index < $Enum::TABLE.len() {
                        let id = $Enum::TABLE[index].id as usize;
                        assert!(places[id] == u8::MAX, "two lines of the table have one id");
                        places[id] = index as u8;
                        index += 1;
                    }
                    places
                };
                Self::TABLE.get(usize::from(PLACES[usize::from(kind)]))
            }

            fn definition(&self) -> &'static Definition {
                let id = match self { $( $Enum::$Kind { .. } => $id, )+ };
                Self::find(id).unwrap_or(&Self::TABLE[0])
            }

            fn decode(header: Header, body: Bytes, payload: Bytes) -> Result<Tagged<Self>, ProtocolError> {
                let mut from = Reader::of_parts(body, payload);
                let (kind, read) = match header.kind {
                    $( $id => (stringify!($name), (|| {
                        let tag = u32::read(&mut from)?;
                        let message = $Enum::$Kind { $( $field: <$Type as Wire>::read(&mut from)?, )* };
                        from.finish()?;
                        Ok((tag, message))
                    })()), )+
                    other => return Err(ProtocolError::UnknownKind(other)),
                };
                let flags = Flags::from_bits(header.flags)
                    .ok_or(ProtocolError::BadFlags { kind, flags: header.flags })?;
                let (tag, message) = read.map_err(|error| ProtocolError::Malformed { kind, error })?;
                Ok(Tagged { tag, flags, message })
            }

            fn encode(&self, tag: u32, flags: Flags) -> Encoded {
                let mut writer = Encoded::writer(tag);
                let id = match self {
                    $( $Enum::$Kind { $( $field, )* } => {
                        $( $field.write(&mut writer); )*
                        $id
                    } )+
                };
                Encoded::from_writer(id, flags, writer)
            }
        }
    };
    (@shape whole) => { false };
    (@shape fragment) => { true };
}
pub(super) use flow_table;
