//! How an object is named: by id, by typed handle, and where it lives.

use crate::object::SkObject;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::marker::PhantomData;

/// Names one object of one loop for ever: an index, the generation of that index, and the loop's number.
/// An id is never used again, so a stale one names nobody.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ObjectId {
    pub(crate) loop_number: u32,
    pub(crate) index: u32,
    pub(crate) generation: u32,
}

impl ObjectId {
    /// The id of no object.
    pub const NOBODY: ObjectId = ObjectId { loop_number: 0, index: u32::MAX, generation: 0 };
}

impl fmt::Debug for ObjectId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == ObjectId::NOBODY {
            return f.write_str("#nobody");
        }
        write!(f, "#{}.{}", self.index, self.generation)
    }
}

impl fmt::Display for ObjectId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// Keeps a type on its thread: neither `Send` nor `Sync`.
struct SameThread<T>(#[expect(dead_code, reason = "only its type matters: a pointer is not Send")] *const T);

/// A typed name of an object on this thread: 12 bytes, `Copy`, and not `Send`. It never keeps the object
/// alive: using it after the object was buried answers [`Access::Gone`].
///
/// To reach the object from another thread make a [`Remote`](crate::Remote) of it with
/// [`Cx::remote`](crate::Cx::remote).
pub struct Handle<T> {
    id: ObjectId,
    same_thread: PhantomData<SameThread<T>>,
}

impl<T> Handle<T> {
    pub(crate) const fn new(id: ObjectId) -> Handle<T> {
        Handle { id, same_thread: PhantomData }
    }

    /// A handle that names nobody; for a field that is filled later.
    pub const fn nobody() -> Handle<T> {
        Handle::new(ObjectId::NOBODY)
    }

    /// The untyped id.
    pub const fn id(self) -> ObjectId {
        self.id
    }
}

impl<T: SkObject> Handle<T> {
    /// The object's signals, as [`attach!`](crate::attach) wants them.
    pub fn signals(self) -> T::Signals<Here> {
        T::signals_of(&Here::new(self.id))
    }

    /// The object's slots, as [`attach!`](crate::attach) wants them.
    pub fn slots(self) -> T::Slots<Here> {
        T::slots_of(&Here::new(self.id))
    }
}

impl<T> Clone for Handle<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Handle<T> {}
impl<T> PartialEq for Handle<T> {
    fn eq(&self, other: &Self) -> bool {
        self.id == other.id
    }
}
impl<T> Eq for Handle<T> {}
impl<T> Hash for Handle<T> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.id.hash(state);
    }
}
impl<T> PartialOrd for Handle<T> {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl<T> Ord for Handle<T> {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.id.cmp(&other.id)
    }
}
impl<T> Default for Handle<T> {
    fn default() -> Self {
        Handle::nobody()
    }
}
impl<T> fmt::Debug for Handle<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = std::any::type_name::<T>();
        let short = name.rsplit("::").next().unwrap_or(name);
        write!(f, "{short}{}", self.id)
    }
}
impl<T> From<Handle<T>> for ObjectId {
    fn from(handle: Handle<T>) -> ObjectId {
        handle.id
    }
}

/// Why an object could not be reached by its handle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Access {
    /// A slot of the object is running: it can be reached again when that slot ends.
    #[error("the object is busy: one of its slots is running")]
    Busy,
    /// The object was buried, or was never of this loop or this type.
    #[error("the object is gone")]
    Gone,
}

/// Where an object lives, seen from here: [`Here`] or [`There`](crate::thread::There).
pub trait Place: Clone + 'static {
    #[doc(hidden)]
    fn target(&self) -> crate::signal::Target;
}

/// On this thread's loop.
#[derive(Clone, Copy)]
pub struct Here {
    pub(crate) id: ObjectId,
    same_thread: PhantomData<SameThread<()>>,
}

impl Here {
    pub(crate) fn new(id: ObjectId) -> Here {
        Here { id, same_thread: PhantomData }
    }
}

impl Place for Here {
    fn target(&self) -> crate::signal::Target {
        crate::signal::Target::Local(self.id)
    }
}
