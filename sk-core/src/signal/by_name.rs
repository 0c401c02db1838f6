//! The by-name layer: classes, objects, signals, slots and links as data, and requests by their names.

use crate::Cx;
use crate::eventloop::Refusal;
use crate::object::{Address, Class, MARKED, MetaError, ObjectId};
use crate::signal::link::{OnceCall, Parked};
use crate::signal::{Bound, Call, Delivery, LinkInfo, Mode, Rewire, SignalMeta, SlotMeta, Target, Wish};
use crate::sys::role::Held;
use crate::thread::{Crossing, Message, PostError, There};
use sk_flat::{FromVariant, SkVariant};
use std::any::TypeId;
use std::marker::PhantomData;
use std::rc::Rc;

/// A call made from variants, or what is wrong with them.
#[doc(hidden)]
pub type Prepared = Result<PreparedCall, String>;

/// A call that is ready to be queued.
#[doc(hidden)]
pub struct PreparedCall(Box<dyn OnceCall>);

/// What [`object!`](crate::object!) asks about argument types: `(&&Described::<A>::new()).prepare(…)` takes
/// the implementation for `&Described` where its bounds hold and falls back to the one for `Described`.
#[doc(hidden)]
pub struct Described<A: ?Sized>(PhantomData<fn(&A)>);

impl<A: ?Sized> Described<A> {
    #[expect(clippy::new_without_default, reason = "only the macro makes these")]
    pub const fn new() -> Self {
        Described(PhantomData)
    }
}

#[doc(hidden)]
pub trait Convertible {
    fn prepare(&self, count: usize, bound: Bound, args: &[SkVariant]) -> Prepared;
}
#[doc(hidden)]
pub trait FixedConversion {
    fn prepare(&self, count: usize, bound: Bound, args: &[SkVariant]) -> Prepared;
}
#[doc(hidden)]
pub trait Crossable {
    fn crossing(&self) -> Option<Crossing>;
}
#[doc(hidden)]
pub trait Staying {
    fn crossing(&self) -> Option<Crossing>;
}

impl<A: FromVariant + Clone + 'static> Convertible for &Described<A> {
    fn prepare(&self, count: usize, bound: Bound, args: &[SkVariant]) -> Prepared {
        if args.len() != count {
            return Err(format!("{count} arguments are due and {} came", args.len()));
        }
        let converted = match args {
            [] => A::from_variant(&SkVariant::Null),
            [one] => A::from_variant(one),
            many => A::from_variant(&SkVariant::List(many.to_vec().into())),
        };
        let converted = converted.map_err(|error| error.to_string())?;
        let call = bound
            .downcast::<Rc<dyn Call<A>>>()
            .map_err(|_| "the slot has other types".to_owned())?;
        Ok(PreparedCall(Parked::<A>::boxed(Held::from(*call), converted)))
    }
}

impl<A: ?Sized> FixedConversion for Described<A> {
    fn prepare(&self, _count: usize, _bound: Bound, _args: &[SkVariant]) -> Prepared {
        Err("these types cannot be made from variants".to_owned())
    }
}

impl<A> Crossable for &Described<A>
where
    A: ?Sized + ToOwned + 'static,
    A::Owned: Send,
{
    fn crossing(&self) -> Option<Crossing> {
        Some(Crossing::of::<A>())
    }
}

impl<A: ?Sized> Staying for Described<A> {
    fn crossing(&self) -> Option<Crossing> {
        None
    }
}

/// What is known of an object.
#[derive(Clone, Debug)]
pub struct ObjectInfo {
    /// Its id.
    pub id: ObjectId,
    /// Its names from the root down; ids stand in for names that were not given.
    pub path: String,
    /// Its class.
    pub class: &'static Class,
    /// Its parent, unless it is a root.
    pub parent: Option<ObjectId>,
}

/// A request by name under way to another loop, and whom to tell if it is refused there.
#[derive(Clone)]
struct Request {
    asker: There,
    target: Address,
    what: String,
}

fn known<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn unposted(error: PostError, target: ObjectId) -> MetaError {
    match error {
        PostError::Full(waiting) => MetaError::Full(waiting),
        PostError::Gone => MetaError::Gone(target),
    }
}

fn signal_of(class: &'static Class, name: &str) -> Result<&'static SignalMeta, MetaError> {
    class.signal(name).ok_or_else(|| MetaError::NoSuchSignal {
        class: class.name,
        signal: name.to_owned(),
        known: known(class.lineage().flat_map(|class| class.signals).map(|signal| signal.name)),
    })
}

fn slot_of(class: &'static Class, name: &str) -> Result<&'static SlotMeta, MetaError> {
    class.slot(name).ok_or_else(|| MetaError::NoSuchSlot {
        class: class.name,
        slot: name.to_owned(),
        known: known(class.lineage().flat_map(|class| class.slots).map(|slot| slot.name)),
    })
}

impl Cx {
    /// The class of a living object.
    pub fn class_of(&self, id: impl Into<ObjectId>) -> Option<&'static Class> {
        self.table.node(id.into()).map(|node| node.class())
    }

    /// Every object of the loop, those of the loop itself (its zones, its own object) included.
    pub fn objects(&self) -> Vec<ObjectInfo> {
        let known = self.table.ids().filter_map(|id| {
            let class = self.table.node(id)?.class();
            Some(ObjectInfo { id, path: self.table.path(id), class, parent: self.table.parent(id) })
        });
        known.collect()
    }

    /// The live links of an object's signals. An object whose slot is running shows none.
    pub fn links_of(&self, id: impl Into<ObjectId>) -> Vec<(&'static SignalMeta, LinkInfo)> {
        let mut links = Vec::new();
        if let Some(node) = self.table.node(id.into()) {
            node.each_signal(&mut |meta, signal| signal.each_link(&mut |link| links.push((meta, link))));
        }
        links
    }

    /// Asks for a link between objects whose types need not be known here. Types are compared now; the
    /// link fires from the next round on, as with [`attach!`](crate::attach). A slot without arguments
    /// fits every signal. A pair already linked changes nothing and is no error.
    ///
    /// # Errors
    /// [`MetaError`] if either end is gone, a name is not declared, the argument lists differ, or a direct
    /// link would cross threads: the graph stays as it was. Where an end lives on another thread, what that
    /// thread finds wrong comes back as a call: this loop's
    /// [`by_name_refused`](crate::SkEventLoop::by_name_refused).
    pub fn attach_by_name(
        &mut self,
        from: impl Into<Address>,
        signal: &str,
        to: impl Into<Address>,
        slot: &str,
        mode: Mode,
    ) -> Result<(), MetaError> {
        let (from, to) = (from.into(), to.into());
        let request = self.request(&from, format!("attach {signal} => {slot}"));
        self.attach_asked(request, from, signal, to, slot, mode)
    }

    fn attach_asked(
        &mut self,
        request: Request,
        from: Address,
        signal: &str,
        to: Address,
        slot: &str,
        mode: Mode,
    ) -> Result<(), MetaError> {
        let (from, to) = (self.located(from), self.located(to));
        if (from.there.is_some() || to.there.is_some()) && mode.delivery == Delivery::Direct {
            return Err(MetaError::Mode("Direct"));
        }
        if let Some(there) = from.there {
            let (signal, slot) = (signal.to_owned(), slot.to_owned());
            let to = to.there.unwrap_or_else(|| self.here(to.id));
            let (from, to) = (Address::from(there.id), Address { id: to.id, there: Some(to) });
            return self.settle_there(&there, request, move |cx, request| {
                cx.attach_asked(request, from, &signal, to, &slot, mode)
            });
        }
        let class = self.class_of(from.id).ok_or(MetaError::Gone(from.id))?;
        let signal = signal_of(class, signal)?;
        match to.there {
            None => self.attach_here(from.id, signal, to.id, slot, mode),
            Some(there) => self.attach_there(request, from.id, signal, there, slot, mode),
        }
    }

    /// Undoes [`attach_by_name`](Cx::attach_by_name), or an [`attach!`](crate::attach).
    ///
    /// # Errors
    /// As for attaching, also in what comes back from other threads. A pair that is not linked is no error.
    pub fn detach_by_name(
        &mut self,
        from: impl Into<Address>,
        signal: &str,
        to: impl Into<Address>,
        slot: &str,
    ) -> Result<(), MetaError> {
        let (from, to) = (from.into(), to.into());
        let request = self.request(&from, format!("detach {signal} => {slot}"));
        self.detach_asked(request, from, signal, to, slot)
    }

    fn detach_asked(
        &mut self,
        request: Request,
        from: Address,
        signal: &str,
        to: Address,
        slot: &str,
    ) -> Result<(), MetaError> {
        let (from, to) = (self.located(from), self.located(to));
        if let Some(there) = from.there {
            let (signal, slot) = (signal.to_owned(), slot.to_owned());
            let to = to.there.unwrap_or_else(|| self.here(to.id));
            let (from, to) = (Address::from(there.id), Address { id: to.id, there: Some(to) });
            return self.settle_there(&there, request, move |cx, request| {
                cx.detach_asked(request, from, &signal, to, &slot)
            });
        }
        let class = self.class_of(from.id).ok_or(MetaError::Gone(from.id))?;
        let signal = signal_of(class, signal)?;
        let source = from.id;
        match to.there {
            None => {
                let class = self.class_of(to.id).ok_or(MetaError::Gone(to.id))?;
                let slot = slot_of(class, slot)?.uid;
                let target = Target::Local(to.id);
                self.keep_rewire(Rewire::Detach { source, signal, target, slot })
                    .map_err(|full| unposted(full, to.id))
            }
            Some(there) => {
                let (back, slot) = (self.here(source), slot.to_owned());
                let request = Request { target: Address::from(there.clone()), ..request };
                self.settle_there(&there.clone(), request, move |cx, _| {
                    let class = cx.class_of(there.id).ok_or(MetaError::Gone(there.id))?;
                    let slot = slot_of(class, &slot)?.uid;
                    let target = Target::Remote(there);
                    let rewire = Rewire::Detach { source, signal, target, slot };
                    cx.post_rewire(&back, rewire).map_err(|error| unposted(error, back.id))
                })
            }
        }
    }

    fn attach_here(
        &mut self,
        source: ObjectId,
        signal: &'static SignalMeta,
        target: ObjectId,
        slot: &str,
        mode: Mode,
    ) -> Result<(), MetaError> {
        let (slot, ignoring) = self.fitting_slot(target, slot, signal)?;
        let place = Target::Local(target);
        let wish = Wish { source, signal, target: place, slot, mode, ignoring, crossing: None };
        self.keep_rewire(Rewire::Attach(wish)).map_err(|full| unposted(full, target))
    }

    /// The slot of that name, if it takes what the signal carries, and whether it ignores that.
    fn fitting_slot(
        &self,
        target: ObjectId,
        slot: &str,
        signal: &'static SignalMeta,
    ) -> Result<(&'static SlotMeta, bool), MetaError> {
        let node = self.table.node(target).ok_or(MetaError::Gone(target))?;
        let slot = slot_of(node.class(), slot)?;
        let ignoring = (slot.args_type)() == TypeId::of::<()>();
        if !ignoring && Rc::clone(node).bind(slot.uid, (signal.args_type)()).is_none() {
            let found = format!("the signal `{}` carries ({})", signal.name, signal.args);
            return Err(MetaError::Arguments { slot: slot.name, expected: slot.args, found });
        }
        Ok((slot, ignoring))
    }

    /// The receiver's loop finds the slot and sends the wish back.
    fn attach_there(
        &mut self,
        request: Request,
        source: ObjectId,
        signal: &'static SignalMeta,
        there: There,
        slot: &str,
        mode: Mode,
    ) -> Result<(), MetaError> {
        let crossing = (signal.crossing)().ok_or(MetaError::Arguments {
            slot: signal.name,
            expected: signal.args,
            found: "what the signal carries cannot be sent to another thread".to_owned(),
        })?;
        let (back, slot) = (self.here(source), slot.to_owned());
        let request = Request { target: Address::from(there.clone()), ..request };
        self.settle_there(&there.clone(), request, move |cx, _| {
            let (slot, ignoring) = cx.fitting_slot(there.id, &slot, signal)?;
            let crossing = if ignoring { Crossing::of::<()>() } else { crossing };
            let target = Target::Remote(there);
            let wish = Wish { source, signal, target, slot, mode, ignoring, crossing: Some(crossing) };
            cx.post_rewire(&back, Rewire::Attach(wish))
                .map_err(|error| unposted(error, back.id))
        })
    }

    /// Calls a slot by name with variants: never directly, always in the next round (S59). An integer that
    /// fits exactly is also a float; nothing else is converted.
    ///
    /// # Errors
    /// [`MetaError`] if the object is gone, has no such slot, the arguments do not fit, or the queue is
    /// full. For an object of another thread only that its mailbox is full or its loop has ended is known
    /// here; the rest comes back as a call: this loop's
    /// [`by_name_refused`](crate::SkEventLoop::by_name_refused).
    pub fn invoke_method(
        &mut self,
        to: impl Into<Address>,
        slot: &str,
        args: &[SkVariant],
    ) -> Result<(), MetaError> {
        let to = self.located(to.into());
        if let Some(there) = to.there {
            let (slot, args, id) = (slot.to_owned(), args.to_vec(), there.id);
            let request = self.request(&Address::from(there.clone()), format!("call {slot}"));
            let run = Message::Run(Box::new(move |cx| match cx.prepare(id, &slot, &args) {
                Ok(call) => call.0.run(cx),
                Err(error) => cx.refuse_stranger(request, error),
            }));
            return there.mailbox.post(run).map_err(|error| unposted(error, there.id));
        }
        let call = self.prepare(to.id, slot, args)?;
        if !self.queue_has_room() {
            return Err(MetaError::Full(self.queue.len()));
        }
        self.queue_once(call.0);
        Ok(())
    }

    fn prepare(&mut self, id: ObjectId, slot: &str, args: &[SkVariant]) -> Result<PreparedCall, MetaError> {
        let node = self
            .table
            .node(id)
            .filter(|node| !node.header().has(MARKED))
            .ok_or(MetaError::Gone(id))?;
        let slot = slot_of(node.class(), slot)?;
        let refused = |found| MetaError::Arguments { slot: slot.name, expected: slot.args, found };
        let bound = Rc::clone(node).bind(slot.uid, (slot.args_type)());
        let bound = bound.ok_or_else(|| refused("the slot cannot be bound".to_owned()))?;
        (slot.prepare)(bound, args).map_err(refused)
    }

    /// An address with an id of this very loop is local, however it was made.
    fn located(&self, address: Address) -> Address {
        match &address.there {
            Some(there) if self.is_mine(there) => Address { id: there.id, there: None },
            _ => address,
        }
    }

    fn request(&self, target: &Address, what: String) -> Request {
        Request { asker: self.here(ObjectId::NOBODY), target: target.clone(), what }
    }

    fn settle_there(
        &mut self,
        there: &There,
        request: Request,
        work: impl FnOnce(&mut Cx, Request) -> Result<(), MetaError> + Send + 'static,
    ) -> Result<(), MetaError> {
        let settle = Message::Settle(Box::new(move |cx| {
            if let Err(error) = work(cx, request.clone()) {
                cx.refuse_stranger(request, error);
            }
        }));
        there.mailbox.post(settle).map_err(|error| unposted(error, there.id))
    }

    /// A request by name that came from another thread was wrong: its asker is told.
    fn refuse_stranger(&mut self, request: Request, error: MetaError) {
        self.counters.refused_by_name += 1;
        if self.may_log() {
            tracing::warn!("`{}`, asked for by another thread, was refused: {error}", request.what);
        }
        let Request { asker, target, what } = request;
        let refusal = Refusal { target, what, error };
        if self.is_mine(&asker) {
            // It went to another loop and came back.
            return self.tell_refusal(refusal);
        }
        // An asker whose mailbox is full hears of that instead, and one that has ended hears nothing more.
        let _ = asker
            .mailbox
            .post(Message::Settle(Box::new(move |cx| cx.tell_refusal(refusal))));
    }
}
