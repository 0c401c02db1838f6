//! What can be wrong with what a peer sent, and what an honest peer may be told.

use super::codec::CodecError;
use super::state::State;
use std::fmt;
use thiserror::Error;

/// What no honest peer sends at any timing. The connection is killed for it, nobody else is touched.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ProtocolError {
    /// The first frame does not begin with the magic bytes.
    #[error("the first frame is not of this protocol")]
    NotFlow,
    /// A kind that the table does not have for this direction.
    #[error("unknown kind {0:#04x}")]
    UnknownKind(u8),
    /// A kind that is not legal in the state of the connection.
    #[error("`{kind}` is not legal in the state `{state}`")]
    WrongState {
        /// Name of the kind.
        kind: &'static str,
        /// State of the connection.
        state: State,
    },
    /// A body longer than its kind and state allow. Found from the header, before anything is kept.
    #[error("`{kind}` of {length} bytes, at most {max} are allowed")]
    TooLong {
        /// Name of the kind.
        kind: &'static str,
        /// Announced length.
        length: u32,
        /// Allowed length.
        max: u32,
    },
    /// Flags that the kind does not have, or that contradict each other.
    #[error("`{kind}` with flags {flags:#04x}")]
    BadFlags {
        /// Name of the kind.
        kind: &'static str,
        /// The flags as sent.
        flags: u8,
    },
    /// A body that does not follow its layout.
    #[error("malformed `{kind}`: {error}")]
    Malformed {
        /// Name of the kind.
        kind: &'static str,
        /// What is wrong.
        error: CodecError,
    },
    /// A value outside what its field may hold.
    #[error("`{kind}`: {field} may not be {value}")]
    BadValue {
        /// Name of the kind.
        kind: &'static str,
        /// Name of the field.
        field: &'static str,
        /// The value as sent.
        value: u64,
    },
    /// Fragments that do not make messages: a beginning inside a message, or a continuation of none.
    #[error("a fragment out of sequence for message {message}")]
    FragmentSequence {
        /// Message id of the offending fragment.
        message: u32,
    },
    /// A message whose fragments are longer together than was agreed.
    #[error("a message of more than {max} bytes")]
    MessageTooLong {
        /// The agreed limit.
        max: usize,
    },
    /// The other side could not prove that it knows the token.
    #[error("the hub's proof is wrong")]
    FalseHub,
}

macro_rules! codes {
    ($(#[$doc:meta])* $Enum:ident { $( $(#[doc = $text:literal])+ $name:ident = $code:literal, )+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[non_exhaustive]
        pub enum $Enum {
            $( $(#[doc = $text])+ $name = $code, )+
        }

        impl $Enum {
            /// All of them, with what they mean, for documentation and other languages.
            pub const ALL: &'static [($Enum, &'static str, &'static str)] =
                &[ $( ($Enum::$name, stringify!($name), concat!($($text),+)), )+ ];

            /// The number on the wire.
            pub const fn code(self) -> u16 {
                self as u16
            }

            /// The meaning of a number, if this build knows it.
            pub const fn from_code(code: u16) -> Option<$Enum> {
                match code {
                    $( $code => Some($Enum::$name), )+
                    _ => None,
                }
            }
        }

        impl fmt::Display for $Enum {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let text = match self { $( $Enum::$name => concat!($($text),+), )+ };
                f.write_str(text.trim())
            }
        }
    };
}

codes! {
    /// Why an honest request was refused. The connection lives on.
    RefusalCode {
        /// The account has no right to do this.
        Denied = 1,
        /// A channel of this name exists.
        Exists = 2,
        /// There is no channel with this identifier and epoch.
        Gone = 3,
        /// Only the owner of the channel may do this.
        NotOwner = 4,
        /// The name is empty, or has characters other than `a-z 0-9 _ . -`, or is too long with its user.
        BadName = 5,
        /// The flow owns as many channels as it may.
        TooManyChannels = 6,
        /// The flow holds as many subscriptions as it may.
        TooManySubscriptions = 7,
        /// The hub has no free channel.
        NoFreeChannel = 8,
        /// The unfinished messages of this connection hold as many bytes as they may.
        Full = 9,
        /// The properties are not a map.
        BadProperties = 10,
    }
}

codes! {
    /// Why the hub ends a connection that did nothing dishonest.
    ClosingReason {
        /// Nothing was heard for too long, or the login or a frame took too long.
        Silent = 1,
        /// The hub ends.
        Shutdown = 2,
        /// The two sides have no version in common.
        Version = 3,
        /// The proof is wrong, or this way of logging in is not open to this connection.
        LoginFailed = 4,
        /// Control frames waited beyond their limit: the peer reads too slowly.
        ControlFull = 5,
        /// Too many connections wait for their login, and this one was the oldest of the busiest address.
        Crowded = 6,
    }
}
