//! The application: the main thread's loop.

use crate::Cx;
use crate::eventloop::poll::OS_SIGNALS_TOKEN;
use crate::eventloop::{LoopSettings, SettingsError, TimingMode};
use crate::sys;
use crate::testing::Scheduler;
use crate::world::World;
use std::cell::Cell;
use std::io;
use std::rc::Rc;
use std::time::Duration;

thread_local! {
    /// The number of the loop that is being stepped on this thread, set during a step only.
    static STEPPED: Cell<u32> = const { Cell::new(0) };
}

/// How [`SkApp::run`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    /// `quit` was called, or the operating system asked for the end.
    Quit,
    /// A loop is running on this thread already; nothing was done.
    Nested,
}

/// Steps a loop unless one is being stepped on this thread.
pub(crate) fn step<R>(cx: &mut Cx, f: impl FnOnce(&mut Cx) -> R) -> Option<R> {
    struct Reset;
    impl Drop for Reset {
        fn drop(&mut self) {
            STEPPED.set(0);
        }
    }
    if STEPPED.get() != 0 {
        tracing::error!("a loop cannot run inside a slot of another one on the same thread");
        return None;
    }
    STEPPED.set(cx.table.loop_number());
    let _reset = Reset;
    Some(f(cx))
}

/// The application's main loop. Its objects are buried when it is dropped.
///
/// ```
/// use sk_core::prelude::*;
///
/// #[derive(Default)]
/// struct Counter { ticks: u32 }
/// impl Counter {
///     fn on_tick(&mut self, cx: &mut Cx) { self.ticks += 1; if self.ticks == 3 { cx.quit() } }
/// }
/// object! { Counter { slots { on_tick() } } }
///
/// let mut app = SkApp::builder().interval(Duration::from_millis(1)).build()?;
/// let cx = app.cx();
/// let counter = cx.spawn(Counter::default());
/// attach!(cx, cx.fast_zone().pulse => counter.on_tick);
/// app.run();
/// assert_eq!(app.cx().with(counter, |c, _| c.ticks), Ok(3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SkApp {
    cx: Cx,
    scheduler: Option<Rc<Scheduler>>,
}

impl SkApp {
    /// An application in the real world with default settings: [`TimingMode::Coarse`], 10 ms.
    ///
    /// # Panics
    /// If the process is out of descriptors; [`SkAppBuilder::build`] answers that as an error.
    #[expect(clippy::new_without_default, reason = "it blocks signals and opens descriptors")]
    pub fn new() -> SkApp {
        match SkApp::builder().build() {
            Ok(app) => app,
            Err(error) => panic!("the application cannot open its poll: {error}"),
        }
    }

    /// An application with settings of its own.
    pub fn builder() -> SkAppBuilder {
        SkAppBuilder {
            name: "main".to_owned(),
            settings: LoopSettings::default(),
            world: None,
            freed_bytes_kept: None,
        }
    }

    pub(crate) fn assemble(cx: Cx, scheduler: Option<Rc<Scheduler>>) -> SkApp {
        SkApp { cx, scheduler }
    }

    /// The loop's inside, to spawn and attach with before and between runs.
    pub fn cx(&mut self) -> &mut Cx {
        &mut self.cx
    }

    /// Pulses until `quit` is called, or until SIGINT, SIGTERM or SIGHUP come and nobody listens to
    /// [`os_signal`](crate::SkEventLoop::os_signal). Returns at once if `quit` was called before. Can be called
    /// again; but after such a signal the next one ends the process at once, as if there were no loop.
    pub fn run(&mut self) -> Run {
        while !self.cx.quitting {
            if !self.step_once() {
                return Run::Nested;
            }
        }
        self.cx.quitting = false;
        Run::Quit
    }

    /// One round: the wait and all steps. Inside a slot of another loop on this thread it does nothing but
    /// log an error.
    pub fn pulse(&mut self) {
        self.step_once();
    }

    fn step_once(&mut self) -> bool {
        match self.scheduler.clone() {
            Some(scheduler) => scheduler.pulse_app(&mut self.cx),
            None => step(&mut self.cx, |cx| {
                cx.prepare_thread();
                cx.pulse_once();
            })
            .is_some(),
        }
    }

    /// Changes the way of waiting, from the next round on.
    pub fn set_mode(&mut self, mode: TimingMode) {
        // No mode contradicts any other setting.
        let _ = self.cx.set_mode(mode);
    }

    /// Changes the fast interval, from the next round on.
    ///
    /// # Errors
    /// If it is zero.
    pub fn set_interval(&mut self, interval: Duration) -> Result<(), SettingsError> {
        self.cx.set_interval(interval)
    }
}

/// Why an application could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AppError {
    /// The settings contradict each other.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The operating system refused something every loop needs.
    #[error("the loop cannot be set up: {0}")]
    Io(#[from] io::Error),
}

/// Settings of an application; see [`SkApp::builder`].
pub struct SkAppBuilder {
    name: String,
    settings: LoopSettings,
    world: Option<World>,
    freed_bytes_kept: Option<usize>,
}

impl SkAppBuilder {
    /// The loop's name in logs and statistics; `main` unless given.
    pub fn name(mut self, name: &str) -> Self {
        self.name = name.to_owned();
        self
    }

    /// How the loop waits.
    pub fn mode(mut self, mode: TimingMode) -> Self {
        self.settings.mode = mode;
        self
    }

    /// The interval of the fast tick. A slow interval below it is raised to it; set that one afterwards.
    pub fn interval(mut self, interval: Duration) -> Self {
        self.settings.interval = interval;
        self.settings.slow_interval = self.settings.slow_interval.max(interval);
        self
    }

    /// The interval of the slow tick.
    pub fn slow_interval(mut self, interval: Duration) -> Self {
        self.settings.slow_interval = interval;
        self
    }

    /// Everything else.
    pub fn configure(mut self, change: impl FnOnce(&mut LoopSettings)) -> Self {
        change(&mut self.settings);
        self
    }

    /// Another world than the real one.
    pub fn world(mut self, world: World) -> Self {
        self.world = Some(world);
        self
    }

    /// So much freed memory stays with the process, where its C library has a choice: for a program through which large
    /// messages flow, which would else spend more time on fresh pages than on them.
    pub fn keep_freed_memory(mut self, bytes: usize) -> Self {
        self.freed_bytes_kept = Some(bytes);
        self
    }

    /// Makes the application. From now on SIGINT, SIGTERM and SIGHUP are blocked for this thread and those it
    /// starts, and are heard by the loop instead; so make it before any other thread.
    ///
    /// # Errors
    /// If settings contradict each other, or the process is out of descriptors.
    pub fn build(self) -> Result<SkApp, AppError> {
        self.settings.check()?;
        if let Some(bytes) = self.freed_bytes_kept {
            sys::heap::keep_freed(bytes);
        }
        let mut world = match self.world {
            Some(world) => world,
            None => World::real()?,
        };
        world.net.block_os_signals()?;
        let os_signals = world.net.watch_os_signals(OS_SIGNALS_TOKEN)?;
        let mut cx = Cx::new(&self.name, world, self.settings);
        cx.pacing.os_signals = Some(os_signals);
        Ok(SkApp::assemble(cx, None))
    }
}
