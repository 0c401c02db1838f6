//! The cell an object lives in: its value, the borrow flag that is its lease, and its state.

use crate::Cx;
use crate::object::{Access, Class, ObjectId, SkObject};
use crate::signal::{AnySignal, Bound, SignalMeta};
use std::any::{Any, TypeId};
use std::cell::{Cell, RefCell};
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

/// What every node has, whatever it holds.
pub struct Header {
    pub(crate) id: ObjectId,
    pub(crate) state: Cell<u8>,
}

impl Header {
    pub(crate) fn has(&self, flag: u8) -> bool {
        self.state.get() & flag != 0
    }
    pub(crate) fn set(&self, flag: u8) {
        self.state.set(self.state.get() | flag);
    }
    pub(crate) fn unset(&self, flag: u8) {
        self.state.set(self.state.get() & !flag);
    }
}

/// An object's cell. The `RefCell`'s borrow flag is the lease: it is taken for one call.
/// `None` once buried; links to it then hold a dead shell until they are swept.
pub struct Node<T> {
    pub(crate) header: Header,
    pub(crate) value: RefCell<Option<T>>,
}

impl<T> Node<T> {
    pub(crate) fn new(id: ObjectId, value: T) -> Node<T> {
        Node { header: Header { id, state: Cell::new(0) }, value: RefCell::new(Some(value)) }
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
        &self.header
    }

    fn class(&self) -> &'static Class {
        T::CLASS
    }

    fn bind(self: Rc<Self>, uid: u64, args: TypeId) -> Option<Bound> {
        T::bind_slot::<T, crate::object::Itself>(&self, uid, args)
    }

    fn with_signal(&self, uid: u64, f: &mut dyn FnMut(&mut dyn AnySignal)) -> Result<(), Access> {
        let mut value = self.value.try_borrow_mut().map_err(|_| Access::Busy)?;
        let signal = value.as_mut().and_then(|object| object.signal_mut(uid)).ok_or(Access::Gone)?;
        f(signal);
        Ok(())
    }

    fn each_signal(&self, f: &mut dyn FnMut(&'static SignalMeta, &mut dyn AnySignal)) {
        if let Ok(mut value) = self.value.try_borrow_mut()
            && let Some(object) = value.as_mut()
        {
            object.each_signal(f);
        }
    }

    fn with_part(
        &self,
        part: TypeId,
        cx: &mut Cx,
        f: &mut dyn FnMut(&mut dyn Any, &mut Cx),
    ) -> Result<(), Access> {
        let mut value = self.value.try_borrow_mut().map_err(|_| Access::Busy)?;
        let part = value.as_mut().and_then(|object| object.part_mut(part)).ok_or(Access::Gone)?;
        f(part, cx);
        Ok(())
    }

    fn is_leased(&self) -> bool {
        self.value.try_borrow_mut().is_err()
    }

    fn spawned(&self, cx: &mut Cx) {
        if let Ok(mut value) = self.value.try_borrow_mut()
            && let Some(object) = value.as_mut()
        {
            object.spawned(cx);
        }
    }

    fn destroying(&self, cx: &mut Cx) {
        if let Ok(mut value) = self.value.try_borrow_mut()
            && let Some(object) = value.as_mut()
        {
            object.destroying(cx);
        }
    }

    fn clear(&self) {
        // Taken out first and dropped after the borrow has ended: the value's own `Drop` may look at
        // anything but must not find its cell borrowed.
        let value = match self.value.try_borrow_mut() {
            Ok(mut value) => value.take(),
            Err(_) => None,
        };
        drop(value);
    }
}
