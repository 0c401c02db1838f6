//! One link of a signal: to whom, how, and what waits on it.

use crate::Cx;
use crate::object::{MARKED, WAITING};
use crate::signal::{Call, Delivery, LinkKey, Mode, Reached, SlotMeta};
use crate::sys::role::Held;
use crate::thread::RemoteSend;
use std::borrow::Borrow;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;

/// A link's own queue keeps room for this many calls, and for what it lately needed.
const QUEUE_KEPT_MAX: usize = 64;
/// After so many rounds in use a link looks whether its queue is larger than it needs.
const ROUNDS_BETWEEN_LOOKS: u64 = 8;

/// 32 bytes.
pub(crate) struct Link<A: ?Sized + ToOwned> {
    pub kind: Kind<A>,
    /// Tells most other links apart without a look at their receivers.
    fingerprint: u64,
}

pub(crate) enum Kind<A: ?Sized + ToOwned> {
    /// The hot one: nothing between it and the slot.
    Direct(Held<dyn Call<A>>),
    /// Everything else on this thread.
    Kept(Rc<Kept<A>>),
    /// To another thread.
    Remote(Rc<dyn RemoteSend<A>>),
}

impl<A: ?Sized + ToOwned> Clone for Link<A> {
    fn clone(&self) -> Self {
        let kind = match &self.kind {
            Kind::Direct(call) => Kind::Direct(call.clone()),
            Kind::Kept(kept) => Kind::Kept(kept.clone()),
            Kind::Remote(remote) => Kind::Remote(remote.clone()),
        };
        Link { kind, fingerprint: self.fingerprint }
    }
}

/// The links of a signal, in the order they were attached. Frozen from rewire to rewire.
pub(crate) enum Links<A: ?Sized + ToOwned> {
    /// Most signals that are heard at all have one listener, which costs no list.
    One(Link<A>),
    Many(Vec<Link<A>>),
}

impl<A: ?Sized + ToOwned> Clone for Links<A> {
    fn clone(&self) -> Self {
        match self {
            Links::One(link) => Links::One(link.clone()),
            Links::Many(links) => Links::Many(links.clone()),
        }
    }
}

impl<A: ?Sized + ToOwned> Links<A> {
    pub(crate) fn of(mut links: Vec<Link<A>>) -> Option<Links<A>> {
        match links.len() {
            0 => None,
            1 => links.pop().map(Links::One),
            _ => Some(Links::Many(links)),
        }
    }

    pub(crate) fn into_vec(self) -> Vec<Link<A>> {
        match self {
            Links::One(link) => vec![link],
            Links::Many(links) => links,
        }
    }

    pub(crate) fn as_slice(&self) -> &[Link<A>] {
        match self {
            Links::One(link) => std::slice::from_ref(link),
            Links::Many(links) => links,
        }
    }
}

/// A link that is queued, or spent after one call, or both.
pub(crate) struct Kept<A: ?Sized + ToOwned> {
    pub call: Held<dyn Call<A>>,
    pub mode: Mode,
    pub spent: Cell<bool>,
    /// Arguments of the calls that wait, oldest first: a queued call needs no box of its own.
    waiting: RefCell<VecDeque<A::Owned>>,
    /// How many waited at most since the room was last looked at.
    most: Cell<usize>,
    look_again_at: Cell<u64>,
    losses: LinkLosses,
}

/// What a link did not deliver.
#[derive(Debug, Default)]
pub(crate) struct LinkLosses {
    replaced: Cell<u64>,
    refused: Cell<u64>,
}

impl LinkLosses {
    pub(crate) fn note_replaced(&self, cx: &mut Cx) {
        self.replaced.set(self.replaced.get() + 1);
        cx.counters.replaced += 1;
    }

    pub(crate) fn note_refused(&self) {
        self.refused.set(self.refused.get() + 1);
    }

    /// How many calls a newer one replaced, and how many found a queue full.
    pub(crate) fn counts(&self) -> (u64, u64) {
        (self.replaced.get(), self.refused.get())
    }
}

impl<A: ?Sized + ToOwned + 'static> Kept<A> {
    pub(crate) fn new(call: Held<dyn Call<A>>, mode: Mode) -> Rc<Kept<A>> {
        Rc::new(Kept {
            call,
            mode,
            spent: Cell::new(false),
            waiting: RefCell::default(),
            most: Cell::new(0),
            look_again_at: Cell::new(0),
            losses: LinkLosses::default(),
        })
    }

    fn emit(self: &Rc<Self>, cx: &mut Cx, args: &A) {
        if self.mode.once {
            if self.spent.replace(true) {
                return;
            }
            cx.note_spent_link();
        }
        let taken = match self.mode.delivery {
            Delivery::Direct => call_directly(&self.call, cx, args),
            Delivery::Queued => self.queue(cx, args),
            Delivery::Latest => self.replace(cx, args) || self.queue(cx, args),
        };
        if !taken {
            self.note_refused();
        }
    }

    /// A one-shot that nobody will hear waits for its next call: it is spent before a call, but not by one
    /// that a full queue refused.
    #[cold]
    fn note_refused(&self) {
        self.spent.set(false);
        self.losses.note_refused();
    }

    /// Whether a call of the link waits already, and so carries the newer arguments now.
    fn replace(&self, cx: &mut Cx, args: &A) -> bool {
        let mut waiting = self.waiting.borrow_mut();
        let Some(older) = waiting.front_mut() else { return false };
        *older = args.to_owned();
        self.losses.note_replaced(cx);
        true
    }

    /// Not whenever the queue is short: a link that fills it every round must not allocate every round.
    #[cold]
    fn give_room_back(&self, waiting: &mut VecDeque<A::Owned>, round: u64) {
        let most = self.most.replace(waiting.len());
        self.look_again_at.set(round + ROUNDS_BETWEEN_LOOKS);
        if waiting.capacity() > QUEUE_KEPT_MAX.max(most * 4) {
            waiting.shrink_to(QUEUE_KEPT_MAX.max(most * 2));
        }
    }

    /// Answers `false` if the queue is full.
    fn queue(self: &Rc<Self>, cx: &mut Cx, args: &A) -> bool {
        if self.call.header().has(MARKED) {
            cx.counters.gone += 1;
            cx.note_dead_link();
            return true;
        }
        if !cx.queue_has_room() {
            return false;
        }
        let mut waiting = self.waiting.borrow_mut();
        waiting.push_back(args.to_owned());
        self.most.set(self.most.get().max(waiting.len()));
        drop(waiting);
        cx.queue.push_link(self);
        true
    }
}

impl<A: ?Sized + ToOwned> Link<A> {
    pub(crate) fn new(key: LinkKey, kind: Kind<A>) -> Link<A> {
        Link { kind, fingerprint: key.fingerprint() }
    }

    pub(crate) fn has(&self, key: LinkKey) -> bool {
        self.fingerprint == key.fingerprint() && self.key() == key
    }

    pub(crate) fn key(&self) -> LinkKey {
        let target = match &self.kind {
            Kind::Direct(call) => call.target(),
            Kind::Kept(kept) => kept.call.target(),
            Kind::Remote(remote) => remote.target(),
        };
        LinkKey { target, slot: self.slot().uid }
    }

    /// Whether the link will never call again: spent, or its receiver is buried.
    pub(crate) fn is_dead(&self) -> bool {
        match &self.kind {
            Kind::Direct(call) => call.is_shell(),
            Kind::Kept(kept) => kept.spent.get() || kept.call.is_shell(),
            Kind::Remote(remote) => remote.is_closed(),
        }
    }

    pub(crate) fn mode(&self) -> Mode {
        match &self.kind {
            Kind::Direct(_) => Mode::Direct,
            Kind::Kept(kept) => kept.mode,
            Kind::Remote(remote) => remote.mode(),
        }
    }

    pub(crate) fn losses(&self) -> (u64, u64) {
        match &self.kind {
            Kind::Direct(_) => (0, 0),
            Kind::Kept(kept) => kept.losses.counts(),
            Kind::Remote(remote) => remote.losses(),
        }
    }

    pub(crate) fn slot(&self) -> &'static SlotMeta {
        match &self.kind {
            Kind::Direct(call) => call.slot(),
            Kind::Kept(kept) => kept.call.slot(),
            Kind::Remote(remote) => remote.slot(),
        }
    }
}

impl<A: ?Sized + ToOwned + 'static> Link<A> {
    /// What is not the hot case.
    #[inline(never)]
    pub(crate) fn emit_kept(&self, cx: &mut Cx, args: &A) {
        match &self.kind {
            Kind::Direct(call) => {
                call_directly(call, cx, args);
            }
            Kind::Kept(kept) => kept.emit(cx, args),
            Kind::Remote(remote) => remote.send(cx, args),
        }
    }

    /// Beyond the depth limit a direct call becomes a queued one.
    pub(crate) fn emit_flat(&self, cx: &mut Cx, args: &A) {
        match &self.kind {
            Kind::Direct(call) => {
                put_off(call, cx, args);
            }
            Kind::Kept(kept) if kept.mode.delivery == Delivery::Direct => {
                if !kept.spent.replace(true) {
                    cx.note_spent_link();
                    if !put_off(&kept.call, cx, args) {
                        kept.note_refused();
                    }
                }
            }
            _ => self.emit_kept(cx, args),
        }
    }
}

/// Answers `false` if the queue is full.
fn put_off<A: ?Sized + ToOwned + 'static>(call: &Held<dyn Call<A>>, cx: &mut Cx, args: &A) -> bool {
    cx.counters.deepened += 1;
    if !cx.queue_has_room() {
        return false;
    }
    cx.queue_once(Parked::<A>::boxed(call.clone(), args.to_owned()));
    true
}

/// Answers `false` if the call was to wait and found no room.
fn call_directly<A: ?Sized + ToOwned + 'static>(call: &Held<dyn Call<A>>, cx: &mut Cx, args: &A) -> bool {
    let reached = call.call(cx, args, 0);
    reached == Reached::Ran || missed(call, cx, args, reached)
}

/// A direct call that could not run: parked if its object is busy, counted if it is gone. Answers `false`
/// if there was no room to park it.
#[cold]
#[inline(never)]
pub(crate) fn missed<A: ?Sized + ToOwned + 'static>(
    call: &Held<dyn Call<A>>,
    cx: &mut Cx,
    args: &A,
    reached: Reached,
) -> bool {
    match reached {
        Reached::Ran => true,
        Reached::Busy => cx.park(call.header(), || Parked::<A>::boxed(call.clone(), args.to_owned())),
        Reached::Gone => {
            cx.counters.gone += 1;
            cx.note_dead_link();
            true
        }
    }
}

/// A queue of calls that waits for the loop to come round: one per link, one token per call.
pub(crate) trait QueuedCall {
    /// Runs the oldest waiting call.
    fn run_next(&self, cx: &mut Cx);
}

impl<A: ?Sized + ToOwned + 'static> QueuedCall for Kept<A> {
    fn run_next(&self, cx: &mut Cx) {
        let mut waiting = self.waiting.borrow_mut();
        let Some(args) = waiting.pop_front() else { return };
        if cx.pulse.round >= self.look_again_at.get() {
            self.give_room_back(&mut waiting, cx.pulse.round);
        }
        drop(waiting);
        run_queued(&*self.call, cx, args.borrow());
    }
}

/// Runs a call from the queue; calls that wait for the object do not hinder it: it keeps its own place.
pub(crate) fn run_queued<A: ?Sized>(call: &dyn Call<A>, cx: &mut Cx, args: &A) {
    if call.call(cx, args, WAITING) != Reached::Ran {
        cx.counters.gone += 1;
    }
}

/// One call with its arguments, kept until its object is free or the next round.
pub(crate) trait OnceCall {
    /// Runs it; nothing hinders it but the end of its object.
    fn run(self: Box<Self>, cx: &mut Cx);
}

pub(crate) struct Parked<A: ?Sized + ToOwned> {
    call: Held<dyn Call<A>>,
    args: A::Owned,
}

impl<A: ?Sized + ToOwned + 'static> Parked<A> {
    pub(crate) fn boxed(call: Held<dyn Call<A>>, args: A::Owned) -> Box<dyn OnceCall> {
        Box::new(Parked::<A> { call, args })
    }
}

impl<A: ?Sized + ToOwned + 'static> OnceCall for Parked<A> {
    fn run(self: Box<Self>, cx: &mut Cx) {
        run_queued(&*self.call, cx, self.args.borrow());
    }
}
