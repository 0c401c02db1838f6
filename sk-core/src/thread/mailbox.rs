//! The one way into a loop from other threads.

use crate::Cx;
use crate::signal::Rewire;
use crate::thread::PostError;
use crate::world::Wake;
use crossbeam_channel::{Receiver, Sender};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicIsize, AtomicU64, AtomicUsize, Ordering, fence};

/// How many messages a mailbox holds unless told otherwise.
pub(crate) const MAILBOX_MESSAGES_MAX: usize = 65_536;

/// The number of no crossing.
const NOBODY: u64 = 0;

/// What one loop tells another.
pub(crate) enum Message {
    /// Calls of a crossing link up to this run of them; their arguments wait in the link's own ring. They are
    /// counted one by one, and this is not.
    Calls(u64, u32),
    /// The newest call of a crossing `Latest` link.
    Newest(u64),
    /// The crossing link goes on in a larger ring.
    Ring(u64, Box<dyn Any + Send>),
    /// Work that counts as a call: it runs in step 6, in order with the calls.
    Run(Box<dyn FnOnce(&mut Cx) + Send>),
    /// The bookkeeping of links: it is done as it is taken.
    Settle(Box<dyn FnOnce(&mut Cx) + Send>),
    /// A change of this loop's graph, for step 8.
    Rewire(Box<Rewire>),
}

/// Keeps what one thread writes often out of the cache lines of its neighbours: a line that two processors
/// write costs each of them more than all the rest of a message. Two lines, because they are fetched in pairs.
#[repr(align(128))]
#[derive(Default)]
pub(crate) struct Apart<T>(pub T);

/// The senders' end: shared by whoever knows an object of the loop.
pub(crate) struct Mailbox {
    sender: Sender<Message>,
    messages_max: usize,
    closed: AtomicBool,
    waker: Arc<dyn Wake>,
    both: Apart<Both>,
    senders: Apart<Senders>,
}

/// What the loop and its senders write. One who wakes the loop needs both, and both come with one line.
#[derive(Default)]
struct Both {
    /// Messages that were not taken yet, and calls in the rings of crossings that have not run yet. For a moment
    /// it may be too low: a call can have run before its sender has counted it.
    waiting: AtomicIsize,
    /// The loop is about to sleep, or sleeps, in a wait that only the waker ends.
    asleep: AtomicBool,
}

/// What senders write and the loop seldom looks at.
struct Senders {
    /// The crossing whose token was put in last, by whomever. A sender who reads his own number here knows
    /// that he himself has put in nothing since: a later value of his would be read instead.
    last: AtomicU64,
    /// Answers that were asked for and have not run yet.
    promised: AtomicUsize,
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
            messages_max,
            closed: AtomicBool::new(false),
            waker,
            both: Apart::default(),
            senders: Apart(Senders {
                last: AtomicU64::new(NOBODY),
                promised: AtomicUsize::new(0),
                next_crossing: AtomicU64::new(NOBODY + 1),
                refused: AtomicU64::new(0),
            }),
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
        if self.waiting() >= self.messages_max {
            self.senders.0.refused.fetch_add(1, Ordering::Relaxed);
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
        let senders = &self.senders.0;
        if senders.promised.fetch_add(1, Ordering::Relaxed) >= self.messages_max {
            senders.promised.fetch_sub(1, Ordering::Relaxed);
            senders.refused.fetch_add(1, Ordering::Relaxed);
            return Err(PostError::Full(self.messages_max));
        }
        Ok(Promise { mailbox: self.clone() })
    }

    /// For what must not get lost when calls have filled the box, and is bounded by something else: the
    /// opening and the end of a link, its larger ring, the one token of a `Latest` link, the notice that a
    /// receiver is gone (each at most once at a time per link), a pipe's bell, an answer that was promised
    /// a place, the end of the thread. Everything else is posted, and refused if the box is full.
    pub(crate) fn post_anyway(&self, message: Message) -> Result<(), PostError> {
        if self.is_closed() {
            return Err(PostError::Gone);
        }
        self.count();
        if self.senders.0.last.load(Ordering::Relaxed) != NOBODY {
            self.senders.0.last.store(NOBODY, Ordering::Relaxed);
        }
        self.put_in(message)
    }

    /// Whether the last that the caller's thread has put in is a token of this crossing, whose sender it is.
    #[inline]
    pub(crate) fn ends_with(&self, crossing: u64) -> bool {
        self.senders.0.last.load(Ordering::Relaxed) == crossing
    }

    /// One more waits: a message that is about to be put in, or a call that was put into its crossing's ring.
    /// For a call it comes before the look whether its token is taken; the loop says that it is, and then reads
    /// this count. In the one order of all these accesses one of the two sees the other.
    #[inline]
    pub(crate) fn count(&self) {
        self.both.0.waiting.fetch_add(1, Ordering::SeqCst);
    }

    /// Puts in the token of a run of calls, the first of which is in its ring and counted.
    pub(crate) fn put_in_token(&self, crossing: u64, run: u32) -> Result<(), PostError> {
        self.senders.0.last.store(crossing, Ordering::Relaxed);
        self.put_in(Message::Calls(crossing, run))
    }

    /// Puts in what was counted, and wakes the loop if it sleeps.
    fn put_in(&self, message: Message) -> Result<(), PostError> {
        self.sender.send(message).map_err(|_| PostError::Gone)?;
        // The loop sets `asleep` and then looks for messages; here a message is put in and then `asleep`
        // is looked at. The fences make sure that one of the two sees the other.
        fence(Ordering::SeqCst);
        if self.both.0.asleep.load(Ordering::Relaxed) && self.both.0.asleep.swap(false, Ordering::AcqRel) {
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
        usize::try_from(self.both.0.waiting.load(Ordering::Relaxed)).unwrap_or(0)
    }

    /// A sender has counted its message and not put it in yet.
    #[cfg(test)]
    pub(crate) fn announce(&self) {
        self.count();
    }

    #[cfg(test)]
    pub(crate) fn put_in_announced(&self, message: Message) {
        self.both.0.waiting.fetch_sub(1, Ordering::Relaxed);
        self.post_anyway(message).unwrap_or_else(|error| panic!("{error}"));
    }

    pub(crate) fn new_crossing(&self) -> u64 {
        self.senders.0.next_crossing.fetch_add(1, Ordering::Relaxed)
    }

    /// How many messages were refused since the last time this was asked.
    pub(crate) fn take_refused(&self) -> u64 {
        let refused = &self.senders.0.refused;
        if refused.load(Ordering::Relaxed) == 0 { 0 } else { refused.swap(0, Ordering::Relaxed) }
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
        self.mailbox.senders.0.promised.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Inbox {
    pub(crate) fn mailbox(&self) -> &Arc<Mailbox> {
        &self.mailbox
    }

    /// The next message. It counts as waiting until the loop says otherwise.
    pub(crate) fn take(&self) -> Option<Message> {
        // Two loads; the attempt to receive would cost a fence in each empty round.
        if self.receiver.is_empty() { None } else { self.receiver.try_recv().ok() }
    }

    /// So many messages were taken, or calls of crossings have run: not one by one, because senders write this
    /// count too.
    pub(crate) fn count_off(&self, done: usize) {
        if done > 0 {
            self.mailbox
                .both
                .0
                .waiting
                .fetch_sub(isize::try_from(done).unwrap_or(isize::MAX), Ordering::Relaxed);
        }
    }

    /// After a run was marked as taken: whatever its sender has put into the ring without seeing the mark, and
    /// without a token of its own, is visible from here on.
    pub(crate) fn see_what_was_counted(&self) {
        self.mailbox.both.0.waiting.load(Ordering::SeqCst);
    }

    /// Whether a message can be taken. A sender that was interrupted between counting its message and
    /// putting it in has none here yet.
    pub(crate) fn holds_any(&self) -> bool {
        !self.receiver.is_empty()
    }

    /// Says that the loop is about to sleep; `false` if a message is there, or about to be, and it must not.
    pub(crate) fn fall_asleep(&self) -> bool {
        self.mailbox.both.0.asleep.store(true, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        if self.mailbox.waiting() == 0 && self.receiver.is_empty() {
            return true;
        }
        self.wake_up();
        false
    }

    pub(crate) fn wake_up(&self) {
        self.mailbox.both.0.asleep.store(false, Ordering::Relaxed);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts what would be system calls.
    #[derive(Debug, Default)]
    struct Bell(AtomicUsize);
    impl Wake for Bell {
        fn wake(&self) {
            self.0.fetch_add(1, Ordering::SeqCst);
        }
    }

    #[test]
    fn only_the_first_message_to_a_loop_that_sleeps_wakes_it() {
        let bell = Arc::new(Bell::default());
        let (mailbox, inbox) = Mailbox::open(bell.clone(), 10);
        let post = || mailbox.post(Message::Settle(Box::new(|_| ())));
        let rung = || bell.0.load(Ordering::SeqCst);
        // As to a loop that spins before its deadline.
        post().unwrap();
        post().unwrap();
        assert_eq!(rung(), 0);
        assert!(!inbox.fall_asleep(), "messages are there");
        assert!(inbox.take().is_some() && inbox.take().is_some() && inbox.take().is_none());
        inbox.count_off(2);
        assert!(inbox.fall_asleep());
        post().unwrap();
        post().unwrap();
        assert_eq!(rung(), 1);
        inbox.wake_up();
        post().unwrap();
        assert_eq!(rung(), 1);
    }
}
