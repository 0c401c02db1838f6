//! An object of another thread, as a value that can be sent anywhere.

use crate::Cx;
use crate::object::{Access, Handle, ObjectId, Place, SkObject};
use crate::signal::{SlotFor, SlotRef, Target};
use crate::thread::{Mailbox, Message};
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

/// On the loop of another thread (or on this one, named from outside).
#[derive(Clone)]
pub struct There {
    pub(crate) mailbox: Arc<Mailbox>,
    pub(crate) id: ObjectId,
}

impl fmt::Debug for There {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} on another loop", self.id)
    }
}

impl Place for There {
    fn target(&self) -> Target {
        Target::Remote(self.clone())
    }
}

/// Why a message was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PostError {
    /// The receiving loop has not kept up.
    #[error("the mailbox is full: {0} messages wait")]
    Full(usize),
    /// The receiving loop has ended.
    #[error("the receiving loop has ended")]
    Gone,
}

/// An object of some thread's loop: `Clone + Send`. Made by [`Cx::remote`]. What is sent to it runs on its
/// own loop, in the order in which this thread sent it.
///
/// ```
/// use sk_core::prelude::*;
///
/// #[derive(Default)]
/// struct Counter { count: u64 }
/// object! { Counter { slots { add(u64) } } }
/// impl Counter {
///     fn add(&mut self, _cx: &mut Cx, n: u64) { self.count += n }
/// }
///
/// let mut app = SkApp::new();
/// let counter = app.cx().spawn(Counter::default());
/// let remote = app.cx().remote(counter);
/// std::thread::spawn(move || remote.post(|counter, cx| { counter.add(cx, 2); cx.quit() })).join().unwrap().unwrap();
/// app.run();
/// assert_eq!(app.cx().with(counter, |c, _| c.count), Ok(2));
/// ```
pub struct Remote<T> {
    there: There,
    object: PhantomData<fn() -> T>,
}

impl<T> Remote<T> {
    pub(crate) fn new(there: There) -> Remote<T> {
        Remote { there, object: PhantomData }
    }

    pub(crate) fn there(&self) -> &There {
        &self.there
    }

    /// Destroys the object at the end of its loop's next round. Safe when it is gone already.
    ///
    /// # Errors
    /// If the loop has ended, or its mailbox is full.
    pub fn destroy_later(&self) -> Result<(), PostError> {
        let id = self.there.id;
        self.there.mailbox.post(Message::Run(Box::new(move |cx| cx.destroy_later(id))))
    }
}

impl<T: SkObject> Remote<T> {
    /// The object's signals, as [`attach!`](crate::attach) wants them.
    pub fn signals(&self) -> T::Signals<There> {
        T::signals_of(&self.there)
    }

    /// The object's slots, as [`attach!`](crate::attach) wants them.
    pub fn slots(&self) -> T::Slots<There> {
        T::slots_of(&self.there)
    }

    /// Runs `f` on the object, in its loop's next round, in order with queued calls. Never blocks.
    /// If the object is gone by then, `f` is dropped and counted.
    ///
    /// # Errors
    /// If the loop has ended, or its mailbox is full.
    pub fn post(&self, f: impl FnOnce(&mut T, &mut Cx) + Send + 'static) -> Result<(), PostError> {
        let id = self.there.id;
        self.there.mailbox.post(Message::Run(Box::new(move |cx| {
            if cx.with(Handle::<T>::new(id), f).is_err() {
                cx.counters.gone += 1;
            }
        })))
    }

    /// Runs `question` on the object, on its own loop, and brings the answer back as a call of `answer` on
    /// an object of the asker's. `Err(Gone)` comes back the same way. Never blocks.
    ///
    /// # Errors
    /// If the loop has ended, or its mailbox is full; or if the asker's loop has ended, or as many answers
    /// as its mailbox holds messages are outstanding there.
    pub fn ask<R, S>(
        &self,
        question: impl FnOnce(&mut T, &mut Cx) -> R + Send + 'static,
        answer: SlotRef<S, There>,
    ) -> Result<(), PostError>
    where
        R: Clone + Send + 'static,
        S: SlotFor<Result<R, Access>>,
    {
        let id = self.there.id;
        let Target::Remote(back) = answer.target() else { return Err(PostError::Gone) };
        let place = back.mailbox.promise()?;
        self.there.mailbox.post(Message::Run(Box::new(move |cx| {
            let found = cx.with(Handle::<T>::new(id), question);
            place.keep(move |cx| cx.call_slot::<Result<R, Access>>(back.id, S::META.uid, &found));
        })))
    }
}

impl<T> Clone for Remote<T> {
    fn clone(&self) -> Self {
        Remote { there: self.there.clone(), object: PhantomData }
    }
}

impl<T> fmt::Debug for Remote<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Remote({:?})", self.there)
    }
}

impl Cx {
    /// A name of the object that other threads can use.
    pub fn remote<T: SkObject>(&self, handle: Handle<T>) -> Remote<T> {
        Remote::new(self.here(handle.id()))
    }
}
