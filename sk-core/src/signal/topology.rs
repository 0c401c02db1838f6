//! Attach and detach: requests made at any time, carried out in the rewire step of a round.

use crate::Cx;
use crate::object::{MARKED, ObjectId, Place, TO_SWEEP};
use crate::signal::signal::End;
use crate::signal::{
    AnySignal, AttachMode, Attached, Mode, Order, SignalMeta, SignalRef, SlotFor, SlotMeta, SlotRef, SlotTag,
};
use crate::thread::{Crossing, There};
use rustc_hash::FxBuildHasher;
use std::any::TypeId;
use std::hash::BuildHasher;
use std::rc::Rc;

/// Room for this many requests is kept from round to round; a program that is wired up makes many once.
const REWIRES_KEPT_MAX: usize = 1024;

/// An object of this loop, or of another thread's.
#[doc(hidden)]
#[derive(Clone)]
pub enum Target {
    Local(ObjectId),
    Remote(There),
}

/// What makes two links of a signal the same: the receiver and its slot, whatever the mode.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LinkKey {
    pub(crate) target: ObjectId,
    pub(crate) slot: u64,
}

impl LinkKey {
    /// The same for the same key, and rarely for another.
    pub(crate) fn fingerprint(self) -> u64 {
        FxBuildHasher.hash_one(self)
    }
}

/// A link that is asked for.
#[derive(Clone)]
pub(crate) struct Wish {
    pub source: ObjectId,
    pub signal: &'static SignalMeta,
    pub target: Target,
    pub slot: &'static SlotMeta,
    pub mode: Mode,
    pub ignoring: bool,
    pub crossing: Option<Crossing>,
}

/// A change of the graph, waiting for the rewire step.
pub(crate) enum Rewire {
    Attach(Wish),
    Detach {
        source: ObjectId,
        signal: &'static SignalMeta,
        target: Target,
        slot: u64,
    },
    /// A receiver on another thread is gone.
    Lost {
        source: ObjectId,
        signal: u64,
        key: LinkKey,
    },
}

/// Which places a link can join: from here to here or there, from there to there.
#[diagnostic::on_unimplemented(
    message = "a remote signal reaches remote slots only",
    note = "make the receiver remote too: `attach!(cx, camera.frame => cx.remote(display).show, Queued)`"
)]
#[doc(hidden)]
pub trait Route {}
impl<P: Place> Route for (crate::object::Here, P) {}
impl Route for (There, There) {}
impl Route for (There, Nowhere) {}

/// Where no slot lives. With it the compiler does not take a remote slot for the only one that a remote
/// signal can reach, and so explains a local one with the words above instead of "mismatched types".
#[doc(hidden)]
pub struct Nowhere;

/// What [`attach!`](crate::attach) expands to: a check of types, and a plain request.
#[doc(hidden)]
#[inline]
pub fn attach<A, S, SP, TP, M>(cx: &mut Cx, signal: SignalRef<A, SP>, slot: SlotRef<S, TP>, _mode: M)
where
    A: ?Sized + ToOwned + 'static,
    S: SlotFor<A>,
    M: AttachMode<A, TP>,
    SP: Place,
    TP: Place,
    (SP, TP): Route,
{
    cx.request_attach(
        signal.place.target(),
        signal.meta,
        slot.target(),
        S::META,
        M::MODE,
        M::crossing(),
        false,
    );
}

/// What [`attach!`](crate::attach) expands to for `slot()`.
#[doc(hidden)]
#[inline]
pub fn attach_ignoring<A, S, SP, TP, M>(cx: &mut Cx, signal: SignalRef<A, SP>, slot: SlotRef<S, TP>, _mode: M)
where
    A: ?Sized + ToOwned + 'static,
    S: SlotFor<()>,
    M: AttachMode<(), TP>,
    SP: Place,
    TP: Place,
    (SP, TP): Route,
{
    cx.request_attach(
        signal.place.target(),
        signal.meta,
        slot.target(),
        S::META,
        M::MODE,
        M::crossing(),
        true,
    );
}

/// What [`detach!`](crate::detach) expands to.
#[doc(hidden)]
#[inline]
pub fn detach<A, S, SP, TP>(cx: &mut Cx, signal: SignalRef<A, SP>, slot: SlotRef<S, TP>)
where
    A: ?Sized + ToOwned + 'static,
    S: SlotTag,
    SP: Place,
    TP: Place,
{
    cx.request_detach(signal.place.target(), signal.meta, slot.target(), S::META);
}

impl Cx {
    #[expect(clippy::too_many_arguments, reason = "the plain-data end of a generic front")]
    fn request_attach(
        &mut self,
        source: Target,
        signal: &'static SignalMeta,
        target: Target,
        slot: &'static SlotMeta,
        mode: Mode,
        crossing: Option<Crossing>,
        ignoring: bool,
    ) {
        match source {
            Target::Local(source) => {
                let wish = Wish { source, signal, target, slot, mode, ignoring, crossing };
                // Refused, it is counted and logged.
                let _ = self.keep_rewire(Rewire::Attach(wish));
            }
            Target::Remote(there) => {
                let wish = Wish { source: there.id, signal, target, slot, mode, ignoring, crossing };
                // Refused, it is counted and logged.
                let _ = self.post_rewire(&there, Rewire::Attach(wish));
            }
        }
    }

    fn request_detach(
        &mut self,
        source: Target,
        signal: &'static SignalMeta,
        target: Target,
        slot: &'static SlotMeta,
    ) {
        match source {
            Target::Local(source) => {
                // Refused, it is counted and logged.
                let _ = self.keep_rewire(Rewire::Detach { source, signal, target, slot: slot.uid });
            }
            Target::Remote(there) => {
                let source = there.id;
                // Refused, it is counted and logged.
                let _ = self.post_rewire(&there, Rewire::Detach { source, signal, target, slot: slot.uid });
            }
        }
    }

    /// Step 8. Spent and dead links go first, so that a one-shot can be attached anew from its own slot.
    pub(crate) fn rewire(&mut self) {
        self.sweep_noted();
        // Requests made by what runs here (a log subscriber, a closing link) wait for the next round. A link
        // that goes may drop the last hold on arguments under way, whose `Drop` is the user's code.
        for _ in 0..self.rewires.len() {
            let Some(rewire) = self.rewires.pop_front() else { break };
            self.guarded(|cx| cx.carry_out(rewire));
        }
        self.rewires.shrink_to(REWIRES_KEPT_MAX);
    }

    fn carry_out(&mut self, rewire: Rewire) {
        match rewire {
            Rewire::Attach(wish) => self.make_link(wish),
            Rewire::Detach { source, signal, target, slot } => {
                let key = LinkKey { target: target_id(&target), slot };
                self.with_signal(source, signal.uid, |signal| signal.detach(key));
            }
            Rewire::Lost { source, signal, key } => {
                self.with_signal(source, signal, |signal| signal.detach(key));
            }
        }
    }

    fn sweep_noted(&mut self) {
        let mut noted = std::mem::take(&mut self.sweeps);
        for emitter in noted.drain(..) {
            self.sweep(emitter);
        }
        self.sweeps = noted;
    }

    /// Every signal of the loop gives up its links to buried receivers.
    pub(crate) fn sweep_everything(&mut self) {
        let ids: Vec<ObjectId> = self.table.ids().collect();
        for id in ids {
            self.sweep(id);
        }
    }

    fn sweep(&mut self, emitter: ObjectId) {
        if let Some(node) = self.table.node(emitter).cloned() {
            node.header().unset(TO_SWEEP);
            self.guarded(|_| {
                node.each_signal(&mut |_, signal| {
                    signal.sweep();
                });
            });
        }
    }

    fn with_signal<R>(
        &self,
        source: ObjectId,
        uid: u64,
        f: impl FnOnce(&mut dyn AnySignal) -> R,
    ) -> Option<R> {
        let node = self.table.node(source)?;
        let (mut f, mut answer) = (Some(f), None);
        let found = node.with_signal(uid, &mut |signal| answer = f.take().map(|f| f(signal)));
        found.ok().and(answer)
    }

    fn make_link(&mut self, wish: Wish) {
        let here = match &wish.target {
            Target::Local(id) => Some(*id),
            Target::Remote(there) => self.is_mine(there).then_some(there.id),
        };
        let Some(source) = self.table.node(wish.source).filter(|node| !node.header().has(MARKED)).cloned()
        else {
            self.counters.links_refused += 1;
            return;
        };
        if self.is_linked(&wish) {
            // Opening a crossing binds it at the far end at once, so a duplicate must be found before.
            self.count_duplicate(&wish);
            return;
        }
        let end = match (here, &wish.target) {
            (Some(id), _) => self.local_end(id, &wish),
            (None, Target::Remote(there)) => self.remote_end(there, &wish),
            (None, Target::Local(_)) => None,
        };
        let Some((end, key)) = end else {
            self.counters.links_refused += 1;
            return;
        };
        let order = Order { key, mode: wish.mode, end, ignoring: wish.ignoring };
        let mut attached = Attached::Mismatch;
        let _ = source.with_signal(wish.signal.uid, &mut {
            let mut order = Some(order);
            let attached = &mut attached;
            move |signal| {
                if let Some(order) = order.take() {
                    *attached = signal.attach(order);
                }
            }
        });
        match attached {
            Attached::New => {
                self.counters.links_made += 1;
                self.sources.listened_to(wish.source);
            }
            Attached::Mismatch => {
                self.counters.links_refused += 1;
                let (signal, slot) = (wish.signal, wish.slot);
                tracing::warn!(
                    ?signal,
                    ?slot,
                    "a link was refused: the slot does not take what the signal carries"
                );
            }
        }
    }

    fn count_duplicate(&mut self, wish: &Wish) {
        self.counters.duplicates += 1;
        let target = target_id(&wish.target);
        let pair = (wish.source, wish.signal.uid, LinkKey { target, slot: wish.slot.uid });
        // The last pair alone is remembered: a loop of one keeps one, and several in turn have the log's limit.
        if self.duplicate_told != Some(pair) && self.may_log() {
            self.duplicate_told = Some(pair);
            let (signal, slot) = (wish.signal.name, wish.slot.name);
            let (from, to) = (self.path_of(wish.source), self.path_of(target));
            tracing::info!("{from}.{signal} is attached to {to}.{slot} already: nothing changes");
        }
    }

    fn local_end(&self, target: ObjectId, wish: &Wish) -> Option<(End, LinkKey)> {
        let node = self.table.node(target).filter(|node| !node.header().has(MARKED))?;
        let asked = if wish.ignoring { TypeId::of::<()>() } else { (wish.signal.args_type)() };
        let bound = Rc::clone(node).bind(wish.slot.uid, asked)?;
        Some((End::Local(bound), LinkKey { target, slot: wish.slot.uid }))
    }

    fn remote_end(&self, there: &There, wish: &Wish) -> Option<(End, LinkKey)> {
        let crossing = wish.crossing?;
        let key = LinkKey { target: there.id, slot: wish.slot.uid };
        let back = crate::thread::WayBack { there: self.here(wish.source), signal: wish.signal.uid };
        Some((End::Remote((crossing.open)(there, wish.slot, wish.mode, back)), key))
    }

    fn is_linked(&self, wish: &Wish) -> bool {
        let key = LinkKey { target: target_id(&wish.target), slot: wish.slot.uid };
        self.with_signal(wish.source, wish.signal.uid, |signal| signal.has(key)) == Some(true)
    }
}

fn target_id(target: &Target) -> ObjectId {
    match target {
        Target::Local(id) => *id,
        Target::Remote(there) => there.id,
    }
}
