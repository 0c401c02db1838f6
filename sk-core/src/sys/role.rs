//! One shared value in several roles.
//!
//! A trait object needs a type for each way of calling. A wrapper that holds an `Rc` of the value would be a
//! second allocation and a second pointer to follow for every link; a role is the value itself, seen as another
//! type.
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
