//! What a supervisor keeps of a thread that its module has to itself.

use crate::Cx;
use crate::eventloop::TimingMode;
use crate::flow::PipeSeed;
use crate::module::{ModuleClass, ModuleError, ParameterError};
use crate::thread::SkThread;
use crossbeam_channel::Receiver;
use sk_flat::{Instant, SkVariant};
use std::collections::VecDeque;
use std::io;
use std::time::Duration;

/// How a module's own thread keeps time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThreadPlace {
    /// How its loop waits.
    pub mode: TimingMode,
    /// The interval of its fast tick.
    pub interval: Duration,
}

type Link = Box<dyn FnMut(&mut Cx) -> io::Result<PipeSeed>>;
pub(super) type Answer = Box<dyn FnOnce(&mut Cx, Result<SkVariant, ModuleError>)>;

/// A module that shall live on a thread of its own.
pub struct ThreadedModule {
    pub(super) class: ModuleClass,
    pub(super) name: String,
    pub(super) parameters: SkVariant,
    place: ThreadPlace,
    link: Link,
}

impl ThreadedModule {
    /// A module of that class, with its default name and parameters. `link` gives it a way to the hub, each time
    /// its thread is started: [`pipe`](crate::object::Handle#method.pipe) of the server.
    pub fn new(
        class: ModuleClass,
        place: ThreadPlace,
        link: impl FnMut(&mut Cx) -> io::Result<PipeSeed> + 'static,
    ) -> ThreadedModule {
        // An empty map names nothing that could be refused.
        let parameters = class.complete(&SkVariant::map::<&str>([])).unwrap_or_default();
        ThreadedModule { class, name: class.name().to_owned(), parameters, place, link: Box::new(link) }
    }

    /// Calls the module something else than its class does: for a second one of the class.
    #[must_use]
    pub fn named(self, name: &str) -> ThreadedModule {
        ThreadedModule { name: name.to_owned(), ..self }
    }

    /// Begins with these parameters: a map of those that are not the default.
    ///
    /// # Errors
    /// A parameter is unknown, of another type or out of range.
    pub fn configured(self, parameters: &SkVariant) -> Result<ThreadedModule, ParameterError> {
        Ok(ThreadedModule { parameters: self.class.complete(parameters)?, ..self })
    }
}

/// What a supervisor keeps of its module's thread.
pub(super) struct ThreadHome {
    pub(super) class: ModuleClass,
    pub(super) name: String,
    pub(super) place: ThreadPlace,
    pub(super) link: Option<Link>,
    pub(super) thread: Option<SkThread>,
    /// Closed when the thread's loop has ended.
    pub(super) ended: Option<Receiver<()>>,
    pub(super) life: u64,
    pub(super) questions: VecDeque<(u64, Answer)>,
    pub(super) next_ticket: u64,
    /// When the thread was asked whether it is awake, while it has not answered.
    pub(super) asked_at: Option<Instant>,
    pub(super) silent: bool,
    /// It was told to end and did not in time.
    pub(super) given_up: bool,
}

impl ThreadHome {
    pub(super) fn new(module: ThreadedModule) -> ThreadHome {
        ThreadHome {
            class: module.class,
            name: module.name,
            place: module.place,
            link: Some(module.link),
            thread: None,
            ended: None,
            life: 0,
            questions: VecDeque::new(),
            next_ticket: 0,
            asked_at: None,
            silent: false,
            given_up: false,
        }
    }

    pub(super) fn place(&self) -> ThreadPlace {
        self.place
    }

    pub(super) fn is_silent(&self) -> bool {
        self.silent
    }
}
