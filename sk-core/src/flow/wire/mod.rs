//! What goes over the wire: bytes, frames, the table of commands and events, and messages in pieces.
//!
//! From below: [`codec`] and `value` are the fields of a frame, [`frame`] its header, [`table`] what every
//! command and event is made of, [`fragment`] a message in pieces, [`budget`] what may be held of them; [`inbound`] and `outbound` are the two
//! halves of a connection.

pub mod budget;
pub mod codec;
pub mod error;
pub mod fragment;
pub mod frame;
pub mod inbound;
pub(super) mod kinds;
mod outbound;
pub mod state;
pub mod table;
pub(super) mod value;

pub use outbound::{Slices, WRITE_PARTS_MAX, Wire};
