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

/// One entry of the queue: what waits for the next round.
pub(crate) enum Token {
    /// The next so many waiting calls of a link. Calls that were emitted one after the other share an entry.
    Link(Rc<dyn QueuedCall>, usize),
    /// A call of its own.
    Once(Box<dyn OnceCall>),
    /// What was put off for a busy object.
    Drain(ObjectId),
}

/// The calls that wait for the next round, oldest first.
#[derive(Default)]
pub(crate) struct CallQueue {
    tokens: VecDeque<Token>,
    calls: usize,
}

impl CallQueue {
    /// How many calls wait.
    pub(crate) fn len(&self) -> usize {
        self.calls
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.calls == 0
    }

    /// One more call of that link waits.
    pub(crate) fn push_link<L: QueuedCall + 'static>(&mut self, link: &Rc<L>) {
        self.calls += 1;
        if let Some(Token::Link(last, calls)) = self.tokens.back_mut()
            && std::ptr::addr_eq(Rc::as_ptr(last), Rc::as_ptr(link))
        {
            *calls += 1;
            return;
        }
        self.tokens.push_back(Token::Link(link.clone(), 1));
    }

    fn push_once(&mut self, call: Box<dyn OnceCall>) {
        self.calls += 1;
        self.tokens.push_back(Token::Once(call));
    }

    pub(crate) fn push_drain(&mut self, id: ObjectId) {
        self.calls += 1;
        self.tokens.push_back(Token::Drain(id));
    }

    /// The oldest entry, or of a longer one its first `most` calls.
    fn pop(&mut self, most: usize) -> Option<Token> {
        let taken = match self.tokens.front_mut()? {
            Token::Link(link, calls) if *calls > most => {
                *calls -= most;
                Some(Token::Link(link.clone(), most))
            }
            _ => None,
        };
        let token = taken.or_else(|| self.tokens.pop_front())?;
        self.calls -= token.calls();
        Some(token)
    }

    /// The calls themselves, when the loop ends.
    pub(crate) fn into_tokens(self) -> impl Iterator<Item = Token> {
        self.tokens.into_iter()
    }
}

impl Token {
    fn calls(&self) -> usize {
        match self {
            Token::Link(_, calls) => *calls,
            Token::Once(_) | Token::Drain(_) => 1,
        }
    }
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

    pub(crate) fn queue_once(&mut self, call: Box<dyn OnceCall>) {
        self.queue.push_once(call);
    }

    /// Step 6, its first part: the calls that were queued before this round began.
    pub(crate) fn run_queue(&mut self, count: usize) {
        let mut left = count;
        while left > 0
            && let Some(token) = self.queue.pop(left)
        {
            left -= token.calls();
            match token {
                Token::Link(link, calls) => self.run_link(link, calls),
                Token::Once(call) => self.run_alone(|cx| call.run(cx)),
                Token::Drain(id) => self.run_alone(|cx| cx.drain_deferred(id)),
            }
        }
        give_room_back(&mut self.queue.tokens, count);
    }

    fn run_alone(&mut self, call: impl FnOnce(&mut Cx)) {
        self.counters.queued_calls += 1;
        self.top_level(call);
    }

    /// One guard stands around as many calls as go well: a panic ends its own call only.
    fn run_link(&mut self, link: Rc<dyn QueuedCall>, calls: usize) {
        let mut rest = Some((link, calls));
        while rest.is_some() {
            self.guarded(|cx| {
                while let Some((link, calls)) = &mut rest
                    && *calls > 0
                {
                    *calls -= 1;
                    if cx.is_observed() {
                        cx.run_alone(|cx| link.run_next(cx));
                    } else {
                        cx.counters.queued_calls += 1;
                        link.run_next(cx);
                        cx.nobody_runs();
                    }
                }
                rest = None;
            });
            self.nobody_runs();
        }
    }
}

/// After a burst a queue keeps twice the room that this round needed.
pub(crate) fn give_room_back<T>(queue: &mut VecDeque<T>, needed: usize) {
    let needed = needed.max(queue.len());
    if queue.capacity() > QUEUE_KEPT_MAX.max(needed * 4) {
        queue.shrink_to(QUEUE_KEPT_MAX.max(needed * 2));
    }
}
