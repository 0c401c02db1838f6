//! What can be wrong with what a peer sent, and what an honest peer may be told.

use super::super::login::scram::ScramError;
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
    /// The other side could not prove that it knows the token or the account.
    #[error("the hub's proof is wrong")]
    FalseHub,
    /// A login by password does not go on.
    #[error(transparent)]
    Scram(ScramError),
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
        /// There is one already: a channel, a flow or a database of this name, or a watch with this tag.
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
        /// The unfinished messages of a connection hold, or those that wait for it, as many bytes as they may.
        Full = 9,
        /// The properties are not a map.
        BadProperties = 10,
        /// This hub does not offer that.
        NotOffered = 11,
        /// The channel is of another kind.
        WrongKind = 12,
        /// There is no service with this identifier and epoch.
        NoSuchService = 13,
        /// The owner of the service went before it answered.
        OwnerGone = 14,
        /// The owner of the service did not answer in time.
        NoAnswer = 15,
        /// The owner of the service will not answer.
        Declined = 16,
        /// The connection, or the owner of the service, has as many open requests, or bytes of them, as it may.
        TooManyRequests = 17,
        /// No message was published yet.
        NothingYet = 18,
        /// This connection did not register to poll this channel.
        NotRegistered = 19,
        /// A channel cannot repeat itself, not by way of others either, and not over more than eight steps.
        Cycle = 20,
        /// The channel repeats another one: detach it first.
        Attached = 21,
        /// No database is selected.
        NoDatabase = 22,
        /// There is no database of this name.
        NoSuchDatabase = 23,
        /// The database has no variable of this key.
        NoSuchVariable = 24,
        /// The key is empty, too long, or has control characters.
        BadKey = 25,
        /// The database has as many variables or bytes as it may.
        DatabaseFull = 26,
        /// The account has as many databases as it may.
        TooManyDatabases = 27,
        /// The value is too long as JSON: ask for it as a variant. Or a message is longer than its receiver takes.
        TooLong = 28,
        /// The flow has as many watches as it may.
        TooManyWatches = 29,
        /// The path has more than 16 parts, or one that is empty, `.`, `..` or has characters other than `A-Z a-z 0-9 _ . -`.
        BadPath = 30,
        /// There is nothing at this path.
        NoSuchPath = 31,
        /// There is a directory at this path, or a file where a directory is needed.
        WrongPath = 32,
        /// The directory is not empty.
        NotEmpty = 33,
        /// The length or the checksum is not what was announced.
        BadChecksum = 34,
        /// The piece does not begin where the hub's part of the file ends, or no upload was begun.
        BadOffset = 35,
        /// The account's files take as many bytes as they may.
        Quota = 36,
        /// The hub's disk failed; the hub's log says how.
        Storage = 37,
        /// There is no account of this name.
        NoSuchUser = 38,
        /// The account cannot be: its name or its keys are not what they should be, or it is the owner's own.
        BadUser = 39,
        /// There is nothing of this name to tell of.
        NoSuchSubject = 40,
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
        /// Too many connections wait for their login, and this one was the oldest of the busiest address; or the
        /// account has as many connections as it may.
        Crowded = 6,
        /// A new connection took the place of this one.
        Replaced = 7,
        /// A subscription that must not miss a message had no room for one more.
        QueueFull = 8,
        /// The account was removed.
        AccountRemoved = 9,
    }
}
