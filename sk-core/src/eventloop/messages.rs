//! Step 3, and the second part of step 6: what other threads send.

use crate::Cx;
use crate::eventloop::queue::RemoteCall;
use crate::eventloop::queue::give_room_back;
use crate::object::ObjectId;
use crate::signal::{OnceCall, Rewire};
use crate::thread::{Mailbox, Message, PostError, RemoteReceive, There};
use std::rc::Rc;
use std::sync::Arc;

/// How many messages are taken at once; the rest waits for the next turn.
const MESSAGES_PER_TURN_MAX: usize = 16_384;
/// How many calls of other threads run in one round; the rest goes first in the next.
const CALLS_PER_ROUND_MAX: usize = 16_384;

struct OwnWork {
    object: ObjectId,
    work: Box<dyn FnOnce(&mut Cx)>,
}

impl OnceCall for OwnWork {
    fn run(self: Box<Self>, cx: &mut Cx) {
        if cx.is_alive(self.object) {
            (self.work)(cx);
        }
    }
}

impl Cx {
    /// Takes what waits in the mailbox: bookkeeping is done, calls are kept for step 6, requests for step 8.
    /// A loop that takes messages while it waits for its moment keeps no more of them than the mailbox does.
    pub(crate) fn take_messages(&mut self) -> bool {
        let (mut taken, mut tokens) = (0, 0);
        while taken < MESSAGES_PER_TURN_MAX
            && self.remote_calls.len() < self.settings.mailbox_messages_max
            && let Some(message) = self.inbox.take()
        {
            taken += 1;
            match message {
                Message::Calls(number, run) => {
                    tokens += 1;
                    self.take_run(number, run);
                }
                Message::Newest(number) => {
                    if let Some(crossing) = self.crossings.get(&number) {
                        self.remote_calls.push_back(RemoteCall::Newest(crossing.clone()));
                    }
                }
                Message::Ring(number, ring) => self.remote_calls.push_back(RemoteCall::Ring(number, ring)),
                Message::Run(work) => self.remote_calls.push_back(RemoteCall::Run(work)),
                // What arrives here may hold what users made, and drop it.
                Message::Settle(work) => self.guarded(work),
                Message::Rewire(rewire) => {
                    // Refused, it is counted and logged.
                    let _ = self.keep_rewire(*rewire);
                }
            }
        }
        if tokens > 0 {
            self.see_what_was_counted();
        }
        self.inbox.count_off(taken - tokens);
        self.counters.messages += (taken - tokens) as u64;
        taken > 0
    }

    fn take_run(&mut self, number: u64, run: u32) {
        // Its sender's end closes it behind its last call, so it is there.
        if let Some(crossing) = self.crossings.get(&number) {
            crossing.take_run(run);
            self.remote_calls.push_back(RemoteCall::Calls(crossing.clone(), run));
        }
    }

    /// So many calls of crossings have run.
    pub(crate) fn count_off_calls(&mut self, calls: usize) {
        self.counters.messages += calls as u64;
        self.inbox.count_off(calls);
    }

    /// So many will not run, because their receiver is gone.
    pub(crate) fn count_gone_calls(&mut self, calls: u32) {
        self.counters.gone += u64::from(calls);
        self.count_off_calls(calls as usize);
    }

    /// See [`Inbox::see_what_was_counted`](crate::thread::Inbox).
    pub(crate) fn see_what_was_counted(&self) {
        self.inbox.see_what_was_counted();
    }

    /// Step 6, its second part: the calls that were taken in step 3.
    pub(crate) fn run_remote_calls(&mut self) {
        let count = self.remote_calls.len();
        let mut left = CALLS_PER_ROUND_MAX;
        for _ in 0..count {
            let Some(call) = self.remote_calls.pop_front() else { return };
            match call {
                RemoteCall::Calls(crossing, run) => {
                    left -= crossing.run_calls(self, run, left);
                    if left == 0 {
                        // Whether it has come to its end is seen in the next round.
                        self.remote_calls.push_front(RemoteCall::Calls(crossing, run));
                        break;
                    }
                    self.let_go(crossing);
                }
                RemoteCall::Newest(crossing) => {
                    crossing.run_newest(self);
                    self.let_go(crossing);
                }
                RemoteCall::Ring(number, ring) => {
                    let crossing = self.crossings.get(&number).cloned();
                    // A ring that nobody takes goes with its arguments, and their `Drop` is the user's.
                    self.guarded(move |_| {
                        if let Some(crossing) = crossing {
                            crossing.next_ring(ring);
                        }
                    });
                }
                RemoteCall::Run(work) => self.top_level(work),
            }
        }
        give_room_back(&mut self.remote_calls, count);
    }

    /// If its receiver was buried after step 3, this was the last hold on its arguments, and their `Drop` is the
    /// user's.
    fn let_go(&mut self, crossing: Rc<dyn RemoteReceive>) {
        if Rc::strong_count(&crossing) == 1 {
            self.guarded(move |_| drop(crossing));
        }
    }

    pub(crate) fn open_crossing(&mut self, number: u64, crossing: Rc<dyn RemoteReceive>) {
        self.crossings_to.entry(crossing.target()).or_default().push(number);
        self.crossings.insert(number, crossing);
    }

    /// The crossing has no receiver any more; what still comes is counted. Answers the former end, whose ring
    /// holds what is the user's to drop.
    pub(crate) fn note_gone_crossing(
        &mut self,
        number: u64,
        gone: Rc<dyn RemoteReceive>,
    ) -> Option<Rc<dyn RemoteReceive>> {
        self.crossings.insert(number, gone)
    }

    /// The sender's end is gone.
    pub(crate) fn close_crossing(&mut self, number: u64) {
        let Some(crossing) = self.crossings.remove(&number) else { return };
        if let Some(numbers) = self.crossings_to.get_mut(&crossing.target()) {
            numbers.retain(|&other| other != number);
            if numbers.is_empty() {
                self.crossings_to.remove(&crossing.target());
            }
        }
    }

    /// The receiver was buried: every loop with a link to it is told.
    pub(crate) fn bury_crossings(&mut self, target: ObjectId) {
        for number in self.crossings_to.remove(&target).unwrap_or_default() {
            if let Some(crossing) = self.crossings.get(&number).cloned() {
                let gone = crossing.end(self);
                drop(crossing);
                let former = self.note_gone_crossing(number, gone);
                self.guarded(move |_| drop(former));
            }
        }
    }

    /// Runs work of a framework object in the next round, in order with queued calls; nothing if the
    /// object is gone by then.
    pub(crate) fn post_own(&mut self, object: impl Into<ObjectId>, work: impl FnOnce(&mut Cx) + 'static) {
        self.queue_once(Box::new(OwnWork { object: object.into(), work: Box::new(work) }));
    }

    pub(crate) fn own_mailbox(&self) -> Arc<Mailbox> {
        self.inbox.mailbox().clone()
    }

    pub(crate) fn is_my_mailbox(&self, mailbox: &Arc<Mailbox>) -> bool {
        Arc::ptr_eq(mailbox, self.inbox.mailbox())
    }

    /// Keeps a request for step 8. One too many is refused and counted; the notice that a receiver is gone
    /// never is, and comes at most once per link.
    pub(crate) fn keep_rewire(&mut self, rewire: Rewire) -> Result<(), PostError> {
        let room = self.settings.rewires_max;
        if self.rewires.len() < room || matches!(rewire, Rewire::Lost { .. }) {
            self.rewires.push_back(rewire);
            return Ok(());
        }
        self.counters.links_refused += 1;
        if self.may_log() {
            tracing::warn!(waiting = room, "too many requests to attach or detach: one was refused");
        }
        Err(PostError::Full(room))
    }

    /// A request to the loop of the signal.
    ///
    /// # Errors
    /// If there is no room for it; it is counted and logged.
    pub(crate) fn post_rewire(&mut self, there: &There, rewire: Rewire) -> Result<(), PostError> {
        if self.is_mine(there) {
            return self.keep_rewire(rewire);
        }
        let posted = there.mailbox.post(Message::Rewire(Box::new(rewire)));
        if let Err(error) = posted {
            self.counters.links_refused += 1;
            if self.may_log() {
                tracing::warn!("a request to attach or detach was refused by another thread: {error}");
            }
        }
        posted
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::Simulation;

    struct Guest;
    crate::object! { Guest { } }

    #[test]
    fn messages_taken_while_the_loop_waits_stay_within_the_bound() {
        const ROOM: usize = 100;
        let mut app = Simulation::new(1).app_with(|settings| settings.mailbox_messages_max = ROOM);
        let cx = app.cx();
        let guest = cx.spawn(Guest);
        let guest = cx.remote(guest);
        let mut accepted = 0;
        for _ in 0..10 {
            while guest.post(|_, _| ()).is_ok() {
                accepted += 1;
            }
            // As in the spin before a deadline: no step 6 comes between.
            cx.take_messages();
        }
        assert_eq!(accepted, 2 * ROOM, "as many as wait, and as many as were taken");
        cx.run_remote_calls();
        assert!(cx.take_messages());
    }
}
