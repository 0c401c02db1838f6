//! The signal itself: a field of the user's struct.

use crate::Cx;
use crate::object::ObjectId;
use crate::signal::link::{Kept, Kind, Link, missed};
use crate::signal::{Bound, Call, Delivery, LinkKey, Links, Mode, Reached, SlotMeta};
use crate::sys::role::Held;
use crate::thread::RemoteSend;
use std::any::{Any, TypeId};
use std::borrow::Borrow;
use std::fmt;
use std::rc::Rc;

/// A signal that carries an `A`: a public field of an object's struct. 8 bytes while nobody listens.
///
/// One argument is itself (`Signal<f32>`), several are a tuple (`Signal<(u64, String)>`), none is `()`.
/// A text can be carried borrowed: `Signal<str>`.
///
/// ```
/// use sk_core::prelude::*;
///
/// #[derive(Default)]
/// struct Probe { measured: Signal<f32> }
/// impl Probe {
///     fn sample(&mut self, cx: &mut Cx) { self.measured.emit(cx, 20.5) }
/// }
/// object! { Probe { signals { measured(f32) } slots { sample() } } }
///
/// #[derive(Default)]
/// struct Display { shown: f32 }
/// impl Display {
///     fn show(&mut self, cx: &mut Cx, celsius: f32) { self.shown = celsius; cx.quit() }
/// }
/// object! { Display { slots { show(f32) } } }
///
/// let mut app = SkApp::new();
/// let cx = app.cx();
/// let probe = cx.spawn(Probe::default());
/// let display = cx.spawn(Display::default());
/// attach!(cx, cx.fast_zone().pulse => probe.sample);
/// attach!(cx, probe.measured => display.show);
/// app.run();
/// assert_eq!(app.cx().with(display, |d, _| d.shown), Ok(20.5));
/// ```
pub struct Signal<A: ?Sized + ToOwned> {
    links: Option<Rc<Links<A>>>,
}

impl<A: ?Sized + ToOwned> Signal<A> {
    /// A signal with no listener.
    pub const fn new() -> Signal<A> {
        Signal { links: None }
    }

    /// How many slots listen.
    pub fn listeners(&self) -> usize {
        self.links().len()
    }

    fn links(&self) -> &[Link<A>] {
        self.links.as_ref().map_or(&[], |links| links.as_slice())
    }
}

impl<A: ?Sized + ToOwned + 'static> Signal<A> {
    /// Triggers the signal: direct slots run now, in the order they were attached; queued ones get a
    /// copy of `args` and run in their loop's next round. Never blocks; with no listener it costs one
    /// branch. What a receiver's slot leaves behind (an error, a panic) does not come back here.
    #[inline]
    pub fn emit(&self, cx: &mut Cx, args: impl Borrow<A>) {
        let Some(links) = &self.links else { return };
        match &**links {
            // The most usual case stands where the signal is emitted, without a call but the slot's.
            Links::One(Link { kind: Kind::Direct(call), .. }) if cx.depth < cx.depth_max => {
                let depth = cx.depth;
                cx.depth = depth + 1;
                call_direct(call, cx, args.borrow());
                cx.depth = depth;
            }
            links => links.fire(cx, args.borrow()),
        }
    }

    /// The links as they are now, for an emitter that must not be leased while its slots run.
    pub(crate) fn frozen(&self) -> Option<Rc<Links<A>>> {
        self.links.clone()
    }
}

impl<A: ?Sized + ToOwned> Default for Signal<A> {
    fn default() -> Self {
        Signal::new()
    }
}

impl<A: ?Sized + ToOwned> fmt::Debug for Signal<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Signal({} listeners)", self.listeners())
    }
}

#[inline(always)]
fn call_direct<A: ?Sized + ToOwned + 'static>(call: &Held<dyn Call<A>>, cx: &mut Cx, args: &A) {
    let reached = call.call(cx, args, 0);
    if reached != Reached::Ran {
        missed(call, cx, args, reached);
    }
}

/// The links of an emission that are still to be followed. Any are left at the end only when a panic unwinds
/// through it: then their slots are skipped, and counted; otherwise this costs nothing.
struct Rest<'a, A: ?Sized + ToOwned>(std::slice::Iter<'a, Link<A>>);

impl<A: ?Sized + ToOwned> Drop for Rest<'_, A> {
    #[inline]
    fn drop(&mut self) {
        if !self.0.as_slice().is_empty() {
            crate::eventloop::note_skipped(self.0.len());
        }
    }
}

impl<A: ?Sized + ToOwned + 'static> Links<A> {
    pub(crate) fn fire(&self, cx: &mut Cx, args: &A) {
        let depth = cx.depth;
        if depth >= cx.depth_max {
            return self.fire_carefully(cx, args);
        }
        cx.depth = depth + 1;
        let mut rest = Rest(self.as_slice().iter());
        for link in rest.0.by_ref() {
            match &link.kind {
                Kind::Direct(call) => call_direct(call, cx, args),
                _ => link.emit_kept(cx, args),
            }
        }
        cx.depth = depth;
    }

    /// The depth limit is reached, or single calls are being timed.
    #[cold]
    fn fire_carefully(&self, cx: &mut Cx, args: &A) {
        if cx.is_too_deep() {
            // Counted as one level all the same, so that a spent link is noted for its own emitter.
            cx.depth += 1;
            for link in self.as_slice() {
                link.emit_flat(cx, args);
            }
            cx.depth -= 1;
            return;
        }
        cx.depth += 1;
        let mut rest = Rest(self.as_slice().iter());
        for link in rest.0.by_ref() {
            if matches!(link.kind, Kind::Remote(_)) {
                link.emit_kept(cx, args);
            } else {
                cx.timed(|cx| link.emit_kept(cx, args));
            }
        }
        cx.depth -= 1;
    }

    /// A top-level dispatch: every slot has a guard of its own.
    pub(crate) fn fire_guarded(&self, cx: &mut Cx, args: &A) {
        cx.depth = 1;
        let timing = cx.timing.on;
        for link in self.as_slice() {
            cx.guarded(|cx| match &link.kind {
                Kind::Remote(_) => link.emit_kept(cx, args),
                _ if timing => cx.timed(|cx| link.emit_kept(cx, args)),
                Kind::Direct(call) => call_direct(call, cx, args),
                Kind::Kept(_) => link.emit_kept(cx, args),
            });
        }
        cx.depth = 0;
    }
}

/// What a new link is made of.
#[doc(hidden)]
pub struct Order {
    pub(crate) key: LinkKey,
    pub(crate) mode: Mode,
    pub(crate) end: End,
    /// The slot takes no arguments, whatever the signal carries.
    pub(crate) ignoring: bool,
}

/// The far end of a new link: what [`Bound`] or a crossing made, of a type only the signal knows.
pub(crate) enum End {
    Local(Bound),
    Remote(Box<dyn Any>),
}

/// What became of an order.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attached {
    New,
    /// The slot does not take what the signal carries.
    Mismatch,
}

/// A live link, as the by-name layer lists it.
#[derive(Clone, Debug)]
pub struct LinkInfo {
    /// The receiver, within its loop.
    pub target: ObjectId,
    /// The slot.
    pub slot: &'static SlotMeta,
    /// How it delivers.
    pub mode: Mode,
    /// Whether the receiver lives on another thread.
    pub remote: bool,
    /// Calls of a `Latest` link that a newer one replaced.
    pub replaced: u64,
    /// Calls refused because a queue or the receiver's mailbox was full.
    pub refused: u64,
}

/// A signal of unknown type.
#[doc(hidden)]
pub trait AnySignal {
    fn has(&self, key: LinkKey) -> bool;
    fn attach(&mut self, order: Order) -> Attached;
    fn detach(&mut self, key: LinkKey) -> bool;
    /// Takes out links that will never call again; answers how many.
    fn sweep(&mut self) -> usize;
    fn each_link(&self, f: &mut dyn FnMut(LinkInfo));
}

/// Calls a slot without arguments, whatever the signal carries.
struct Ignoring(Held<dyn Call<()>>);

impl<A: ?Sized> Call<A> for Ignoring {
    fn call(&self, cx: &mut Cx, _args: &A, allowed: u8) -> Reached {
        self.0.call(cx, &(), allowed)
    }
    fn header(&self) -> &crate::object::Header {
        self.0.header()
    }
    fn slot(&self) -> &'static SlotMeta {
        self.0.slot()
    }
    fn is_shell(&self) -> bool {
        self.0.is_shell()
    }
}

struct IgnoringRemote(Rc<dyn RemoteSend<()>>);

impl<A: ?Sized> RemoteSend<A> for IgnoringRemote {
    fn send(&self, cx: &mut Cx, _args: &A) {
        self.0.send(cx, &());
    }
    fn is_closed(&self) -> bool {
        self.0.is_closed()
    }
    fn mode(&self) -> Mode {
        self.0.mode()
    }
    fn slot(&self) -> &'static SlotMeta {
        self.0.slot()
    }
    fn losses(&self) -> (u64, u64) {
        self.0.losses()
    }
    fn target(&self) -> ObjectId {
        self.0.target()
    }
}

impl<A: ?Sized + ToOwned + 'static> Signal<A> {
    fn kind(order: Order) -> Option<Kind<A>> {
        match order.end {
            End::Remote(sender) if order.ignoring => {
                let sender = sender.downcast::<Rc<dyn RemoteSend<()>>>().ok()?;
                Some(Kind::Remote(Rc::new(IgnoringRemote(*sender))))
            }
            End::Remote(sender) => sender
                .downcast::<Rc<dyn RemoteSend<A>>>()
                .ok()
                .map(|sender| Kind::Remote(*sender)),
            End::Local(bound) => {
                let call: Rc<dyn Call<A>> = if order.ignoring && TypeId::of::<A>() != TypeId::of::<()>() {
                    Rc::new(Ignoring(Held::from(*bound.downcast::<Rc<dyn Call<()>>>().ok()?)))
                } else {
                    *bound.downcast::<Rc<dyn Call<A>>>().ok()?
                };
                let call = Held::from(call);
                Some(if order.mode.delivery == Delivery::Direct && !order.mode.once {
                    Kind::Direct(call)
                } else {
                    Kind::Kept(Kept::new(call, order.mode))
                })
            }
        }
    }

    /// Links are frozen between rewires, so nobody else holds them now but an emitter of the loop's own
    /// that was caught in the middle: it keeps the old ones.
    fn edit(&mut self, change: impl FnOnce(&mut Vec<Link<A>>)) {
        let links = match self.links.as_mut().and_then(Rc::get_mut) {
            Some(Links::Many(links)) => {
                change(links);
                if links.len() > 1 {
                    return;
                }
                std::mem::take(links)
            }
            _ => {
                let shared = self.links.take().map(Rc::unwrap_or_clone);
                let mut links = shared.map_or(Vec::new(), Links::into_vec);
                change(&mut links);
                links
            }
        };
        self.links = Links::of(links).map(Rc::new);
    }
}

impl<A: ?Sized + ToOwned + 'static> AnySignal for Signal<A> {
    fn has(&self, key: LinkKey) -> bool {
        self.links().iter().any(|link| link.has(key))
    }

    fn attach(&mut self, order: Order) -> Attached {
        let key = order.key;
        let Some(kind) = Self::kind(order) else { return Attached::Mismatch };
        let link = Link::new(key, kind);
        if self.links.is_none() {
            self.links = Some(Rc::new(Links::One(link)));
            return Attached::New;
        }
        self.edit(|links| {
            if links.len() == links.capacity() {
                links.retain(|link| !link.is_dead());
                if links.len() == links.capacity() {
                    // 2, 4, 8 …: few signals have many listeners.
                    links.reserve_exact(links.len());
                }
            }
            links.push(link);
        });
        Attached::New
    }

    fn detach(&mut self, key: LinkKey) -> bool {
        let Some(at) = self.links().iter().position(|link| link.has(key)) else { return false };
        if self.listeners() == 1 {
            self.links = None;
        } else {
            self.edit(|links| drop(links.remove(at)));
        }
        true
    }

    fn sweep(&mut self) -> usize {
        let dead = self.links().iter().filter(|link| link.is_dead()).count();
        if dead == self.listeners() {
            self.links = None;
        } else if dead > 0 {
            self.edit(|links| links.retain(|link| !link.is_dead()));
        }
        dead
    }

    fn each_link(&self, f: &mut dyn FnMut(LinkInfo)) {
        for link in self.links() {
            let (replaced, refused) = link.losses();
            f(LinkInfo {
                target: link.key().target,
                slot: link.slot(),
                mode: link.mode(),
                remote: matches!(link.kind, Kind::Remote(_)),
                replaced,
                refused,
            });
        }
    }
}
