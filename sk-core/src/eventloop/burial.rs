//! Deferred destruction: marks, and the burial of whole subtrees without recursion.

use crate::Cx;
use crate::eventloop::Reason;
use crate::eventloop::sk_event_loop::News;
use crate::object::{MARKED, ObjectId};
use std::rc::Rc;

/// The object's `on_destroy` ran, or shall not run.
const DYING: u8 = 8;
/// How many objects are buried a round before the rest is left to the next one. Looked at between subtrees.
const BURIALS_PER_ROUND_MAX: usize = 65_536;
/// How often the end of a loop buries what hooks spawned meanwhile before it stops running hooks.
const END_PASSES_WITH_HOOKS: usize = 8;
/// Shells of buried objects that are tolerated however few objects live.
const SHELLS_TOLERATED: u32 = 1024;

impl Cx {
    /// Marks the subtree and puts it up for burial.
    pub(crate) fn mark(&mut self, top: ObjectId, reason: Reason) {
        if !self.table.exists(top) {
            return;
        }
        if let Some(node) = self.table.node(top) {
            if node.header().has(MARKED) {
                return;
            }
            node.header().set(MARKED);
        }
        let mut at = self.table.first_child(top);
        while let Some(id) = at {
            if let Some(node) = self.table.node(id) {
                node.header().set(MARKED);
            }
            at = self.table.next_below(top, id);
        }
        self.burials.push_back((top, reason));
    }

    /// Step 9. Marks made meanwhile join in.
    pub(crate) fn bury_marked(&mut self, limit: usize) {
        let mut buried = 0;
        let listeners = self.with(self.own.event_loop, |l, _| l.buried.listeners());
        self.own_buried_listeners = listeners.is_ok_and(|count| count > 0);
        while buried < limit {
            let Some((top, reason)) = self.burials.pop_front() else { break };
            buried += self.bury_subtree(top, reason);
        }
        if self.shells > SHELLS_TOLERATED && self.shells > self.table.living() / 2 {
            self.sweep_everything();
            self.shells = 0;
        }
    }

    pub(crate) fn bury_some(&mut self) {
        self.bury_marked(BURIALS_PER_ROUND_MAX);
    }

    /// Parents' hooks run before their children's; values are dropped children first.
    fn bury_subtree(&mut self, top: ObjectId, reason: Reason) -> usize {
        if !self.table.exists(top) {
            return 0;
        }
        let mut buried = 0;
        let mut at = top;
        loop {
            if let Some(node) = self.table.node(at)
                && !node.header().has(DYING)
            {
                node.header().set(MARKED | DYING);
                if node.class().has_hooks {
                    let node = node.clone();
                    self.run_hook(at, &*node, "on_destroy");
                }
            }
            if let Some(child) = self.table.first_child(at) {
                at = child;
                continue;
            }
            if at == top {
                self.bury_one(at, reason);
                return buried + 1;
            }
            let parent = self.table.parent(at);
            self.bury_one(at, Reason::Parent);
            buried += 1;
            match parent {
                Some(parent) => at = parent,
                None => return buried,
            }
        }
    }

    /// What a hook spawns below its own dying object has no hooks: that could go on for ever.
    pub(crate) fn deny_hooks_below_the_dying(&self, id: ObjectId) {
        if self.table.parent(id).is_some_and(|parent| self.is_dying(parent))
            && let Some(node) = self.table.node(id)
        {
            node.header().set(DYING);
        }
    }

    fn is_dying(&self, id: ObjectId) -> bool {
        self.table.node(id).is_some_and(|node| node.header().has(DYING))
    }

    fn bury_one(&mut self, id: ObjectId, reason: Reason) {
        let node = self.table.release(id);
        self.counters.buried += 1;
        if !self.parked.is_empty()
            && let Some(waiting) = self.parked.remove(&id.index)
        {
            self.counters.gone += waiting.len() as u64;
            self.drop_each(waiting);
        }
        if let Some(node) = node {
            // The value's own `Drop` is the user's code.
            self.guarded(|_| node.clear());
            if Rc::strong_count(&node) > 1 {
                self.shells += 1;
            }
        }
        if !self.crossings_to.is_empty() {
            // The arguments of calls under way may go with them.
            self.guarded(|cx| cx.bury_crossings(id));
        }
        self.sources.forget(id);
        if self.own_buried_listeners || self.watches.contains_key(&id) {
            self.news.push_back(News::Buried(id, reason));
        }
    }

    /// The end of the loop: every object is buried, then what is queued is dropped.
    pub(crate) fn end(&mut self) {
        if self.ended {
            return;
        }
        self.ended = true;
        self.quitting = true;
        self.inbox.close();
        let own = [
            self.own.event_loop.id(),
            self.own.fast_zone.id(),
            self.own.slow_zone.id(),
            self.own.one_sec_zone.id(),
        ];
        // Hooks may spawn; what they spawn is buried too, but only so often with hooks of its own.
        let mut with_hooks = END_PASSES_WITH_HOOKS;
        for keep in [&own[..], &[]] {
            while self.mark_roots(keep, with_hooks == 0) {
                with_hooks = with_hooks.saturating_sub(1);
                self.bury_marked(self.table.living() as usize);
            }
        }
        // Arguments and work hold what users made: each is dropped with a guard of its own.
        let queue = std::mem::take(&mut self.queue);
        self.drop_each(queue.into_tokens());
        self.inbox.clear();
        let remote_calls = std::mem::take(&mut self.remote_calls);
        self.drop_each(remote_calls);
        for (_, waiting) in std::mem::take(&mut self.parked) {
            self.drop_each(waiting);
        }
        self.rewires.clear();
        let crossings = std::mem::take(&mut self.crossings);
        self.drop_each(crossings.into_values());
        self.news.clear();
    }

    fn drop_each<T>(&mut self, things: impl IntoIterator<Item = T>) {
        for thing in things {
            self.guarded(|_| drop(thing));
        }
    }
}

impl Cx {
    /// Puts every root but `keep` up for burial; answers whether there was one.
    fn mark_roots(&mut self, keep: &[ObjectId], silently: bool) -> bool {
        let mut found = false;
        let mut at = self.table.first_root();
        while let Some(id) = at {
            at = self.table.next_sibling(id);
            if !keep.contains(&id) {
                found = true;
                self.mark(id, Reason::LoopEnd);
            }
        }
        if silently {
            for id in self.table.ids() {
                if let Some(node) = self.table.node(id) {
                    node.header().set(DYING);
                }
            }
        }
        found
    }
}

impl Drop for Cx {
    /// Links hold their receivers: without emptying every cell, cycles of objects would never be freed.
    fn drop(&mut self) {
        self.end();
    }
}
