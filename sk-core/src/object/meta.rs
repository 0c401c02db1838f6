//! What is known of a class at run time: its name, signals, slots and base.

use crate::Cx;
use crate::object::{Handle, Node, ObjectId, Place};
use crate::signal::{AnySignal, Bound, SignalMeta, SlotMeta};
use crate::thread::{Remote, There};
use std::any::{Any, TypeId};
use std::rc::Rc;

/// An object that signals and has slots. [`object!`](crate::object!) implements it beside a plain struct;
/// nobody writes it by hand.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not an object: it has no `object!` table",
    note = "write `object! {{ {Self} {{ signals {{ … }} slots {{ … }} }} }}` beside the struct"
)]
pub trait SkObject: Sized + 'static {
    /// Typed accessors of the signals.
    type Signals<P: Place>;
    /// Typed accessors of the slots.
    type Slots<P: Place>;
    /// The class, as the by-name layer sees it.
    const CLASS: &'static Class;

    #[doc(hidden)]
    fn signals_of<P: Place>(place: &P) -> Self::Signals<P>;
    #[doc(hidden)]
    fn slots_of<P: Place>(place: &P) -> Self::Slots<P>;
    #[doc(hidden)]
    fn signal_mut(&mut self, uid: u64) -> Option<&mut dyn AnySignal>;
    #[doc(hidden)]
    fn each_signal(&mut self, f: &mut dyn FnMut(&'static SignalMeta, &mut dyn AnySignal));
    #[doc(hidden)]
    fn part_mut(&mut self, part: TypeId) -> Option<&mut dyn Any>;
    #[doc(hidden)]
    fn bind_slot<O: SkObject, P: Project<O, Self>>(
        node: &Rc<Node<O>>,
        uid: u64,
        args: TypeId,
    ) -> Option<Bound>;
    #[doc(hidden)]
    fn spawned(&mut self, cx: &mut Cx);
    #[doc(hidden)]
    fn destroying(&mut self, cx: &mut Cx);
}

/// The way from an object to the part of it that a base class is.
#[doc(hidden)]
pub trait Project<O, B>: 'static {
    fn project(outer: &mut O) -> &mut B;
}

/// The object itself.
#[doc(hidden)]
pub struct Itself;
impl<O> Project<O, O> for Itself {
    fn project(outer: &mut O) -> &mut O {
        outer
    }
}

/// A class that offers the signals and slots of a field as its own (`extends` of the papers).
#[doc(hidden)]
pub trait Extends {
    type Base: SkObject;
    fn base(&mut self) -> &mut Self::Base;
}

/// First by `P` to an `M`, then to its base.
#[doc(hidden)]
pub struct Through<P, M>(std::marker::PhantomData<fn() -> (P, M)>);
impl<O, M: Extends + 'static, P: Project<O, M>> Project<O, M::Base> for Through<P, M> {
    fn project(outer: &mut O) -> &mut M::Base {
        P::project(outer).base()
    }
}

/// A class: what [`object!`](crate::object!) declared.
pub struct Class {
    /// The struct's name, without its module.
    pub name: &'static str,
    /// The Rust type.
    pub type_id: TypeId,
    /// Its own signals, in the order of declaration.
    pub signals: &'static [&'static SignalMeta],
    /// Its own slots, in the order of declaration.
    pub slots: &'static [&'static SlotMeta],
    /// The class it extends.
    pub base: Option<&'static Class>,
    /// Whether it or a base of it has a hook.
    #[doc(hidden)]
    pub has_hooks: bool,
}

impl Class {
    /// This class and those it extends, nearest first.
    pub fn lineage(&'static self) -> impl Iterator<Item = &'static Class> {
        std::iter::successors(Some(self), |class| class.base)
    }

    /// The signal of that name, looked for from the class itself towards its bases.
    pub fn signal(&'static self, name: &str) -> Option<&'static SignalMeta> {
        self.lineage()
            .flat_map(|class| class.signals)
            .find(|signal| signal.name == name)
            .copied()
    }

    /// The slot of that name, looked for from the class itself towards its bases.
    pub fn slot(&'static self, name: &str) -> Option<&'static SlotMeta> {
        self.lineage()
            .flat_map(|class| class.slots)
            .find(|slot| slot.name == name)
            .copied()
    }

    pub(crate) fn is_a(&'static self, type_id: TypeId) -> bool {
        self.lineage().any(|class| class.type_id == type_id)
    }
}

impl std::fmt::Debug for Class {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Class")
            .field("name", &self.name)
            .field("signals", &self.signals)
            .field("slots", &self.slots)
            .field("base", &self.base.map(|base| base.name))
            .finish()
    }
}

/// Names an object of this or another thread's loop for the by-name layer. `Send`.
#[derive(Clone, Debug)]
pub struct Address {
    pub(crate) id: ObjectId,
    pub(crate) there: Option<There>,
}

impl Address {
    /// The object's id within its loop.
    pub fn id(&self) -> ObjectId {
        self.id
    }
}

impl From<ObjectId> for Address {
    fn from(id: ObjectId) -> Address {
        Address { id, there: None }
    }
}
impl<T> From<Handle<T>> for Address {
    fn from(handle: Handle<T>) -> Address {
        Address { id: handle.id(), there: None }
    }
}
impl From<There> for Address {
    fn from(there: There) -> Address {
        Address { id: there.id, there: Some(there) }
    }
}
impl<T> From<&Remote<T>> for Address {
    fn from(remote: &Remote<T>) -> Address {
        Address { id: remote.there().id, there: Some(remote.there().clone()) }
    }
}
impl<T> From<Remote<T>> for Address {
    fn from(remote: Remote<T>) -> Address {
        (&remote).into()
    }
}

/// Why a request by name was refused. The graph stays as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MetaError {
    /// Nobody has that id.
    #[error("the object {0} is gone")]
    Gone(ObjectId),
    /// The class has no such slot.
    #[error("{class} has no slot `{slot}`; it has: {known}")]
    NoSuchSlot {
        /// The object's class.
        class: &'static str,
        /// What was asked for.
        slot: String,
        /// The slots there are, separated by commas.
        known: String,
    },
    /// The class has no such signal.
    #[error("{class} has no signal `{signal}`; it has: {known}")]
    NoSuchSignal {
        /// The object's class.
        class: &'static str,
        /// What was asked for.
        signal: String,
        /// The signals there are, separated by commas.
        known: String,
    },
    /// The arguments do not fit.
    #[error("`{slot}` takes ({expected}): {found}")]
    Arguments {
        /// The slot.
        slot: &'static str,
        /// Its declared argument types.
        expected: &'static str,
        /// What is wrong with what came.
        found: String,
    },
    /// The mode cannot be had between these two.
    #[error("a {0} link cannot cross threads: use Queued or Latest")]
    Mode(&'static str),
    /// The queue is full.
    #[error("the queue is full ({0} calls wait)")]
    Full(usize),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_can_be_sent_to_another_thread() {
        fn sendable<T: Send>() {}
        sendable::<Address>();
    }
}
