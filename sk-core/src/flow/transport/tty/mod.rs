//! A serial line as a transport: up to sixteen byte streams over one pair of wires, each a connection of its own.
//!
//! [`slip_encode`] and [`SlipReader`] find packets on the line, [`Envelope`] is what stands in one, [`Line`] repeats
//! what was lost and shares the line among the streams. None of them knows a port; the objects that do are made
//! by a satellite or a server that is given such an address.

mod end;
mod envelope;
mod line;
#[cfg(test)]
mod line_tests;
mod port;
mod slip;
mod stream;
mod window;

pub use envelope::{ENVELOPE_BYTES_MAX, Envelope, Kind, PAYLOAD_BYTES_MAX, STREAMS};
pub use line::{DOWN_AFTER, Line, LineEvent, Role, StreamError, StreamId};
pub(crate) use port::{Opening, SerialLine};
pub use slip::{SlipReader, slip_encode};
