//! The lines of the table for what a hub sends.

use super::super::codec::{ChannelRef, Payload, Reader, Wire};
use super::super::error::ProtocolError;
use super::super::frame::{Flags, Header};
use super::super::kinds::ChannelKind;
use super::super::state::State;
use super::super::value::{Properties, Value};
use super::definition::{Definition, Direction, Encoded, Field, Message, Right, States, Tagged, flow_table};
use bytes::Bytes;

flow_table! {
    /// What a hub sends to its clients.
    Event: HubToClient

    /// The first frame of a hub: the agreed version and limits.
    0x81 welcome Welcome [Greeting] Nothing 1 whole {
        magic: [u8; 8] = "The bytes `SpecialK`.",
        version: u16 = "The version that both will speak.",
        fragment_bytes: u32 = "The longest fragment payload, both ways.",
        message_bytes: u32 = "The longest message, both ways.",
        nonce: [u8; 32] = "Random bytes, new for each connection.",
    }
    /// The login succeeded.
    0x82 logged_in LoggedIn [Login] Nothing 1 whole {
        connection: u64 = "The connection's id; no two live connections share one.",
        user: String = "The account's name.",
        proof: [u8; 32] = "The hub's proof of the token, or `ServerSignature` of RFC 5802; zeros after `login_peer`.",
    }
    /// Asks whether the client is there; to be answered by `pong` with the same tag.
    0x83 ping Ping [Synchronous Flow] Nothing 1 whole {
    }
    /// Answers a `ping` of the client.
    0x84 pong Pong [Synchronous Flow] Nothing 1 whole {
    }
    /// Answers `login_scram`; the client must prove that it knows the password.
    0x85 scram_challenge ScramChallenge [Login] Nothing 1 whole {
        message: String = "The `server-first-message` of RFC 5802.",
    }
    /// The connection is a flow from here on, and every channel there is has been told.
    0x86 flow_begun FlowBegun [Synchronous] Nothing 1 whole {
        channels: u32 = "How many channels were told.",
        name: String = "The flow's full name, `user.name`.",
        session: [u8; 16] = "Its session: who sends it in a later `set_async` takes this flow's place.",
        resumed: u8 = "1: it took the place of the flow of that session, with its channels, subscriptions and current database.",
    }
    /// One channel of a list.
    0x87 channel_listed ChannelListed [Synchronous Flow] Nothing 1 whole {
        channel: ChannelRef = "Identifier and epoch.",
        kind: ChannelKind = "What it is for.",
        hash: u64 = "The hashID: the first 8 bytes of SHA-256 of the name, little-endian.",
        owner: u64 = "The connection that owns it; 0 is the hub.",
        name: String = "The full name, `user.name`.",
        properties: Properties = "The map that its owner gave.",
    }
    /// The end of a list.
    0x88 list_end ListEnd [Synchronous Flow] Nothing 1 whole {
        count: u32 = "How many entries were listed.",
    }
    /// The command with this tag succeeded.
    0x89 done Done [Synchronous Flow] Nothing 1 whole {
    }
    /// The command with this tag succeeded, and what it changed is on the hub's disk.
    0x8a saved Saved [Synchronous Flow] Nothing 1 whole {
    }
    /// Answers a question.
    0x8b flag Flag [Synchronous Flow] Nothing 1 whole {
        value: u8 = "1: yes; 0: no.",
    }
    /// Answers a question.
    0x8c value Value [Synchronous Flow] Nothing 1 whole {
        value: Value = "The answer.",
    }
    /// Answers `udp_open`.
    0x8d udp_opened UdpOpened [Flow] Nothing 1 whole {
        session: u64 = "What each datagram begins with.",
        key: [u8; 32] = "What its proof is keyed by.",
        port: u16 = "The hub's UDP port.",
    }
    /// A channel was created; goes to every flow.
    0x90 channel_added ChannelAdded [Synchronous Flow] Nothing 1 whole {
        channel: ChannelRef = "Identifier and epoch.",
        kind: ChannelKind = "What it is for.",
        hash: u64 = "The hashID: the first 8 bytes of SHA-256 of the name, little-endian.",
        owner: u64 = "The connection that owns it; 0 is the hub.",
        name: String = "The full name, `user.name`.",
        properties: Properties = "The map that its owner gave.",
    }
    /// A channel was removed; goes to every flow, and ends subscriptions to it and messages under way on it.
    0x91 channel_removed ChannelRemoved [Synchronous Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
    }
    /// The first subscriber came; goes to the owner.
    0x92 start_publishing StartPublishing [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
    }
    /// The last subscriber went; goes to the owner.
    0x93 stop_publishing StopPublishing [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
    }
    /// One fragment of a message on a channel that this flow subscribes to.
    0x94 data Data [Flow] Nothing 1 fragment {
        channel: ChannelRef = "The channel.",
        message: u32 = "The message's id; the same in all its fragments.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// Messages of a subscription were dropped; comes at most once a second for each reason.
    0x95 dropped Dropped [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
        reason: u8 = "Why; see the list of drop reasons.",
        total: u64 = "How many were dropped for this reason since the subscription began.",
    }
    /// Answers `subscribe`: from here on messages come.
    0x96 subscribed Subscribed [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
    }
    /// A subscription is over: answers `unsubscribe`, and comes with the tag 0 when the right to it was revoked. Nothing of the channel comes any more, and a message under way is void.
    0x97 unsubscribed Unsubscribed [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
    }
    /// A channel says something else about itself; goes to every flow.
    0x98 header_changed HeaderChanged [Synchronous Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
        properties: Properties = "The new map.",
    }
    /// A replica repeats its source from here on; goes to the replica's owner.
    0x99 attached Attached [Flow] Nothing 1 whole {
        replica: ChannelRef = "The channel that repeats.",
        source: ChannelRef = "The channel that is repeated.",
    }
    /// A replica repeats no more; goes to its owner, with the tag 0 when the source has gone or the right to it.
    0x9a detached Detached [Flow] Nothing 1 whole {
        replica: ChannelRef = "The channel that repeated.",
        source: ChannelRef = "The channel that was repeated.",
    }
    /// One fragment of the newest message of a channel; answers `poll`.
    0x9b latest Latest [Synchronous] Nothing 1 fragment {
        channel: ChannelRef = "The channel.",
        message: u32 = "The message's id; the same in all its fragments.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// How much the owner of a channel with `delivery: reliable` may publish; what goes beyond is dropped.
    0x9c credit Credit [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
        bytes: u64 = "Since the channel was created or its flow resumed, in all: of each fragment its payload and 64 bytes.",
    }
    /// A tick of a sync channel that this flow subscribes to.
    0x9d tick Tick [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
        sequence: u64 = "The source's number of the tick.",
    }
    /// How a target keeps up with a sync channel; goes to the target and to the source, at most once a second.
    0x9e tick_report TickReport [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
        target: u64 = "The connection of the target.",
        lag_ns: u64 = "From the hub's sending of a tick to its `tick_done`, the longest since the last report.",
        done: u64 = "Ticks done since the subscription began.",
        missed: u64 = "Ticks missed since the subscription began.",
        divisor: u8 = "Which ticks it gets now: every one, every second, every fourth.",
    }
    /// Another connection owns a channel: its flow came back and took its own place again. Goes to every flow.
    0x9f owner_changed OwnerChanged [Synchronous Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
        owner: u64 = "The connection that owns it now.",
    }
    /// One fragment of a request; goes to the owner of the service.
    0xa0 request Request [Flow] Nothing 1 fragment {
        channel: ChannelRef = "The service channel.",
        request: u64 = "The request's id at this hub, to be repeated in the answer.",
        asker: u64 = "The connection that asks.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// Nobody waits for the answer to a request any more; goes to the owner of the service.
    0xa1 request_over RequestOver [Flow] Nothing 1 whole {
        request: u64 = "Its id.",
    }
    /// One fragment of an answer; goes to who called, with the tag of the call.
    0xa2 reply Reply [Synchronous Flow] Nothing 1 fragment {
        more: u8 = "1: further answers follow; 0: this is the last.",
        payload: Payload = "The bytes of this fragment.",
    }
    /// Answers `blob_begin`.
    0xb0 blob_resume BlobResume [Flow] Nothing 1 whole {
        offset: u64 = "How much of this very file the hub has: send from here on.",
    }
    /// One entry of a directory.
    0xb1 blob_listed BlobListed [Synchronous Flow] Nothing 1 whole {
        name: String = "Its name.",
        directory: u8 = "1: a directory; 0: a file.",
        bytes: u64 = "The length of a file.",
    }
    /// Answers `blob_stat`.
    0xb2 blob_entry BlobEntry [Synchronous Flow] Nothing 1 whole {
        directory: u8 = "1: a directory; 0: a file.",
        bytes: u64 = "The length of a file.",
        checksum: u32 = "CRC-32 of a file.",
    }
    /// One fragment of a range of a file; answers `blob_read`.
    0xb3 blob_data BlobData [Synchronous Flow] Nothing 1 fragment {
        payload: Payload = "The bytes of this fragment.",
    }
    /// The current database of this connection is another one, or none.
    0xc0 database_selected DatabaseSelected [Synchronous Flow] Nothing 1 whole {
        database: String = "Its name; empty: none, because the last one was removed.",
    }
    /// One database of a list.
    0xc1 database_listed DatabaseListed [Synchronous Flow] Nothing 1 whole {
        database: String = "Its name.",
        durable: u8 = "1: every change goes to the disk.",
        variables: u32 = "How many variables it has.",
        bytes: u64 = "What they take.",
    }
    /// One key of a list.
    0xc2 key_listed KeyListed [Synchronous Flow] Nothing 1 whole {
        key: String = "The key.",
    }
    /// One variable of a list.
    0xc3 variable Variable [Synchronous Flow] Nothing 1 whole {
        key: String = "Its key.",
        value: Value = "Its value.",
    }
    /// A watched variable has this value. Changes that follow each other closely may come as the last of them.
    0xc4 changed Changed [Flow] Nothing 1 whole {
        sequence: u64 = "Grows with each change of the database.",
        key: String = "Its key.",
        value: Value = "Its value.",
    }
    /// A watched variable is gone.
    0xc5 deleted Deleted [Flow] Nothing 1 whole {
        sequence: u64 = "Grows with each change of the database.",
        key: String = "Its key.",
    }
    /// What a watch had to tell at its beginning was told.
    0xc6 watching Watching [Flow] Nothing 1 whole {
        sequence: u64 = "That of the database's last change.",
        whole: u8 = "1: every variable there is was told, and others known from before are gone; 0: only what changed.",
    }
    /// A watch is over, because its database is gone or the right to it.
    0xc7 watch_over WatchOver [Flow] Nothing 1 whole {
    }
    /// One account of a list.
    0xe0 user_listed UserListed [Synchronous Flow] Nothing 1 whole {
        user: String = "Its name.",
        connections: u32 = "How many connections are logged in to it.",
    }
    /// The command with this tag was refused and changed nothing.
    0xf0 refused Refused [Synchronous Flow] Nothing 1 whole {
        code: u16 = "Why; see the list of refusal codes.",
        text: String = "The same for people.",
    }
    /// The hub ends the connection. This is the last frame.
    0xf1 closing Closing [Greeting Login Synchronous Flow] Nothing 1 whole {
        reason: u16 = "Why; see the list of closing reasons.",
        text: String = "The same for people.",
    }
}
