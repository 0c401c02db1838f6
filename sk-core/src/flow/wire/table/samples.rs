//! One value of every command and event, for golden vectors, for tests and for other languages.

use super::super::codec::Path;
use super::super::kinds::{ChannelKind, Policy};
use super::super::value::{Form, Properties, Value};
use super::{ChannelRef, Command, Event};
use crate::flow::limits::{FRAGMENT_BYTES_MAX, MAGIC, MESSAGE_BYTES_MAX};
use bytes::Bytes;
use sk_flat::{SkVariant, VariantError, channel_hash};

/// The channel of the samples.
pub const CHANNEL: ChannelRef = ChannelRef { id: 1024, epoch: 1 };
/// Another one.
pub const OTHER: ChannelRef = ChannelRef { id: 1025, epoch: 3 };
/// The client's nonce of the samples.
pub const CLIENT_NONCE: [u8; 32] = [1; 32];
/// The hub's.
pub const HUB_NONCE: [u8; 32] = [2; 32];
/// The session of the samples.
pub const SESSION: [u8; 16] = [3; 16];
/// The payload of the samples.
pub const PAYLOAD: &[u8] = b"pulse";

/// Properties of a channel.
///
/// # Errors
/// None: they are small. The type is that of their constructor.
pub fn properties() -> Result<Properties, VariantError> {
    Properties::new(&SkVariant::map([("unit", "m/s2".into()), ("rate", 100.0.into())]))
}

/// One of each command, in the order of the table. `client_proof` goes into `login_token`.
///
/// # Errors
/// None: the values are small.
pub fn commands(client_proof: [u8; 32]) -> Result<Vec<Command>, VariantError> {
    let (channel, properties, payload) = (CHANNEL, properties()?, Bytes::from_static(PAYLOAD));
    let (fragment_bytes, message_bytes) = (FRAGMENT_BYTES_MAX as u32, MESSAGE_BYTES_MAX as u32);
    let (form, key, database) = (Form::Binary, "gain.p".to_owned(), "arm".to_owned());
    let path = || Path("maps/floor-1.png".to_owned());
    let text = str::to_owned;
    Ok(vec![
        Command::Hello {
            magic: MAGIC,
            version: 1,
            version_oldest: 1,
            fragment_bytes,
            message_bytes,
            nonce: CLIENT_NONCE,
        },
        Command::LoginToken { proof: client_proof },
        Command::LoginPeer {},
        Command::Ping {},
        Command::Pong {},
        Command::SetAsync { name: text("camera"), session: [0; 16], form },
        Command::ListChannels { form },
        Command::LoginScram { message: text("n,,n=ada,r=rOprNGfwEbeRWgbNEkqO") },
        Command::LoginScramProof {
            message: text(
                "c=biws,r=rOprNGfwEbeRWgbNEkqO%hvYDpWUa2RaTCAfuxFIlj)hNlF$k0,p=dHzbZapWIk4jUhN+Ute9ytag9zjfMHgsqmmiz7AndVQ=",
            ),
        },
        Command::Inspect { subject: text("hub"), form },
        Command::UdpOpen {},
        Command::CreateStream { name: text("imu"), properties: properties.clone() },
        Command::RemoveChannel { channel },
        Command::Subscribe { channel, policy: Policy::Latest, depth: 64, divisor: 1 },
        Command::Unsubscribe { channel },
        Command::Publish { channel, message: 9, payload: payload.clone() },
        Command::ChangeHeader { channel, properties: properties.clone() },
        Command::Attach { replica: channel, source: OTHER },
        Command::Detach { replica: channel },
        Command::PollRegister { channel },
        Command::PollDeregister { channel },
        Command::Poll { channel },
        Command::CreateSync { name: text("clock"), properties: properties.clone() },
        Command::SyncTick { channel, sequence: 7 },
        Command::TickDone { channel, sequence: 7 },
        Command::CreateService { name: text("gripper"), properties: properties.clone() },
        Command::Call { channel, deadline_ms: 500, payload: payload.clone() },
        Command::Answer { request: 5, more: 0, payload: payload.clone() },
        Command::Decline { request: 5, text: text("not now") },
        Command::Cancel { call: 4 },
        Command::CreateBlob { name: text("maps"), properties },
        Command::BlobBegin { channel, path: path(), bytes: 5, checksum: 0x1234_5678 },
        Command::BlobWrite { channel, path: path(), offset: 0, payload },
        Command::BlobCommit { channel, path: path() },
        Command::BlobAbort { channel, path: path() },
        Command::BlobMkdir { channel, path: path() },
        Command::BlobMove { channel, from: path(), to: Path(text("maps/old.png")) },
        Command::BlobRemove { channel, path: path() },
        Command::BlobList { channel, path: Path(text("maps")) },
        Command::BlobStat { channel, path: path() },
        Command::BlobRead { channel, path: path(), offset: 0, bytes: 65_536 },
        Command::DbSelect { database: database.clone() },
        Command::DbCreate { database: database.clone(), durable: 1 },
        Command::DbExists { database: database.clone() },
        Command::DbRemove { database: database.clone() },
        Command::DbSave {},
        Command::DbLoad {},
        Command::DbList { prefix: text("flow:") },
        Command::VarSet { key: key.clone(), value: Value::new(&1.5.into())? },
        Command::VarGet { key: key.clone(), form },
        Command::VarHas { key: key.clone() },
        Command::VarDelete { key: key.clone() },
        Command::DbKeys { prefix: text("gain.") },
        Command::DbAll { prefix: text("gain."), form },
        Command::Watch { database, prefix: text("gain."), after: 0, form },
        Command::Unwatch { watch: 8 },
        Command::UserSet {
            user: text("ada"),
            rounds: 15_000,
            salt: [4; 16],
            stored_key: [5; 32],
            server_key: [6; 32],
        },
        Command::UserRemove { user: text("ada") },
        Command::UserList {},
    ])
}

/// One of each event, in the order of the table. `hub_proof` goes into `logged_in`.
///
/// # Errors
/// None: the values are small.
pub fn events(hub_proof: [u8; 32]) -> Result<Vec<Event>, VariantError> {
    let (channel, properties, payload) = (CHANNEL, properties()?, Bytes::from_static(PAYLOAD));
    let (fragment_bytes, message_bytes) = (FRAGMENT_BYTES_MAX as u32, MESSAGE_BYTES_MAX as u32);
    let (owner, name, key) = (1 << 32, "robot.imu".to_owned(), "gain.p".to_owned());
    let (kind, hash, value) = (ChannelKind::Stream, channel_hash(&name), Value::new(&1.5.into())?);
    let text = str::to_owned;
    Ok(vec![
        Event::Welcome { magic: MAGIC, version: 1, fragment_bytes, message_bytes, nonce: HUB_NONCE },
        Event::LoggedIn { connection: owner, user: text("robot"), proof: hub_proof },
        Event::Ping {},
        Event::Pong {},
        Event::ScramChallenge {
            message: text(
                "r=rOprNGfwEbeRWgbNEkqO%hvYDpWUa2RaTCAfuxFIlj)hNlF$k0,s=W22ZaJ0SNY7soEsUEjb6gQ==,i=15000",
            ),
        },
        Event::FlowBegun { channels: 1, name: text("robot.camera"), session: SESSION, resumed: 0 },
        Event::ChannelListed {
            channel,
            kind,
            hash,
            owner,
            name: name.clone(),
            properties: properties.clone(),
        },
        Event::ListEnd { count: 1 },
        Event::Done {},
        Event::Saved {},
        Event::Flag { value: 1 },
        Event::Value { value: value.clone() },
        Event::UdpOpened { session: 6, key: [7; 32], port: 7110 },
        Event::ChannelAdded { channel, kind, hash, owner, name, properties: properties.clone() },
        Event::ChannelRemoved { channel },
        Event::StartPublishing { channel },
        Event::StopPublishing { channel },
        Event::Data { channel, message: 9, payload: payload.clone() },
        Event::Dropped { channel, reason: 1, total: 3 },
        Event::Subscribed { channel },
        Event::Unsubscribed { channel },
        Event::HeaderChanged { channel, properties },
        Event::Attached { replica: channel, source: OTHER },
        Event::Detached { replica: channel, source: OTHER },
        Event::Latest { channel, message: 9, payload: payload.clone() },
        Event::Credit { channel, bytes: 1 << 20 },
        Event::Tick { channel, sequence: 7 },
        Event::TickReport { channel, target: owner, lag_ns: 250_000, done: 99, missed: 1, divisor: 1 },
        Event::OwnerChanged { channel, owner },
        Event::Request { channel, request: 5, asker: owner, payload: payload.clone() },
        Event::RequestOver { request: 5 },
        Event::Reply { more: 0, payload: payload.clone() },
        Event::BlobResume { offset: 65_536 },
        Event::BlobListed { name: text("floor-1.png"), directory: 0, bytes: 5 },
        Event::BlobEntry { directory: 0, bytes: 5, checksum: 0x1234_5678 },
        Event::BlobData { payload },
        Event::DatabaseSelected { database: text("arm") },
        Event::DatabaseListed { database: text("arm"), durable: 1, variables: 3, bytes: 120 },
        Event::KeyListed { key: key.clone() },
        Event::Variable { key: key.clone(), value: value.clone() },
        Event::Changed { sequence: 12, key: key.clone(), value },
        Event::Deleted { sequence: 13, key },
        Event::Watching { sequence: 13, whole: 1 },
        Event::WatchOver {},
        Event::UserListed { user: text("ada"), connections: 1 },
        Event::Refused { code: 1, text: text("denied") },
        Event::Closing { reason: 2, text: text("the hub ends") },
    ])
}

#[cfg(test)]
mod tests {
    use super::super::Message;
    use super::*;

    #[test]
    fn there_is_one_sample_of_each_kind_in_the_order_of_the_table() {
        let commands = commands([0; 32]).expect("small");
        let events = events([0; 32]).expect("small");
        assert!(commands.iter().map(|sample| sample.definition()).eq(Command::TABLE.iter()));
        assert!(events.iter().map(|sample| sample.definition()).eq(Event::TABLE.iter()));
    }
}
