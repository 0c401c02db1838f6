//! The types of the wire: how one field of a frame is read and written.
//!
//! Everything is little-endian. Reading is strict: a field that does not fit its layout and bytes left
//! over at the end are errors. Nothing is allocated from a length before that many bytes are there.

use super::super::limits::{FRAGMENT_BYTES_MAX, PATH_BYTES_MAX, TEXT_BYTES_MAX};
use super::value::{Form, ValueOf};
use bytes::{Buf, BufMut, Bytes, BytesMut};
use std::fmt;
use thiserror::Error;

/// What is wrong with a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CodecError {
    /// The body ends inside a field of this type.
    #[error("the body ends inside a field of type {0}")]
    Short(&'static str),
    /// The body has bytes after its last field.
    #[error("{0} bytes after the last field")]
    Trailing(usize),
    /// A length beyond what the type allows.
    #[error("a {what} of {length} bytes, at most {max} are allowed")]
    TooLong {
        /// Type of the field.
        what: &'static str,
        /// Length as sent.
        length: usize,
        /// Allowed length.
        max: usize,
    },
    /// A string that is not UTF-8.
    #[error("a string that is not UTF-8")]
    NotUtf8,
    /// A value that is not one variant in the form it says.
    #[error("a value that is not a variant in the form it says")]
    NotVariant,
    /// A number that stands for nothing.
    #[error("a {what} of number {number}, which does not exist")]
    NoSuchChoice {
        /// Type of the field.
        what: &'static str,
        /// The number.
        number: u8,
    },
}

/// Reads fields from the body of one frame, in order.
#[derive(Debug)]
pub struct Reader {
    body: Bytes,
    payload: Bytes,
}

impl Reader {
    /// A reader of a body that lies in one piece.
    pub fn new(body: Bytes) -> Reader {
        Reader { body, payload: Bytes::new() }
    }

    /// A reader of a body whose last field, the payload, lies in a buffer of its own.
    pub fn of_parts(body: Bytes, payload: Bytes) -> Reader {
        Reader { body, payload }
    }

    /// Takes `count` bytes, sharing the buffer.
    ///
    /// # Errors
    /// `Short`, naming `what`, if there are fewer.
    pub fn take(&mut self, count: usize, what: &'static str) -> Result<Bytes, CodecError> {
        if self.body.len() < count {
            return Err(CodecError::Short(what));
        }
        Ok(self.body.split_to(count))
    }

    /// Takes all that is left, sharing the buffer.
    pub fn rest(&mut self) -> Bytes {
        if self.body.is_empty() { std::mem::take(&mut self.payload) } else { std::mem::take(&mut self.body) }
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// `Trailing` if bytes are left.
    pub fn finish(self) -> Result<(), CodecError> {
        match self.body.len() + self.payload.len() {
            0 => Ok(()),
            left => Err(CodecError::Trailing(left)),
        }
    }
}

/// Collects the fields of one frame. The payload is kept apart, so that it is never copied.
#[derive(Debug, Default)]
pub struct Writer {
    /// All fields but the payload.
    pub head: BytesMut,
    /// The payload, empty for kinds that have none.
    pub payload: Bytes,
}

/// A type that a field of the wire can have.
pub trait Wire: Sized {
    /// Its name in the documentation.
    const NAME: &'static str;
    /// The most bytes that a field of this type takes.
    const BYTES_MAX: usize;

    /// Reads a field.
    ///
    /// # Errors
    /// If the bytes do not follow the layout of the type.
    fn read(from: &mut Reader) -> Result<Self, CodecError>;

    /// Writes a field.
    fn write(&self, into: &mut Writer);
}

macro_rules! wire_numbers {
    ($($Number:ident: $get:ident, $put:ident;)+) => {
        $(
            impl Wire for $Number {
                const NAME: &'static str = stringify!($Number);
                const BYTES_MAX: usize = size_of::<$Number>();

                fn read(from: &mut Reader) -> Result<Self, CodecError> {
                    Ok(from.take(Self::BYTES_MAX, Self::NAME)?.$get())
                }

                fn write(&self, into: &mut Writer) {
                    into.head.$put(*self);
                }
            }
        )+
    };
}

wire_numbers! {
    u8: get_u8, put_u8;
    u16: get_u16_le, put_u16_le;
    u32: get_u32_le, put_u32_le;
    u64: get_u64_le, put_u64_le;
    i16: get_i16_le, put_i16_le;
}

macro_rules! wire_arrays {
    ($($count:literal: $name:literal;)+) => {
        $(
            impl Wire for [u8; $count] {
                const NAME: &'static str = $name;
                const BYTES_MAX: usize = $count;

                fn read(from: &mut Reader) -> Result<Self, CodecError> {
                    let mut array = [0; $count];
                    from.take($count, $name)?.copy_to_slice(&mut array);
                    Ok(array)
                }

                fn write(&self, into: &mut Writer) {
                    into.head.put_slice(self);
                }
            }
        )+
    };
}

wire_arrays! {
    8: "8 bytes";
    16: "16 bytes";
    32: "32 bytes";
}

impl Wire for String {
    const NAME: &'static str = "string";
    const BYTES_MAX: usize = 2 + TEXT_BYTES_MAX;

    fn read(from: &mut Reader) -> Result<Self, CodecError> {
        read_text(from, Self::NAME, TEXT_BYTES_MAX)
    }

    fn write(&self, into: &mut Writer) {
        write_text(self, TEXT_BYTES_MAX, into);
    }
}

fn read_text(from: &mut Reader, what: &'static str, max: usize) -> Result<String, CodecError> {
    let length = usize::from(u16::read(from)?);
    if length > max {
        return Err(CodecError::TooLong { what, length, max });
    }
    let bytes = from.take(length, what)?;
    std::str::from_utf8(&bytes).map(str::to_owned).map_err(|_| CodecError::NotUtf8)
}

/// A text that is too long is cut before the character that crosses the limit. Names are checked before
/// they come here; this is for texts that people read.
fn write_text(text: &str, max: usize, into: &mut Writer) {
    let text = &text[..text.floor_char_boundary(max)];
    into.head.put_u16_le(text.len() as u16);
    into.head.put_slice(text.as_bytes());
}

/// A reference to a channel on the wire: the identifier of the papers, and the epoch that tells two
/// bearers of one identifier apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChannelRef {
    /// Identifier, 0 to 32,767.
    pub id: i16,
    /// Changes each time the identifier is given out anew.
    pub epoch: u16,
}

impl fmt::Display for ChannelRef {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}#{}", self.id, self.epoch)
    }
}

impl Wire for ChannelRef {
    const NAME: &'static str = "channel";
    const BYTES_MAX: usize = 4;

    fn read(from: &mut Reader) -> Result<Self, CodecError> {
        Ok(ChannelRef { id: i16::read(from)?, epoch: u16::read(from)? })
    }

    fn write(&self, into: &mut Writer) {
        self.id.write(into);
        self.epoch.write(into);
    }
}

impl<const BYTES_MAX: usize, const JSON_BYTES_MAX: usize> Wire for ValueOf<BYTES_MAX, JSON_BYTES_MAX> {
    const NAME: &'static str = "value";
    const BYTES_MAX: usize = 1 + 4 + if BYTES_MAX > JSON_BYTES_MAX { BYTES_MAX } else { JSON_BYTES_MAX };

    fn read(from: &mut Reader) -> Result<Self, CodecError> {
        let form = Form::read(from)?;
        let max = if form == Form::Json { JSON_BYTES_MAX } else { BYTES_MAX };
        let length = usize::try_from(u32::read(from)?).unwrap_or(usize::MAX);
        if length > max {
            return Err(CodecError::TooLong { what: Self::NAME, length, max });
        }
        let bytes = from.take(length, Self::NAME)?;
        let value = match form {
            Form::Binary => Self::from_encoded(&bytes),
            Form::Json => std::str::from_utf8(&bytes)
                .map_err(|_| CodecError::NotUtf8)
                .map(Self::from_json)?,
        };
        value.map_err(|_| CodecError::NotVariant)
    }

    /// A value whose JSON is too long is written as null: who answers with one looks at `wire_bytes` first.
    fn write(&self, into: &mut Writer) {
        self.form().write(into);
        let bytes = self.wire_bytes().unwrap_or_else(|_| Bytes::from_static(b"null"));
        into.head.put_u32_le(bytes.len() as u32);
        into.head.put_slice(&bytes);
    }
}

/// A path on the wire: longer than other strings may be. What it may hold is checked where it is used.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Path(pub String);

impl Wire for Path {
    const NAME: &'static str = "path";
    const BYTES_MAX: usize = 2 + PATH_BYTES_MAX;

    fn read(from: &mut Reader) -> Result<Self, CodecError> {
        read_text(from, Self::NAME, PATH_BYTES_MAX).map(Path)
    }

    fn write(&self, into: &mut Writer) {
        write_text(&self.0, PATH_BYTES_MAX, into);
    }
}

/// The last field of a fragment: the rest of the frame, without a length of its own.
pub type Payload = Bytes;

impl Wire for Payload {
    const NAME: &'static str = "payload";
    const BYTES_MAX: usize = FRAGMENT_BYTES_MAX;

    fn read(from: &mut Reader) -> Result<Self, CodecError> {
        Ok(from.rest())
    }

    fn write(&self, into: &mut Writer) {
        into.payload = self.clone();
    }
}

#[cfg(test)]
mod tests {
    use super::super::value::Properties;
    use super::*;
    use proptest::prelude::*;

    fn written<T: Wire>(value: &T) -> Bytes {
        let mut writer = Writer::default();
        value.write(&mut writer);
        writer.head.put_slice(&writer.payload);
        writer.head.freeze()
    }

    fn read_back<T: Wire>(bytes: Bytes) -> Result<T, CodecError> {
        let mut reader = Reader::new(bytes);
        let value = T::read(&mut reader)?;
        reader.finish()?;
        Ok(value)
    }

    #[test]
    fn numbers_are_little_endian() {
        assert_eq!(&written(&0x0102_0304_u32)[..], [4, 3, 2, 1]);
        assert_eq!(&written(&-2_i16)[..], [0xfe, 0xff]);
        assert_eq!(&written(&ChannelRef { id: 1, epoch: 2 })[..], [1, 0, 2, 0]);
    }

    #[test]
    fn a_field_cut_short_and_bytes_left_over_are_errors() {
        assert_eq!(read_back::<u32>(Bytes::from_static(&[1, 2, 3])), Err(CodecError::Short("u32")));
        assert_eq!(read_back::<u8>(Bytes::from_static(&[1, 2, 3])), Err(CodecError::Trailing(2)));
    }

    #[test]
    fn a_string_is_read_up_to_its_limit_and_not_beyond() {
        for (length, fits) in [(254, true), (255, true), (256, false)] {
            let mut bytes = (length as u16).to_le_bytes().to_vec();
            bytes.resize(2 + length, b'a');
            assert_eq!(read_back::<String>(bytes.into()).is_ok(), fits, "{length} bytes");
        }
        assert_eq!(read_back::<String>(Bytes::from_static(&[1, 0, 0xff])), Err(CodecError::NotUtf8));
    }

    #[test]
    fn a_long_text_is_cut_between_characters() {
        let text = "ä".repeat(200);
        let back: String = read_back(written(&text)).expect("what was written reads back");
        assert_eq!(back, "ä".repeat(127));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(number in any::<u64>(), text in "\\PC{0,60}", id in 0_i16.., epoch: u16) {
            prop_assert_eq!(read_back::<u64>(written(&number)), Ok(number));
            prop_assert_eq!(read_back::<String>(written(&text)), Ok(text));
            let channel = ChannelRef { id, epoch };
            prop_assert_eq!(read_back::<ChannelRef>(written(&channel)), Ok(channel));
        }

        #[test]
        fn garbage_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let bytes = Bytes::from(bytes);
            let _ = read_back::<String>(bytes.clone());
            let _ = read_back::<Properties>(bytes.clone());
            let _ = read_back::<[u8; 32]>(bytes);
        }
    }
}
