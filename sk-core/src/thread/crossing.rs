//! A link between two threads: its own ring of arguments, and a token in the mailbox per call.
//!
//! A call has no allocation of its own: the arguments go into the link's ring, the mailbox carries the link's
//! number. The mailbox itself is a list of blocks and takes one for every 31 messages. A ring that is full is
//! followed by one of twice its size; the mailbox tells the receiver where the old one ends, so the order is
//! kept.

use crate::Cx;
use crate::object::ObjectId;
use crate::signal::{Call, Delivery, LinkKey, LinkLosses, Mode, Reached, Rewire, SlotMeta};
use crate::thread::{Mailbox, Message, PostError, There};
use crossbeam_queue::ArrayQueue;
use std::any::{Any, TypeId};
use std::borrow::Borrow;
use std::cell::{Cell, RefCell};
use std::marker::PhantomData;
use std::rc::Rc;
use std::sync::Arc;

/// The first ring of a crossing; most links never have more calls under way.
const RING_CALLS_FIRST: usize = 16;
/// The largest.
const RING_CALLS_MAX: usize = 65_536;

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
    fn run_next(&self, cx: &mut Cx);
    fn next_ring(&self, ring: Box<dyn Any + Send>);
    fn target(&self) -> ObjectId;
    /// Tells the sender's loop that the receiver is gone.
    fn tell_gone(&self);
}

enum Outlet<T> {
    Ring(RefCell<rtrb::Producer<T>>),
    Newest(Arc<ArrayQueue<T>>),
}

enum Inlet<T> {
    Ring(RefCell<rtrb::Consumer<T>>),
    Newest(Arc<ArrayQueue<T>>),
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
}

struct Receiving<A: ?Sized + ToOwned> {
    call: Rc<dyn Call<A>>,
    inlet: Inlet<A::Owned>,
    back: WayBack,
    carries: PhantomData<fn(&A)>,
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
    // A closed mailbox shows in the first call: `is_closed`.
    let _ = mailbox.post_anyway(Message::Settle(Box::new(move |cx| {
        receive::<A>(cx, number, target, slot, inlet, back);
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
    back: WayBack,
) where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    let bound = cx.bind(target, slot.uid, TypeId::of::<A>());
    match bound.and_then(|bound| bound.downcast::<Rc<dyn Call<A>>>().ok()) {
        Some(call) => {
            let receiving = Receiving::<A> { call: *call, inlet, back, carries: PhantomData };
            cx.open_crossing(number, target, Rc::new(receiving));
        }
        None => {
            tracing::warn!(slot = slot.name, "a link from another thread found no such receiver");
            tell(&back, target, slot.uid);
        }
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
                None => self.mailbox.post_anyway(Message::Call(self.number)),
            },
            Outlet::Ring(ring) => self.send_by_ring(&mut ring.borrow_mut(), args),
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
    fn send_by_ring(&self, ring: &mut rtrb::Producer<A::Owned>, args: &A) -> Result<(), PostError> {
        // The room in the mailbox is looked at first: arguments without a token would shift all later calls.
        self.mailbox.check_room()?;
        if ring.is_full() {
            let larger = (ring.buffer().capacity() * 2).min(RING_CALLS_MAX);
            if larger == ring.buffer().capacity() {
                return Err(PostError::Full(larger));
            }
            let (producer, consumer) = rtrb::RingBuffer::<A::Owned>::new(larger);
            *ring = producer;
            self.mailbox.post_anyway(Message::Ring(self.number, Box::new(consumer)))?;
        }
        if ring.push(args.to_owned()).is_err() {
            return Err(PostError::Full(ring.buffer().capacity()));
        }
        self.mailbox.post_anyway(Message::Call(self.number))
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

impl<A> RemoteReceive for Receiving<A>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    fn run_next(&self, cx: &mut Cx) {
        let args = match &self.inlet {
            Inlet::Ring(ring) => ring.borrow_mut().pop().ok(),
            Inlet::Newest(newest) => newest.pop(),
        };
        if let Some(args) = args
            && self.call.call(cx, args.borrow(), crate::object::WAITING) != Reached::Ran
        {
            cx.counters.gone += 1;
        }
    }

    fn next_ring(&self, ring: Box<dyn Any + Send>) {
        if let Inlet::Ring(at) = &self.inlet
            && let Ok(ring) = ring.downcast::<rtrb::Consumer<A::Owned>>()
        {
            *at.borrow_mut() = *ring;
        }
    }

    fn target(&self) -> ObjectId {
        self.call.target()
    }

    fn tell_gone(&self) {
        tell(&self.back, self.call.target(), self.call.slot().uid);
    }
}
