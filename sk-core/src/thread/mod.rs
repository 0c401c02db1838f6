//! Several loops: one per thread, talking by messages only.

mod crossing;
mod mailbox;
mod remote;
mod sk_thread;

pub use crossing::{Crossing, RemoteSend};
pub(crate) use crossing::{RemoteReceive, WayBack};
pub(crate) use mailbox::{Inbox, MAILBOX_MESSAGES_MAX, Mailbox, Message};
pub use remote::{PostError, Remote, There};
pub use sk_thread::{SkThread, ThreadBuilder, ThreadError};
