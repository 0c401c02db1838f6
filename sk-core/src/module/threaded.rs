//! A module's life on a thread of its own, as its supervisor sees it: orders out, reports in, and what happens
//! when the thread does not answer.

use crate::Cx;
use crate::module::agent::{Ending, Report, Seed, WayBack, agent};
use crate::module::supervisor::{Home, Wanted};
use crate::module::thread_home::{Answer, ThreadHome};
use crate::module::{ModuleError, ModuleOrder, ModuleState, ModuleSupervisor, ParameterError};
use crate::object::Handle;
use crate::thread::{SkThread, ThreadError};
use crossbeam_channel::{RecvTimeoutError, bounded};
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

/// How long a thread has to end, if three of its intervals are not longer.
const END_WITHIN: Duration = Duration::from_secs(2);
/// How often it is looked whether a thread still answers.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// How long a slot may keep a module's loop before that is noted.
pub(super) const SLOT_MAX: Duration = Duration::from_millis(100);
/// How many questions to one module wait for their answers.
const QUESTIONS_MAX: usize = 64;

impl ThreadHome {
    fn end_within(&self) -> Duration {
        END_WITHIN.max(self.place.interval * 3)
    }

    /// Runs work of the agent's on the thread. Answers whether the thread will hear it.
    fn tell(&self, work: impl FnOnce(&mut Cx, Handle<super::agent::Agent>) + Send + 'static) -> bool {
        let Some(thread) = &self.thread else { return false };
        let name = self.name.clone();
        let sent = thread.post(move |cx| {
            // One that could not be planted has reported why.
            if let Some(agent) = agent(cx, &name) {
                work(cx, agent);
            }
        });
        if let Err(error @ ThreadError::Full(..)) = &sent {
            tracing::error!("module {}: {error}", self.name);
        }
        sent.is_ok()
    }

    /// Asks whether the thread is awake, or finds that it has not answered. Answers whether it has become silent.
    pub(super) fn look(&mut self, path: &str, now: Instant) -> bool {
        let Some(asked_at) = self.asked_at else {
            if self.tell(|cx, agent| agent.awake(cx)) {
                self.asked_at = Some(now);
            }
            return false;
        };
        // A loop that sleeps hears the question when its interval is over.
        let late = now.since(asked_at) > SLOT_MAX + self.place.interval * 2;
        let became = late && !self.silent;
        if became {
            self.silent = true;
            tracing::warn!("{path} has not answered for {:?}: a slot keeps its loop", now.since(asked_at));
        }
        became
    }

    fn awake(&mut self) {
        if self.silent {
            tracing::info!("module {} answers again", self.name);
        }
        (self.asked_at, self.silent) = (None, false);
    }

    /// At the end of the supervisor, when no round comes any more: waits for the thread, but not for ever.
    pub(super) fn end_and_wait(&mut self, cx: &mut Cx) {
        let Some(thread) = self.thread.take() else { return };
        self.questions.clear();
        if cx.scheduler().is_some() {
            // The loop is stepped by nobody now; ending it stops the module.
            drop(thread);
            return;
        }
        let name = self.name.clone();
        // A thread that does not hear it has ended, or does not end in time.
        let _ = thread.post(move |cx| match agent(cx, &name) {
            Some(agent) => agent.end(cx),
            None => cx.quit(),
        });
        // One that was waited for is not waited for again.
        let within = if self.given_up { Duration::ZERO } else { self.end_within() };
        match self.ended.take().map(|ended| ended.recv_timeout(within)) {
            Some(Err(RecvTimeoutError::Timeout)) => {
                if !self.given_up {
                    tracing::error!("module {} did not stop in time: the hub ends without it", self.name);
                }
                thread.abandon();
            }
            _ => drop(thread),
        }
    }
}

impl ModuleSupervisor {
    /// The parameters with these changes, checked.
    fn with_changes(&mut self, values: &SkVariant) -> Result<SkVariant, ModuleError> {
        let changes = values.as_map().ok_or(ParameterError::NotAMap { found: values.kind() })?;
        let mut next = self.parameters.clone();
        if let Some(next) = next.as_map_mut() {
            next.extend(changes.iter().map(|(name, value)| (name.clone(), value.clone())));
        }
        Ok(self.thread_home()?.class.complete(&next)?)
    }

    fn thread_home(&mut self) -> Result<&mut ThreadHome, ModuleError> {
        match &mut self.home {
            Home::Thread(home) => Ok(home),
            Home::Here(_) => Err(ModuleError::Gone),
        }
    }
}

impl Handle<ModuleSupervisor> {
    fn with_home<R>(
        self,
        cx: &mut Cx,
        f: impl FnOnce(&mut ThreadHome, &mut Cx) -> R,
    ) -> Result<R, ModuleError> {
        cx.with(self, |supervisor, cx| supervisor.thread_home().map(|home| f(home, cx)))?
    }

    /// Starts the thread if there is none, and tells it how far the module shall be brought.
    pub(super) fn bring_up_there(self, cx: &mut Cx) -> Result<(), ModuleError> {
        if !self.with_home(cx, |home, _| home.thread.is_some())? {
            let begun = self.begin_thread(cx);
            self.or_fail(cx, begun)?;
        }
        let (run, again) = cx.with(self, |supervisor, _| {
            let was = std::mem::replace(&mut supervisor.state, ModuleState::Beginning);
            (
                supervisor.wanted == Wanted::Running,
                !matches!(was, ModuleState::Beginning | ModuleState::Made),
            )
        })?;
        self.with_home(cx, |home, _| home.tell(move |cx, agent| agent.bring(cx, run, again)))?;
        self.tell(cx);
        Ok(())
    }

    fn begin_thread(self, cx: &mut Cx) -> Result<(), ModuleError> {
        let failed =
            |step, error: &dyn std::fmt::Display| ModuleError::Failed { step, message: error.to_string() };
        let mut link = self.with_home(cx, |home, _| home.link.take())?.ok_or(ModuleError::Busy)?;
        let pipe = link(cx);
        self.with_home(cx, |home, _| home.link = Some(link))?;
        let pipe = pipe.map_err(|error| failed("link", &error))?;
        let (class, name, place, life) = self.with_home(cx, |home, _| {
            home.life += 1;
            (home.class, home.name.clone(), home.place, home.life)
        })?;
        let parameters = cx.with(self, |supervisor, _| supervisor.parameters.clone())?;
        let thread = SkThread::new(&name).mode(place.mode).interval(place.interval).start(cx);
        let thread = thread.map_err(|error| failed("thread", &error))?;
        let (open, ended) = bounded(0);
        let back = WayBack { supervisor: cx.remote(self), life };
        let seed = Seed { class, name, parameters, pipe, ending: Ending { back, _open: open } };
        thread
            .post(move |cx| seed.plant(cx))
            .map_err(|error| failed("thread", &error))?;
        self.with_home(cx, |home, _| {
            home.thread = Some(thread);
            home.ended = Some(ended);
            (home.asked_at, home.silent, home.given_up) = (None, false, false);
        })?;
        let watch = cx.with(self, |supervisor, _| supervisor.watch)?;
        Ok(watch.start(cx, LOOK_EVERY)?)
    }

    pub(super) fn ask_there(self, cx: &mut Cx, order: ModuleOrder, answer: Answer) {
        if let Err((answer, error)) = self.try_ask_there(cx, order, answer) {
            answer(cx, Err(error));
        }
    }

    /// Gives the answer back with what it is to be called with, if there is no need to wait.
    fn try_ask_there(
        self,
        cx: &mut Cx,
        order: ModuleOrder,
        answer: Answer,
    ) -> Result<(), (Answer, ModuleError)> {
        let mut waiting = Some(answer);
        let asked = cx.with(self, |supervisor, _| {
            if let ModuleOrder::Change(values) = &order {
                let next = supervisor.with_changes(values)?;
                if supervisor.thread_home()?.thread.is_none() {
                    // Its next life begins with them.
                    supervisor.parameters = next;
                    return Ok(false);
                }
            }
            let home = supervisor.thread_home()?;
            if home.questions.len() >= QUESTIONS_MAX {
                return Err(ModuleError::Busy);
            }
            let ticket = home.next_ticket;
            home.next_ticket += 1;
            if !home.tell(move |cx, agent| agent.order(cx, ticket, &order)) {
                return Err(ModuleError::NotRunning);
            }
            if let Some(answer) = waiting.take() {
                home.questions.push_back((ticket, answer));
            }
            Ok(true)
        });
        match (asked.map_err(ModuleError::from).and_then(|asked| asked), waiting) {
            (Ok(false), Some(answer)) => {
                answer(cx, Ok(SkVariant::Null));
                Ok(())
            }
            (Err(error), Some(answer)) => Err((answer, error)),
            _ => Ok(()),
        }
    }

    /// Tells the thread to stop its module and end, and waits for it without blocking.
    pub(super) fn stop_there(self, cx: &mut Cx) -> Result<(), ModuleError> {
        let (state, has_thread, within, alarm) = cx.with(self, |supervisor, _| {
            supervisor.wanted = Wanted::Stopped;
            supervisor.running_since = None;
            let (state, alarm) = (supervisor.state.clone(), supervisor.alarm);
            let home = supervisor.thread_home()?;
            Ok::<_, ModuleError>((state, home.thread.is_some(), home.end_within(), alarm))
        })??;
        if matches!(state, ModuleState::Stopping | ModuleState::Stuck) {
            return Ok(());
        }
        alarm.stop(cx)?;
        if has_thread {
            self.with_home(cx, |home, _| {
                let name = home.name.clone();
                home.thread.as_ref().map(|thread| {
                    thread.post(move |cx| match agent(cx, &name) {
                        Some(agent) => agent.end(cx),
                        None => cx.quit(),
                    })
                })
            })?;
            cx.with(self, |supervisor, _| supervisor.state = ModuleState::Stopping)?;
            alarm.start_once(cx, within)?;
        } else {
            cx.with(self, |supervisor, _| supervisor.state = ModuleState::Stopped)?;
        }
        if state != ModuleState::Stopped {
            self.tell(cx);
        }
        Ok(())
    }

    /// The thread did not end in time.
    pub(super) fn give_up_waiting(self, cx: &mut Cx) {
        let path = cx.path_of(self);
        tracing::error!("{path} does not stop: a slot of it hangs; the hub goes on without it");
        let marked = cx.with(self, |supervisor, _| {
            if let Home::Thread(home) = &mut supervisor.home {
                home.given_up = true;
            }
            supervisor.state = ModuleState::Stuck;
            supervisor.last_error = Some("its thread did not end".to_owned());
        });
        if marked.is_ok() {
            self.tell(cx);
        }
    }

    /// What the thread has to say.
    pub(super) fn on_report(self, cx: &mut Cx, life: u64, report: Report) {
        if self.with_home(cx, |home, _| home.life == life) != Ok(true) {
            return;
        }
        let state = self.state(cx);
        let lives = matches!(state, Ok(ModuleState::Beginning | ModuleState::Made | ModuleState::Running));
        match report {
            Report::Made | Report::Started | Report::Failed(_) if !lives => {}
            Report::Made => {
                let made = cx.with(self, |supervisor, _| {
                    let made = supervisor.wanted == Wanted::Made;
                    if made {
                        supervisor.state = ModuleState::Made;
                    }
                    made
                });
                if made == Ok(true) {
                    self.tell(cx);
                }
            }
            Report::Started => {
                let now = cx.now();
                let started = cx.with(self, |supervisor, _| {
                    supervisor.state = ModuleState::Running;
                    supervisor.running_since = Some(now);
                });
                if started.is_ok() {
                    self.tell(cx);
                }
            }
            Report::Failed(reason) => self.fail(cx, reason),
            Report::Answered { ticket, answer, parameters } => self.answered(cx, ticket, answer, parameters),
            // One that is gone needs no watching.
            Report::Awake => drop(self.with_home(cx, |home, _| home.awake())),
            Report::Ended => self.thread_ended(cx),
        }
    }

    fn answered(
        self,
        cx: &mut Cx,
        ticket: u64,
        answer: Result<SkVariant, ModuleError>,
        parameters: SkVariant,
    ) {
        if parameters != SkVariant::Null {
            // It is there: the report found it.
            let _ = cx.with(self, |supervisor, _| supervisor.parameters = parameters);
        }
        let waiting = self.with_home(cx, |home, _| {
            let at = home.questions.iter().position(|(number, _)| *number == ticket)?;
            home.questions.remove(at)
        });
        if let Ok(Some((_, call))) = waiting {
            call(cx, answer);
        }
    }

    /// The loop of the thread has ended, by the supervisor's word or by the module's own.
    fn thread_ended(self, cx: &mut Cx) {
        let left = self.with_home(cx, |home, _| {
            home.ended = None;
            (home.asked_at, home.silent) = (None, false);
            (home.thread.take(), std::mem::take(&mut home.questions))
        });
        let Ok((thread, questions)) = left else { return };
        // It is at its very end, so this waits for microseconds.
        drop(thread);
        for (_, call) in questions {
            call(cx, Err(ModuleError::NotRunning));
        }
        let Ok((watch, alarm, state)) =
            cx.with(self, |supervisor, _| (supervisor.watch, supervisor.alarm, supervisor.state.clone()))
        else {
            return;
        };
        // Both are children of this object.
        let _ = watch.stop(cx);
        match state {
            ModuleState::Stopping | ModuleState::Stuck => {
                let _ = alarm.stop(cx);
                let _ = cx.with(self, |supervisor, _| supervisor.state = ModuleState::Stopped);
                self.tell(cx);
                self.bring_up_if_wanted(cx);
            }
            // It is begun again, with a new thread, as was decided before.
            ModuleState::Failed { .. } | ModuleState::Stopped => {}
            _ => self.fail(cx, "the loop of its thread has ended".to_owned()),
        }
    }
}
