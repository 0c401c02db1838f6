//! Every limit of the flow network that is decided here, with its unit in its name.

use std::time::Duration;

/// The newest version of the protocol that this build speaks.
pub const VERSION: u16 = 1;
/// The oldest version of the protocol that this build still speaks.
pub const VERSION_OLDEST: u16 = 1;
/// The eight bytes that begin the first frame of either side.
pub const MAGIC: [u8; 8] = *b"SpecialK";

/// The longest frame body before login. Longer ones are refused from their header alone.
pub const BODY_BYTES_MAX_BEFORE_LOGIN: usize = 512;
/// The longest payload of one fragment, and what this build proposes.
pub const FRAGMENT_BYTES_MAX: usize = 64 * 1024;
/// The smallest fragment size that a peer may propose.
pub const FRAGMENT_BYTES_MIN: usize = 256;
/// The longest message, all its fragments together, and what this build proposes.
pub const MESSAGE_BYTES_MAX: usize = 16 * 1024 * 1024;
/// The longest string on the wire, in bytes of UTF-8. Channel names have the same limit.
pub const TEXT_BYTES_MAX: usize = 255;
/// The longest property map of a channel, in the binary form.
pub const PROPERTIES_BYTES_MAX: usize = 16 * 1024;
/// The same as JSON, where one byte may take six.
pub const PROPERTIES_JSON_BYTES_MAX: usize = 6 * PROPERTIES_BYTES_MAX;
/// The longest value of a variable, in either form.
pub const VALUE_BYTES_MAX: usize = 1024 * 1024;
/// The longest path inside a blob channel.
pub const PATH_BYTES_MAX: usize = 1_024;

/// How many channels a hub has: identifiers 0 to 32,767.
pub const CHANNELS_MAX: usize = 32_768;
/// How many of them only the hub itself may open: the lowest identifiers.
pub const CHANNELS_RESERVED_FOR_HUB: usize = 1_024;
/// How many channels one flow may own.
pub const CHANNELS_PER_FLOW_MAX: usize = 256;
/// How many subscriptions one flow may hold.
pub const SUBSCRIPTIONS_PER_FLOW_MAX: usize = 1_024;
/// How many whole messages a subscription keeps if it does not say otherwise.
pub const SUBSCRIPTION_DEPTH_DEFAULT: u16 = 64;
/// How many whole messages a subscription may ask to keep.
pub const SUBSCRIPTION_DEPTH_MAX: u16 = 1_024;

/// How many channels may repeat one another in a row.
pub const REPLICA_LEVELS_MAX: usize = 8;

/// How many requests one connection may have open at services, those it is still sending included.
pub const REQUESTS_PER_ASKER_MAX: usize = 64;
/// How many open requests the services of one owner may have together; a hub's own services too.
pub const REQUESTS_PER_OWNER_MAX: usize = 1_024;
/// How long an answer may take if the call does not say otherwise.
pub const DEADLINE_DEFAULT: Duration = Duration::from_secs(5);
/// How long an answer may be waited for.
pub const DEADLINE_MAX: Duration = Duration::from_secs(3_600);

/// How often the reports of one target of a sync channel come, at most.
pub const TICK_REPORT_INTERVAL: Duration = Duration::from_secs(1);
/// How long a target that was divided down must keep up before it gets more ticks again; longer each time that it
/// fails.
pub const SYNC_GOOD_TIME_MIN: Duration = Duration::from_secs(5);
/// The longest that this becomes.
pub const SYNC_GOOD_TIME_MAX: Duration = Duration::from_secs(60);

/// What may wait for one connection, payloads counted in full. Beyond it its messages are dropped.
pub const CONNECTION_BYTES_MAX: usize = 32 * 1024 * 1024;
/// What may wait for all connections together, be kept for late joiners and be held of unfinished messages and of
/// requests and answers, shared payloads counted once.
pub const HUB_BYTES_MAX: usize = 256 * 1024 * 1024;
/// What is kept of it for late joiners and for those who poll, at most.
pub const KEPT_BYTES_MAX: usize = HUB_BYTES_MAX / 2;
/// How much a hub that has too many bytes waiting drops at once, so that it need not look for room each time.
pub const SHED_BYTES: usize = HUB_BYTES_MAX / SHED_SHARE;
/// Which part of all that is.
pub const SHED_SHARE: usize = 16;
/// How far the owner of a reliable channel may be ahead of its slowest subscriber before it has to wait.
pub const CREDIT_BYTES: u64 = 1024 * 1024;
/// What unfinished messages of one connection may hold together.
pub const UNFINISHED_BYTES_MAX: usize = 32 * 1024 * 1024;
/// What unfinished messages of all connections may hold together.
pub const UNFINISHED_BYTES_MAX_IN_ALL: usize = HUB_BYTES_MAX / 2;
/// What one fragment or one waiting message is charged beyond its payload.
pub const ITEM_OVERHEAD_BYTES: usize = 64;
/// What may wait in a connection's queue of control frames. Beyond it the connection is closed; from half
/// of it on its own commands wait.
pub const CONTROL_BYTES_MAX: usize = 4 * 1024 * 1024;
/// What may be announced to everybody, of channels and what they say of themselves, until deadlines are looked at
/// again: a part of the queue of control frames that each has. Who announces more waits.
pub const ANNOUNCED_BYTES_MAX: usize = CONTROL_BYTES_MAX / 4;
/// How much is moved from the queues to the transport's side ahead of the socket. Small, so that drop
/// policies still reach what waits behind it.
pub const WIRE_BYTES_AHEAD: usize = 64 * 1024;
/// Payloads below this size are copied out of the receive buffer, so that a small message that waits
/// does not keep a large buffer alive.
pub const SHARED_PAYLOAD_BYTES_MIN: usize = 1024;
/// The work, in units of the table's cost column, that one connection may cause in one turn.
pub const TURN_COST_MAX: u32 = 256;

/// How many variables one database holds.
pub const DATABASE_KEYS_MAX: usize = 100_000;
/// What keys and values of one database take together.
pub const DATABASE_BYTES_MAX: usize = 64 * 1024 * 1024;
/// How many databases of one account are there without their flow or channel: those created by name, and those
/// that were saved.
pub const DATABASES_PER_ACCOUNT_MAX: usize = 64;
/// What all databases of one account take together.
pub const ACCOUNT_BYTES_MAX: usize = DATABASES_PER_ACCOUNT_MAX * DATABASE_BYTES_MAX;
/// How many variables all databases of one account have together.
pub const ACCOUNT_KEYS_MAX: usize = DATABASES_PER_ACCOUNT_MAX * DATABASE_KEYS_MAX;
/// How many deletions a database remembers for those who watch it.
pub const DELETIONS_KEPT_MAX: usize = 1_024;
/// How many watches one flow may have.
pub const WATCHES_PER_FLOW_MAX: usize = 256;
/// How many changes of one flow may wait for the disk; its further commands wait meanwhile.
pub const UNSAVED_PER_FLOW_MAX: usize = 1_024;
/// What they may hold before further commands wait; a whole database that is saved or loaded counts in full.
pub const UNSAVED_BYTES_PER_FLOW_MAX: usize = 4 * 1024 * 1024;
/// What may be on its way from the disk into databases at once, unless one alone is larger.
pub const LOADING_BYTES_MAX: usize = DATABASE_BYTES_MAX;

/// How many requests of one connection may wait for the disk of blobs; its further commands wait meanwhile. And how
/// many pieces of uploads it may have begun and not ended.
pub const BLOB_REQUESTS_PER_CONNECTION_MAX: usize = 64;
/// How many bytes of uploads of one connection may wait for the disk before it is read from again.
pub const BLOB_BYTES_AHEAD_MAX: usize = 4 * 1024 * 1024;
/// How many downloads one connection may have under way.
pub const BLOB_READS_PER_CONNECTION_MAX: usize = 16;
/// How much of a file is read from the disk at once.
pub const BLOB_CHUNK_BYTES: usize = 256 * 1024;

/// How many accounts a hub has.
pub const ACCOUNTS_MAX: usize = 1_024;
/// The longest name of an account: its logins must fit into the messages before login.
pub const ACCOUNT_NAME_BYTES_MAX: usize = 64;
/// How many patterns one right of an account may have.
pub const PATTERNS_PER_RIGHT_MAX: usize = 64;

/// How many connections a hub serves at once.
pub const CONNECTIONS_MAX: usize = 16_384;
/// How many of them may be logged in to one account, but for the owner's.
pub const CONNECTIONS_PER_ACCOUNT_MAX: usize = 1_024;
/// How many connections may be open at once without a login.
pub const UNAUTHENTICATED_MAX: usize = 1_024;
/// How many connections one address may open at once, and how many a second after that.
pub const CONNECTIONS_PER_ADDRESS_BURST: u64 = 512;
/// See [`CONNECTIONS_PER_ADDRESS_BURST`].
pub const CONNECTIONS_PER_ADDRESS_PER_SECOND: u64 = 256;
/// How many addresses are remembered for such limits.
pub const ADDRESSES_MAX: usize = 4_096;
/// How many logins from one address may fail within [`FAILED_LOGINS_WINDOW`]; further ones are answered late.
pub const FAILED_LOGINS_FREE: u32 = 5;
/// See [`FAILED_LOGINS_FREE`].
pub const FAILED_LOGINS_WINDOW: Duration = Duration::from_secs(60);
/// How late.
pub const FAILED_LOGIN_DELAY: Duration = Duration::from_secs(1);
/// The time from the opening of a connection to its login, all of it.
pub const LOGIN_TIME_MAX: Duration = Duration::from_secs(2);
/// A side that heard nothing for this long asks with a ping.
pub const PING_AFTER: Duration = Duration::from_secs(2);
/// A side that heard nothing for this long gives the other up.
pub const SILENCE_MAX: Duration = Duration::from_secs(6);
/// The time that a frame once begun may take to arrive.
pub const FRAME_TIME_MAX: Duration = Duration::from_secs(10);
/// The time that a closing connection has to take its last bytes.
pub const LINGER_TIME_MAX: Duration = Duration::from_secs(1);
/// How often deadlines are looked at.
pub const CHECK_INTERVAL: Duration = Duration::from_millis(250);
/// How often a subscriber is told about what it lost, at most.
pub const DROPPED_REPORT_INTERVAL: Duration = Duration::from_secs(1);
/// How many lines a second the log gets about misbehaving peers; the rest is counted.
pub const LOG_LINES_PER_SECOND_MAX: u32 = 10;

const _: () = {
    assert!(FRAGMENT_BYTES_MIN <= FRAGMENT_BYTES_MAX && FRAGMENT_BYTES_MAX <= MESSAGE_BYTES_MAX);
    assert!(MESSAGE_BYTES_MAX <= UNFINISHED_BYTES_MAX && MESSAGE_BYTES_MAX <= CONNECTION_BYTES_MAX);
    assert!(CONNECTIONS_PER_ACCOUNT_MAX + UNAUTHENTICATED_MAX < CONNECTIONS_MAX);
    assert!(CHANNELS_MAX == i16::MAX as usize + 1 && CHANNELS_RESERVED_FOR_HUB < CHANNELS_MAX);
    assert!(PROPERTIES_JSON_BYTES_MAX < CONTROL_BYTES_MAX && VALUE_BYTES_MAX < CONTROL_BYTES_MAX / 2);
    assert!(CREDIT_BYTES as usize + MESSAGE_BYTES_MAX < CONNECTION_BYTES_MAX);
    assert!(CONNECTION_BYTES_MAX <= KEPT_BYTES_MAX && SHED_BYTES >= MESSAGE_BYTES_MAX);
    assert!(VERSION_OLDEST <= VERSION);
    assert!(REQUESTS_PER_ASKER_MAX < REQUESTS_PER_OWNER_MAX);
};
