//! A link between two threads: its own ring of arguments, and a token in the mailbox for a run of calls.
//!
//! A call has no allocation of its own: the arguments go into the link's ring. The mailbox carries the link's
//! number once for a *run*, which is calls that follow each other with nothing else of the same thread to the
//! same loop between them. So a burst costs one queue operation, and calls, posts and rewires of a thread are
//! one FIFO all the same. Each call in the ring bears the number of its run; the loop marks a run as taken
//! and runs what bears its number or a former one. A sender that finds its run taken begins the next.
//!
//! A ring that is full is followed by one of twice its size; the mailbox tells the receiver where the old one
//! ends, so the order is kept. The mailbox itself is a list of blocks and takes one for every 31 messages.

use crate::Cx;
use crate::object::ObjectId;
use crate::signal::{Call, Delivery, LinkKey, LinkLosses, Mode, Reached, Rewire, SlotMeta};
use crate::thread::mailbox::Apart;
use crate::thread::{Mailbox, Message, PostError, There};
use crossbeam_queue::ArrayQueue;
use std::any::{Any, TypeId};
use std::borrow::Borrow;
use std::cell::{Cell, RefCell};
use std::marker::PhantomData;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// The first ring of a crossing; most links never have more calls under way.
const RING_CALLS_FIRST: usize = 16;
/// The largest.
const RING_CALLS_MAX: usize = 65_536;
/// After so many calls the receiver says that they no longer wait.
const CALLS_PER_COUNT: usize = 32;

/// How links of a `Signal<A>` cross threads: known where `A::Owned: Send` is.
#[doc(hidden)]
#[derive(Clone, Copy)]
pub struct Crossing {
    /// Gives an `Rc<dyn RemoteSend<A>>`.
    pub(crate) open: fn(&There, &'static SlotMeta, Mode, WayBack) -> Box<dyn Any>,
}

/// Where the news goes that the receiver is gone.
#[doc(hidden)]
pub struct WayBack {
    pub(crate) there: There,
    pub(crate) signal: u64,
}

impl Crossing {
    pub fn of<A>() -> Crossing
    where
        A: ?Sized + ToOwned + 'static,
        A::Owned: Send,
    {
        Crossing { open: open::<A> }
    }
}

/// The sender's end.
#[doc(hidden)]
pub trait RemoteSend<A: ?Sized> {
    fn send(&self, cx: &mut Cx, args: &A);
    fn is_closed(&self) -> bool;
    fn mode(&self) -> Mode;
    fn slot(&self) -> &'static SlotMeta;
    /// The receiver, within its loop.
    fn target(&self) -> ObjectId;
    /// How many calls a newer one replaced, and how many found the mailbox full.
    fn losses(&self) -> (u64, u64);
}

/// The receiver's end.
pub(crate) trait RemoteReceive {
    /// Step 3: calls that come from now on belong to a later run, but for one that is being sent just now.
    fn take_run(&self, run: u32);
    /// Step 6: runs what was sent up to that run, `most` calls at most. Answers how many; if that is `most`,
    /// some may be left.
    fn run_calls(&self, cx: &mut Cx, run: u32, most: usize) -> usize;
    fn run_newest(&self, cx: &mut Cx);
    fn next_ring(&self, ring: Box<dyn Any + Send>);
    fn target(&self) -> ObjectId;
    /// The receiver is gone: tells the sender's loop, and answers what stands in its place from now on.
    fn end(&self, cx: &mut Cx) -> Rc<dyn RemoteReceive>;
}

/// The number of a run, and the arguments of one of its calls.
type Numbered<T> = (u32, T);

enum Outlet<T> {
    Ring(RefCell<rtrb::Producer<Numbered<T>>>),
    Newest(Arc<ArrayQueue<T>>),
}

enum Inlet<T> {
    Ring(RefCell<rtrb::Consumer<Numbered<T>>>),
    Newest(Arc<ArrayQueue<T>>),
}

/// What the two ends know of each other. Calls are numbered from 1 on, and a run by one of its first two calls.
/// The numbers go round; those in use are never half of them apart, because a mailbox holds fewer calls.
#[derive(Default)]
struct Ends {
    /// The last call. It is written before the call is counted in the mailbox.
    sent: Apart<AtomicU32>,
    /// The last run that the receiver has taken; or `GONE`.
    taken: Apart<AtomicU64>,
}

/// The receiver will take nothing more: each call has a token of its own from now on.
const GONE: u64 = 1 << 32;

impl Ends {
    #[inline]
    fn is_taken(&self, run: u32) -> bool {
        let taken = self.taken.0.load(Ordering::SeqCst);
        taken == GONE || is_up_to(run, taken as u32)
    }
}

#[inline]
fn is_up_to(run: u32, last: u32) -> bool {
    last.wrapping_sub(run) <= u32::MAX / 2
}

struct Sending<A: ?Sized + ToOwned> {
    mailbox: Arc<Mailbox>,
    number: u64,
    mode: Mode,
    slot: &'static SlotMeta,
    target: ObjectId,
    spent: Cell<bool>,
    losses: LinkLosses,
    outlet: Outlet<A::Owned>,
    /// The run that the last call belongs to, or the next one if that was taken already.
    run: Cell<u32>,
    ends: Arc<Ends>,
}

struct Receiving<A: ?Sized + ToOwned> {
    call: Rc<dyn Call<A>>,
    inlet: Inlet<A::Owned>,
    ends: Arc<Ends>,
    /// The last call that has run.
    done: Cell<u32>,
    is_gone: Cell<bool>,
    back: WayBack,
    carries: PhantomData<fn(&A)>,
}

/// Stands in the place of a receiver that is gone, and counts what still comes, until the sender's end goes.
struct Gone {
    /// The last call that was counted.
    passed: Cell<u32>,
    target: ObjectId,
}

fn open<A>(there: &There, slot: &'static SlotMeta, mode: Mode, back: WayBack) -> Box<dyn Any>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    let (outlet, inlet) = match mode.delivery {
        Delivery::Latest => {
            let newest = Arc::new(ArrayQueue::new(1));
            (Outlet::Newest(newest.clone()), Inlet::Newest(newest))
        }
        Delivery::Queued | Delivery::Direct => {
            let (producer, consumer) = rtrb::RingBuffer::new(RING_CALLS_FIRST);
            (Outlet::Ring(RefCell::new(producer)), Inlet::Ring(RefCell::new(consumer)))
        }
    };
    let mailbox = there.mailbox.clone();
    let number = mailbox.new_crossing();
    let target = there.id;
    let ends = Arc::new(Ends::default());
    let ends_there = ends.clone();
    // A closed mailbox shows in the first call: `is_closed`.
    let _ = mailbox.post_anyway(Message::Settle(Box::new(move |cx| {
        receive::<A>(cx, number, target, slot, inlet, ends_there, back);
    })));
    let sending: Rc<dyn RemoteSend<A>> = Rc::new(Sending::<A> {
        mailbox,
        number,
        mode,
        slot,
        target,
        spent: Cell::new(false),
        losses: LinkLosses::default(),
        outlet,
        run: Cell::new(0),
        ends,
    });
    Box::new(sending)
}

/// At the far end: binds the slot and registers the crossing.
fn receive<A>(
    cx: &mut Cx,
    number: u64,
    target: ObjectId,
    slot: &'static SlotMeta,
    inlet: Inlet<A::Owned>,
    ends: Arc<Ends>,
    back: WayBack,
) where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    let bound = cx.bind(target, slot.uid, TypeId::of::<A>());
    match bound.and_then(|bound| bound.downcast::<Rc<dyn Call<A>>>().ok()) {
        Some(call) => {
            let (done, is_gone) = (Cell::new(0), Cell::new(false));
            let receiving =
                Receiving::<A> { call: *call, inlet, ends, done, is_gone, back, carries: PhantomData };
            cx.open_crossing(number, Rc::new(receiving));
        }
        None => {
            tracing::warn!(slot = slot.name, "a link from another thread found no such receiver");
            let gone = Gone::after(cx, &ends, 0, target);
            cx.note_gone_crossing(number, gone);
            tell(&back, target, slot.uid);
        }
    }
}

impl Gone {
    /// Calls after `done` will not run. The ring goes with its receiver.
    fn after(cx: &mut Cx, ends: &Ends, done: u32, target: ObjectId) -> Rc<dyn RemoteReceive> {
        ends.taken.0.store(GONE, Ordering::SeqCst);
        cx.see_what_was_counted();
        // A call that is not among these finds `GONE` and has a token of its own.
        let sent = ends.sent.0.load(Ordering::Relaxed);
        cx.count_gone_calls(sent.wrapping_sub(done));
        Rc::new(Gone { passed: Cell::new(sent), target })
    }
}

fn tell(back: &WayBack, target: ObjectId, slot: u64) {
    let lost = Rewire::Lost { source: back.there.id, signal: back.signal, key: LinkKey { target, slot } };
    // The sender's loop may have ended first: then there is nobody to tell.
    let _ = back.there.mailbox.post_anyway(Message::Rewire(Box::new(lost)));
}

impl<A> RemoteSend<A> for Sending<A>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    fn send(&self, cx: &mut Cx, args: &A) {
        if self.mode.once {
            if self.spent.replace(true) {
                return;
            }
            cx.note_spent_link();
        }
        let sent = match &self.outlet {
            Outlet::Newest(newest) => match newest.force_push(args.to_owned()) {
                // Its token is under way still.
                Some(_replaced) => {
                    self.losses.note_replaced(cx);
                    Ok(())
                }
                // A token that is refused would leave its arguments behind, and every later call would
                // take them for one under way. One place is the link's own, so it is never refused.
                None => self.mailbox.post_anyway(Message::Newest(self.number)),
            },
            Outlet::Ring(ring) => self.send_by_ring(ring, args),
        };
        match sent {
            Ok(()) => {}
            Err(PostError::Full(_)) => {
                // A one-shot that nobody will hear waits for its next call.
                self.spent.set(false);
                self.losses.note_refused();
                cx.refused_full();
            }
            Err(PostError::Gone) => {
                cx.counters.gone += 1;
                cx.note_dead_link();
            }
        }
    }

    fn is_closed(&self) -> bool {
        self.spent.get() || self.mailbox.is_closed()
    }

    fn mode(&self) -> Mode {
        self.mode
    }

    fn slot(&self) -> &'static SlotMeta {
        self.slot
    }

    fn target(&self) -> ObjectId {
        self.target
    }

    fn losses(&self) -> (u64, u64) {
        self.losses.counts()
    }
}

impl<A> Sending<A>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    fn send_by_ring(
        &self,
        ring: &RefCell<rtrb::Producer<Numbered<A::Owned>>>,
        args: &A,
    ) -> Result<(), PostError> {
        if self.mailbox.is_closed() {
            return Err(PostError::Gone);
        }
        // The room in the mailbox is looked at first: arguments without a token would shift all later calls.
        self.mailbox.check_room()?;
        // The user's own code, which may send something too: before anything else is looked at.
        let args = args.to_owned();
        let ring = &mut *ring.borrow_mut();
        if ring.is_full() {
            self.take_larger(ring)?;
        }
        let call = self.ends.sent.0.load(Ordering::Relaxed).wrapping_add(1);
        let goes_on = self.mailbox.ends_with(self.number);
        if !goes_on {
            self.run.set(call);
        }
        if ring.push((self.run.get(), args)).is_err() {
            return Err(PostError::Full(ring.buffer().capacity()));
        }
        self.ends.sent.0.store(call, Ordering::Relaxed);
        self.mailbox.count();
        if !goes_on {
            return self.mailbox.put_in_token(self.number, call);
        }
        if !self.ends.is_taken(self.run.get()) {
            return Ok(());
        }
        // Its token was taken. Perhaps the receiver has seen this call; if not, the next token covers it.
        self.run.set(call);
        self.mailbox.put_in_token(self.number, call)
    }

    #[cold]
    fn take_larger(&self, ring: &mut rtrb::Producer<Numbered<A::Owned>>) -> Result<(), PostError> {
        let larger = (ring.buffer().capacity() * 2).min(RING_CALLS_MAX);
        if larger == ring.buffer().capacity() {
            return Err(PostError::Full(larger));
        }
        let (producer, consumer) = rtrb::RingBuffer::<Numbered<A::Owned>>::new(larger);
        *ring = producer;
        self.mailbox.post_anyway(Message::Ring(self.number, Box::new(consumer)))
    }
}

impl<A: ?Sized + ToOwned> Drop for Sending<A> {
    fn drop(&mut self) {
        let number = self.number;
        // Behind the calls that are under way: those are still delivered.
        let _ = self
            .mailbox
            .post_anyway(Message::Run(Box::new(move |cx| cx.close_crossing(number))));
    }
}

impl<A> Receiving<A>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    fn next_up_to(&self, run: u32) -> Option<A::Owned> {
        let Inlet::Ring(ring) = &self.inlet else { return None };
        let mut ring = ring.borrow_mut();
        let is_taken = ring.peek().is_ok_and(|(of, _)| is_up_to(*of, run));
        if is_taken { ring.pop().ok().map(|(_, args)| args) } else { None }
    }

    /// One call, with a guard of its own. The arguments go within it: their `Drop` is the user's.
    fn run(&self, cx: &mut Cx, args: A::Owned) {
        cx.top_level(move |cx| {
            if self.call.call(cx, args.borrow(), crate::object::WAITING) != Reached::Ran {
                cx.counters.gone += 1;
            }
        });
    }
}

impl<A> RemoteReceive for Receiving<A>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    fn take_run(&self, run: u32) {
        self.ends.taken.0.store(u64::from(run), Ordering::SeqCst);
    }

    fn run_calls(&self, cx: &mut Cx, run: u32, most: usize) -> usize {
        let (mut ran, mut counted) = (0, 0);
        while ran < most
            && !self.is_gone.get()
            && let Some(args) = self.next_up_to(run)
        {
            ran += 1;
            self.done.set(self.done.get().wrapping_add(1));
            self.run(cx, args);
            if ran - counted == CALLS_PER_COUNT {
                cx.count_off_calls(CALLS_PER_COUNT);
                counted = ran;
            }
        }
        cx.count_off_calls(ran - counted);
        ran
    }

    fn run_newest(&self, cx: &mut Cx) {
        if let Inlet::Newest(newest) = &self.inlet
            && let Some(args) = newest.pop()
        {
            self.run(cx, args);
        }
    }

    fn next_ring(&self, ring: Box<dyn Any + Send>) {
        if let Inlet::Ring(at) = &self.inlet
            && let Ok(ring) = ring.downcast::<rtrb::Consumer<Numbered<A::Owned>>>()
        {
            *at.borrow_mut() = *ring;
        }
    }

    fn target(&self) -> ObjectId {
        self.call.target()
    }

    fn end(&self, cx: &mut Cx) -> Rc<dyn RemoteReceive> {
        self.is_gone.set(true);
        tell(&self.back, self.call.target(), self.call.slot().uid);
        Gone::after(cx, &self.ends, self.done.get(), self.call.target())
    }
}

impl RemoteReceive for Gone {
    fn take_run(&self, _run: u32) {}

    fn run_calls(&self, cx: &mut Cx, run: u32, _most: usize) -> usize {
        let calls = run.wrapping_sub(self.passed.get());
        // A token from before the end covers calls that were counted then.
        if is_up_to(self.passed.get(), run) {
            self.passed.set(run);
            cx.count_gone_calls(calls);
        }
        0
    }

    fn run_newest(&self, cx: &mut Cx) {
        cx.counters.gone += 1;
    }

    fn next_ring(&self, _ring: Box<dyn Any + Send>) {}

    fn target(&self) -> ObjectId {
        self.target
    }

    fn end(&self, _cx: &mut Cx) -> Rc<dyn RemoteReceive> {
        Rc::new(Gone { passed: self.passed.clone(), target: self.target })
    }
}
