//! What waits for the disk, and who waits for its answers.

use super::super::super::Event;
use super::super::super::database::{
    DatabaseName, Saved, StoreAnswer, StoreFailure, StoreRequest, StoreWork, Stored,
};
use super::super::super::error::RefusalCode;
use super::super::super::limits::{ITEM_OVERHEAD_BYTES, LOADING_BYTES_MAX};
use super::super::{ConnectionId, ServerCore};
use rustc_hash::FxHashMap;
use sk_flat::Instant;
use std::collections::VecDeque;

/// The hub's half of its store: requests on their way out, and what their answers are for.
#[derive(Debug, Default)]
pub(in super::super) struct Storing {
    on: bool,
    last: u64,
    requests: VecDeque<StoreRequest>,
    waiting: FxHashMap<u64, Waiting>,
    /// What is on its way from the disk.
    loading: usize,
}

#[derive(Debug)]
struct Waiting {
    database: DatabaseName,
    purpose: Purpose,
    /// What the request holds, or its answer will.
    bytes: usize,
    /// It was handed out, and brings that from the disk.
    is_loading: bool,
}

/// What an answer is for.
#[derive(Clone, Copy, Debug)]
pub(in super::super) enum Purpose {
    /// Commands wait for these contents.
    Summon,
    /// `db_load` of a database that is in memory.
    Reload { connection: ConnectionId, tag: u32 },
    /// Nobody waits for it.
    Quiet,
    /// To be told to the one who asked.
    Acknowledge { connection: ConnectionId, tag: u32 },
}

impl Storing {
    /// Whether there is a disk.
    pub(in super::super) fn is_on(&self) -> bool {
        self.on
    }

    /// Queues a request that holds so many bytes, or brings them; answers its number. Who asks is held when he has as
    /// much waiting as he may, so the queue is bounded by the number of connections.
    fn ask(&mut self, database: &DatabaseName, work: StoreWork, purpose: Purpose, bytes: usize) -> u64 {
        self.last += 1;
        let number = self.last;
        self.requests
            .push_back(StoreRequest { number, database: database.clone(), work });
        let waiting = Waiting { database: database.clone(), purpose, bytes, is_loading: false };
        self.waiting.insert(number, waiting);
        number
    }

    /// What is loaded comes into memory whole, so not everything is loaded at once.
    fn may_hand_out(&self) -> bool {
        let Some(first) = self.requests.front() else { return false };
        let bytes = self.waiting.get(&first.number).map_or(0, |waiting| waiting.bytes);
        first.work.writes() || self.loading == 0 || self.loading + bytes <= LOADING_BYTES_MAX
    }
}

impl ServerCore {
    /// Offers databases that live on the disk, from here on: those listed are there. Whoever runs the hub hands
    /// the requests of [`next_store_request`](ServerCore::next_store_request) to the store and its answers to
    /// [`stored`](ServerCore::stored).
    pub fn keep_databases(&mut self, saved: impl IntoIterator<Item = (DatabaseName, Saved)>) {
        self.storing.on = true;
        for (name, saved) in saved {
            self.databases.found(name, saved);
        }
    }

    /// The next thing for the disk to do. They are to be done in this order. While much is on its way from the disk,
    /// what comes after waits for that.
    pub fn next_store_request(&mut self) -> Option<StoreRequest> {
        if !self.storing.may_hand_out() {
            return None;
        }
        let request = self.storing.requests.pop_front()?;
        if let Some(waiting) = self.storing.waiting.get_mut(&request.number)
            && !request.work.writes()
        {
            waiting.is_loading = true;
            self.storing.loading += waiting.bytes;
        }
        Some(request)
    }

    /// Whether [`next_store_request`](ServerCore::next_store_request) would answer one.
    pub fn has_store_requests(&self) -> bool {
        self.storing.may_hand_out()
    }

    /// Whatever is still to be written, for a hub that ends: nobody waits for what is still to be loaded.
    pub fn last_store_requests(&mut self) -> impl Iterator<Item = StoreRequest> + '_ {
        self.storing.requests.drain(..).filter(|request| request.work.writes())
    }

    /// Asks the disk for something about a database; answers the number of the request.
    pub(in super::super) fn ask_store(
        &mut self,
        database: &DatabaseName,
        work: StoreWork,
        purpose: Purpose,
    ) -> u64 {
        let bytes = self.store_bytes(database, &work);
        self.storing.ask(database, work, purpose, bytes)
    }

    /// What a request holds until it is answered, or what its answer brings.
    fn store_bytes(&self, database: &DatabaseName, work: &StoreWork) -> usize {
        let whole = |saved: &Saved| saved.bytes + saved.keys * ITEM_OVERHEAD_BYTES;
        ITEM_OVERHEAD_BYTES
            + match work {
                StoreWork::Change { key, value, .. } => {
                    key.len() + value.as_ref().map_or(0, |value| value.encoded().len())
                }
                StoreWork::Replace { about, .. } => whole(about),
                StoreWork::Load => self.databases.saved(database).map_or(0, whole),
                StoreWork::Remove => 0,
            }
    }

    /// How many requests have not been answered.
    pub fn unanswered_store_requests(&self) -> usize {
        self.storing.waiting.len()
    }

    /// Takes an answer of the disk: acknowledges what was written, or refuses it with `Storage`, to exactly
    /// those who wait for it.
    pub fn stored(&mut self, answer: StoreAnswer, now: Instant) {
        self.now = now;
        let number = answer.number;
        let Some(answered) = self.storing.waiting.remove(&number) else { return };
        let Waiting { database, purpose, bytes, is_loading } = answered;
        self.storing.loading -= if is_loading { bytes } else { 0 };
        match (purpose, answer.outcome) {
            (Purpose::Quiet, Ok(_)) => {}
            (Purpose::Quiet, Err(failure)) => self.log_failure(&database, &failure),
            (Purpose::Summon, outcome) => self.summoned(&database, number, outcome),
            (Purpose::Reload { connection, tag }, Ok(Stored::Contents(contents))) => {
                self.reloaded(connection, tag, &database, contents);
                self.go_on(connection, number, bytes);
            }
            (Purpose::Acknowledge { connection, tag }, Ok(_)) => {
                if tag != 0 {
                    self.answer(connection, tag, &Event::Saved {});
                }
                self.go_on(connection, number, bytes);
            }
            (Purpose::Reload { connection, tag }, Ok(Stored::Written)) => {
                self.refuse(connection, tag, RefusalCode::Storage);
                self.go_on(connection, number, bytes);
            }
            (
                Purpose::Reload { connection, tag } | Purpose::Acknowledge { connection, tag },
                Err(failure),
            ) => {
                self.log_failure(&database, &failure);
                if let Ok(open) = self.databases.open_mut(&database) {
                    open.torn = true;
                }
                self.refuse(connection, tag, RefusalCode::Storage);
                self.go_on(connection, number, bytes);
            }
        }
        self.settle();
    }

    fn log_failure(&mut self, database: &DatabaseName, failure: &StoreFailure) {
        if let Some(silenced) = self.log.pass(self.now) {
            tracing::error!(%database, silenced, "the disk failed: {failure}");
        }
    }

    /// Contents came for commands that wait: they are looked at again, or refused.
    fn summoned(&mut self, name: &DatabaseName, number: u64, outcome: Result<Stored, StoreFailure>) {
        let failed = match outcome {
            Ok(Stored::Contents(contents)) => {
                self.databases.arrived(name, number, contents.as_ref());
                false
            }
            Ok(Stored::Written) => true,
            Err(failure) => {
                self.log_failure(name, &failure);
                true
            }
        };
        if failed {
            self.databases.failed_to_arrive(name, number);
        }
        self.rights_changed(name);
        for id in self.connections.ids() {
            let Some(connection) = self.connections.get_mut(id) else { continue };
            if !connection.desk.answered(number) {
                continue;
            }
            if failed && let Some(again) = connection.desk.take_again() {
                self.refuse(id, again.tag, RefusalCode::Storage);
            }
            self.enqueue_if_ready(id);
        }
    }

    fn reloaded(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
        contents: Option<super::super::super::database::Contents>,
    ) {
        let replaced = match &contents {
            Some(contents) => self.databases.replace(name, contents),
            None => Err(RefusalCode::NoSuchDatabase),
        };
        match replaced {
            Ok(()) => {
                self.tell_all_watchers(name);
                self.rights_changed(name);
                self.answer(id, tag, &Event::Done {});
            }
            Err(code) => self.refuse(id, tag, code),
        }
    }

    /// A connection's request was answered: if its commands waited, they go on.
    fn go_on(&mut self, id: ConnectionId, number: u64, bytes: usize) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let desk = &mut connection.desk;
        if !desk.answered(number) {
            desk.unsaved = desk.unsaved.saturating_sub(1);
            desk.unsaved_bytes = desk.unsaved_bytes.saturating_sub(bytes);
        }
        self.enqueue_if_ready(id);
    }

    fn enqueue_if_ready(&mut self, id: ConnectionId) {
        let ready = self
            .connections
            .get(id)
            .is_some_and(|found| found.has_input() && !found.is_held());
        if ready {
            self.enqueue(id);
        }
    }

    pub(super) fn ask_and_wait(&mut self, id: ConnectionId, tag: u32, name: &DatabaseName, work: StoreWork) {
        self.ask_for(id, tag, name, work, Purpose::Acknowledge { connection: id, tag });
    }

    /// Asks the disk for something that this connection is told of. A synchronous one waits for it with all that
    /// follows, because its answers come in order.
    pub(super) fn ask_for(
        &mut self,
        id: ConnectionId,
        _tag: u32,
        name: &DatabaseName,
        work: StoreWork,
        purpose: Purpose,
    ) {
        let bytes = self.store_bytes(name, &work);
        let number = self.storing.ask(name, work, purpose, bytes);
        let synchronous = self.is_synchronous(id);
        if let Some(connection) = self.connections.get_mut(id) {
            if synchronous {
                connection.desk.answers_wait_for(number);
            } else {
                connection.desk.unsaved += 1;
                connection.desk.unsaved_bytes += bytes;
            }
        }
    }
}
