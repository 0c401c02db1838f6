//! A small HTTP/1.1 server on the loop: pages that stand in memory, and a door for those who upgrade.
//!
//! It answers GET and HEAD of paths that somebody registered, says in clear words what it does not have, and
//! hands a connection that upgrades to whoever registered that path. Request bodies are refused. Every length,
//! count and time has a limit, and none of them is allocated for before it was looked at.

mod answer;
mod connection;
mod request;
mod server;
mod site;

pub use answer::Answer;
pub use request::{HEAD_BYTES_MAX, HEADERS_MAX, Method, Request, RequestError};
pub use server::HttpServer;
pub use site::{HttpSettings, Page};
#[cfg(feature = "websocket")]
pub(crate) use site::{Upgrade, Upgraded};
