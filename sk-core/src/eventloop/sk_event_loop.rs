//! The loop as an object: what it has to say to others, as signals.

use crate::Cx;
use crate::eventloop::Step;
use crate::object::{Address, Handle, MetaError, ObjectId};
use crate::signal::Signal;
use crate::world::OsSignal;
use std::time::Duration;

/// The loop as an object: `cx.event_loop()`. Its signals are emitted at the end of a round.
#[derive(Debug, Default)]
pub struct SkEventLoop {
    /// A round took longer than an interval; carries how many ticks were missed since the last time.
    pub overrun: Signal<u64>,
    /// A `Synced` loop waited four intervals for a tick of its source that did not come.
    pub sync_lost: Signal<()>,
    /// The work of a round took more than 80 % of the interval: once per episode.
    pub overloaded: Signal<Overload>,
    /// A slot answered `Err` or panicked.
    pub slot_failed: Signal<Failure>,
    /// A queue or mailbox was full and a call was refused: once per episode.
    pub mailbox_full: Signal<()>,
    /// An object of this loop was buried.
    pub buried: Signal<(ObjectId, Reason)>,
    /// The operating system sent SIGINT, SIGTERM or SIGHUP. Only the application's main loop hears these. If nobody
    /// listens, the application ends.
    pub os_signal: Signal<OsSignal>,
    /// A request by name that was sent to another thread was refused there: the answer to
    /// [`attach_by_name`](Cx::attach_by_name), [`detach_by_name`](Cx::detach_by_name) and
    /// [`invoke_method`](Cx::invoke_method) that could not be given at once. What succeeds is not told.
    ///
    /// ```
    /// use sk_core::prelude::*;
    /// use sk_core::eventloop::Refusal;
    /// use sk_core::testing::Simulation;
    ///
    /// struct Camera;
    /// object! { Camera { } }
    ///
    /// #[derive(Default)]
    /// struct Shell { said: String }
    /// impl Shell {
    ///     fn on_refused(&mut self, _cx: &mut Cx, refusal: &Refusal) {
    ///         self.said = format!("{}: {}", refusal.what, refusal.error);
    ///     }
    /// }
    /// object! { Shell { slots { on_refused(&Refusal) } } }
    ///
    /// let simulation = Simulation::new(1);
    /// let mut app = simulation.app();
    /// let cx = app.cx();
    /// let vision = SkThread::new("vision").start(cx)?;
    /// let camera = vision.build(|cx| {
    ///     let camera = cx.spawn(Camera);
    ///     cx.remote(camera)
    /// })?;
    /// let shell = cx.spawn(Shell::default());
    /// attach!(cx, cx.event_loop().by_name_refused => shell.on_refused);
    /// cx.invoke_method(&camera, "zoom", &[2.into()]).unwrap();
    /// simulation.run_for(&mut app, Duration::from_secs(1));
    /// let said = app.cx().with(shell, |shell, _| shell.said.clone());
    /// assert_eq!(said.as_deref(), Ok("call zoom: Camera has no slot `zoom`; it has: none"));
    /// # Ok::<(), ThreadError>(())
    /// ```
    pub by_name_refused: Signal<Refusal>,
}

crate::object! {
    pub SkEventLoop {
        signals {
            overrun(u64)
            sync_lost()
            overloaded(&Overload)
            slot_failed(&Failure)
            mailbox_full()
            buried(ObjectId, Reason)
            os_signal(OsSignal)
            by_name_refused(&Refusal)
        }
    }
}

/// Waits for the burial of one object: `cx.watch(id)`. It buries itself afterwards.
#[derive(Debug, Default)]
pub struct Watch {
    /// The object was buried.
    pub buried: Signal<(ObjectId, Reason)>,
}

crate::object! { pub Watch { signals { buried(ObjectId, Reason) } } }

/// Why an object was buried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// `destroy_later` named it.
    Asked,
    /// An ancestor of it was buried.
    Parent,
    /// Its slot failed and the policy was to destroy it.
    Failed,
    /// Its loop ended.
    LoopEnd,
}

/// A slot that failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The object.
    pub object: ObjectId,
    /// Its path.
    pub path: String,
    /// Its class.
    pub class: &'static str,
    /// The slot.
    pub slot: &'static str,
    /// What the slot's error or panic says.
    pub message: String,
    /// Whether it panicked.
    pub panicked: bool,
    /// After a panic: the calls it came through, outermost first, as `path.slot`.
    pub chain: Vec<String>,
    /// After a panic: how many further slots of the same emits did not run.
    pub skipped: u64,
}

/// A request by name that another thread refused.
#[derive(Clone, Debug)]
pub struct Refusal {
    /// The object at which it failed: that of the signal, or that of the slot.
    pub target: Address,
    /// What was asked for: `call zoom`, `attach frame => show`, `detach frame => show`.
    pub what: String,
    /// Why it was refused.
    pub error: MetaError,
}

/// A loop whose work takes nearly all of its interval.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Overload {
    /// The work of the round.
    pub job_time: Duration,
    /// The interval it has.
    pub interval: Duration,
    /// The step that took most of it.
    pub step: Step,
    /// The slot that took longest, with its own time; none if nothing could be timed in this episode.
    pub culprit: Option<Culprit>,
}

/// The slot that took longest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Culprit {
    /// The object.
    pub object: ObjectId,
    /// Its path.
    pub path: String,
    /// The slot, as `Class.slot`.
    pub slot: String,
    /// Its own time, without that of the slots it called.
    pub time: Duration,
}

impl std::fmt::Display for Overload {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "a round took {:?} of an interval of {:?}, most of it in step {:?}",
            self.job_time, self.interval, self.step
        )?;
        match &self.culprit {
            Some(culprit) => write!(f, "; {} of {} took {:?}", culprit.slot, culprit.path, culprit.time),
            None => Ok(()),
        }
    }
}

/// What the loop has to say at the end of a round.
pub(crate) enum News {
    Overrun(u64),
    SyncLost,
    Overloaded(Overload),
    SlotFailed(Failure),
    MailboxFull,
    Buried(ObjectId, Reason),
    /// Somebody watches an object that was gone already.
    BuriedBefore(ObjectId, Handle<Watch>),
    OsSignal(OsSignal),
    ByNameRefused(Refusal),
}

impl Cx {
    /// Step 10's end: signals of the loop itself.
    pub(crate) fn tell_news(&mut self) {
        for _ in 0..self.news.len() {
            let Some(news) = self.news.pop_front() else { return };
            let object = self.own.event_loop;
            match news {
                News::Overrun(missed) => self.emit_own(object, |l| &l.overrun, &missed),
                News::SyncLost => self.emit_own(object, |l| &l.sync_lost, &()),
                News::Overloaded(overload) => self.emit_own(object, |l| &l.overloaded, &overload),
                News::SlotFailed(failure) => self.emit_own(object, |l| &l.slot_failed, &failure),
                News::MailboxFull => self.emit_own(object, |l| &l.mailbox_full, &()),
                News::Buried(id, reason) => self.tell_buried(id, reason),
                News::BuriedBefore(id, watch) => self.tell_watch(watch, id, Reason::Asked),
                News::OsSignal(signal) => self.tell_os_signal(signal),
                News::ByNameRefused(refusal) => self.emit_own(object, |l| &l.by_name_refused, &refusal),
            }
        }
    }

    /// Another thread's answer to a request by name, to be told at the end of this round.
    pub(crate) fn tell_refusal(&mut self, refusal: Refusal) {
        if self.news.len() < self.settings.queue_calls_max {
            self.news.push_back(News::ByNameRefused(refusal));
        } else {
            self.refused_full();
        }
    }

    fn tell_buried(&mut self, id: ObjectId, reason: Reason) {
        let object = self.own.event_loop;
        self.emit_own(object, |l| &l.buried, &(id, reason));
        for watch in self.watches.remove(&id).unwrap_or_default() {
            self.tell_watch(watch, id, reason);
        }
    }

    fn tell_watch(&mut self, watch: Handle<Watch>, id: ObjectId, reason: Reason) {
        self.emit_own(watch, |w| &w.buried, &(id, reason));
        self.destroy_later(watch);
    }

    fn tell_os_signal(&mut self, signal: OsSignal) {
        let object = self.own.event_loop;
        let heard = self.with(object, |l, _| l.os_signal.listeners() > 0);
        if heard == Ok(true) && !self.quitting {
            self.emit_own(object, |l| &l.os_signal, &signal);
        } else {
            tracing::info!(?signal, "ending; a second signal ends at once");
            self.quit();
            // If that is refused a second signal finds the loop quitting, or nobody.
            let _ = self.world.net.release_os_signals();
        }
    }
}
