//! Step 4 and 7: sources that are ready, and what waits to be written.

use crate::Cx;
use crate::eventloop::TimingMode;
use crate::object::ObjectId;
use crate::world::{Readiness, Token};
use sk_flat::Instant;
use slab::Slab;
use std::collections::VecDeque;
use std::time::Duration;

/// Serves a source that is ready; answers whether it is ready still.
pub(crate) type Dispatch = fn(&mut Cx, ObjectId, Readiness) -> bool;
/// Writes what an object has gathered.
pub(crate) type Flush = fn(&mut Cx, ObjectId);

/// The token of the POSIX signals; no source gets it.
pub(crate) const OS_SIGNALS_TOKEN: Token = Token(u64::MAX - 2);

struct Source {
    owner: ObjectId,
    generation: u32,
    dispatch: Dispatch,
    readable: bool,
    writable: bool,
    queued: bool,
}

/// The descriptors of a loop and which of them are ready.
#[derive(Default)]
pub(crate) struct Sources {
    entries: Slab<Source>,
    /// Tokens carry it, so that an event of a source that is gone finds nobody.
    generation: u32,
    ready: VecDeque<usize>,
    fresh: Vec<Readiness>,
    dirty: VecDeque<(ObjectId, Flush)>,
    os_signals_ready: bool,
    looked: bool,
}

impl Sources {
    pub(crate) fn none_ready(&self) -> bool {
        self.ready.is_empty() && self.dirty.is_empty()
    }

    /// The owner is buried.
    pub(crate) fn forget(&mut self, owner: ObjectId) {
        if !self.entries.is_empty() {
            let gone: Vec<usize> = self
                .entries
                .iter()
                .filter(|(_, source)| source.owner == owner)
                .map(|(key, _)| key)
                .collect();
            for key in gone {
                self.entries.remove(key);
                self.ready.retain(|&ready| ready != key);
            }
        }
    }

    fn accept(&mut self, event: Readiness) {
        if event.token == OS_SIGNALS_TOKEN {
            self.os_signals_ready = true;
            return;
        }
        let (key, generation) = (event.token.0 as u32 as usize, (event.token.0 >> 32) as u32);
        let Some(source) = self.entries.get_mut(key).filter(|source| source.generation == generation) else {
            return;
        };
        source.readable |= event.readable;
        source.writable |= event.writable;
        if !source.queued {
            source.queued = true;
            self.ready.push_back(key);
        }
    }
}

impl Cx {
    /// A token for a descriptor of `owner`; the source goes when the owner is buried.
    pub(crate) fn add_source(&mut self, owner: ObjectId, dispatch: Dispatch) -> Token {
        self.sources.generation = self.sources.generation.wrapping_add(1);
        let generation = self.sources.generation;
        let source = Source { owner, generation, dispatch, readable: false, writable: false, queued: false };
        let key = self.sources.entries.insert(source);
        Token(u64::from(generation) << 32 | key as u64)
    }

    /// The descriptor is closed though its owner lives on.
    pub(crate) fn remove_source(&mut self, token: Token) {
        let (key, generation) = (token.0 as u32 as usize, (token.0 >> 32) as u32);
        if self
            .sources
            .entries
            .get(key)
            .is_some_and(|source| source.generation == generation)
        {
            self.sources.entries.remove(key);
            self.sources.ready.retain(|&ready| ready != key);
        }
    }

    /// The source is to be served though nothing new was reported: it was left with something to read, or
    /// its owner has news of its own. It comes in this step 4, or in the next round's.
    pub(crate) fn offer_source(&mut self, token: Token) {
        self.sources.accept(Readiness { token, readable: true, writable: false });
    }

    /// A source made before its owner goes to it.
    pub(crate) fn give_source(&mut self, token: Token, owner: ObjectId) {
        let (key, generation) = (token.0 as u32 as usize, (token.0 >> 32) as u32);
        if let Some(source) = self.sources.entries.get_mut(key).filter(|s| s.generation == generation) {
            source.owner = owner;
        }
    }

    /// The object has something to write in step 7. Call it once per round and object.
    pub(crate) fn write_later(&mut self, owner: ObjectId, flush: Flush) {
        self.sources.dirty.push_back((owner, flush));
    }

    /// Asks the net what is ready, waiting at most `span`.
    pub(crate) fn look_at_sources(&mut self, span: Option<Duration>) {
        let mut fresh = std::mem::take(&mut self.sources.fresh);
        if let Err(error) = self.world.net.wait(span, &mut fresh)
            && self.may_log()
        {
            tracing::error!("waiting for sockets failed: {error}");
        }
        for event in fresh.drain(..) {
            self.sources.accept(event);
        }
        self.sources.fresh = fresh;
        self.sources.looked = true;
    }

    /// Step 4: ready sources in turn, until none is ready or half the interval is used.
    pub(crate) fn serve_sources(&mut self, began: Instant) -> bool {
        let looked = std::mem::take(&mut self.sources.looked);
        if !looked && !self.sources.entries.is_empty() {
            self.look_at_sources(Some(Duration::ZERO));
            self.sources.looked = false;
        }
        let os_signals_ready = std::mem::take(&mut self.sources.os_signals_ready);
        self.hear_os_signals(os_signals_ready);
        let mut served = false;
        // Two slots that write to each other through a socket pair could go on for ever.
        let until = match self.settings.mode {
            TimingMode::NoTiming => began + crate::eventloop::INTERVAL_DEFAULT,
            _ => began + self.settings.interval / 2,
        };
        while let Some(key) = self.sources.ready.pop_front() {
            served = true;
            self.serve(key);
            if self.sources.ready.is_empty() || self.world.clock.now() >= until {
                break;
            }
        }
        served
    }

    fn serve(&mut self, key: usize) {
        let Some(source) = self.sources.entries.get_mut(key) else { return };
        let token = Token(u64::from(source.generation) << 32 | key as u64);
        let readiness = Readiness { token, readable: source.readable, writable: source.writable };
        (source.queued, source.readable, source.writable) = (false, false, false);
        let (owner, dispatch, generation) = (source.owner, source.dispatch, source.generation);
        if !self.is_alive(owner) {
            return;
        }
        let more = dispatch(self, owner, readiness);
        if let Some(source) = self.sources.entries.get_mut(key).filter(|s| more && s.generation == generation)
        {
            source.readable = true;
            if !source.queued {
                source.queued = true;
                self.sources.ready.push_back(key);
            }
        }
    }

    /// Step 7: one write for each object that has gathered something.
    pub(crate) fn flush_sources(&mut self) -> bool {
        let count = self.sources.dirty.len();
        for _ in 0..count {
            if let Some((owner, flush)) = self.sources.dirty.pop_front() {
                flush(self, owner);
            }
        }
        count > 0
    }
}
