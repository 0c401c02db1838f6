//! What a hub tells of itself: the answers to `inspect`, read from a variant or written into one.
//!
//! Times are told as spans before the answer, in seconds. A newer hub may tell more: unknown keys are passed over.

use super::delivery::{Counts, DropReason};
use sk_flat::SkVariant;
use std::collections::BTreeMap;
use std::time::Duration;

/// What became of messages: offered = delivered + dropped + queued.
#[derive(Clone, Debug, Default, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct CountsReport {
    /// Messages that were meant for somebody.
    pub offered: u64,
    /// Messages whose last byte the transport took.
    pub delivered: u64,
    /// Messages that wait or are being sent.
    pub queued: u64,
    /// Messages that were dropped, by reason; reasons for which none was are left out.
    pub dropped: BTreeMap<String, u64>,
}

impl From<&Counts> for CountsReport {
    fn from(counts: &Counts) -> CountsReport {
        let dropped = DropReason::ALL
            .iter()
            .map(|(reason, ..)| (reason.to_string(), counts.dropped[*reason as usize]));
        CountsReport {
            offered: counts.offered,
            delivered: counts.delivered,
            queued: counts.queued,
            dropped: dropped.filter(|(_, count)| *count > 0).collect(),
        }
    }
}

/// Subject `hub`: the hub as a whole.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct HubReport {
    /// The version of the program.
    pub version: String,
    /// The newest version of the protocol that it speaks.
    pub protocol: u16,
    /// How long it has been running.
    pub up: Duration,
    /// Connections of every state.
    pub connections: u32,
    /// Those that have not logged in.
    pub waiting_for_login: u32,
    /// Those that are flows.
    pub flows: u32,
    /// Open channels.
    pub channels: u32,
    /// Live subscriptions.
    pub subscriptions: u32,
    /// Of all subscriptions, live and ended.
    pub counts: CountsReport,
    /// What waits or is kept, in bytes, shared payloads once.
    pub bytes_waiting: u64,
    /// What of that is kept for late joiners and who polls, in bytes.
    pub bytes_kept: u64,
    /// Connections that were ended for what they sent.
    pub spurious: u64,
    /// Fragments that came too late for their channel or call.
    pub late_fragments: u64,
    /// What came by datagram, if the hub takes any.
    pub datagrams: Option<DatagramsReport>,
    /// The limits of this hub by name.
    pub limits: BTreeMap<String, u64>,
}

/// What became of the datagrams that a hub received.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct DatagramsReport {
    /// The UDP port that flows are told.
    pub port: u16,
    /// Proven, new, and a `publish`.
    pub taken: u64,
    /// For a session that there is not, or no datagram of a session at all.
    pub unknown: u64,
    /// With a wrong proof.
    pub forged: u64,
    /// With a counter that came before, or too late to tell.
    pub replayed: u64,
    /// Proven, but not what the protocol allows a datagram to hold.
    pub malformed: u64,
}

/// Subject `flows`: every connection.
#[derive(Clone, Debug, Default, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct FlowsReport {
    /// The connections.
    pub flows: Vec<FlowReport>,
    /// How many did not fit into the answer.
    pub left_out: u32,
}

/// One connection.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct FlowReport {
    /// Its id.
    pub id: u64,
    /// Its account, after the login.
    pub account: Option<String>,
    /// Its full name, if it is a flow.
    pub flow: Option<String>,
    /// Where it comes from.
    pub origin: String,
    /// How far it has come.
    pub state: String,
    /// How long it has been open.
    pub since: Duration,
    /// What waits for it, in bytes.
    pub bytes_waiting: u64,
    /// How many channels it owns.
    pub channels: u32,
    /// How many subscriptions it holds.
    pub subscriptions: u32,
}

/// Subject `channel <full name>`: one channel.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct ChannelReport {
    /// Its full name.
    pub name: String,
    /// Its identifier.
    pub id: i16,
    /// Its epoch.
    pub epoch: u16,
    /// Its hashID.
    pub hash: u64,
    /// What it is for.
    pub kind: String,
    /// The name of the flow that owns it, or `hub`.
    pub owner: String,
    /// The connection that owns it; 0 is the hub.
    pub owner_id: u64,
    /// What its owner says about it.
    pub properties: SkVariant,
    /// How many whole messages came.
    pub published: u64,
    /// How long ago the last one came.
    pub last: Option<Duration>,
    /// Whether anybody hears it.
    pub heard: bool,
    /// Whether the last message is kept for late joiners.
    pub latch: bool,
    /// How long that message is, with what it is charged beyond its payload, in bytes.
    pub bytes_latched: u64,
    /// What the owner may publish, if the channel is reliable.
    pub credit: Option<CreditReport>,
    /// The channel that it repeats.
    pub repeats: Option<String>,
    /// The channels that repeat it.
    pub repeated_by: Vec<String>,
    /// How many connections registered to poll it.
    pub pollers: u32,
    /// Its subscribers.
    pub subscribers: Vec<SubscriberReport>,
    /// How many of them did not fit into the answer.
    pub left_out: u32,
}

/// The credit of a reliable channel, in bytes since its present owner began.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct CreditReport {
    /// What was published.
    pub used: u64,
    /// What may be published.
    pub granted: u64,
}

/// One subscriber of a channel.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct SubscriberReport {
    /// Its connection.
    pub id: u64,
    /// The name of its flow.
    pub flow: String,
    /// What becomes of messages if it does not keep up.
    pub policy: String,
    /// How many messages wait at most; nothing on a reliable channel, where the owner's credit says it.
    pub depth: Option<u32>,
    /// What became of its messages.
    pub counts: CountsReport,
    /// What waits for it, in bytes.
    pub bytes_waiting: u64,
}

/// Subject `graph`: who publishes to whom.
#[derive(Clone, Debug, Default, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct GraphReport {
    /// The names of all flows.
    pub flows: Vec<String>,
    /// The channels.
    pub channels: Vec<GraphChannel>,
    /// How many flows, channels and subscriptions did not fit into the answer.
    pub left_out: u32,
}

/// One channel of the graph.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct GraphChannel {
    /// Its full name.
    pub name: String,
    /// What it is for.
    pub kind: String,
    /// The name of the flow that owns it, or `hub`.
    pub owner: String,
    /// The channel that it repeats.
    pub repeats: Option<String>,
    /// The names of the flows that subscribe to it.
    pub subscribers: Vec<String>,
}

/// Subject `why <channel or flow> <flow>`: whether data of the first reaches the second, and if not, where it ends.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct WhyReport {
    /// The channel or flow that was asked about.
    pub from: String,
    /// The flow that data should reach.
    pub to: String,
    /// Whether data passes every hop.
    pub passes: bool,
    /// What was found at each hop, in the direction of data.
    pub hops: Vec<Hop>,
}

/// One hop on the way of data.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct Hop {
    /// The channel or flow where this is so.
    pub at: String,
    /// Whether data passes here.
    pub passes: bool,
    /// Why, or why not.
    pub says: String,
}
