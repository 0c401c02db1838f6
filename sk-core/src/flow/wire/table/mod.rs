//! The command table: every command and event stands here once.
//!
//! A line says: id, name, variant, the states in which it is legal, the right it needs, its cost, whether
//! it is whole or a fragment, and the fields of its body after the tag. The enums, the decoder, the
//! encoder, the check of state and right, the tables of the protocol's page, the golden vectors and the
//! fuzz dictionary are made from it. What does not stand here is malformed.

mod commands;
pub mod definition;
mod events;
pub mod samples;

pub use commands::Command;
pub use events::Event;

use super::super::limits::BODY_BYTES_MAX_BEFORE_LOGIN;
use super::codec::ChannelRef;
use super::state::State;
use definition::Message;

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
    use super::super::codec::{ChannelRef, Payload, Wire};
    use super::super::error::ProtocolError;
    use super::super::frame::{Flags, Header};
    use super::definition::{Right, Tagged};
    use super::*;
    use bytes::Bytes;

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
        // These serve the connection itself, or are for the owner of what they name, whom the hub knows.
        let own = [
            "ping",
            "pong",
            "set_async",
            "remove_channel",
            "change_header",
            "detach",
            "db_select",
            "user_set",
        ];
        for line in Command::TABLE {
            let early = line.states.has(State::Greeting) || line.states.has(State::Login);
            assert_eq!(line.right == Right::Nothing, early || own.contains(&line.name), "{}", line.name);
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
