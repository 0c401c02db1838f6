//! The cell an object lives in: its value, the borrow flag that is its lease, and its state.

use crate::Cx;
use crate::object::{Access, Class, ObjectId, SkObject};
use crate::signal::{AnySignal, Bound, SignalMeta};
use crate::sys::lease::{Denied, Head, Lease, Leased};
use std::any::{Any, TypeId};
use std::rc::Rc;

/// `destroy_later` named the object or one of its ancestors: no further slot call reaches it.
pub(crate) const MARKED: u8 = 1;
/// Calls wait for the object: later direct calls queue up behind them.
pub(crate) const WAITING: u8 = 2;
/// What waits was put off to the next round: its token stands in the queue.
pub(crate) const DEFERRED: u8 = 4;
// 8: burial's own.
/// One of the object's signals has a link to sweep, and the object is in the list for it.
pub(crate) const TO_SWEEP: u8 = 16;
/// What waits is being run: the leases of these calls do not run it again as they end.
pub(crate) const DRAINING: u8 = 32;

/// What every node has, whatever it holds: the object's id, and its flags.
pub(crate) type Header = Head<ObjectId>;

/// An object's cell, which grants the lease for one call. Empty once the object is buried; links to it then hold
/// a dead shell until they are swept.
pub struct Node<T> {
    cell: Leased<ObjectId, T>,
}

impl<T> Node<T> {
    pub(crate) fn new(id: ObjectId, value: T) -> Node<T> {
        Node { cell: Leased::new(id, value) }
    }

    #[inline]
    pub(crate) fn header(&self) -> &Header {
        self.cell.head()
    }

    /// The cell, for a slot call.
    #[inline]
    pub(crate) fn cell(&self) -> &Leased<ObjectId, T> {
        &self.cell
    }

    /// The object for an access that is not a slot call, whatever its flags are.
    pub(crate) fn access(&self) -> Result<Lease<'_, ObjectId, T>, Access> {
        self.cell.lease(0).map_err(|denied| match denied {
            Denied::Empty => Access::Gone,
            Denied::Leased | Denied::Flagged => Access::Busy,
        })
    }

    /// Whether the object is buried, so that only its cell is left.
    pub(crate) fn is_shell(&self) -> bool {
        self.cell.is_empty()
    }
}

/// A node of unknown class.
pub(crate) trait AnyNode: Any {
    fn header(&self) -> &Header;
    fn class(&self) -> &'static Class;
    /// The slot `uid`, ready to be called with arguments of type `args`.
    fn bind(self: Rc<Self>, uid: u64, args: TypeId) -> Option<Bound>;
    /// Runs `f` on the signal `uid`; `Err(Gone)` if there is none.
    fn with_signal(&self, uid: u64, f: &mut dyn FnMut(&mut dyn AnySignal)) -> Result<(), Access>;
    fn each_signal(&self, f: &mut dyn FnMut(&'static SignalMeta, &mut dyn AnySignal));
    /// Runs `f` on the object, or on the base of type `part` inside it.
    fn with_part(
        &self,
        part: TypeId,
        cx: &mut Cx,
        f: &mut dyn FnMut(&mut dyn Any, &mut Cx),
    ) -> Result<(), Access>;
    /// Whether one of its slots is running, or it is being accessed.
    fn is_leased(&self) -> bool;
    fn spawned(&self, cx: &mut Cx);
    fn destroying(&self, cx: &mut Cx);
    /// Drops the value where it stands.
    fn clear(&self);
}

impl<T: SkObject> AnyNode for Node<T> {
    fn header(&self) -> &Header {
        self.cell.head()
    }

    fn class(&self) -> &'static Class {
        T::CLASS
    }

    fn bind(self: Rc<Self>, uid: u64, args: TypeId) -> Option<Bound> {
        T::bind_slot::<T, crate::object::Itself>(&self, uid, args)
    }

    fn with_signal(&self, uid: u64, f: &mut dyn FnMut(&mut dyn AnySignal)) -> Result<(), Access> {
        let mut object = self.access()?;
        let signal = object.signal_mut(uid).ok_or(Access::Gone)?;
        f(signal);
        Ok(())
    }

    fn each_signal(&self, f: &mut dyn FnMut(&'static SignalMeta, &mut dyn AnySignal)) {
        if let Ok(mut object) = self.access() {
            object.each_signal(f);
        }
    }

    fn with_part(
        &self,
        part: TypeId,
        cx: &mut Cx,
        f: &mut dyn FnMut(&mut dyn Any, &mut Cx),
    ) -> Result<(), Access> {
        let mut object = self.access()?;
        let part = object.part_mut(part).ok_or(Access::Gone)?;
        f(part, cx);
        Ok(())
    }

    fn is_leased(&self) -> bool {
        self.cell.is_leased()
    }

    fn spawned(&self, cx: &mut Cx) {
        if let Ok(mut object) = self.access() {
            object.spawned(cx);
        }
    }

    fn destroying(&self, cx: &mut Cx) {
        if let Ok(mut object) = self.access() {
            object.destroying(cx);
        }
    }

    fn clear(&self) {
        // Taken out first and dropped after the lease has ended: the value's own `Drop` may look at anything
        // but must not find its cell leased.
        drop(self.cell.take());
    }
}
