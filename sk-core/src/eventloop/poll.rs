//! Step 4 and 7: sources that are ready, and what waits to be written.

use crate::Cx;
use crate::eventloop::TimingMode;
use crate::object::ObjectId;
use crate::world::{Readiness, Token};
use rustc_hash::FxHashMap;
use sk_flat::Instant;
use slab::Slab;
use smallvec::SmallVec;
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
    /// How many steps 8 the loop had passed when it was made: it is served after the next one, so that links
    /// asked for together with it hear the first news.
    born: u64,
    readable: bool,
    writable: bool,
    queued: bool,
}

impl Source {
    fn token(&self, key: usize) -> Token {
        Token(u64::from(self.generation) << 32 | key as u64)
    }
}

/// The descriptors of a loop and which of them are ready.
#[derive(Default)]
pub(crate) struct Sources {
    entries: Slab<Source>,
    /// Which sources are whose; asked at every burial and every new link.
    owned: FxHashMap<ObjectId, SmallVec<[usize; 1]>>,
    /// How many steps 8 the loop has passed, those with nothing to do included.
    rewire_steps: u64,
    /// Tokens carry it, so that an event of a source that is gone finds nobody.
    generation: u32,
    /// One that has gone meanwhile is passed over when its turn comes.
    ready: VecDeque<Token>,
    fresh: Vec<Readiness>,
    dirty: VecDeque<(ObjectId, Flush)>,
    /// Listeners that wait for descriptors; looked at once a round.
    later: Vec<(Instant, Token)>,
    os_signals_ready: bool,
    looked: bool,
}

impl Sources {
    pub(crate) fn none_ready(&self) -> bool {
        self.ready.is_empty() && self.dirty.is_empty()
    }

    fn get_mut(&mut self, token: Token) -> Option<&mut Source> {
        let (key, generation) = (token.0 as u32 as usize, (token.0 >> 32) as u32);
        self.entries.get_mut(key).filter(|source| source.generation == generation)
    }

    /// The owner is buried.
    pub(crate) fn forget(&mut self, owner: ObjectId) {
        if self.owned.is_empty() {
            return;
        }
        for key in self.owned.remove(&owner).unwrap_or_default() {
            self.entries.remove(key);
        }
    }

    fn own(&mut self, key: usize, owner: ObjectId) {
        self.owned.entry(owner).or_default().push(key);
    }

    fn disown(&mut self, key: usize, owner: ObjectId) {
        if let Some(keys) = self.owned.get_mut(&owner) {
            keys.retain(|owned| *owned != key);
            if keys.is_empty() {
                self.owned.remove(&owner);
            }
        }
    }

    /// Somebody begins to listen to `owner`: it may have had news already that nobody heard.
    pub(crate) fn listened_to(&mut self, owner: ObjectId) {
        let keys = self.owned.get(&owner).cloned().unwrap_or_default();
        for key in keys {
            if let Some(source) = self.entries.get_mut(key) {
                source.readable = true;
                if !source.queued {
                    source.queued = true;
                    self.ready.push_back(source.token(key));
                }
            }
        }
    }

    /// Step 8 of a round is passed, whether or not there was anything to do in it: the links that were asked
    /// for stand, so the sources made before it have their listeners.
    pub(crate) fn pass_rewire_step(&mut self) {
        self.rewire_steps += 1;
    }

    fn accept(&mut self, event: Readiness) {
        if event.token == OS_SIGNALS_TOKEN {
            self.os_signals_ready = true;
            return;
        }
        let Some(source) = self.get_mut(event.token) else { return };
        source.readable |= event.readable;
        source.writable |= event.writable;
        if !source.queued {
            source.queued = true;
            self.ready.push_back(event.token);
        }
    }
}

impl Cx {
    /// A token for a descriptor of `owner`; the source goes when the owner is buried.
    pub(crate) fn add_source(&mut self, owner: ObjectId, dispatch: Dispatch) -> Token {
        self.sources.generation = self.sources.generation.wrapping_add(1);
        let generation = self.sources.generation;
        let born = self.sources.rewire_steps;
        let source =
            Source { owner, generation, dispatch, born, readable: false, writable: false, queued: false };
        let key = self.sources.entries.insert(source);
        self.sources.own(key, owner);
        Token(u64::from(generation) << 32 | key as u64)
    }

    /// The descriptor is closed though its owner lives on.
    pub(crate) fn remove_source(&mut self, token: Token) {
        let (key, generation) = (token.0 as u32 as usize, (token.0 >> 32) as u32);
        let entry = self.sources.entries.get(key).filter(|source| source.generation == generation);
        if let Some(owner) = entry.map(|source| source.owner) {
            self.sources.entries.remove(key);
            self.sources.disown(key, owner);
        }
    }

    /// The same, after a while.
    pub(crate) fn offer_source_after(&mut self, token: Token, after: Duration) {
        let due = self.now() + after;
        self.sources.later.push((due, token));
    }

    fn mark_what_waited(&mut self, now: Instant) {
        if self.sources.later.is_empty() {
            return;
        }
        let (due, later): (Vec<_>, Vec<_>) = self.sources.later.drain(..).partition(|(due, _)| *due <= now);
        self.sources.later = later;
        for (_, token) in due {
            self.offer_source(token);
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
            let before = std::mem::replace(&mut source.owner, owner);
            self.sources.disown(key, before);
            self.sources.own(key, owner);
        }
    }

    /// The source goes to another object that serves it in its own way.
    #[cfg(feature = "websocket")]
    pub(crate) fn pass_source(&mut self, token: Token, owner: ObjectId, dispatch: Dispatch) {
        self.give_source(token, owner);
        if let Some(source) = self.sources.get_mut(token) {
            source.dispatch = dispatch;
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
        self.mark_what_waited(began);
        let os_signals_ready = std::mem::take(&mut self.sources.os_signals_ready);
        self.hear_os_signals(os_signals_ready);
        let mut served = false;
        // Two slots that write to each other through a socket pair could go on for ever.
        let until = match self.settings.mode {
            TimingMode::NoTiming => began + crate::eventloop::INTERVAL_DEFAULT,
            _ => began + self.settings.interval / 2,
        };
        let mut newborn = Vec::new();
        while let Some(token) = self.sources.ready.pop_front() {
            let passed = self.sources.rewire_steps;
            match self.sources.get_mut(token) {
                None => continue,
                Some(source) if source.born == passed => {
                    newborn.push(token);
                    continue;
                }
                Some(_) => {}
            }
            served = true;
            self.serve(token);
            if self.sources.ready.is_empty() || self.world.clock.now() >= until {
                break;
            }
        }
        self.sources.ready.extend(newborn);
        served
    }

    fn serve(&mut self, token: Token) {
        let Some(source) = self.sources.get_mut(token) else { return };
        let readiness = Readiness { token, readable: source.readable, writable: source.writable };
        (source.queued, source.readable, source.writable) = (false, false, false);
        let (owner, dispatch) = (source.owner, source.dispatch);
        if !self.is_alive(owner) {
            return;
        }
        let more = self.as_own_work(owner, |cx| dispatch(cx, owner, readiness));
        if more {
            self.offer_source(token);
        }
    }

    /// Step 7: one write for each object that has gathered something.
    pub(crate) fn flush_sources(&mut self) -> bool {
        let count = self.sources.dirty.len();
        for _ in 0..count {
            if let Some((owner, flush)) = self.sources.dirty.pop_front() {
                self.as_own_work(owner, |cx| flush(cx, owner));
            }
        }
        count > 0
    }
}
