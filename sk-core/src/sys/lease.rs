//! A shared value that one caller at a time may change: what `RefCell<Option<T>>` does, in one word.
//!
//! An object's cell is looked at and written in every slot call. With a borrow flag, a tag for "there is still a
//! value" and a byte of states beside each other a call tests three words and writes two; here all of it is one
//! word, zero in the usual case, and the cell is 16 bytes smaller.
#![allow(unsafe_code)]

use std::cell::{Cell, UnsafeCell};
use std::mem::MaybeUninit;
use std::ops::{Deref, DerefMut};

/// Somebody holds the lease. The low byte is the owner's own flags.
const LEASED: u32 = 1 << 8;
/// The value was taken out.
const EMPTY: u32 = 1 << 9;

/// What can be read of a cell while its value is leased: its name, and flags that mean nothing here.
pub struct Head<I> {
    pub(crate) id: I,
    flags: Cell<u32>,
}

impl<I> Head<I> {
    #[inline]
    pub(crate) fn has(&self, flags: u8) -> bool {
        self.flags.get() & u32::from(flags) != 0
    }

    pub(crate) fn set(&self, flags: u8) {
        self.flags.set(self.flags.get() | u32::from(flags));
    }

    pub(crate) fn unset(&self, flags: u8) {
        self.flags.set(self.flags.get() & !u32::from(flags));
    }
}

/// Why there is no lease now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Denied {
    /// Somebody holds it.
    Leased,
    /// The value was taken out.
    Empty,
    /// A flag of the owner's that the caller named, and no reason of the cell's own.
    Flagged,
}

/// The cell. Not `Sync`, as its flags are a `Cell`: whoever asks for a lease is on the one thread that has the cell.
/// A lease borrows the cell, so that none exists while the cell moves to another thread.
pub(crate) struct Leased<I, T> {
    head: Head<I>,
    /// Initialised unless `EMPTY`; touched only by who has set `LEASED`, or by `Drop`.
    value: UnsafeCell<MaybeUninit<T>>,
}

impl<I, T> Leased<I, T> {
    pub(crate) fn new(id: I, value: T) -> Leased<I, T> {
        let head = Head { id, flags: Cell::new(0) };
        Leased { head, value: UnsafeCell::new(MaybeUninit::new(value)) }
    }

    #[inline]
    pub(crate) fn head(&self) -> &Head<I> {
        &self.head
    }

    /// The value for one call, if no flag is set at all: the usual case, one comparison and one write.
    #[inline]
    pub(crate) fn lease_unflagged(&self) -> Option<Lease<'_, I, T>> {
        let flags = &self.head.flags;
        if flags.get() != 0 {
            return None;
        }
        // A constant and not `flags | LEASED`: the next call need not wait for what this one read.
        flags.set(LEASED);
        Some(Lease { cell: self })
    }

    /// The value for one call, if nobody has it and none of the flags `hindered_by` is set.
    pub(crate) fn lease(&self, hindered_by: u8) -> Result<Lease<'_, I, T>, Denied> {
        let flags = self.head.flags.get();
        if flags & EMPTY != 0 {
            return Err(Denied::Empty);
        }
        if flags & LEASED != 0 {
            return Err(Denied::Leased);
        }
        if flags & u32::from(hindered_by) != 0 {
            return Err(Denied::Flagged);
        }
        self.head.flags.set(flags | LEASED);
        Ok(Lease { cell: self })
    }

    pub(crate) fn is_leased(&self) -> bool {
        self.head.flags.get() & LEASED != 0
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.head.flags.get() & EMPTY != 0
    }

    /// Takes the value out for good; `None` if somebody has it, or it was taken before.
    pub(crate) fn take(&self) -> Option<T> {
        let lease = self.lease(0).ok()?;
        self.head.flags.set(self.head.flags.get() | EMPTY);
        // SAFETY: the lease was granted, so `EMPTY` was not set and the value is initialised, and nobody else
        // refers to it. `EMPTY` is set now, so it is never read again.
        let value = unsafe { (*self.value.get()).assume_init_read() };
        drop(lease);
        Some(value)
    }
}

impl<I, T> Drop for Leased<I, T> {
    fn drop(&mut self) {
        if !self.is_empty() {
            // SAFETY: not `EMPTY`, so the value is initialised; `&mut self` means that no lease exists (one that
            // was forgotten can no longer be used), and nobody comes after.
            unsafe { self.value.get_mut().assume_init_drop() }
        }
    }
}

/// The value, until it is dropped.
pub(crate) struct Lease<'a, I, T> {
    cell: &'a Leased<I, T>,
}

impl<I, T> Deref for Lease<'_, I, T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: a lease is made only when neither `LEASED` nor `EMPTY` was set, and sets `LEASED`, which no
        // function but its own `Drop` clears. So it is the only one of its cell, and the value is initialised:
        // `take` needs a lease of its own. The reference lives as long as the borrow of this lease.
        unsafe { (*self.cell.value.get()).assume_init_ref() }
    }
}

impl<I, T> DerefMut for Lease<'_, I, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as in `deref`, and the lease is borrowed for changing.
        unsafe { (*self.cell.value.get()).assume_init_mut() }
    }
}

impl<'a, I, T> Lease<'a, I, T> {
    /// Gives the lease back if no flag was set meanwhile; otherwise the lease comes back.
    #[inline]
    pub(crate) fn end_unflagged(self) -> Result<(), Lease<'a, I, T>> {
        let flags = &self.cell.head.flags;
        if flags.get() != LEASED {
            return Err(self);
        }
        flags.set(0);
        std::mem::forget(self);
        Ok(())
    }

    #[inline]
    pub(crate) fn head(&self) -> &Head<I> {
        self.cell.head()
    }

    /// Gives the lease back, and shows the flags.
    pub(crate) fn end(self) -> &'a Head<I> {
        self.cell.head()
    }
}

impl<I, T> Drop for Lease<'_, I, T> {
    #[inline]
    fn drop(&mut self) {
        let flags = &self.cell.head.flags;
        flags.set(flags.get() & !LEASED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::rc::Rc;

    const MARK: u8 = 1;
    const OTHER: u8 = 128;

    #[test]
    fn there_is_one_lease_at_a_time() {
        let cell = Leased::new(7, String::from("a"));
        let mut first = cell.lease(0).ok().unwrap();
        first.push('b');
        assert_eq!(cell.lease(0).err(), Some(Denied::Leased));
        assert!(cell.is_leased() && cell.take().is_none());
        assert!(first.end_unflagged().is_ok());
        assert_eq!(&**cell.lease(0).ok().unwrap(), "ab");
        assert!(!cell.is_leased());
        assert_eq!(cell.head().id, 7);
    }

    #[test]
    fn flags_hinder_only_those_who_name_them_and_outlive_a_lease() {
        let cell = Leased::new((), 1);
        cell.head().set(MARK);
        assert_eq!(cell.lease(MARK | OTHER).err(), Some(Denied::Flagged));
        let lease = cell.lease(OTHER).ok().unwrap();
        cell.head().set(OTHER);
        cell.head().unset(MARK);
        let lease = lease.end_unflagged().err().unwrap();
        assert!(cell.is_leased());
        assert!(lease.end().has(OTHER) && !cell.head().has(MARK) && !cell.is_leased());
        assert!(cell.lease_unflagged().is_none());
    }

    #[test]
    fn what_was_taken_is_gone_and_dropped_once() {
        let value = Rc::new(5);
        let cell = Leased::new((), value.clone());
        assert_eq!(cell.take().as_deref(), Some(&5));
        assert!(cell.is_empty() && !cell.is_leased());
        assert_eq!(cell.lease(0).err(), Some(Denied::Empty));
        assert!(cell.take().is_none());
        drop(cell);
        assert_eq!(Rc::strong_count(&value), 1);
        drop(Leased::new((), value.clone()));
        assert_eq!(Rc::strong_count(&value), 1, "a cell that is dropped drops its value");
    }

    #[test]
    fn a_panic_gives_the_lease_back() {
        let cell = Leased::new((), 1);
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _lease = cell.lease(0).ok().unwrap();
            std::panic::resume_unwind(Box::new(()));
        }));
        assert!(panicked.is_err() && !cell.is_leased());
        assert!(cell.lease(0).is_ok());
    }
}
