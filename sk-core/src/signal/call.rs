//! The call of one slot of one object: the hot path from `emit` to the user's method.

use crate::Cx;
use crate::object::{Header, MARKED, Node, ObjectId, Project, SkObject, WAITING};
use crate::signal::{SlotFor, SlotMeta, SlotTag};
use crate::sys::lease::{Denied, Lease};
use crate::sys::role::InRole;
use std::any::{Any, TypeId};
use std::rc::Rc;

/// An `Rc<dyn Call<A>>` of an `A` that the asker knows.
#[doc(hidden)]
pub type Bound = Box<dyn Any>;

/// What became of a call.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reached {
    /// The slot ran.
    Ran,
    /// The object's lease is taken, or calls wait for it: park this one.
    Busy,
    /// The object is marked or buried.
    Gone,
}

/// A slot bound to an object, called with an `A`.
#[doc(hidden)]
pub trait Call<A: ?Sized> {
    /// `allowed`: states of the object in which the call goes through all the same.
    fn call(&self, cx: &mut Cx, args: &A, allowed: u8) -> Reached;
    fn header(&self) -> &Header;
    fn slot(&self) -> &'static SlotMeta;
    fn target(&self) -> ObjectId {
        self.header().id
    }
    /// Whether the object is buried, so that the link is only a shell.
    fn is_shell(&self) -> bool;
}

/// The object of a node as the receiver of its slot `S`, or of the slot of the base that `P` leads to.
type Receiver<O, P, S> = InRole<Node<O>, (P, S)>;

impl<A, O, P, S> Call<A> for Receiver<O, P, S>
where
    A: ?Sized,
    O: SkObject,
    S: SlotFor<A>,
    P: Project<O, S::Object>,
{
    #[inline]
    fn call(&self, cx: &mut Cx, args: &A, allowed: u8) -> Reached {
        match self.cell().lease_unflagged() {
            Some(object) => run::<A, O, P, S>(object, cx, args),
            None => call_flagged::<A, O, P, S>(self, cx, args, allowed),
        }
    }

    fn header(&self) -> &Header {
        Node::header(self)
    }

    fn slot(&self) -> &'static SlotMeta {
        S::META
    }

    fn is_shell(&self) -> bool {
        Node::is_shell(self)
    }
}

/// What happens in every call, whatever the state of the object. Here and in `call` nothing but the slot itself is
/// called, unless a flag is set, so that they need no registers but those of the call.
#[inline]
fn run<A, O, P, S>(mut object: Lease<'_, ObjectId, O>, cx: &mut Cx, args: &A) -> Reached
where
    A: ?Sized,
    O: SkObject,
    S: SlotFor<A>,
    P: Project<O, S::Object>,
{
    cx.enter(object.head().id, S::META);
    if let Err(message) = S::invoke(P::project(&mut object), cx, args) {
        cx.slot_failed(message);
    }
    match object.end_unflagged() {
        Ok(()) => Reached::Ran,
        Err(object) => end_flagged(object, cx),
    }
}

/// A flag is set before the call: it may hinder it, or not.
#[cold]
#[inline(never)]
fn call_flagged<A, O, P, S>(node: &Node<O>, cx: &mut Cx, args: &A, allowed: u8) -> Reached
where
    A: ?Sized,
    O: SkObject,
    S: SlotFor<A>,
    P: Project<O, S::Object>,
{
    match node.cell().lease((MARKED | WAITING) & !allowed) {
        Ok(object) => run::<A, O, P, S>(object, cx, args),
        // Whoever is marked or buried is gone, also while its last slot runs.
        Err(denied) if denied == Denied::Empty || node.header().has(MARKED) => Reached::Gone,
        Err(_) => Reached::Busy,
    }
}

/// A flag is set after the call: calls may wait for the object.
#[cold]
#[inline(never)]
fn end_flagged<O>(object: Lease<'_, ObjectId, O>, cx: &mut Cx) -> Reached {
    let header = object.end();
    if header.has(WAITING) {
        cx.drain_waiting(header);
    }
    Reached::Ran
}

fn bound<A, O, P, S>(node: &Rc<Node<O>>) -> Bound
where
    A: ?Sized + 'static,
    O: SkObject,
    S: SlotFor<A>,
    P: Project<O, S::Object>,
{
    let call: Rc<dyn Call<A>> = Receiver::<O, P, S>::share(node);
    Box::new(call)
}

/// Binds a slot that takes its arguments as they are owned.
#[doc(hidden)]
pub fn bind_exact<O, P, S>(node: &Rc<Node<O>>, args: TypeId) -> Option<Bound>
where
    O: SkObject,
    S: SlotFor<<S as SlotTag>::Args>,
    P: Project<O, S::Object>,
{
    (args == TypeId::of::<S::Args>()).then(|| bound::<S::Args, O, P, S>(node))
}

/// Binds a slot that borrows its one argument: a signal may carry it borrowed or owned.
#[doc(hidden)]
pub fn bind_ref<R, O, P, S>(node: &Rc<Node<O>>, args: TypeId) -> Option<Bound>
where
    R: ?Sized + ToOwned + 'static,
    R::Owned: 'static,
    O: SkObject,
    S: SlotFor<R> + SlotFor<R::Owned>,
    P: Project<O, S::Object>,
{
    if args == TypeId::of::<R>() {
        Some(bound::<R, O, P, S>(node))
    } else if args == TypeId::of::<R::Owned>() {
        Some(bound::<R::Owned, O, P, S>(node))
    } else {
        None
    }
}

/// Binds a slot that takes one `String`: a signal may carry it as a `str`.
#[doc(hidden)]
pub fn bind_str<O, P, S>(node: &Rc<Node<O>>, args: TypeId) -> Option<Bound>
where
    O: SkObject,
    S: SlotFor<str> + SlotFor<String>,
    P: Project<O, S::Object>,
{
    bind_ref::<str, O, P, S>(node, args)
}

/// Binds a slot that takes one `Vec`: a signal may carry it as a slice.
#[doc(hidden)]
pub fn bind_slice<T, O, P, S>(node: &Rc<Node<O>>, args: TypeId) -> Option<Bound>
where
    T: Clone + 'static,
    O: SkObject,
    S: SlotFor<[T]> + SlotFor<Vec<T>>,
    P: Project<O, S::Object>,
{
    bind_ref::<[T], O, P, S>(node, args)
}
