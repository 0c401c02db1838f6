//! How a command is refused, and in which words.

use super::super::error::RefusalCode;
use super::super::{Event, Flags, Message as _};
use super::{ConnectionId, ServerCore};
use crate::testing::{Bug, is_planted};

impl ServerCore {
    pub(super) fn refuse(&mut self, id: ConnectionId, tag: u32, code: RefusalCode) {
        assert!(!is_planted(Bug::PanicAtRefusal), "a bug was planted here");
        let text = words(code, self.asked);
        self.send(id, Event::Refused { code: code.code(), text }.encode(tag, Flags::NONE));
    }
}

/// What a code means for the command that is carried out, by its name in the table. Some codes are about several
/// things, and who reads of one wants to know which.
fn words(code: RefusalCode, command: Option<&'static str>) -> String {
    let said = match (code, command) {
        (RefusalCode::Exists, Some("set_async")) => "A flow of this name exists.",
        (RefusalCode::Exists, Some("db_create")) => "A database of this name exists.",
        (RefusalCode::Exists, Some("watch")) => "This flow has a watch with this tag.",
        (RefusalCode::Exists, Some(_)) => "A channel of this name exists.",
        (RefusalCode::Gone, Some("inspect")) => "There is no channel of this name.",
        (RefusalCode::TooLong, Some("var_get" | "inspect")) => {
            "The value is too long as JSON: ask for it as a variant."
        }
        (RefusalCode::TooLong, Some("call")) => "The request is longer than the owner of the service takes.",
        (RefusalCode::BadName, Some("set_async")) => {
            "The flow's name has characters other than `a-z 0-9 _ . -`, or is too long with its user."
        }
        (RefusalCode::BadName, Some(command)) if command.starts_with("db_") => {
            "This cannot be the name of such a database."
        }
        (RefusalCode::Full, Some("publish" | "call" | "blob_write")) => {
            "The unfinished messages of this connection, or of all, hold as many bytes as they may."
        }
        _ => return code.to_string(),
    };
    said.to_owned()
}
