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
mod call;
pub mod channel;
pub mod codec;
pub mod database;
pub mod definition;
pub mod delivery;
pub mod error;
pub mod fragment;
pub mod frame;
pub mod inbound;
mod kinds;
pub mod limits;
pub mod login;
mod message;
mod outgoing;
pub mod report;
pub mod rights;
pub mod satellite;
pub mod scram;
pub mod server;
mod service;
mod sk_flow_sat;
mod sk_flow_server;
pub mod state;
pub mod table;
pub mod transport;
mod value;
pub mod wire;

pub use call::{Answer, Call, CallError};
pub use codec::{ChannelRef, Path};
pub use definition::{Definition, Direction, Encoded, Field, Message, Right, Rights, States, Tagged};
pub use error::{ClosingReason, ProtocolError, RefusalCode};
pub use frame::{Flags, Header};
pub use inbound::Inbound;
pub use kinds::{ChannelKind, Policy};
pub use message::{Flow, FlowMessage};
pub use satellite::{Divisor, TickReport};
pub use service::{Request, Service};
pub use sk_flow_sat::{BlobProgress, FlowBlob, FlowDatabase, FlowDownload, SkFlowSat, Variable};
pub use sk_flow_server::{KeepError, SkFlowServer};
pub use state::State;
pub use table::{Command, Event};
pub use transport::{AddressError, FLOW_PATH, HubAddress, PipeSeed};
#[cfg(feature = "tls")]
pub use transport::{TlsError, TlsIdentity, TlsTrust};
pub use value::{Form, Properties, Value};
