//! The small closed choices of the wire: one byte each.

use super::codec::{CodecError, Reader, Wire, Writer};
use super::value::Form;
use std::fmt;

macro_rules! wire_choices {
    ($(
        $(#[$doc:meta])*
        $Choice:ident = $wire:literal { $( $(#[doc = $text:literal])+ $Name:ident = $number:literal $shown:literal, )+ }
    )+) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum $Choice {
            $( $(#[doc = $text])+ $Name = $number, )+
        }

        impl $Choice {
            /// All of them, with what they mean, for documentation and other languages.
            pub const ALL: &'static [($Choice, &'static str, &'static str)] =
                &[ $( ($Choice::$Name, $shown, concat!($($text),+)), )+ ];

            /// The choice of a number on the wire.
            pub const fn from_wire(number: u8) -> Option<$Choice> {
                match number {
                    $( $number => Some($Choice::$Name), )+
                    _ => None,
                }
            }
        }

        impl fmt::Display for $Choice {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(match self { $( $Choice::$Name => $shown, )+ })
            }
        }

        wire_byte!($Choice, $wire);
    )+ };
}

macro_rules! wire_byte {
    ($Choice:ident, $wire:literal) => {
        impl Wire for $Choice {
            const NAME: &'static str = $wire;
            const BYTES_MAX: usize = 1;

            fn read(from: &mut Reader) -> Result<Self, CodecError> {
                let number = u8::read(from)?;
                $Choice::from_wire(number).ok_or(CodecError::NoSuchChoice { what: $wire, number })
            }

            fn write(&self, into: &mut Writer) {
                (*self as u8).write(into);
            }
        }
    };
}

wire_byte!(Form, "form");

wire_choices! {
    /// What a channel is for.
    ChannelKind = "kind of channel" {
        /// Streaming: its owner publishes, every subscriber receives.
        Stream = 0 "stream",
        /// Service: anybody who may asks, its owner answers.
        Service = 1 "service",
        /// Blob: files of its owner's, held by the hub, for others to download.
        Blob = 2 "blob",
        /// Sync: the ticks of its owner, without any content.
        Sync = 3 "sync",
    }

    /// What becomes of messages for a subscriber who does not keep up.
    Policy = "policy" {
        /// The newest ones wait, up to the depth; older ones that have not begun are dropped and counted.
        Latest = 0 "latest",
        /// All wait, up to the depth; one more ends the connection, since it must not miss any.
        All = 1 "all",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;

    #[test]
    fn a_number_without_a_meaning_is_malformed() {
        let read = |byte: u8| ChannelKind::read(&mut Reader::new(Bytes::copy_from_slice(&[byte])));
        assert_eq!(read(1), Ok(ChannelKind::Service));
        assert_eq!(read(4), Err(CodecError::NoSuchChoice { what: "kind of channel", number: 4 }));
    }
}
