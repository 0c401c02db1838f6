//! A satellite's commands to databases, and lists that come in many lines.

use super::super::blob::BlobEntry;
use super::super::{Command, Event, Message, Value};
use super::{AccountInfo, SatelliteCore, SatelliteError, SatelliteEvent};

/// One database of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DatabaseInfo {
    /// Its name.
    pub name: String,
    /// Whether every change goes to the disk.
    pub durable: bool,
    /// How many variables it has.
    pub variables: u32,
    /// The bytes of its keys and values.
    pub bytes: u64,
}

/// A list of something else than channels, while it comes in.
#[derive(Debug)]
pub(super) enum List {
    Accounts(Vec<AccountInfo>),
    Databases(Vec<DatabaseInfo>),
    Keys(Vec<String>),
    Variables(Vec<(String, Value)>),
    Blobs(Vec<BlobEntry>),
}

/// The lines of the table that are about databases.
const DATABASE_COMMANDS: std::ops::RangeInclusive<u8> = 0x40..=0x4e;

impl SatelliteCore {
    /// Sends a command of the databases: `Db…`, `Var…`, `Watch` or `Unwatch`. What answers has its tag.
    ///
    /// # Errors
    /// If it is another command, the connection is not ready or not of the kind that has it, or too much waits.
    pub fn database(&mut self, command: &Command) -> Result<u32, SatelliteError> {
        let line = command.definition();
        let legal = line.states.has(self.inbound.state()) && DATABASE_COMMANDS.contains(&line.id);
        if !legal || !self.is_ready() {
            return Err(SatelliteError::State(line.name));
        }
        let tag = self.command(command)?;
        let list = match command {
            Command::DbList { .. } => List::Databases(Vec::new()),
            Command::DbKeys { .. } => List::Keys(Vec::new()),
            Command::DbAll { .. } => List::Variables(Vec::new()),
            _ => return Ok(tag),
        };
        self.lists.insert(tag, list);
        Ok(tag)
    }

    /// The full name of this flow, once it is one: `user.name`. Its database is `flow:` and that.
    pub fn flow_name(&self) -> Option<&str> {
        self.flow_full_name.as_deref()
    }

    pub(super) fn on_database_event(&mut self, tag: u32, event: Event) {
        let told = match event {
            Event::DatabaseSelected { database } => {
                let database = Some(database).filter(|name| !name.is_empty());
                SatelliteEvent::DatabaseSelected { tag, database }
            }
            Event::Changed { sequence, key, value } => {
                SatelliteEvent::Changed { tag, sequence, key, value: Some(value) }
            }
            Event::Deleted { sequence, key } => SatelliteEvent::Changed { tag, sequence, key, value: None },
            Event::Watching { sequence, whole } => {
                SatelliteEvent::Watching { tag, sequence, whole: whole != 0 }
            }
            Event::WatchOver {} => SatelliteEvent::WatchOver { tag },
            line => return self.on_line(tag, line),
        };
        self.events.push_back(told);
    }

    fn on_line(&mut self, tag: u32, line: Event) {
        match (self.lists.get_mut(&tag), line) {
            (
                Some(List::Databases(list)),
                Event::DatabaseListed { database: name, durable, variables, bytes },
            ) => list.push(DatabaseInfo { name, durable: durable != 0, variables, bytes }),
            (Some(List::Accounts(list)), Event::UserListed { user: name, connections }) => {
                list.push(AccountInfo { name, connections });
            }
            (Some(List::Keys(list)), Event::KeyListed { key }) => list.push(key),
            (Some(List::Variables(list)), Event::Variable { key, value }) => list.push((key, value)),
            // A line of a list that nobody asked for.
            _ => {}
        }
    }

    /// The end of a list of this kind; `false` if it was none.
    pub(super) fn end_list(&mut self, tag: u32) -> bool {
        let Some(list) = self.lists.remove(&tag) else { return false };
        self.events.push_back(match list {
            List::Accounts(accounts) => SatelliteEvent::Accounts { tag, accounts },
            List::Databases(databases) => SatelliteEvent::Databases { tag, databases },
            List::Keys(keys) => SatelliteEvent::Keys { tag, keys },
            List::Blobs(entries) => SatelliteEvent::BlobEntries { tag, entries },
            List::Variables(variables) => SatelliteEvent::Variables { tag, variables },
        });
        true
    }
}
