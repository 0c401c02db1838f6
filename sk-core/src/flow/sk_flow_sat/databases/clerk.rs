//! A satellite's dealings with databases. Commands act on the connection's current database, so one for another
//! database is preceded by a `db_select`; if that is refused, none is current and the command is refused too.
//! Watches and creations are repeated after a reconnection.

use super::object::{FlowDatabase, Variable};
use crate::Cx;
use crate::flow::satellite::{AccountInfo, SatelliteCore, SatelliteEvent};
use crate::flow::{Command, Form, RefusalCode, Value};
use crate::object::Handle;
use sk_flat::SkVariant;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::rc::Rc;

/// How many commands may wait for a hub or its answers.
pub(super) const COMMANDS_WAITING_MAX: usize = 4_096;
/// Checks of the satellite, four a second, between two attempts at a watch.
const CHECKS_BETWEEN_ATTEMPTS: u32 = 4;

/// What is called with the value of a variable, none if there is no such variable, or with why there is no answer.
pub(in super::super) type Answer = Box<dyn FnOnce(&mut Cx, Result<Option<SkVariant>, String>)>;

pub(in super::super) enum Order {
    Set(String, Value),
    /// A set that nobody wants to hear of.
    Tell(String, Value),
    Delete(String),
    Get(String, Answer),
    Save,
    Load,
}

/// What a command that was sent was for.
enum Sent {
    /// Nobody wants to know.
    Quiet,
    Select,
    Change(String),
    Get(Answer),
    Save,
    Load,
    Watch(String),
    /// A command about accounts.
    Account(Answer),
}

/// What is to be told to the user, when the satellite is not leased.
pub(in super::super) enum Told {
    Changed(Handle<FlowDatabase>, Variable),
    Watching(Handle<FlowDatabase>, String),
    Done(Handle<FlowDatabase>, String),
    Refused(Handle<FlowDatabase>, String),
    Answered(Answer, Result<Option<SkVariant>, String>),
}

struct Entry {
    object: Handle<FlowDatabase>,
    /// Whether it is to be created where it is missing, and then durable.
    create: Option<bool>,
    watches: BTreeMap<String, Watched>,
}

#[derive(Default)]
struct Watched {
    /// The tag of the watch that is in force.
    tag: Option<u32>,
    /// Where to go on after a reconnection; 0 is the beginning.
    sequence: u64,
    told: BTreeSet<String>,
    known: BTreeMap<String, Value>,
}

/// The name that stands for this flow's own database, whatever the hub calls the flow.
const OWN: &str = "";

#[derive(Default)]
pub(in super::super) struct Clerk {
    entries: BTreeMap<Rc<str>, Entry>,
    waiting: VecDeque<(Rc<str>, Order)>,
    /// The database that was selected last, whether the hub has said so or not yet.
    current: Option<Rc<str>>,
    /// The last `db_select`.
    selecting: u32,
    /// Why a database could not be selected.
    unselected: BTreeMap<Rc<str>, String>,
    sent: BTreeMap<u32, (Rc<str>, Sent)>,
    told: VecDeque<Told>,
    /// What is set in the flow's own database, which goes with each connection.
    own: BTreeMap<String, Value>,
    checks: u32,
}

impl Clerk {
    pub(in super::super) fn object(&self, name: &str) -> Option<Handle<FlowDatabase>> {
        self.entries.get(name).map(|entry| entry.object)
    }

    pub(in super::super) fn add(&mut self, name: &Rc<str>, object: Handle<FlowDatabase>) {
        self.entries
            .insert(name.clone(), Entry { object, create: None, watches: BTreeMap::new() });
    }

    /// A command about accounts was sent.
    pub(in super::super) fn expect_answer(&mut self, tag: u32, answer: Answer) {
        self.sent.insert(tag, (OWN.into(), Sent::Account(answer)));
    }

    pub(in super::super) fn answer_later(
        &mut self,
        answer: Answer,
        outcome: Result<Option<SkVariant>, String>,
    ) {
        self.told.push_back(Told::Answered(answer, outcome));
    }

    /// The next thing to tell.
    pub(in super::super) fn next_told(&mut self) -> Option<Told> {
        self.told.pop_front()
    }

    /// Queues a command; `false` if too many wait.
    pub(in super::super) fn order(
        &mut self,
        core: Option<&mut SatelliteCore>,
        name: &Rc<str>,
        order: Order,
    ) -> bool {
        if self.waiting.len() + self.sent.len() >= COMMANDS_WAITING_MAX {
            return false;
        }
        if **name == *OWN {
            match &order {
                Order::Set(key, value) => drop(self.own.insert(key.clone(), value.clone())),
                Order::Delete(key) => drop(self.own.remove(key)),
                _ => {}
            }
        }
        self.waiting.push_back((name.clone(), order));
        self.go_on(core);
        true
    }

    pub(in super::super) fn create(
        &mut self,
        core: Option<&mut SatelliteCore>,
        name: &Rc<str>,
        durable: bool,
    ) {
        if let Some(entry) = self.entries.get_mut(name) {
            entry.create = Some(durable);
        }
        if let Some(core) = core.filter(|core| core.is_ready()) {
            self.send_create(core, name, durable);
        }
    }

    fn send_create(&mut self, core: &mut SatelliteCore, name: &Rc<str>, durable: bool) {
        let command = Command::DbCreate { database: name.to_string(), durable: durable.into() };
        if let Ok(tag) = core.database(&command) {
            self.sent.insert(tag, (name.clone(), Sent::Quiet));
        }
    }

    pub(super) fn watch(&mut self, core: Option<&mut SatelliteCore>, name: &Rc<str>, prefix: &str) {
        let Some(entry) = self.entries.get_mut(name) else { return };
        if entry.watches.contains_key(prefix) {
            return;
        }
        entry.watches.insert(prefix.to_owned(), Watched::default());
        if let Some(core) = core.filter(|core| core.is_ready()) {
            self.send_watch(core, name, prefix);
        }
    }

    pub(super) fn unwatch(&mut self, core: Option<&mut SatelliteCore>, name: &Rc<str>, prefix: &str) {
        let removed = self.entries.get_mut(name).and_then(|entry| entry.watches.remove(prefix));
        let Some(Watched { tag: Some(watch), .. }) = removed else { return };
        // What still comes of it is of no interest any more.
        self.sent.remove(&watch);
        if let Some(core) = core
            && let Ok(tag) = core.database(&Command::Unwatch { watch })
        {
            self.sent.insert(tag, (name.clone(), Sent::Quiet));
        }
    }

    fn send_watch(&mut self, core: &mut SatelliteCore, name: &Rc<str>, prefix: &str) {
        let entry = self.entries.get_mut(name);
        let Some(watched) = entry.and_then(|entry| entry.watches.get_mut(prefix)) else { return };
        let (prefix, after) = (prefix.to_owned(), watched.sequence);
        let command = Command::Watch {
            database: full_name(core, name),
            prefix: prefix.clone(),
            after,
            form: Form::Binary,
        };
        if let Ok(tag) = core.database(&command) {
            watched.tag = Some(tag);
            watched.told.clear();
            self.sent.insert(tag, (name.clone(), Sent::Watch(prefix)));
        }
    }

    /// The newest value of a watched variable.
    pub(in super::super) fn known(&self, name: &str, key: &str) -> Option<&Value> {
        let watches = &self.entries.get(name)?.watches;
        watches
            .iter()
            .filter(|(prefix, _)| key.starts_with(prefix.as_str()))
            .find_map(|(_, watched)| watched.known.get(key))
    }

    /// Keeps in the flow's own database what the hub cannot know, from the next connection on.
    pub(in super::super) fn introduce(&mut self, key: &str, variant: &SkVariant) {
        if let Ok(value) = Value::new(variant) {
            self.own.insert(key.to_owned(), value);
        }
    }

    /// The same for this connection too, if it is something new. What finds no room is told with the next.
    pub(in super::super) fn tell(
        &mut self,
        core: Option<&mut SatelliteCore>,
        key: &str,
        variant: &SkVariant,
    ) {
        let Ok(value) = Value::new(variant) else { return };
        if self.own.get(key).is_some_and(|known| known.encoded() == value.encoded()) {
            return;
        }
        self.own.insert(key.to_owned(), value.clone());
        let core = core.filter(|core| core.is_ready());
        if core.is_some() && self.waiting.len() + self.sent.len() < COMMANDS_WAITING_MAX {
            self.waiting.push_back((OWN.into(), Order::Tell(key.to_owned(), value)));
            self.go_on(core);
        }
    }

    /// A hub is there again: what was created and watched is so again, and what waited goes.
    pub(in super::super) fn restore(&mut self, core: &mut SatelliteCore) {
        let names: Vec<Rc<str>> = self.entries.keys().cloned().collect();
        for name in names {
            if let Some(durable) = self.entries.get(&name).and_then(|entry| entry.create) {
                self.send_create(core, &name, durable);
            }
        }
        self.send_missing_watches(core);
        // First what was there before, so that what waits comes after it.
        let own: Rc<str> = OWN.into();
        for (key, value) in self.own.iter().rev() {
            self.waiting.push_front((own.clone(), Order::Tell(key.clone(), value.clone())));
        }
        self.go_on(Some(core));
    }

    fn send_missing_watches(&mut self, core: &mut SatelliteCore) {
        let mut missing = Vec::new();
        for (name, entry) in &self.entries {
            let without = entry.watches.iter().filter(|(_, watched)| watched.tag.is_none());
            missing.extend(without.map(|(prefix, _)| (name.clone(), prefix.clone())));
        }
        for (name, prefix) in missing {
            self.send_watch(core, &name, &prefix);
        }
    }

    /// Tries again to watch what was not there.
    pub(in super::super) fn check(&mut self, core: &mut SatelliteCore) {
        self.checks += 1;
        if self.checks.is_multiple_of(CHECKS_BETWEEN_ATTEMPTS) && core.is_ready() {
            self.send_missing_watches(core);
        }
    }

    /// The hub is lost: what it did not answer is not known to have happened.
    pub(in super::super) fn lose(&mut self) {
        self.current = None;
        self.unselected.clear();
        for entry in self.entries.values_mut() {
            entry.watches.values_mut().for_each(|watched| watched.tag = None);
        }
        for (name, sent) in std::mem::take(&mut self.sent).into_values() {
            self.fail(&name, sent, "the hub was lost before it answered");
        }
    }

    fn fail(&mut self, name: &Rc<str>, sent: Sent, why: &str) {
        match sent {
            Sent::Quiet | Sent::Select | Sent::Watch(_) => {}
            Sent::Get(answer) | Sent::Account(answer) => {
                self.answer_later(answer, Err(why.to_owned()));
            }
            Sent::Change(_) | Sent::Save | Sent::Load => {
                if let Some(object) = self.object(name) {
                    self.told.push_back(Told::Refused(object, why.to_owned()));
                }
            }
        }
    }

    /// Sends what waits.
    fn go_on(&mut self, core: Option<&mut SatelliteCore>) {
        let Some(core) = core.filter(|core| core.is_ready()) else { return };
        while let Some((name, order)) = self.waiting.pop_front() {
            if !self.select(core, &name) {
                self.waiting.push_front((name, order));
                return;
            }
            let (command, sent) = match order {
                Order::Set(key, value) => (Command::VarSet { key: key.clone(), value }, Sent::Change(key)),
                Order::Tell(key, value) => (Command::VarSet { key, value }, Sent::Quiet),
                Order::Delete(key) => (Command::VarDelete { key: key.clone() }, Sent::Change(key)),
                Order::Get(key, answer) => (Command::VarGet { key, form: Form::Binary }, Sent::Get(answer)),
                Order::Save => (Command::DbSave {}, Sent::Save),
                Order::Load => (Command::DbLoad {}, Sent::Load),
            };
            match core.database(&command) {
                Ok(tag) => drop(self.sent.insert(tag, (name, sent))),
                Err(error) => self.fail(&name, sent, &error.to_string()),
            }
        }
    }

    /// Makes a database the current one; `false` if there is no room to say so.
    pub(in super::super) fn select(&mut self, core: &mut SatelliteCore, name: &Rc<str>) -> bool {
        if self.current.as_ref() == Some(name) {
            return true;
        }
        let database = full_name(core, name);
        let Ok(tag) = core.database(&Command::DbSelect { database }) else { return false };
        self.selecting = tag;
        self.sent.insert(tag, (name.clone(), Sent::Select));
        self.current = Some(name.clone());
        true
    }

    /// Why a command was refused for which no database was current: what was said when it was selected.
    pub(in super::super) fn why_unselected(&self, name: &str, code: u16) -> Option<&str> {
        let why = self.unselected.get(name).map(String::as_str);
        why.filter(|_| code == RefusalCode::NoDatabase.code())
    }

    /// Takes an event that is about databases; answers whether it was.
    pub(in super::super) fn hear(&mut self, core: &mut SatelliteCore, event: &SatelliteEvent) -> bool {
        match event {
            SatelliteEvent::DatabaseSelected { tag, database } => self.selected(*tag, database.is_some()),
            SatelliteEvent::Done { tag } | SatelliteEvent::Saved { tag } => return self.done(*tag),
            SatelliteEvent::Value { tag, value } => {
                return self.answered(*tag, || Ok(Some(value.variant())));
            }
            SatelliteEvent::Accounts { tag, accounts } => {
                if let Some((_, Sent::Account(answer))) = self.sent.remove(tag) {
                    self.answer_later(answer, Ok(Some(as_variant(accounts))));
                }
            }
            SatelliteEvent::Refused { tag, code, text } => return self.refused(*tag, *code, text),
            SatelliteEvent::Changed { tag, sequence, key, value } => {
                self.changed(*tag, *sequence, key, value.as_ref());
            }
            SatelliteEvent::Watching { tag, sequence, whole } => self.watching(*tag, *sequence, *whole),
            SatelliteEvent::WatchOver { tag } => {
                if let Some((_, Sent::Watch(_))) = self.sent.get(tag)
                    && let Some((name, Sent::Watch(prefix))) = self.sent.remove(tag)
                {
                    self.unwatched(&name, &prefix);
                }
            }
            _ => return false,
        }
        self.go_on(Some(core));
        true
    }

    fn selected(&mut self, tag: u32, any: bool) {
        if let Some((name, Sent::Select)) = self.sent.get(&tag) {
            self.unselected.remove(name);
            self.sent.remove(&tag);
        } else if !any {
            // The current one was removed. If another was selected meanwhile, that is done once more.
            self.current = None;
        }
    }

    fn done(&mut self, tag: u32) -> bool {
        let Some((name, sent)) = self.sent.remove(&tag) else { return false };
        let what = match sent {
            Sent::Change(key) => key,
            Sent::Save | Sent::Load => String::new(),
            Sent::Account(answer) => {
                self.answer_later(answer, Ok(None));
                return true;
            }
            Sent::Quiet | Sent::Select | Sent::Get(_) | Sent::Watch(_) => return true,
        };
        if let Some(object) = self.object(&name) {
            self.told.push_back(Told::Done(object, what));
        }
        true
    }

    fn answered(&mut self, tag: u32, found: impl FnOnce() -> Result<Option<SkVariant>, String>) -> bool {
        if !matches!(self.sent.get(&tag), Some((_, Sent::Get(_)))) {
            return false;
        }
        if let Some((_, Sent::Get(answer))) = self.sent.remove(&tag) {
            self.told.push_back(Told::Answered(answer, found()));
        }
        true
    }

    fn refused(&mut self, tag: u32, code: u16, text: &str) -> bool {
        if code == RefusalCode::NoSuchVariable.code() && self.answered(tag, || Ok(None)) {
            return true;
        }
        let Some((name, sent)) = self.sent.remove(&tag) else { return false };
        match sent {
            Sent::Watch(prefix) => self.unwatched(&name, &prefix),
            Sent::Select => {
                if self.selecting == tag {
                    self.current = None;
                }
                self.unselected.insert(name, text.to_owned());
            }
            sent => {
                let why = self.why_unselected(&name, code).unwrap_or(text).to_owned();
                self.fail(&name, sent, &why);
            }
        }
        true
    }

    /// A watch is not in force. Its database may come back: that is tried now and then.
    fn unwatched(&mut self, name: &str, prefix: &str) {
        if let Some(watched) = self.watched(name, prefix) {
            watched.tag = None;
        }
    }

    fn watched(&mut self, name: &str, prefix: &str) -> Option<&mut Watched> {
        self.entries.get_mut(name)?.watches.get_mut(prefix)
    }

    fn changed(&mut self, tag: u32, sequence: u64, key: &str, value: Option<&Value>) {
        let Some((name, Sent::Watch(prefix))) = self.sent.get(&tag) else { return };
        let name = name.clone();
        let Some(entry) = self.entries.get_mut(&name) else { return };
        let Some(watched) = entry.watches.get_mut(prefix) else { return };
        if watched.sequence != 0 {
            watched.sequence = sequence;
        }
        let before = match value {
            Some(value) => {
                watched.told.insert(key.to_owned());
                watched.known.insert(key.to_owned(), value.clone())
            }
            None => watched.known.remove(key),
        };
        if before.as_ref().map(Value::encoded) != value.map(Value::encoded) {
            let variable = Variable::new(&name, key, value.map(Value::variant));
            self.told.push_back(Told::Changed(entry.object, variable));
        }
    }

    fn watching(&mut self, tag: u32, sequence: u64, whole: bool) {
        let Some((name, Sent::Watch(prefix))) = self.sent.get(&tag) else { return };
        let (name, prefix) = (name.clone(), prefix.clone());
        let Some(entry) = self.entries.get_mut(&name) else { return };
        let Some(watched) = entry.watches.get_mut(&prefix) else { return };
        watched.sequence = sequence;
        let told = std::mem::take(&mut watched.told);
        if whole {
            let gone: Vec<String> =
                watched.known.keys().filter(|key| !told.contains(*key)).cloned().collect();
            for key in gone {
                watched.known.remove(&key);
                let variable = Variable::new(&name, &key, None);
                self.told.push_back(Told::Changed(entry.object, variable));
            }
        }
        if sequence != 0 {
            self.told.push_back(Told::Watching(entry.object, prefix));
        }
    }
}

fn full_name(core: &SatelliteCore, name: &str) -> String {
    match name {
        OWN => format!("flow:{}", core.flow_name().unwrap_or_default()),
        name => name.to_owned(),
    }
}

/// A list on its way through the clerk, whose answers are variants: name, connections, name, connections.
fn as_variant(accounts: &[AccountInfo]) -> SkVariant {
    let items = accounts
        .iter()
        .flat_map(|account| [SkVariant::from(account.name.as_str()), SkVariant::from(account.connections)]);
    SkVariant::from(items.collect::<Vec<_>>())
}

/// The list that such an answer is.
pub(in super::super) fn listed(variant: Option<SkVariant>) -> Vec<AccountInfo> {
    let items = variant.as_ref().and_then(SkVariant::as_list).unwrap_or_default();
    let account = |pair: &[SkVariant]| AccountInfo {
        name: pair[0].as_str().unwrap_or_default().to_owned(),
        connections: u32::try_from(&pair[1]).unwrap_or_default(),
    };
    items.chunks_exact(2).map(account).collect()
}
