//! The one way into a loop from other threads.

use crate::Cx;
use crate::signal::Rewire;
use crate::thread::PostError;
use crate::world::Wake;
use crossbeam_channel::{Receiver, Sender};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering, fence};

/// How many messages a mailbox holds unless told otherwise.
pub(crate) const MAILBOX_MESSAGES_MAX: usize = 65_536;

/// What one loop tells another.
pub(crate) enum Message {
    /// The next call of a crossing link; its arguments wait in the link's own ring.
    Call(u64),
    /// The crossing link goes on in a larger ring.
    Ring(u64, Box<dyn Any + Send>),
    /// Work that counts as a call: it runs in step 6, in order with the calls.
    Run(Box<dyn FnOnce(&mut Cx) + Send>),
    /// The bookkeeping of links: it is done as it is taken.
    Settle(Box<dyn FnOnce(&mut Cx) + Send>),
    /// A change of this loop's graph, for step 8.
    Rewire(Box<Rewire>),
}

/// The senders' end: shared by whoever knows an object of the loop.
pub(crate) struct Mailbox {
    sender: Sender<Message>,
    waiting: AtomicUsize,
    /// Answers that were asked for and have not run yet.
    promised: AtomicUsize,
    messages_max: usize,
    /// The loop is about to sleep, or sleeps, in a wait that only the waker ends.
    asleep: AtomicBool,
    closed: AtomicBool,
    waker: Arc<dyn Wake>,
    next_crossing: AtomicU64,
    refused: AtomicU64,
}

/// The loop's end.
pub(crate) struct Inbox {
    receiver: Receiver<Message>,
    mailbox: Arc<Mailbox>,
}

impl Mailbox {
    pub(crate) fn open(waker: Arc<dyn Wake>, messages_max: usize) -> (Arc<Mailbox>, Inbox) {
        // bounded by: `waiting` against `messages_max`; a bounded channel of crossbeam would take its whole
        // room, megabytes, for every loop at once.
        let (sender, receiver) = crossbeam_channel::unbounded();
        let mailbox = Arc::new(Mailbox {
            sender,
            waiting: AtomicUsize::new(0),
            promised: AtomicUsize::new(0),
            messages_max,
            asleep: AtomicBool::new(false),
            closed: AtomicBool::new(false),
            waker,
            next_crossing: AtomicU64::new(0),
            refused: AtomicU64::new(0),
        });
        let inbox = Inbox { receiver, mailbox: mailbox.clone() };
        (mailbox, inbox)
    }

    /// Puts a message in, and wakes the loop if it sleeps.
    pub(crate) fn post(&self, message: Message) -> Result<(), PostError> {
        self.check_room()?;
        self.post_anyway(message)
    }

    /// Counts and refuses if the box is full. Between several senders the bound is exact to one message
    /// for each of them.
    pub(crate) fn check_room(&self) -> Result<(), PostError> {
        if self.waiting.load(Ordering::Relaxed) >= self.messages_max {
            self.refused.fetch_add(1, Ordering::Relaxed);
            return Err(PostError::Full(self.messages_max));
        }
        Ok(())
    }

    /// Keeps a place for an answer, from the question until the answer has run. Answers have a bound of
    /// their own, as many as messages: a full box refuses questions, and no answer gets lost in it.
    pub(crate) fn promise(self: &Arc<Mailbox>) -> Result<Promise, PostError> {
        if self.is_closed() {
            return Err(PostError::Gone);
        }
        if self.promised.fetch_add(1, Ordering::Relaxed) >= self.messages_max {
            self.promised.fetch_sub(1, Ordering::Relaxed);
            self.refused.fetch_add(1, Ordering::Relaxed);
            return Err(PostError::Full(self.messages_max));
        }
        Ok(Promise { mailbox: self.clone() })
    }

    /// For what must not get lost when calls have filled the box, and is bounded by something else: the
    /// opening and the end of a link, its larger ring, the one token of a `Latest` link, the notice that a
    /// receiver is gone (each at most once at a time per link), a pipe's bell, an answer that was promised
    /// a place, the end of the thread. Everything else is posted, and refused if the box is full.
    pub(crate) fn post_anyway(&self, message: Message) -> Result<(), PostError> {
        if self.closed.load(Ordering::Acquire) {
            return Err(PostError::Gone);
        }
        self.waiting.fetch_add(1, Ordering::Relaxed);
        self.sender.send(message).map_err(|_| PostError::Gone)?;
        // The loop sets `asleep` and then looks for messages; here a message is put in and then `asleep`
        // is looked at. The fences make sure that one of the two sees the other.
        fence(Ordering::SeqCst);
        if self.asleep.load(Ordering::Relaxed) && self.asleep.swap(false, Ordering::AcqRel) {
            self.waker.wake();
        }
        Ok(())
    }

    /// For the end of the loop: it may be about to sleep.
    pub(crate) fn wake_in_any_case(&self) {
        self.waker.wake();
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }

    pub(crate) fn waiting(&self) -> usize {
        self.waiting.load(Ordering::Relaxed)
    }

    /// A sender has counted its message and not put it in yet.
    #[cfg(test)]
    pub(crate) fn announce(&self) {
        self.waiting.fetch_add(1, Ordering::Relaxed);
    }

    #[cfg(test)]
    pub(crate) fn put_in_announced(&self, message: Message) {
        self.waiting.fetch_sub(1, Ordering::Relaxed);
        self.post_anyway(message).unwrap_or_else(|error| panic!("{error}"));
    }

    pub(crate) fn new_crossing(&self) -> u64 {
        self.next_crossing.fetch_add(1, Ordering::Relaxed)
    }

    /// How many messages were refused since the last time this was asked.
    pub(crate) fn take_refused(&self) -> u64 {
        if self.refused.load(Ordering::Relaxed) == 0 { 0 } else { self.refused.swap(0, Ordering::Relaxed) }
    }
}

/// A place for one answer; given back when it is dropped.
pub(crate) struct Promise {
    mailbox: Arc<Mailbox>,
}

impl Promise {
    /// Sends the answer. Its place is given back when it has run, or was dropped.
    pub(crate) fn keep(self, answer: impl FnOnce(&mut Cx) + Send + 'static) {
        let mailbox = self.mailbox.clone();
        // The asker's loop may have ended meanwhile: then nobody waits for the answer.
        let _ = mailbox.post_anyway(Message::Run(Box::new(move |cx| {
            let _place = self;
            answer(cx);
        })));
    }
}

impl Drop for Promise {
    fn drop(&mut self) {
        self.mailbox.promised.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Inbox {
    pub(crate) fn mailbox(&self) -> &Arc<Mailbox> {
        &self.mailbox
    }

    pub(crate) fn take(&self) -> Option<Message> {
        // The count is looked at first: an empty inbox costs a load, not a look at the channel.
        if self.mailbox.waiting.load(Ordering::Acquire) == 0 {
            return None;
        }
        let message = self.receiver.try_recv().ok()?;
        self.mailbox.waiting.fetch_sub(1, Ordering::Relaxed);
        Some(message)
    }

    /// Whether a message can be taken. A sender that was interrupted between counting its message and
    /// putting it in has none here yet.
    pub(crate) fn holds_any(&self) -> bool {
        !self.receiver.is_empty()
    }

    /// Says that the loop is about to sleep; `false` if a message is there, or about to be, and it must not.
    pub(crate) fn fall_asleep(&self) -> bool {
        self.mailbox.asleep.store(true, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        if self.mailbox.waiting.load(Ordering::Relaxed) == 0 {
            return true;
        }
        self.wake_up();
        false
    }

    pub(crate) fn wake_up(&self) {
        self.mailbox.asleep.store(false, Ordering::Relaxed);
    }

    /// Nothing is taken in any more.
    pub(crate) fn close(&self) {
        self.mailbox.closed.store(true, Ordering::Release);
    }

    /// Drops what still waits. What it holds may have a `Drop` of the user's, and that may panic.
    pub(crate) fn clear(&self) {
        while let Ok(message) = self.receiver.try_recv() {
            if catch_unwind(AssertUnwindSafe(|| drop(message))).is_err() {
                tracing::error!("what a message held panicked as it was dropped");
            }
        }
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        self.close();
        self.clear();
    }
}
