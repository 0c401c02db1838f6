//! The FlowProtocol: how satellites and their hub talk, without sockets, clocks or other I/O.
//!
//! The layers, each of which knows only those before it:
//!
//! - bytes → [`frame`]: header, the check for a whole frame, the buffer bytes gather in;
//! - frame → [`table`]: every command and event with its states, right, layout and cost, once;
//! - command → [`state`], [`login`], [`fragment`], [`channel`], [`delivery`]: the parts of a connection and
//!   of a hub;
//! - effect → [`server`] and [`satellite`]: the two sides. Bytes and instants go in, frames and events come
//!   out; somebody else has the sockets.
//!
//! `docs/flow-protocol.md` is the normative description for people who write another client.

pub mod blob;
pub mod channel;
pub mod database;
pub mod limits;
pub mod login;
pub mod report;
pub mod rights;
pub mod satellite;
pub mod server;
mod service;
mod sk_flow_sat;
mod sk_flow_server;
pub mod transport;
pub mod wire;

pub use channel::delivery;
pub use login::scram;
pub use satellite::{Divisor, TickReport};
pub use service::{Request, Service};
pub use sk_flow_sat::{
    Answer, BlobProgress, Call, CallError, Flow, FlowBlob, FlowDatabase, FlowDownload, FlowMessage,
    SkFlowSat, Variable,
};
pub use sk_flow_server::{KeepError, SkFlowServer};
pub use transport::{AddressError, FLOW_PATH, HubAddress, PipeSeed};
#[cfg(feature = "tls")]
pub use transport::{TlsError, TlsIdentity, TlsTrust};
pub use wire::codec::{ChannelRef, Path};
pub use wire::error::{ClosingReason, ProtocolError, RefusalCode};
pub use wire::frame::{Flags, Header};
pub use wire::inbound::Inbound;
pub use wire::kinds::{ChannelKind, Policy};
pub use wire::state::State;
pub use wire::table::definition;
pub use wire::table::definition::{
    Definition, Direction, Encoded, Field, Message, Right, Rights, States, Tagged,
};
pub use wire::table::{Command, Event};
pub use wire::value::{Form, Properties, Value};
pub use wire::{codec, error, fragment, frame, inbound, state, table};
