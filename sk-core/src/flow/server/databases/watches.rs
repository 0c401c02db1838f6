//! Watches: what there is, then what changes. A watch remembers a number and no more; the database knows what
//! changed after it. So a watcher that reads slowly hears of each variable's newest value, and costs nothing.

use super::super::super::database::{DatabaseName, PairDatabase, Watcher};
use super::super::super::definition::Encoded;
use super::super::super::error::RefusalCode;
use super::super::super::limits::WATCHES_PER_FLOW_MAX;
use super::super::super::{Event, Flags, Form, Message, Value};
use super::super::{ConnectionId, ServerCore};
use super::access::Access;
use crate::testing::{Bug, is_planted};
use std::sync::Arc;

/// What there is to be told next.
pub(in super::super) enum Next<T> {
    /// This.
    Now(T),
    /// It will be found out in another turn.
    Later,
    /// Nothing.
    Nothing,
}

/// One watch of a flow.
#[derive(Debug)]
pub(in super::super) struct Watch {
    pub(super) tag: u32,
    pub(super) database: DatabaseName,
    prefix: Box<str>,
    form: Form,
    /// Everything up to this number was told.
    cursor: u64,
    stage: Stage,
    /// Whether it is in the list of those with something to tell.
    pub(super) in_turn: bool,
}

#[derive(Debug)]
enum Stage {
    /// All variables are being told, from the one behind `after` on, as of this number.
    All { after: Option<Arc<str>>, until: u64 },
    /// What changed since an earlier watch is being told, up to this number.
    Missed { until: u64 },
    /// Everything was told; changes come as they happen.
    Following,
}

impl ServerCore {
    pub(super) fn watch(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
        prefix: String,
        after: u64,
        form: Form,
    ) -> Result<(), RefusalCode> {
        if !self.may(id, name, Access::Read) {
            return Err(RefusalCode::Denied);
        }
        let connection = self.connections.get_mut(id).ok_or(RefusalCode::Denied)?;
        if connection.desk.watch_mut(tag).is_some() {
            return Err(RefusalCode::Exists);
        }
        if connection.desk.watches.len() >= WATCHES_PER_FLOW_MAX {
            return Err(RefusalCode::TooManyWatches);
        }
        let open = self.databases.open_mut(name)?;
        open.watchers.push(Watcher { connection: id.wire(), tag });
        let until = open.pairs.sequence();
        let stage = if after == 0 { Stage::All { after: None, until } } else { Stage::Missed { until } };
        let (database, prefix) = (name.clone(), prefix.into());
        connection.desk.watches.push(Watch {
            tag,
            database,
            prefix,
            form,
            cursor: after,
            stage,
            in_turn: true,
        });
        connection.desk.news.push_back(tag);
        self.mark_dirty(id);
        Ok(())
    }

    pub(super) fn unwatch(&mut self, id: ConnectionId, tag: u32, watch: u32) {
        self.end_watch(id, watch);
        self.answer(id, tag, &Event::Done {});
    }

    fn end_watch(&mut self, id: ConnectionId, watch: u32) -> bool {
        let Some(connection) = self.connections.get_mut(id) else { return false };
        let Some(ended) = connection.desk.forget_watch(watch) else { return false };
        self.drop_watcher(&ended.database, Watcher { connection: id.wire(), tag: watch });
        true
    }

    pub(super) fn drop_watcher(&mut self, name: &DatabaseName, watcher: Watcher) {
        if let Ok(open) = self.databases.open_mut(name) {
            open.watchers.retain(|other| *other != watcher);
        }
    }

    /// Ends the watches that a connection has no right to any more.
    pub(in super::super) fn recheck_watches(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get(id) else { return };
        let watches: Vec<(DatabaseName, u32)> = connection
            .desk
            .watches
            .iter()
            .map(|watch| (watch.database.clone(), watch.tag))
            .collect();
        for (name, tag) in watches {
            if !self.may(id, &name, Access::Read) && self.end_watch(id, tag) {
                self.answer(id, tag, &Event::WatchOver {});
            }
        }
    }

    /// A variable changed: those who watch it have something to tell.
    pub(super) fn tell_watchers(&mut self, name: &DatabaseName, key: &str) {
        let Some(open) = self.databases.open(name) else { return };
        let (connections, dirty) = (&mut self.connections, &mut self.dirty);
        for watcher in &open.watchers {
            let id = ConnectionId::from_wire(watcher.connection);
            let Some(connection) = connections.get_mut(id) else { continue };
            let desk = &mut connection.desk;
            let Some(watch) = desk.watches.iter_mut().find(|watch| watch.tag == watcher.tag) else {
                continue;
            };
            if watch.in_turn || !key.starts_with(&*watch.prefix) {
                continue;
            }
            watch.in_turn = true;
            desk.news.push_back(watcher.tag);
            if !connection.dirty {
                connection.dirty = true;
                dirty.push(id);
            }
        }
    }

    /// Many variables may have changed.
    pub(super) fn tell_all_watchers(&mut self, name: &DatabaseName) {
        let Some(open) = self.databases.open(name) else { return };
        for watcher in open.watchers.clone() {
            let id = ConnectionId::from_wire(watcher.connection);
            let Some(connection) = self.connections.get_mut(id) else { continue };
            let Some(watch) = connection.desk.watch_mut(watcher.tag) else { continue };
            if !std::mem::replace(&mut watch.in_turn, true) {
                connection.desk.news.push_back(watcher.tag);
            }
            self.mark_dirty(id);
        }
    }

    /// The next frame of this connection's watches, one of each in turn. So many changes are gone through at most;
    /// then others have their turn.
    pub(in super::super) fn next_news(&mut self, id: ConnectionId, looks: &mut usize) -> Option<Encoded> {
        let desk = &mut self.connections.get_mut(id)?.desk;
        while let Some(tag) = desk.news.pop_front() {
            let Some(watch) = desk.watches.iter_mut().find(|watch| watch.tag == tag) else { continue };
            let open = self.databases.open(&watch.database);
            match open.map_or(Next::Nothing, |open| watch.next(&open.pairs, looks)) {
                Next::Nothing => watch.in_turn = false,
                Next::Now(event) => {
                    desk.news.push_back(tag);
                    return Some(event.encode(tag, Flags::NONE));
                }
                Next::Later => {
                    desk.news.push_back(tag);
                    self.enqueue(id);
                    return None;
                }
            }
        }
        None
    }
}

impl Watch {
    /// What is to be told next, if anything.
    fn next(&mut self, pairs: &PairDatabase, looks: &mut usize) -> Next<Event> {
        if let Stage::All { after, until } = &mut self.stage {
            if let Some((key, value)) = pairs.iter(&self.prefix, after.as_deref()).next() {
                let sequence = pairs.changed(key).unwrap_or(*until);
                *after = Some(key.clone());
                let (key, value) = (key.to_string(), sendable(value, self.form));
                return Next::Now(Event::Changed { sequence, key, value });
            }
            self.cursor = *until;
            self.stage = Stage::Following;
            return Next::Now(Event::Watching { sequence: self.cursor, whole: 1 });
        }
        if !pairs.knows_since(self.cursor) {
            // So much was deleted that it is not known any more what, or the number is of another run. All that there is follows, so that the
            // watcher finds out what is gone; with 0 he knows nothing that he could go on from until then.
            self.stage = Stage::All { after: None, until: pairs.sequence() };
            return Next::Now(Event::Watching { sequence: 0, whole: 0 });
        }
        while let Some(change) = pairs.change_after(self.cursor) {
            if let Stage::Missed { until } = self.stage
                && change.sequence > until
            {
                return Next::Now(self.caught_up(until));
            }
            if *looks == 0 {
                return Next::Later;
            }
            *looks -= 1;
            self.cursor = change.sequence;
            let forgotten = is_planted(Bug::WatchForgotten) && change.sequence.is_multiple_of(4);
            if forgotten || !change.key.starts_with(&*self.prefix) {
                continue;
            }
            let (sequence, key) = (change.sequence, change.key.to_owned());
            return Next::Now(match change.value {
                Some(value) => Event::Changed { sequence, key, value: sendable(value, self.form) },
                None => Event::Deleted { sequence, key },
            });
        }
        match self.stage {
            Stage::Missed { until } => Next::Now(self.caught_up(until)),
            Stage::All { .. } | Stage::Following => Next::Nothing,
        }
    }

    fn caught_up(&mut self, until: u64) -> Event {
        self.stage = Stage::Following;
        Event::Watching { sequence: until, whole: 0 }
    }
}

/// A value in the form that was asked for, or as a variant if it is too long as JSON: it says which it is.
pub(in super::super) fn sendable(value: &Value, form: Form) -> Value {
    let value = value.clone().in_form(form);
    if form == Form::Json && value.wire_bytes().is_err() { value.in_form(Form::Binary) } else { value }
}
