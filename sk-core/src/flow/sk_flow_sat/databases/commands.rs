//! What a database of the hub can be told, and what is emitted of the answers.

use super::super::SkFlowSat;
use super::clerk::{Order, Told};
use super::object::FlowDatabase;
use crate::Cx;
use crate::flow::database::{DatabaseName, check_key};
use crate::flow::{Flow, Value};
use crate::object::Handle;
use crate::signal::Signal;
use sk_flat::{IntoVariant, SkVariant};
use std::io;
use std::rc::Rc;

impl Handle<SkFlowSat> {
    /// A database of the hub: `flow:user.name`, `user:name`, `chan:user.name`, or a plain name. The same name
    /// gives the same object.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn database(self, cx: &mut Cx, name: &str) -> io::Result<Handle<FlowDatabase>> {
        DatabaseName::parse(name).map_err(|code| io::Error::other(code.to_string()))?;
        self.database_object(cx, name)
    }

    /// The satellite's own database, in which others see its values, among them its loop's interval
    /// (`pulse.interval_ms`) and mode (`pulse.mode`), and once a second how late its ticks came and how long its
    /// rounds took (`pulse.statistics`). It goes with the connection; what was set here is set again in the next.
    ///
    /// # Errors
    /// If the satellite is gone.
    pub fn own_database(self, cx: &mut Cx) -> io::Result<Handle<FlowDatabase>> {
        self.database_object(cx, "")
    }

    fn database_object(self, cx: &mut Cx, name: &str) -> io::Result<Handle<FlowDatabase>> {
        let known = cx
            .with(self, |satellite, _| satellite.clerk.object(name))
            .map_err(io::Error::other)?;
        if let Some(object) = known {
            return Ok(object);
        }
        let name: Rc<str> = name.into();
        let object = cx.under(self).spawn(FlowDatabase {
            name: name.clone(),
            satellite: self,
            changed: Signal::new(),
            watching: Signal::new(),
            done: Signal::new(),
            refused: Signal::new(),
        });
        cx.with(self, |satellite, _| satellite.clerk.add(&name, object))
            .map_err(io::Error::other)?;
        Ok(object)
    }
}

impl Flow {
    /// A database of the hub; see [`database`](Handle#method.database) of a satellite.
    ///
    /// # Errors
    /// If the name cannot be, or the satellite is gone.
    pub fn database(&self, cx: &mut Cx, name: &str) -> io::Result<Handle<FlowDatabase>> {
        self.satellite().database(cx, name)
    }
}

impl Handle<FlowDatabase> {
    /// Creates it where it is missing, now and after each reconnection; a durable one has every change on the
    /// disk before [`done`](FlowDatabase::done) says so. One that exists stays as it is.
    pub fn create(self, cx: &mut Cx, durable: bool) {
        self.on_satellite(cx, |satellite, name| {
            satellite.clerk.create(satellite.core.as_mut(), name, durable);
            true
        });
    }

    /// Sets a variable. Answers whether that is under way; [`done`](FlowDatabase::done) or
    /// [`refused`](FlowDatabase::refused) tells what became of it.
    pub fn set(self, cx: &mut Cx, key: &str, value: impl IntoVariant) -> bool {
        let Ok(value) = Value::new(&value.into_variant()) else { return false };
        check_key(key).is_ok() && self.order(cx, Order::Set(key.to_owned(), value))
    }

    /// Deletes a variable, as [`set`](Handle#method.set) does.
    pub fn delete(self, cx: &mut Cx, key: &str) -> bool {
        check_key(key).is_ok() && self.order(cx, Order::Delete(key.to_owned()))
    }

    /// Asks for a variable: `answer` is called with its value, none if there is no such variable, or with why
    /// there is no answer. Answers `false`, and never calls it, if too much waits.
    pub fn get(
        self,
        cx: &mut Cx,
        key: &str,
        answer: impl FnOnce(&mut Cx, Result<Option<SkVariant>, String>) + 'static,
    ) -> bool {
        check_key(key).is_ok() && self.order(cx, Order::Get(key.to_owned(), Box::new(answer)))
    }

    /// Writes all of it to the hub's disk.
    pub fn save(self, cx: &mut Cx) -> bool {
        self.order(cx, Order::Save)
    }

    /// Puts what was saved in place of what it holds.
    pub fn load(self, cx: &mut Cx) -> bool {
        self.order(cx, Order::Load)
    }

    /// Watches the variables whose keys begin with `prefix`: [`changed`](FlowDatabase::changed) tells what there
    /// is, then every change. After a reconnection only what changed meanwhile is told. A database that is not
    /// there is waited for.
    pub fn watch(self, cx: &mut Cx, prefix: &str) {
        self.on_satellite(cx, |satellite, name| {
            satellite.clerk.watch(satellite.core.as_mut(), name, prefix);
            true
        });
    }

    /// Watches no more.
    pub fn unwatch(self, cx: &mut Cx, prefix: &str) {
        self.on_satellite(cx, |satellite, name| {
            satellite.clerk.unwatch(satellite.core.as_mut(), name, prefix);
            true
        });
    }

    /// The value of a watched variable as it was told last, without asking the hub.
    pub fn known(self, cx: &mut Cx, key: &str) -> Option<SkVariant> {
        let (satellite, name) = self.parts(cx)?;
        cx.with(satellite, |satellite, _| satellite.clerk.known(&name, key).map(Value::variant))
            .ok()?
    }

    pub(in super::super) fn parts(self, cx: &mut Cx) -> Option<(Handle<SkFlowSat>, Rc<str>)> {
        cx.with(self, |database, _| (database.satellite, database.name.clone())).ok()
    }

    fn order(self, cx: &mut Cx, order: Order) -> bool {
        self.on_satellite(cx, |satellite, name| satellite.clerk.order(satellite.core.as_mut(), name, order))
    }

    fn on_satellite(self, cx: &mut Cx, work: impl FnOnce(&mut SkFlowSat, &Rc<str>) -> bool) -> bool {
        let Some((satellite, name)) = self.parts(cx) else { return false };
        let done = cx.with(satellite, |satellite, cx| {
            let done = work(satellite, &name);
            satellite.flush_later(cx);
            done
        });
        done.unwrap_or(false)
    }
}

/// Emits what the clerk has to tell, unleased.
pub(in super::super) fn tell_told(cx: &mut Cx, satellite: Handle<SkFlowSat>) {
    while let Ok(Some(told)) = cx.with(satellite, |satellite, _| satellite.clerk.next_told()) {
        match told {
            Told::Changed(object, variable) => cx.emit_own(object, |o: &FlowDatabase| &o.changed, &variable),
            Told::Watching(object, prefix) => cx.emit_own(object, |o: &FlowDatabase| &o.watching, &prefix),
            Told::Done(object, key) => cx.emit_own(object, |o: &FlowDatabase| &o.done, &key),
            Told::Refused(object, why) => cx.emit_own(object, |o: &FlowDatabase| &o.refused, &why),
            Told::Answered(answer, value) => answer(cx, value),
        }
    }
}
