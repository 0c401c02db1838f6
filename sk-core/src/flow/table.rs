//! The command table: every command and event stands here once.
//!
//! A line says: id, name, variant, the states in which it is legal, the right it needs, its cost, whether
//! it is whole or a fragment, and the fields of its body after the tag. The enums, the decoder, the
//! encoder, the check of state and right, the tables of the protocol's page, the golden vectors and the
//! fuzz dictionary are made from it. What does not stand here is malformed.

use super::codec::{ChannelRef, Payload, Reader, Wire};
use super::definition::{Definition, Direction, Encoded, Field, Message, Right, States, Tagged, flow_table};
use super::error::ProtocolError;
use super::frame::{Flags, Header};
use super::limits::BODY_BYTES_MAX_BEFORE_LOGIN;
use super::properties::Properties;
use super::state::State;
use bytes::Bytes;

flow_table! {
    /// What a client sends to its hub.
    Command: ClientToHub

    /// The first frame of a client: which versions it speaks and what it can take.
    0x01 hello Hello [Greeting] Nothing 1 whole {
        magic: [u8; 8] = "The bytes `SpecialK`.",
        version: u16 = "The newest version that the client speaks.",
        version_oldest: u16 = "The oldest version that the client speaks.",
        fragment_bytes: u32 = "The longest fragment payload that the client takes, at least 256.",
        message_bytes: u32 = "The longest message that the client takes, at least `fragment_bytes`.",
        nonce: [u8; 32] = "Random bytes, new for each connection.",
    }
    /// Logs in to the owner's account by proof of the owner's token; answered by `logged_in`, or `closing`.
    0x02 login_token LoginToken [Login] Nothing 16 whole {
        proof: [u8; 32] = "HMAC-SHA-256 over both nonces, keyed by the token.",
    }
    /// Logs in to the owner's account by the user id that the kernel tells of the other end of a Unix socket.
    0x03 login_peer LoginPeer [Login] Nothing 16 whole {
    }
    /// Asks whether the hub is there; answered by `pong` with the same tag.
    0x04 ping Ping [Synchronous Flow] Nothing 1 whole {
    }
    /// Answers a `ping` of the hub, with its tag.
    0x05 pong Pong [Synchronous Flow] Nothing 1 whole {
    }
    /// Turns the connection into a flow; answered by a `channel_added` for each channel there is, then `flow_begun`.
    0x06 set_async SetAsync [Synchronous] Nothing 64 whole {
    }
    /// Lists the channels; answered by a `channel_listed` for each, then `list_end`.
    0x07 list_channels ListChannels [Synchronous] List 64 whole {
    }
    /// Creates a streaming channel owned by this flow; all hear `channel_added`, this flow with the tag.
    0x10 create_stream CreateStream [Flow] Publish 16 whole {
        name: String = "The name without its user, of `a-z 0-9 _ . -`. The channel is called `user.name`.",
        properties: Properties = "A map that says what flows: `mime`, `format`, `unit`, `rate`, and whatever is useful.",
    }
    /// Removes a channel that this flow owns; all hear `channel_removed`, this flow with the tag.
    0x11 remove_channel RemoveChannel [Flow] Publish 16 whole {
        channel: ChannelRef = "The channel.",
    }
    /// Subscribes to a streaming channel; answered by `subscribed`. Twice is as good as once.
    0x12 subscribe Subscribe [Flow] Subscribe 4 whole {
        channel: ChannelRef = "The channel.",
        depth: u16 = "How many whole messages wait at most before the oldest is dropped; 0 means 64; at most 1,024.",
    }
    /// Ends a subscription; answered by `unsubscribed`. It may be sent where there is none.
    0x13 unsubscribe Unsubscribe [Flow] Subscribe 4 whole {
        channel: ChannelRef = "The channel.",
    }
    /// One fragment of a message on a channel that this flow owns; not answered unless it is refused.
    0x14 publish Publish [Flow] Publish 1 fragment {
        channel: ChannelRef = "The channel.",
        message: u32 = "The message's id, chosen by the publisher; the same in all its fragments.",
        payload: Payload = "The bytes of this fragment.",
    }
}

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
        proof: [u8; 32] = "The hub's proof of the token; zeros after `login_peer`.",
    }
    /// Asks whether the client is there; to be answered by `pong` with the same tag.
    0x83 ping Ping [Synchronous Flow] Nothing 1 whole {
    }
    /// Answers a `ping` of the client.
    0x84 pong Pong [Synchronous Flow] Nothing 1 whole {
    }
    /// The connection is a flow from here on, and every channel there is has been told.
    0x86 flow_begun FlowBegun [Synchronous] Nothing 1 whole {
        channels: u32 = "How many channels were told.",
    }
    /// One channel of a list.
    0x87 channel_listed ChannelListed [Synchronous] Nothing 1 whole {
        channel: ChannelRef = "Identifier and epoch.",
        hash: u64 = "The hashID: the first 8 bytes of SHA-256 of the name, little-endian.",
        owner: u64 = "The connection that owns it; 0 is the hub.",
        name: String = "The full name, `user.name`.",
        properties: Properties = "The map that its owner gave.",
    }
    /// The end of a list.
    0x88 list_end ListEnd [Synchronous] Nothing 1 whole {
        channels: u32 = "How many channels were listed.",
    }
    /// A streaming channel was created; goes to every flow.
    0x90 channel_added ChannelAdded [Synchronous Flow] Nothing 1 whole {
        channel: ChannelRef = "Identifier and epoch.",
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
    /// Answers `unsubscribe`: nothing of this channel comes any more, and a message under way is void.
    0x97 unsubscribed Unsubscribed [Flow] Nothing 1 whole {
        channel: ChannelRef = "The channel.",
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

/// What is legal before login must fit under the cap that holds there, or it could never be sent.
const _: () = {
    let tables = [Command::TABLE, Event::TABLE];
    let mut table = 0;
    while table < tables.len() {
        let mut line = 0;
        while line < tables[table].len() {
            let definition = &tables[table][line];
            let early = definition.states.has(State::Greeting) || definition.states.has(State::Login);
            assert!(!early || definition.bytes_max() <= BODY_BYTES_MAX_BEFORE_LOGIN);
            line += 1;
        }
        table += 1;
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_found_by_its_id_and_nothing_else_is() {
        for table in [Command::TABLE, Event::TABLE] {
            assert!(table.is_sorted_by_key(|line| line.id));
        }
        let commands = (0..=255).filter_map(Command::find).collect::<Vec<_>>();
        assert_eq!(commands, Command::TABLE.iter().collect::<Vec<_>>());
        let events = (0..=255).filter_map(Event::find).collect::<Vec<_>>();
        assert_eq!(events, Event::TABLE.iter().collect::<Vec<_>>());
        assert!((0..=255).all(|kind| Command::find(kind).is_none() || Event::find(kind).is_none()));
    }

    #[test]
    fn a_payload_is_the_last_field_and_only_fragments_have_one() {
        for line in Command::TABLE.iter().chain(Event::TABLE) {
            let payloads = line.fields.iter().filter(|field| field.wire == Payload::NAME).count();
            assert_eq!(payloads, usize::from(line.fragment), "{}", line.name);
            assert_eq!(line.fragment, line.fields.last().is_some_and(|field| field.wire == Payload::NAME));
        }
    }

    #[test]
    fn commands_before_login_need_no_right_and_others_of_effect_need_one() {
        for line in Command::TABLE {
            let early = line.states.has(State::Greeting) || line.states.has(State::Login);
            let own = ["ping", "pong", "set_async"].contains(&line.name);
            assert_eq!(line.right == Right::Nothing, early || own, "{}", line.name);
        }
    }

    #[test]
    fn a_frame_is_decoded_to_what_was_encoded() {
        let channel = ChannelRef { id: 7, epoch: 3 };
        let command = Command::Publish { channel, message: 9, payload: Bytes::from_static(b"pulse") };
        let encoded = command.encode(5, Flags::WHOLE);
        let header = Header::parse(&encoded.head).expect("a header");
        assert_eq!(header.length as usize, encoded.len() - 6);
        let body = Bytes::from(encoded.to_vec()).slice(6..);
        let whole = Command::decode(header, body, Bytes::new());
        let parts = Command::decode(header, encoded.head.slice(6..), encoded.payload.clone());
        assert_eq!(whole, parts);
        assert_eq!(whole, Ok(Tagged { tag: 5, flags: Flags::WHOLE, message: command }));
    }

    #[test]
    fn bytes_after_the_last_field_are_malformed() {
        let mut bytes = Command::Ping {}.encode(1, Flags::NONE).to_vec();
        bytes.push(0);
        let header = Header { kind: 0x04, flags: 0, length: 5 };
        let found = Command::decode(header, Bytes::from(bytes).slice(6..), Bytes::new());
        assert!(matches!(found, Err(ProtocolError::Malformed { kind: "ping", .. })), "{found:?}");
    }
}
