//! What a slot and a signal are to the type system.

use crate::Cx;
use crate::object::{Node, Place, Project, SkObject};
use crate::signal::{Bound, Prepared, Target};
use std::any::TypeId;
use std::fmt::{self, Display};
use std::marker::PhantomData;
use std::rc::Rc;

/// What a slot left: nothing, or why it failed.
#[doc(hidden)]
pub type Outcome = Result<(), Box<str>>;

/// What a slot may return: `()` or `Result<(), E>` with an `E` that can be displayed.
#[diagnostic::on_unimplemented(
    message = "a slot returns nothing or `Result<(), E>` with `E: Display`, not `{Self}`"
)]
pub trait IntoOutcome {
    #[doc(hidden)]
    fn into_outcome(self) -> Outcome;
}

impl IntoOutcome for () {
    #[inline(always)]
    fn into_outcome(self) -> Outcome {
        Ok(())
    }
}

impl<E: Display> IntoOutcome for Result<(), E> {
    #[inline]
    fn into_outcome(self) -> Outcome {
        self.map_err(|error| error.to_string().into_boxed_str())
    }
}

/// A slot as a type, made by [`object!`](crate::object!).
pub trait SlotTag: 'static {
    /// The class the slot belongs to.
    type Object: SkObject;
    /// Its arguments as owned values: one is itself, several are a tuple, none is `()`.
    type Args: 'static;
    #[doc(hidden)]
    const META: &'static SlotMeta;
    #[doc(hidden)]
    fn bind<O: SkObject, P: Project<O, Self::Object>>(node: &Rc<Node<O>>, args: TypeId) -> Option<Bound>;
}

/// A slot that takes what a `Signal<A>` carries.
#[diagnostic::on_unimplemented(
    message = "the slot `{Self}` does not take what the signal carries: `{A}`",
    note = "the argument lists must match, though borrowing does not count (`f32` and `&f32`, `String` and `&str`)",
    note = "a slot without arguments is attached to any signal as `slot()`"
)]
pub trait SlotFor<A: ?Sized>: SlotTag {
    #[doc(hidden)]
    fn invoke(object: &mut Self::Object, cx: &mut Cx, args: &A) -> Outcome;
}

/// What is known of a slot at run time.
pub struct SlotMeta {
    /// Its name.
    pub name: &'static str,
    /// The class that declares it.
    pub class: &'static str,
    /// Its declared argument types, as written.
    pub args: &'static str,
    #[doc(hidden)]
    pub uid: u64,
    /// The type of its arguments as owned values.
    #[doc(hidden)]
    pub args_type: fn() -> TypeId,
    /// Converts variants for a bound slot, where the argument types allow it.
    #[doc(hidden)]
    pub prepare: fn(Bound, &[sk_flat::SkVariant]) -> Prepared,
}

impl fmt::Debug for SlotMeta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}({})", self.name, self.args)
    }
}

/// What is known of a signal at run time.
pub struct SignalMeta {
    /// Its name.
    pub name: &'static str,
    /// The class that declares it.
    pub class: &'static str,
    /// Its declared argument types, as written.
    pub args: &'static str,
    #[doc(hidden)]
    pub uid: u64,
    /// The type of what it carries.
    #[doc(hidden)]
    pub args_type: fn() -> TypeId,
    /// How a link of it crosses threads, where the argument types can.
    #[doc(hidden)]
    pub crossing: fn() -> Option<crate::thread::Crossing>,
}

impl fmt::Debug for SignalMeta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}({})", self.name, self.args)
    }
}

/// One signal of one object, as [`attach!`](crate::attach) names it.
pub struct SignalRef<A: ?Sized, P> {
    pub(crate) place: P,
    pub(crate) meta: &'static SignalMeta,
    carries: PhantomData<fn(&A)>,
}

impl<A: ?Sized, P: Place> SignalRef<A, P> {
    #[doc(hidden)]
    pub fn new(place: P, meta: &'static SignalMeta) -> Self {
        SignalRef { place, meta, carries: PhantomData }
    }
}

/// One slot of one object, as [`attach!`](crate::attach) names it.
pub struct SlotRef<S, P> {
    pub(crate) place: P,
    tag: PhantomData<fn() -> S>,
}

impl<S: SlotTag, P: Place> SlotRef<S, P> {
    #[doc(hidden)]
    pub fn new(place: P) -> Self {
        SlotRef { place, tag: PhantomData }
    }

    pub(crate) fn target(&self) -> Target {
        self.place.target()
    }
}

impl<S, P: Clone> Clone for SlotRef<S, P> {
    fn clone(&self) -> Self {
        SlotRef { place: self.place.clone(), tag: PhantomData }
    }
}
