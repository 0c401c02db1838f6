//! Lists: answers of many lines, of which the next is made when there is room for it. Later commands of the
//! connection wait for the end.

use super::super::blobs::desk::Listing;
use super::super::databases::watches::{Next, sendable};
use super::super::{ConnectionId, Notice, ServerCore};
use crate::flow::database::{DatabaseName, Line};
use crate::flow::definition::Encoded;
use crate::flow::{Event, Flags, Form, Message, Value};
use sk_flat::{Name, SkVariant};
use std::collections::VecDeque;
use std::sync::Arc;

/// How many channels, databases or changes are gone through for one connection before others have their turn: those
/// that are none of its business take time too.
const LOOKS_PER_TURN_MAX: usize = 1_024;

/// What a list is of, and how far it has been told.
#[derive(Clone, Debug)]
pub(in super::super) enum Telling {
    /// Channels.
    Channels {
        /// Whether it is the beginning of a flow.
        begins_flow: bool,
        /// The lowest identifier that has not been told.
        next: u16,
    },
    /// Accounts.
    Accounts {
        /// The last one that was told.
        after: Option<Name>,
    },
    /// Databases.
    Databases {
        prefix: String,
        /// The last one that was told.
        after: Option<DatabaseName>,
    },
    /// Variables of a database, or their keys.
    Variables {
        database: DatabaseName,
        prefix: String,
        /// The last one that was told.
        after: Option<Arc<str>>,
        /// Those that the hub makes up, as they were when the list began.
        computed: VecDeque<(&'static str, SkVariant)>,
        /// Whether the values are told.
        values: bool,
    },
    /// What stands in a folder of a blob channel.
    Blobs(Listing),
}

/// An answer of many lines while it is being given: to `list_channels`, `set_async`, `db_all` and such.
#[derive(Clone, Debug)]
pub(in super::super) struct Replay {
    pub(in super::super) tag: u32,
    /// The form of the values.
    pub(in super::super) form: Form,
    pub(in super::super) told: u32,
    pub(in super::super) what: Telling,
}

impl Telling {
    /// Whether the next line is not known yet.
    pub(in super::super) fn waits(&self) -> bool {
        matches!(self, Telling::Blobs(listing) if listing.waits())
    }
}

impl ServerCore {
    pub(in super::super) fn tell_list(&mut self, id: ConnectionId, tag: u32, form: Form, what: Telling) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.replay = Some(Replay { tag, form, told: 0, what });
        self.mark_dirty(id);
    }

    /// Adds lines to a list that is being told, or news of watches, and moves frames to the wire.
    pub(in super::super) fn fill(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.output.fill();
        let mut looks = LOOKS_PER_TURN_MAX;
        while let Some(connection) = self.connections.get(id)
            && connection.closing.is_none()
            && connection.output.has_room_for_list()
            && let Some(frame) = self.next_line(id, &mut looks)
            && let Some(connection) = self.connections.get_mut(id)
        {
            // A list pauses long before the limit of the control queue.
            connection.output.control(frame);
            connection.output.fill();
        }
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.fill_latest();
        if connection.output.paused && connection.replay.is_none() {
            self.tell_inherited(id);
        }
    }

    fn next_line(&mut self, id: ConnectionId, looks: &mut usize) -> Option<Encoded> {
        let Some(mut replay) = self.connections.get_mut(id)?.replay.take() else {
            return self.next_news(id, looks);
        };
        if replay.what.waits() {
            self.connections.get_mut(id)?.replay = Some(replay);
            self.go_on_listing(id);
            return None;
        }
        let line = self.line(id, &mut replay, looks);
        let connection = self.connections.get_mut(id)?;
        match line {
            Next::Now(line) => {
                replay.told += 1;
                connection.replay = Some(replay);
                return Some(line);
            }
            Next::Later => {
                connection.replay = Some(replay);
                self.enqueue(id);
                return None;
            }
            Next::Nothing => {}
        }
        let count = replay.told;
        if !matches!(replay.what, Telling::Channels { begins_flow: true, .. }) {
            return Some(Event::ListEnd { count }.encode(replay.tag, Flags::NONE));
        }
        let name = connection.flow.as_ref().map(Name::to_string).unwrap_or_default();
        self.notices.push_back(Notice::FlowBegun { connection: id });
        let (session, resumed) = (connection.session, connection.resumed.into());
        let begun = Event::FlowBegun { channels: count, name, session, resumed };
        Some(begun.encode(replay.tag, Flags::NONE))
    }

    fn line(&self, id: ConnectionId, replay: &mut Replay, looks: &mut usize) -> Next<Encoded> {
        let (tag, form) = (replay.tag, replay.form);
        while *looks > 0 {
            *looks -= 1;
            match &mut replay.what {
                Telling::Channels { begins_flow, next } => {
                    let Some((channel, _)) = self.channels.from_id(*next) else { return Next::Nothing };
                    *next = channel.reference.id as u16 + 1;
                    if self.connections.get(id).is_some_and(|found| found.rights.sees(id, channel)) {
                        return Next::Now(match *begins_flow {
                            true => channel.added(0, form),
                            false => channel.listed(tag, form),
                        });
                    }
                }
                Telling::Databases { prefix, after } => {
                    let Some(line) = self.databases.next(prefix, after.as_ref()) else {
                        return Next::Nothing;
                    };
                    *after = Some(line.name.clone());
                    if self.may_see(id, &line.name) {
                        return Next::Now(database_line(tag, &line));
                    }
                }
                told => return self.line_at_once(id, tag, form, told).map_or(Next::Nothing, Next::Now),
            }
        }
        Next::Later
    }

    /// The next line of a list of which every entry is told.
    fn line_at_once(&self, id: ConnectionId, tag: u32, form: Form, what: &mut Telling) -> Option<Encoded> {
        match what {
            Telling::Channels { .. } | Telling::Databases { .. } => None,
            Telling::Blobs(listing) => listing.line(tag),
            Telling::Accounts { after } => self.account_line(tag, after),
            // The right to read it may have been revoked since the list began.
            Telling::Variables { database, .. } if !self.may_read(id, database) => None,
            Telling::Variables { database, prefix, after, computed, values } => {
                let open = self.databases.open(database);
                let stored = open.and_then(|open| open.pairs.iter(prefix, after.as_deref()).next());
                let first = computed.front().map(|(key, _)| *key);
                let (key, value) = match (stored, first) {
                    (Some((key, value)), first) if first.is_none_or(|first| **key < *first) => {
                        *after = Some(key.clone());
                        (key.to_string(), value.clone())
                    }
                    (_, Some(_)) => {
                        let (key, variant) = computed.pop_front()?;
                        (key.to_owned(), Value::new(&variant).ok()?)
                    }
                    _ => return None,
                };
                let event = if *values {
                    Event::Variable { key, value: sendable(&value, form) }
                } else {
                    Event::KeyListed { key }
                };
                Some(event.encode(tag, Flags::NONE))
            }
        }
    }
}

fn database_line(tag: u32, line: &Line) -> Encoded {
    let event = Event::DatabaseListed {
        database: line.name.to_string(),
        durable: line.durable.into(),
        variables: line.keys as u32,
        bytes: line.bytes as u64,
    };
    event.encode(tag, Flags::NONE)
}
