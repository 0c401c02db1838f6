//! What a satellite learns from its hub.

use super::super::blob::BlobEntry;
use super::super::delivery::DropReason;
use super::super::{ChannelKind, ChannelRef, Properties, Value};
use super::{AccountInfo, DatabaseInfo};
use bytes::Bytes;
use std::time::Duration;
use thiserror::Error;

/// What a satellite knows of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelInfo {
    /// Identifier and epoch.
    pub channel: ChannelRef,
    /// What it is for.
    pub kind: ChannelKind,
    /// The hashID.
    pub hash: u64,
    /// The connection that owns it; 0 is the hub.
    pub owner: u64,
    /// The full name, `user.name`.
    pub name: String,
    /// What its owner says about it.
    pub properties: Properties,
}

/// How a target of a sync channel keeps up, as the hub measures it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickReport {
    /// The sync channel.
    pub channel: ChannelRef,
    /// The connection of the target.
    pub target: u64,
    /// Whether that is this satellite's own.
    pub is_own: bool,
    /// From the hub's sending of a tick to the target's being done with it, the longest since the last report.
    pub lag: Duration,
    /// Ticks done in time since the subscription began.
    pub done: u64,
    /// Ticks missed since then: left out by the source, or not done before the next one.
    pub missed: u64,
    /// Which ticks the target gets now: every one, every second, every fourth.
    pub divisor: u8,
}

/// An event of a satellite.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SatelliteEvent {
    /// The login succeeded, and the hub proved the token where there is one.
    LoggedIn {
        /// The account.
        user: String,
        /// The id of this connection.
        connection: u64,
    },
    /// The command with this tag succeeded.
    Done {
        /// Of the command.
        tag: u32,
    },
    /// The command with this tag succeeded, and what it changed is on the hub's disk.
    Saved {
        /// Of the command.
        tag: u32,
    },
    /// The answer to a question.
    Flag {
        /// Of the question.
        tag: u32,
        /// Yes or no.
        value: bool,
    },
    /// The answer to a question.
    Value {
        /// Of the question.
        tag: u32,
        /// The answer.
        value: Value,
    },
    /// There is a session for datagrams now, and a former one is over.
    UdpOpened {
        /// Of the command.
        tag: u32,
        /// The hub's UDP port.
        port: u16,
    },
    /// The current database is another one, or none.
    DatabaseSelected {
        /// Of the `db_select`; 0 if it was removed.
        tag: u32,
        /// Its name.
        database: Option<String>,
    },
    /// The answer to `user_list`.
    Accounts {
        /// Of the command.
        tag: u32,
        /// The accounts, by name.
        accounts: Vec<AccountInfo>,
    },
    /// The answer to `db_list`.
    Databases {
        /// Of the command.
        tag: u32,
        /// The databases, by name.
        databases: Vec<DatabaseInfo>,
    },
    /// The answer to `db_keys`.
    Keys {
        /// Of the command.
        tag: u32,
        /// The keys, sorted.
        keys: Vec<String>,
    },
    /// The answer to `db_all`.
    Variables {
        /// Of the command.
        tag: u32,
        /// Keys and values, sorted by key.
        variables: Vec<(String, Value)>,
    },
    /// A watched variable has this value now.
    Changed {
        /// Of the watch.
        tag: u32,
        /// The number of the change.
        sequence: u64,
        /// The variable.
        key: String,
        /// Its value; none if it was deleted.
        value: Option<Value>,
    },
    /// What a watch had to tell was told, up to here.
    Watching {
        /// Of the watch.
        tag: u32,
        /// The number to go on from after a reconnection; 0: everything is about to be told, none holds until then.
        sequence: u64,
        /// Everything there is was told since the watch began or since the last of these events; variables known
        /// from before that were not told are gone.
        whole: bool,
    },
    /// A watch is over, because its database is gone or the right to it.
    WatchOver {
        /// Of the watch.
        tag: u32,
    },
    /// A channel says something else about itself.
    HeaderChanged {
        /// Of the command, if it was this satellite's.
        tag: u32,
        /// What is known of the channel now.
        info: ChannelInfo,
    },
    /// Another connection owns a channel: its flow came back and took its own place again.
    OwnerChanged(ChannelInfo),
    /// A channel of one's own repeats another one from here on.
    Attached {
        /// What was asked.
        tag: u32,
        /// One's own channel.
        replica: ChannelRef,
        /// The one it repeats.
        source: ChannelRef,
    },
    /// A channel of one's own repeats no more.
    Detached {
        /// What was asked; 0 if the source, or the right to it, has gone.
        tag: u32,
        /// One's own channel.
        replica: ChannelRef,
        /// The one it repeated; of epoch 0 if there was none.
        source: ChannelRef,
    },
    /// The answer to `poll`: the newest message.
    Latest {
        /// What was asked.
        tag: u32,
        /// The channel.
        channel: ChannelRef,
        /// Its bytes.
        payload: Bytes,
    },
    /// After `publish` was turned away: the slowest subscriber of this reliable channel has caught up.
    Room(ChannelRef),
    /// Commands may be given now. A flow knows all channels at this point.
    Ready,
    /// A channel of this satellite's own exists now.
    Created {
        /// What was asked.
        tag: u32,
        /// The reference to publish with.
        channel: ChannelRef,
        /// Its full name.
        name: String,
    },
    /// A channel exists; comes for one's own channels too.
    ChannelAdded(ChannelInfo),
    /// A channel is gone, and with it every subscription to it.
    ChannelRemoved(ChannelInfo),
    /// Somebody listens to a channel of one's own.
    StartPublishing(ChannelRef),
    /// Nobody listens any more to a channel of one's own.
    StopPublishing(ChannelRef),
    /// A subscription is in force.
    Subscribed(ChannelRef),
    /// A subscription has ended because it was asked for.
    Unsubscribed(ChannelRef),
    /// A message.
    Message {
        /// Of which channel; its name is [`SatelliteCore::channel_of`](super::SatelliteCore::channel_of).
        channel: ChannelRef,
        /// Its bytes, shared with the receive buffer if it came in one fragment.
        payload: Bytes,
    },
    /// Somebody asks a service of this satellite's.
    Request {
        /// The service.
        channel: ChannelRef,
        /// To be answered with [`SatelliteCore::answer`](super::SatelliteCore::answer).
        request: u64,
        /// The connection that asks.
        asker: u64,
        /// What.
        payload: Bytes,
    },
    /// Nobody waits any more for the answer to a request.
    RequestOver {
        /// Which.
        request: u64,
    },
    /// An answer to a call. What ends a call otherwise is `Refused` with its tag.
    Reply {
        /// Of the call.
        tag: u32,
        /// Whether further answers follow.
        more: bool,
        /// The answer.
        payload: Bytes,
    },
    /// An upload may go on.
    BlobResume {
        /// Of the `blob_begin`.
        tag: u32,
        /// From here.
        offset: u64,
    },
    /// The answer to `blob_list`.
    BlobEntries {
        /// Of the command.
        tag: u32,
        /// What stands in the folder, by name.
        entries: Vec<BlobEntry>,
    },
    /// The answer to `blob_stat`.
    BlobLooked {
        /// Of the command.
        tag: u32,
        /// Kind and length; the name is empty.
        entry: BlobEntry,
        /// CRC-32 of a file.
        checksum: u32,
    },
    /// Bytes of a download, in their order. What ends it before its last is `Refused` with its tag.
    BlobData {
        /// Of the `blob_read`.
        tag: u32,
        /// The bytes.
        payload: Bytes,
        /// Nothing more comes.
        last: bool,
    },
    /// A tick of a sync channel that is followed.
    Tick {
        /// Which.
        channel: ChannelRef,
        /// To be said in [`SatelliteCore::tick_done`](super::SatelliteCore::tick_done) after the pulse.
        sequence: u64,
    },
    /// How a target of a sync channel keeps up: this satellite, or one that follows it.
    TickReport(TickReport),
    /// Messages of a subscription did not come.
    Dropped {
        /// Of which channel.
        channel: ChannelRef,
        /// Why; `None` if this build does not know the reason.
        reason: Option<DropReason>,
        /// How many for this reason since the subscription began.
        total: u64,
    },
    /// The answer to `list`.
    Listed {
        /// What was asked.
        tag: u32,
        /// All channels by identifier.
        channels: Vec<ChannelInfo>,
    },
    /// The hub refused a command.
    Refused {
        /// What was asked.
        tag: u32,
        /// Why, as a number of [`RefusalCode`](super::super::RefusalCode).
        code: u16,
        /// The same for people, as the hub says it.
        text: String,
    },
    /// The hub answered a ping.
    Pong {
        /// What was asked.
        tag: u32,
    },
    /// The hub ends the connection.
    Closing {
        /// Why, as a number of [`ClosingReason`](super::super::ClosingReason).
        reason: u16,
        /// The same for people, as the hub says it.
        text: String,
    },
}

/// Why a satellite cannot do what it was asked, found without asking the hub.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SatelliteError {
    /// The connection is not ready, or is not of the kind that has this command.
    #[error("`{0}` is not possible in the state of this connection")]
    State(&'static str),
    /// The name is none.
    #[error("not a channel's name: {0}")]
    Name(#[from] sk_flat::NameError),
    /// The properties cannot be sent.
    #[error("properties that cannot be sent: {0}")]
    Properties(#[from] sk_flat::VariantError),
    /// The channel is not one's own, or is gone.
    #[error("channel {0} is not this satellite's, or is gone")]
    NotOwn(ChannelRef),
    /// Nobody waits for an answer to this request any more, or it was never this satellite's.
    #[error("nobody waits for the answer to request {0}")]
    NoRequest(u64),
    /// The satellite has opened no channel of this name.
    #[error("this satellite has opened no channel `{0}`")]
    NotOpen(String),
    /// Too much waits to be sent, or for the slowest subscriber of a reliable channel.
    #[error("too many bytes wait to be sent")]
    Full,
    /// The message is longer than was agreed with the hub.
    #[error("a message of {length} bytes, at most {max} were agreed")]
    TooLong {
        /// Its length.
        length: usize,
        /// The agreed limit.
        max: usize,
    },
    /// Nothing was heard from the hub for too long.
    #[error("the hub has been silent for too long")]
    Silent,
}
