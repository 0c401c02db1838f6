//! A loop on a thread of its own.

use crate::Cx;
use crate::eventloop::{LoopSettings, SettingsError, TimingMode};
use crate::object::ObjectId;
use crate::testing::Scheduler;
use crate::thread::{Message, PostError, There};
use crate::world::WorldSeed;
use std::cell::RefCell;
use std::io;
use std::rc::Rc;
use std::thread::JoinHandle;
use std::time::Duration;

/// A thread with a loop of its own. Objects are built there and never handed over; what they are built from
/// is sent. Dropping it stops the loop, buries its objects and waits for the thread.
///
/// ```
/// use sk_core::prelude::*;
///
/// #[derive(Default)]
/// struct Camera { taken: u64, frame: Signal<u64> }
/// impl Camera {
///     fn grab(&mut self, cx: &mut Cx) { self.taken += 1; self.frame.emit(cx, self.taken) }
/// }
/// object! { Camera { signals { frame(u64) } slots { grab() } } }
///
/// struct Display;
/// impl Display {
///     fn show(&mut self, cx: &mut Cx, frame: u64) { if frame >= 3 { cx.quit() } }
/// }
/// object! { Display { slots { show(u64) } } }
///
/// let mut app = SkApp::new();
/// let cx = app.cx();
/// let display = cx.spawn(Display);
/// let vision = SkThread::new("vision").interval(Duration::from_millis(1)).start(cx)?;
/// let camera = vision.build(|cx| {
///     let camera = cx.spawn(Camera::default());
///     attach!(cx, cx.fast_zone().pulse => camera.grab);
///     cx.remote(camera)
/// })?;
/// attach!(cx, camera.frame => cx.remote(display).show, Queued);
/// app.run();
/// vision.stop();
/// # Ok::<(), ThreadError>(())
/// ```
pub struct SkThread {
    name: String,
    running: Option<Running>,
}

enum Running {
    Real { there: There, thread: JoinHandle<()> },
    Simulated { there: There, cx: Rc<RefCell<Cx>>, scheduler: Rc<Scheduler> },
}

/// Why a thread could not do as told.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ThreadError {
    /// The operating system gave no thread, or no descriptors for its loop.
    #[error("the thread {0:?} cannot be started: {1}")]
    Start(String, #[source] io::Error),
    /// The settings contradict each other.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The thread's loop has ended, or the work panicked there.
    #[error("the thread {0:?} has ended")]
    Ended(String),
    /// The thread's mailbox is full.
    #[error("the thread {0:?} does not keep up: {1}")]
    Full(String, #[source] PostError),
}

/// Settings of a thread that is about to start.
pub struct ThreadBuilder {
    name: String,
    change: Box<dyn FnOnce(&mut LoopSettings)>,
}

impl SkThread {
    /// A thread of that name. What is not set is inherited from the loop that starts it: mode, intervals,
    /// policies.
    #[expect(clippy::new_ret_no_self, reason = "a thread begins with its settings")]
    pub fn new(name: &str) -> ThreadBuilder {
        ThreadBuilder { name: name.to_owned(), change: Box::new(|_| {}) }
    }

    /// Runs `make` on the thread, in its loop's next round, and waits for the answer: to spawn objects and
    /// come back with [`Remote`](crate::Remote)s of them.
    ///
    /// # Errors
    /// If the thread's loop has ended or ends meanwhile, its mailbox is full, or `make` panics.
    pub fn build<R: Send + 'static>(
        &self,
        make: impl FnOnce(&mut Cx) -> R + Send + 'static,
    ) -> Result<R, ThreadError> {
        let ended = || ThreadError::Ended(self.name.clone());
        match self.running.as_ref().ok_or_else(ended)? {
            Running::Simulated { cx, .. } => {
                let mut cx = cx.try_borrow_mut().map_err(|_| ended())?;
                Ok(make(&mut cx))
            }
            Running::Real { there, .. } => {
                let (sender, receiver) = crossbeam_channel::bounded(1);
                let work = Message::Run(Box::new(move |cx| {
                    // The asker is waiting: the channel has room for its one answer.
                    let _ = sender.send(make(cx));
                }));
                there.mailbox.post(work).map_err(|error| match error {
                    PostError::Gone => ended(),
                    full @ PostError::Full(_) => ThreadError::Full(self.name.clone(), full),
                })?;
                receiver.recv().map_err(|_| ended())
            }
        }
    }

    /// Runs `work` on the thread, in its loop's next round, in order with everything else sent there. Never
    /// waits.
    ///
    /// # Errors
    /// If the thread's loop has ended, or its mailbox is full.
    pub fn post(&self, work: impl FnOnce(&mut Cx) + Send + 'static) -> Result<(), ThreadError> {
        let ended = || ThreadError::Ended(self.name.clone());
        let (Running::Real { there, .. } | Running::Simulated { there, .. }) =
            self.running.as_ref().ok_or_else(ended)?;
        there.mailbox.post(Message::Run(Box::new(work))).map_err(|error| match error {
            PostError::Gone => ended(),
            full @ PostError::Full(_) => ThreadError::Full(self.name.clone(), full),
        })
    }

    /// Asks the loop to end and does not wait for it: for a thread that hangs in a slot. It goes on until that
    /// slot ends, or the process.
    pub fn abandon(mut self) {
        match self.running.take() {
            Some(Running::Real { there, thread }) => {
                ask_to_end(&there);
                drop(thread);
            }
            // In a simulation no slot hangs: it would be this very thread that hangs.
            simulated => {
                self.running = simulated;
                self.halt();
            }
        }
    }

    /// The thread's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Ends the loop after its round, buries its objects and waits for the thread.
    pub fn stop(mut self) {
        self.halt();
    }

    fn halt(&mut self) {
        match self.running.take() {
            None => {}
            Some(Running::Simulated { cx, scheduler, .. }) => {
                scheduler.remove(&cx);
                // A thread that is stopped from its own slot ends when that slot has ended.
                match cx.try_borrow_mut() {
                    Ok(mut cx) => cx.end(),
                    Err(_) => tracing::error!(name = self.name, "a simulated thread stopped itself"),
                }
            }
            Some(Running::Real { there, thread }) => {
                ask_to_end(&there);
                if thread.join().is_err() {
                    tracing::error!(name = self.name, "the thread ended with a panic outside its slots");
                }
            }
        }
    }
}

fn ask_to_end(there: &There) {
    // A mailbox that is closed belongs to a loop that has ended by itself.
    let _ = there.mailbox.post_anyway(Message::Run(Box::new(|cx| cx.quit())));
    there.mailbox.wake_in_any_case();
}

impl Drop for SkThread {
    fn drop(&mut self) {
        self.halt();
    }
}

impl ThreadBuilder {
    /// How the loop waits.
    pub fn mode(self, mode: TimingMode) -> Self {
        self.configure(move |settings| settings.mode = mode)
    }

    /// The interval of the fast tick. A slow interval below it is raised to it; set that one afterwards.
    pub fn interval(self, interval: Duration) -> Self {
        self.configure(move |settings| {
            settings.interval = interval;
            settings.slow_interval = settings.slow_interval.max(interval);
        })
    }

    /// The interval of the slow tick.
    pub fn slow_interval(self, interval: Duration) -> Self {
        self.configure(move |settings| settings.slow_interval = interval)
    }

    /// Everything else.
    pub fn configure(self, change: impl FnOnce(&mut LoopSettings) + 'static) -> Self {
        let before = self.change;
        let change = Box::new(move |settings: &mut LoopSettings| {
            before(settings);
            change(settings);
        });
        ThreadBuilder { name: self.name, change }
    }

    /// Starts the thread and its loop.
    ///
    /// # Errors
    /// If the settings contradict each other, or the system has no thread or descriptors left.
    pub fn start(self, cx: &mut Cx) -> Result<SkThread, ThreadError> {
        let mut settings = *cx.settings();
        (self.change)(&mut settings);
        settings.check()?;
        let refused = |error| ThreadError::Start(self.name.clone(), error);
        let seed = cx.world.for_thread().map_err(refused)?;
        let running = match cx.scheduler() {
            Some(scheduler) => {
                let world = seed.grow().map_err(refused)?;
                let cx = scheduler.add(Cx::new(&self.name, world, settings));
                let there = cx.borrow().here(ObjectId::NOBODY);
                Running::Simulated { there, cx, scheduler }
            }
            None => start_real(&self.name, seed, settings).map_err(refused)?,
        };
        Ok(SkThread { name: self.name, running: Some(running) })
    }
}

fn start_real(name: &str, seed: WorldSeed, settings: LoopSettings) -> io::Result<Running> {
    let (sender, receiver) = crossbeam_channel::bounded(1);
    let own_name = name.to_owned();
    let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
        let world = match seed.grow() {
            Ok(world) => world,
            Err(error) => {
                // The starter is waiting: the channel has room for its one answer.
                let _ = sender.send(Err(error));
                return;
            }
        };
        let mut cx = Cx::new(&own_name, world, settings);
        let _ = sender.send(Ok(cx.here(ObjectId::NOBODY)));
        while !cx.quitting {
            let stepped = crate::eventloop::step(&mut cx, |cx| {
                cx.prepare_thread();
                cx.pulse_once();
            });
            if stepped.is_none() {
                break;
            }
        }
    })?;
    match receiver.recv() {
        Ok(Ok(there)) => Ok(Running::Real { there, thread }),
        Ok(Err(error)) => Err(error),
        Err(_) => Err(io::Error::other("the thread ended before its loop began")),
    }
}
