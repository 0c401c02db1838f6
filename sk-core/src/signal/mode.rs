//! How a link delivers: the modes, as types so that a wrong one is a compile error.

use crate::object::Here;
use crate::thread::{Crossing, There};
use std::fmt;

/// The slot runs inside `emit`. Both ends live on one thread.
#[derive(Clone, Copy, Debug, Default)]
pub struct Direct;

/// The slot runs in the next round of the receiver's loop, with a copy of the arguments.
#[derive(Clone, Copy, Debug, Default)]
pub struct Queued;

/// As [`Queued`], but at most one call waits: a newer one replaces it, and the replaced are counted.
#[derive(Clone, Copy, Debug, Default)]
pub struct Latest;

/// [`Direct`], once: the link is spent before its call.
#[derive(Clone, Copy, Debug, Default)]
pub struct OneShot;

/// Another mode, once: `Queued.once()`, `Latest.once()`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Once<M>(pub M);

impl Direct {
    /// The same as [`OneShot`].
    pub const fn once(self) -> Once<Direct> {
        Once(self)
    }
}
impl Queued {
    /// Queued, but only the first call.
    pub const fn once(self) -> Once<Queued> {
        Once(self)
    }
}
impl Latest {
    /// Only the first call, so that nothing newer can replace it: the same as `Queued.once()`.
    pub const fn once(self) -> Once<Latest> {
        Once(self)
    }
}

/// How a link delivers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Delivery {
    /// Inside `emit`.
    Direct,
    /// In the next round.
    Queued,
    /// In the next round, the newest only.
    Latest,
}

/// A link's mode as a value, for the by-name layer and for listings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Mode {
    /// How it delivers.
    pub delivery: Delivery,
    /// Whether the link is gone after its first call.
    pub once: bool,
}

#[expect(non_upper_case_globals, reason = "these stand where an enum's variants would")]
impl Mode {
    /// Inside `emit`.
    pub const Direct: Mode = Mode { delivery: Delivery::Direct, once: false };
    /// In the next round.
    pub const Queued: Mode = Mode { delivery: Delivery::Queued, once: false };
    /// In the next round, the newest only.
    pub const Latest: Mode = Mode { delivery: Delivery::Latest, once: false };
    /// Inside the first `emit`, then gone.
    pub const OneShot: Mode = Mode { delivery: Delivery::Direct, once: true };

    /// The same, but only once.
    pub const fn once(self) -> Mode {
        Mode { once: true, ..self }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.delivery, self.once) {
            (Delivery::Direct, true) => f.write_str("OneShot"),
            (delivery, false) => write!(f, "{delivery:?}"),
            (delivery, true) => write!(f, "{delivery:?}.once"),
        }
    }
}

/// A mode type, whatever its ends.
pub trait LinkShape: Copy {
    /// The mode as a value.
    const MODE: Mode;
}
impl LinkShape for Direct {
    const MODE: Mode = Mode::Direct;
}
impl LinkShape for Queued {
    const MODE: Mode = Mode::Queued;
}
impl LinkShape for Latest {
    const MODE: Mode = Mode::Latest;
}
impl LinkShape for OneShot {
    const MODE: Mode = Mode::OneShot;
}
impl<M: LinkShape> LinkShape for Once<M> {
    const MODE: Mode = M::MODE.once();
}

/// A mode in which a `Signal<A>` can reach a slot at place `P`.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot carry `{A}` to a slot at `{P}`",
    note = "a link to a `Remote` is `Queued` or `Latest`, and what it carries is `Send`"
)]
pub trait AttachMode<A: ?Sized, P>: LinkShape {
    #[doc(hidden)]
    fn crossing() -> Option<Crossing>;
}

impl<A: ?Sized, M: LinkShape> AttachMode<A, Here> for M {
    fn crossing() -> Option<Crossing> {
        None
    }
}

macro_rules! crosses {
    ($($mode:ty),*) => {$(
        impl<A> AttachMode<A, There> for $mode
        where
            A: ?Sized + ToOwned + 'static,
            A::Owned: Send,
        {
            fn crossing() -> Option<Crossing> {
                Some(Crossing::of::<A>())
            }
        }
    )*};
}
crosses!(Queued, Latest, Once<Queued>, Once<Latest>);
