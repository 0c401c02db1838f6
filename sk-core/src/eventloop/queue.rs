//! The calls that wait for the next round, and those that other threads sent.

use crate::Cx;
use crate::eventloop::sk_event_loop::News;
use crate::object::ObjectId;
use crate::signal::{OnceCall, QueuedCall};
use crate::thread::RemoteReceive;
use std::any::Any;
use std::collections::VecDeque;
use std::rc::Rc;

/// Room for this many calls a loop's queue keeps in any case.
const QUEUE_KEPT_MAX: usize = 1024;

/// One entry of the queue: a call that waits for the next round.
pub(crate) enum Token {
    /// The next waiting call of a link.
    Link(Rc<dyn QueuedCall>),
    /// A call of its own.
    Once(Box<dyn OnceCall>),
    /// What was put off for a busy object.
    Drain(ObjectId),
}

/// What step 3 took for step 6.
pub(crate) enum RemoteCall {
    /// Calls of a crossing link, up to this run.
    Calls(Rc<dyn RemoteReceive>, u32),
    /// The newest call of a crossing `Latest` link.
    Newest(Rc<dyn RemoteReceive>),
    /// A crossing link goes on in another ring.
    Ring(u64, Box<dyn Any + Send>),
    /// Work that counts as a call.
    Run(Box<dyn FnOnce(&mut Cx) + Send>),
}

impl Cx {
    /// Whether the queue takes another call; if not, it is counted and told once per episode.
    pub(crate) fn queue_has_room(&mut self) -> bool {
        if self.queue.len() < self.settings.queue_calls_max {
            return true;
        }
        self.refused_full();
        false
    }

    #[cold]
    pub(crate) fn refused_full(&mut self) {
        self.counters.refused_full += 1;
        self.tell_full();
    }

    fn tell_full(&mut self) {
        self.queue_full_now = true;
        if !self.queue_full_told {
            self.queue_full_told = true;
            tracing::warn!(waiting = self.queue.len(), "a queue is full: calls are refused");
            self.news.push_back(News::MailboxFull);
        }
    }

    /// An episode of refusals ends with the first round in which nothing was refused.
    pub(crate) fn watch_room(&mut self) {
        if self.inbox.mailbox().take_refused() > 0 {
            self.tell_full();
        }
        self.queue_full_told &= self.queue_full_now;
        self.queue_full_now = false;
    }

    pub(crate) fn queue_link(&mut self, link: Rc<dyn QueuedCall>) {
        self.queue.push_back(Token::Link(link));
    }

    pub(crate) fn queue_once(&mut self, call: Box<dyn OnceCall>) {
        self.queue.push_back(Token::Once(call));
    }

    /// Step 6, its first part: the calls that were queued before this round began.
    pub(crate) fn run_queue(&mut self, count: usize) {
        for _ in 0..count {
            let Some(token) = self.queue.pop_front() else { return };
            self.counters.queued_calls += 1;
            self.top_level(|cx| match token {
                Token::Link(link) => link.run_next(cx),
                Token::Once(call) => call.run(cx),
                Token::Drain(id) => cx.drain_deferred(id),
            });
        }
        give_room_back(&mut self.queue, count);
    }
}

/// After a burst a queue keeps twice the room that this round needed.
pub(crate) fn give_room_back<T>(queue: &mut VecDeque<T>, needed: usize) {
    let needed = needed.max(queue.len());
    if queue.capacity() > QUEUE_KEPT_MAX.max(needed * 4) {
        queue.shrink_to(QUEUE_KEPT_MAX.max(needed * 2));
    }
}
