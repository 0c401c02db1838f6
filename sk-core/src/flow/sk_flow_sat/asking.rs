//! Questions to the hub that have one answer: what it knows of itself, and which databases it has.

use super::SkFlowSat;
use super::databases::FlowDatabase;
use crate::Cx;
use crate::flow::satellite::{DatabaseInfo, SatelliteCore, SatelliteError, SatelliteEvent};
use crate::flow::{Command, Form};
use crate::object::Handle;
use sk_flat::SkVariant;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

/// How many questions may wait for their answers.
const QUESTIONS_MAX: usize = 1_024;

/// What is called with the answer, or with why there is none.
type Hear<R> = Box<dyn FnOnce(&mut Cx, Result<R, String>)>;

/// What a question wants to hear.
enum Asked {
    Value(Hear<SkVariant>),
    Databases(Hear<Vec<DatabaseInfo>>),
    Keys(Rc<str>, Hear<Vec<String>>),
    Variables(Rc<str>, Hear<Vec<(String, SkVariant)>>),
    Done(Hear<()>),
}

type Told = Box<dyn FnOnce(&mut Cx)>;

/// The questions under way, and the answers that nobody was told of yet.
#[derive(Default)]
pub(super) struct Questions {
    open: BTreeMap<u32, Asked>,
    told: VecDeque<Told>,
}

impl Asked {
    fn fails(self, why: String) -> Told {
        match self {
            Asked::Value(hear) => Box::new(move |cx| hear(cx, Err(why))),
            Asked::Databases(hear) => Box::new(move |cx| hear(cx, Err(why))),
            Asked::Keys(_, hear) => Box::new(move |cx| hear(cx, Err(why))),
            Asked::Variables(_, hear) => Box::new(move |cx| hear(cx, Err(why))),
            Asked::Done(hear) => Box::new(move |cx| hear(cx, Err(why))),
        }
    }

    /// The database that is to be current when the question is asked.
    fn database(&self) -> Option<&Rc<str>> {
        match self {
            Asked::Keys(database, _) | Asked::Variables(database, _) => Some(database),
            Asked::Value(_) | Asked::Databases(_) | Asked::Done(_) => None,
        }
    }
}

fn heard(asked: Asked, event: &SatelliteEvent) -> Told {
    match (asked, event.clone()) {
        (Asked::Value(hear), SatelliteEvent::Value { value, .. }) => {
            Box::new(move |cx| hear(cx, Ok(value.variant())))
        }
        (Asked::Databases(hear), SatelliteEvent::Databases { databases, .. }) => {
            Box::new(move |cx| hear(cx, Ok(databases)))
        }
        (Asked::Keys(_, hear), SatelliteEvent::Keys { keys, .. }) => Box::new(move |cx| hear(cx, Ok(keys))),
        (Asked::Variables(_, hear), SatelliteEvent::Variables { variables, .. }) => {
            let variables = variables.into_iter().map(|(key, value)| (key, value.variant())).collect();
            Box::new(move |cx| hear(cx, Ok(variables)))
        }
        (Asked::Done(hear), SatelliteEvent::Done { .. } | SatelliteEvent::Saved { .. }) => {
            Box::new(move |cx| hear(cx, Ok(())))
        }
        (asked, _) => asked.fails("the hub answered something else".to_owned()),
    }
}

/// The tag of an event that may answer a question.
fn tag_of(event: &SatelliteEvent) -> Option<u32> {
    match event {
        SatelliteEvent::Value { tag, .. }
        | SatelliteEvent::Databases { tag, .. }
        | SatelliteEvent::Keys { tag, .. }
        | SatelliteEvent::Variables { tag, .. }
        | SatelliteEvent::Done { tag }
        | SatelliteEvent::Saved { tag }
        | SatelliteEvent::Refused { tag, .. } => Some(*tag),
        _ => None,
    }
}

impl Questions {
    /// The hub is lost, and with it every answer.
    pub(super) fn lose(&mut self) {
        for asked in std::mem::take(&mut self.open).into_values() {
            self.told
                .push_back(asked.fails("the hub was lost before it answered".to_owned()));
        }
    }
}

impl SkFlowSat {
    /// Takes an event that answers a question; answers whether it does.
    pub(super) fn hear_answer(&mut self, event: &SatelliteEvent) -> bool {
        let asked = tag_of(event).and_then(|tag| self.questions.open.remove(&tag));
        let Some(asked) = asked else { return false };
        let told = match event {
            SatelliteEvent::Refused { code, text, .. } => {
                let unselected = asked.database().and_then(|name| self.clerk.why_unselected(name, *code));
                let why = unselected.unwrap_or(text).to_owned();
                asked.fails(why)
            }
            event => heard(asked, event),
        };
        self.questions.told.push_back(told);
        true
    }

    fn ask(
        &mut self,
        cx: &mut Cx,
        asked: Asked,
        command: impl FnOnce(&mut SatelliteCore) -> Result<u32, SatelliteError>,
    ) {
        match self.send_question(&asked, command) {
            Ok(tag) => drop(self.questions.open.insert(tag, asked)),
            Err(why) => {
                // Later, as every answer: nobody is called while this object is leased.
                let told = asked.fails(why);
                let this = cx.this(self);
                cx.post_own(this, told);
            }
        }
        self.flush_later(cx);
    }

    fn send_question(
        &mut self,
        asked: &Asked,
        command: impl FnOnce(&mut SatelliteCore) -> Result<u32, SatelliteError>,
    ) -> Result<u32, String> {
        if self.questions.open.len() >= QUESTIONS_MAX {
            return Err("too many questions wait for an answer".to_owned());
        }
        let core = self.core.as_mut().filter(|core| core.is_ready());
        let core = core.ok_or_else(|| "there is no hub".to_owned())?;
        if let Some(name) = asked.database()
            && !self.clerk.select(core, name)
        {
            return Err("too much waits to be sent".to_owned());
        }
        command(core).map_err(|error| error.to_string())
    }
}

/// Calls those who have an answer, unleased.
pub(super) fn tell_answers(cx: &mut Cx, satellite: Handle<SkFlowSat>) {
    while let Ok(Some(told)) = cx.with(satellite, |satellite, _| satellite.questions.told.pop_front()) {
        told(cx);
    }
}

impl Handle<SkFlowSat> {
    /// Asks what the hub knows of itself at this moment: `hub`, `flows`, `graph`, `channel NAME` or `why FROM TO`.
    /// The types to read the answers with are those of [`report`](crate::flow::report). Without a hub it is answered
    /// at once that there is none; see [`ready`](SkFlowSat::ready).
    ///
    /// ```
    /// use sk_core::flow::{Rights, SkFlowSat, SkFlowServer, report::HubReport, server::Settings};
    /// use sk_core::prelude::*;
    /// use sk_flat::FromVariant;
    ///
    /// struct Looker { satellite: Handle<SkFlowSat> }
    /// impl Looker {
    ///     fn look(&mut self, cx: &mut Cx) {
    ///         self.satellite.inspect(cx, "hub", |cx, told| {
    ///             let report = told.map(|told| HubReport::from_variant(&told));
    ///             assert!(matches!(report, Ok(Ok(HubReport { flows: 1, channels: 0, .. }))));
    ///             cx.quit();
    ///         });
    ///     }
    /// }
    /// object! { Looker { slots { look() } } }
    ///
    /// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    /// let cx = app.cx();
    /// let hub = SkFlowServer::start(cx, Settings { user: "robot".parse()?, token: None, owner_uid: None });
    /// let pipe = hub.pipe(cx, Rights::ALL)?;
    /// let satellite = SkFlowSat::inside(cx, pipe);
    /// let looker = cx.spawn(Looker { satellite });
    /// attach!(cx, satellite.ready => looker.look);
    /// app.run();
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn inspect(
        self,
        cx: &mut Cx,
        subject: &str,
        hear: impl FnOnce(&mut Cx, Result<SkVariant, String>) + 'static,
    ) {
        self.ask(cx, Asked::Value(Box::new(hear)), |core| core.inspect(subject));
    }

    /// Asks for the hub's databases whose names begin with `prefix`.
    pub fn databases(
        self,
        cx: &mut Cx,
        prefix: &str,
        hear: impl FnOnce(&mut Cx, Result<Vec<DatabaseInfo>, String>) + 'static,
    ) {
        let command = Command::DbList { prefix: prefix.to_owned() };
        self.ask(cx, Asked::Databases(Box::new(hear)), |core| core.database(&command));
    }

    /// Creates a named database; a durable one has every change on the disk before it is acknowledged. One of the
    /// name that exists is refused.
    pub fn create_database(
        self,
        cx: &mut Cx,
        name: &str,
        durable: bool,
        hear: impl FnOnce(&mut Cx, Result<(), String>) + 'static,
    ) {
        let command = Command::DbCreate { database: name.to_owned(), durable: durable.into() };
        self.ask(cx, Asked::Done(Box::new(hear)), |core| core.database(&command));
    }

    /// Removes a named database, on the hub's disk too.
    pub fn remove_database(
        self,
        cx: &mut Cx,
        name: &str,
        hear: impl FnOnce(&mut Cx, Result<(), String>) + 'static,
    ) {
        let command = Command::DbRemove { database: name.to_owned() };
        self.ask(cx, Asked::Done(Box::new(hear)), |core| core.database(&command));
    }

    fn ask(
        self,
        cx: &mut Cx,
        asked: Asked,
        command: impl FnOnce(&mut SatelliteCore) -> Result<u32, SatelliteError>,
    ) {
        // A satellite that is gone has nobody to tell.
        let _ = cx.with(self, |satellite, cx| satellite.ask(cx, asked, command));
    }
}

impl Handle<FlowDatabase> {
    /// Asks for its keys that begin with `prefix`, sorted.
    pub fn keys(
        self,
        cx: &mut Cx,
        prefix: &str,
        hear: impl FnOnce(&mut Cx, Result<Vec<String>, String>) + 'static,
    ) {
        let Some((satellite, name)) = self.parts(cx) else { return };
        let command = Command::DbKeys { prefix: prefix.to_owned() };
        satellite.ask(cx, Asked::Keys(name, Box::new(hear)), |core| core.database(&command));
    }

    /// Asks for its variables whose keys begin with `prefix`, sorted by key.
    pub fn all(
        self,
        cx: &mut Cx,
        prefix: &str,
        hear: impl FnOnce(&mut Cx, Result<Vec<(String, SkVariant)>, String>) + 'static,
    ) {
        let Some((satellite, name)) = self.parts(cx) else { return };
        let command = Command::DbAll { prefix: prefix.to_owned(), form: Form::Binary };
        satellite.ask(cx, Asked::Variables(name, Box::new(hear)), |core| core.database(&command));
    }
}
