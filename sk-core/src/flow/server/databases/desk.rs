//! What a connection has to do with databases.

use super::super::super::Command;
use super::super::super::database::DatabaseName;
use super::super::super::definition::Tagged;
use super::super::super::limits::{UNSAVED_BYTES_PER_FLOW_MAX, UNSAVED_PER_FLOW_MAX};
use super::watches::Watch;
use std::collections::VecDeque;

/// A connection's own state with the databases.
#[derive(Debug, Default)]
pub(in super::super) struct Desk {
    /// The current database.
    pub(in super::super) selected: Option<DatabaseName>,
    pub(super) watches: Vec<Watch>,
    /// The tags of watches that have something to tell, in turn.
    pub(super) news: VecDeque<u32>,
    /// The request whose answer this connection's commands wait for.
    awaited: Option<u64>,
    /// The command that is to be looked at again then.
    again: Option<Box<Tagged<Command>>>,
    /// How many changes of this flow wait for the disk, and what they hold meanwhile.
    pub(super) unsaved: usize,
    pub(super) unsaved_bytes: usize,
}

impl Desk {
    /// Whether the connection's commands must wait.
    pub(in super::super) fn is_held(&self) -> bool {
        self.awaited.is_some()
            || self.unsaved >= UNSAVED_PER_FLOW_MAX
            || self.unsaved_bytes >= UNSAVED_BYTES_PER_FLOW_MAX
    }

    pub(in super::super) fn has_news(&self) -> bool {
        !self.news.is_empty()
    }

    /// The command that waited, now that it need not any more.
    pub(in super::super) fn take_again(&mut self) -> Option<Tagged<Command>> {
        self.again.take().map(|again| *again)
    }

    pub(in super::super) fn has_again(&self) -> bool {
        self.again.is_some()
    }

    pub(super) fn wait_for(&mut self, request: u64, again: Tagged<Command>) {
        self.awaited = Some(request);
        self.again = Some(Box::new(again));
    }

    /// The answers of a synchronous connection come in the order of its commands, so they wait for this one.
    pub(in super::super) fn answers_wait_for(&mut self, request: u64) {
        self.awaited = Some(request);
    }

    /// Notes that a request was answered; tells whether this connection waited for it.
    pub(super) fn answered(&mut self, request: u64) -> bool {
        let waited = self.awaited == Some(request);
        if waited {
            self.awaited = None;
        }
        waited
    }

    pub(super) fn watch_mut(&mut self, tag: u32) -> Option<&mut Watch> {
        self.watches.iter_mut().find(|watch| watch.tag == tag)
    }

    pub(super) fn forget_watch(&mut self, tag: u32) -> Option<Watch> {
        let at = self.watches.iter().position(|watch| watch.tag == tag)?;
        self.news.retain(|waiting| *waiting != tag);
        Some(self.watches.swap_remove(at))
    }

    /// Forgets everything; answers the databases that were watched, with the tags.
    pub(super) fn end(&mut self) -> Vec<(DatabaseName, u32)> {
        let desk = std::mem::take(self);
        desk.watches.into_iter().map(|watch| (watch.database, watch.tag)).collect()
    }
}
