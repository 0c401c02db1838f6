//! One shared value in several roles.
//!
//! A trait object needs a type for each way of calling. A wrapper that holds an `Rc` of the value would be a
//! second allocation and a second pointer to follow for every link; a role is the value itself, seen as another
//! type. And the value of an `Rc<dyn Trait>` has to be looked for behind its counts at every use, since how far
//! behind depends on its alignment; a [`Held`] knows where it is.
#![allow(unsafe_code)]

use std::marker::PhantomData;
use std::ops::Deref;
use std::rc::Rc;

/// A `T` that implements traits in a way that depends on `R`.
#[repr(transparent)]
pub(crate) struct InRole<T, R> {
    value: T,
    role: PhantomData<fn() -> R>,
}

impl<T, R> InRole<T, R> {
    /// Another hold on the same value.
    pub(crate) fn share(value: &Rc<T>) -> Rc<InRole<T, R>> {
        let raw = Rc::into_raw(value.clone()).cast::<InRole<T, R>>();
        // SAFETY: `InRole<T, R>` is `repr(transparent)` over `T`, as the role has no size, so both have the same
        // size, alignment and valid values, and dropping one drops the other. The pointer came from `into_raw`
        // and its count is given back here once.
        unsafe { Rc::from_raw(raw) }
    }
}

impl<T, R> Deref for InRole<T, R> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        &self.value
    }
}

/// An `Rc` that points at its value.
pub(crate) struct Held<T: ?Sized> {
    /// From `Rc::into_raw`, with the count that came with it.
    value: *const T,
    /// As an `Rc` it owns a share of a `T` and stays on its thread.
    share: PhantomData<Rc<T>>,
}

impl<T: ?Sized> From<Rc<T>> for Held<T> {
    fn from(shared: Rc<T>) -> Held<T> {
        Held { value: Rc::into_raw(shared), share: PhantomData }
    }
}

impl<T: ?Sized> Deref for Held<T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: the pointer came from `into_raw` and holds a count until it is dropped, so the value lives;
        // only shared references to it are ever made.
        unsafe { &*self.value }
    }
}

impl<T: ?Sized> Clone for Held<T> {
    fn clone(&self) -> Held<T> {
        // SAFETY: the pointer came from `into_raw` and holds a count, so there is at least one now.
        unsafe { Rc::increment_strong_count(self.value) }
        Held { value: self.value, share: PhantomData }
    }
}

impl<T: ?Sized> Drop for Held<T> {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `into_raw`; its count is given back here, once, and it is not used again.
        drop(unsafe { Rc::from_raw(self.value) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::rc::Weak;

    trait Shape {
        fn corners(&self) -> usize;
    }
    struct Three;
    struct Four;
    impl Shape for InRole<String, Three> {
        fn corners(&self) -> usize {
            self.len() * 3
        }
    }
    impl Shape for InRole<String, Four> {
        fn corners(&self) -> usize {
            self.len() * 4
        }
    }

    #[test]
    fn roles_share_one_value_and_the_last_hold_drops_it() {
        let text = Rc::new(String::from("ab"));
        let weak = Rc::downgrade(&text);
        let three: Rc<dyn Shape> = InRole::<_, Three>::share(&text);
        let four: Rc<dyn Shape> = InRole::<_, Four>::share(&text);
        assert_eq!((three.corners(), four.corners()), (6, 8));
        assert_eq!(Rc::strong_count(&text), 3);
        drop((text, three));
        assert!(weak.upgrade().is_some());
        drop(four);
        assert!(weak.upgrade().is_none());
    }

    #[test]
    fn what_is_held_lives_until_the_last_hold_goes() {
        #[repr(align(64))]
        struct Wide(u8);
        impl Shape for Wide {
            fn corners(&self) -> usize {
                usize::from(self.0)
            }
        }
        let wide = Rc::new(Wide(9));
        let weak = Rc::downgrade(&wide);
        let first: Held<dyn Shape> = Held::from(wide as Rc<dyn Shape>);
        let second = first.clone();
        assert_eq!((first.corners(), Weak::strong_count(&weak)), (9, 2));
        drop(first);
        assert_eq!(second.corners(), 9);
        drop(second);
        assert!(weak.upgrade().is_none());
    }
}
