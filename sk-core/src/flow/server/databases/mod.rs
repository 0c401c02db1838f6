//! PairDatabases at the hub: commands, rights, lists, watches, and what goes to the disk.

mod access;
mod defaults;
pub(super) mod desk;
pub(super) mod selected;
pub(super) mod storing;
pub(super) mod watches;

use super::super::database::{DatabaseKind, DatabaseName, Entity, Reach, StoreWork, Watcher, check_key};
use super::super::definition::Tagged;
use super::super::error::RefusalCode;
use super::super::rights::RIGHT_PREFIX;
use super::super::{Command, Event, Flags, Form, State, Value};
use super::connection::telling::Telling;
use super::{ConnectionId, ServerCore};
use access::Access;
use sk_flat::Name;
use storing::Purpose;

/// Keys that begin so are made up when they are read, in the databases of flows, channels and accounts.
const COMPUTED_PREFIX: &str = "hub.";

impl ServerCore {
    /// One command of the databases. If it needs what is on the disk, it waits until that has come, and the
    /// connection's later commands with it.
    pub(super) fn database_command(&mut self, id: ConnectionId, tag: u32, command: Command) {
        let selects = matches!(command, Command::DbSelect { .. });
        let target = match self.target(id, &command) {
            Ok(target) => target,
            Err(code) => return self.refuse_database_command(id, tag, selects, code),
        };
        if let Some(request) = self.summon(id, &target, &command) {
            if let Some(connection) = self.connections.get_mut(id) {
                let again = Tagged { tag, flags: Flags::NONE, message: command };
                connection.desk.wait_for(request, again);
            }
            return;
        }
        if let Err(code) = self.do_database_command(id, tag, &target, command) {
            self.refuse_database_command(id, tag, selects, code);
        }
    }

    fn refuse_database_command(&mut self, id: ConnectionId, tag: u32, selects: bool, code: RefusalCode) {
        if selects {
            self.deselect(id);
        }
        self.refuse(id, tag, code);
    }

    /// After a `db_select` that was refused no database is current: a client may have sent commands behind it
    /// without waiting, and those must not act on the one before.
    fn deselect(&mut self, id: ConnectionId) {
        self.select(id, None);
    }

    /// Which database a command is about: the one that it names, or the current one. `db_list` and `unwatch`
    /// are about none.
    fn target(&self, id: ConnectionId, command: &Command) -> Result<Option<DatabaseName>, RefusalCode> {
        match command {
            Command::DbList { .. } | Command::Unwatch { .. } => Ok(None),
            Command::DbSelect { database }
            | Command::DbCreate { database, .. }
            | Command::DbExists { database }
            | Command::DbRemove { database }
            | Command::Watch { database, .. } => DatabaseName::parse(database).map(Some),
            _ => {
                let connection = self.connections.get(id).ok_or(RefusalCode::Denied)?;
                connection.desk.selected.clone().map(Some).ok_or(RefusalCode::NoDatabase)
            }
        }
    }

    /// The number of the request to wait for, if the command needs contents that are on the disk. For whoever may
    /// neither read nor write them nothing is brought into memory.
    fn summon(&mut self, id: ConnectionId, target: &Option<DatabaseName>, command: &Command) -> Option<u64> {
        let needs_contents = !matches!(
            command,
            Command::DbSelect { .. }
                | Command::DbCreate { .. }
                | Command::DbExists { .. }
                | Command::DbRemove { .. }
                | Command::DbLoad {}
        );
        let name = target.as_ref().filter(|_| needs_contents)?;
        if !self.may(id, name, Access::Read) && !self.may(id, name, Access::Write) {
            return None;
        }
        match self.databases.reach(name) {
            Reach::Here | Reach::Nowhere => None,
            Reach::Coming(request) => Some(request),
            Reach::OnDisk => {
                let request = self.ask_store(name, StoreWork::Load, Purpose::Summon);
                self.databases.expect(name, request);
                Some(request)
            }
        }
    }

    fn do_database_command(
        &mut self,
        id: ConnectionId,
        tag: u32,
        target: &Option<DatabaseName>,
        command: Command,
    ) -> Result<(), RefusalCode> {
        let Some(name) = target else {
            match command {
                Command::DbList { prefix } => {
                    self.tell_list(id, tag, Form::Binary, Telling::Databases { prefix, after: None });
                }
                Command::Unwatch { watch } => self.unwatch(id, tag, watch),
                _ => {}
            }
            return Ok(());
        };
        match command {
            Command::DbSelect { .. } => self.select_database(id, tag, name),
            Command::DbCreate { durable, .. } => self.create_database(id, tag, name, durable != 0),
            Command::DbExists { .. } if !self.may_see(id, name) => Err(RefusalCode::Denied),
            Command::DbExists { .. } => {
                let value = u8::from(self.databases.exists(name));
                self.answer(id, tag, &Event::Flag { value });
                Ok(())
            }
            Command::DbRemove { .. } => self.remove_database(id, tag, name),
            Command::DbSave {} => self.save_database(id, tag, name),
            Command::DbLoad {} => self.load_database(id, tag, name),
            Command::VarSet { key, value } => self.set_variable(id, tag, name, &key, Some(value)),
            Command::VarDelete { key } => self.set_variable(id, tag, name, &key, None),
            Command::VarGet { key, form } => {
                let value = self.variable(id, name, &key)?.ok_or(RefusalCode::NoSuchVariable)?.in_form(form);
                value.wire_bytes().map_err(|_| RefusalCode::TooLong)?;
                self.answer(id, tag, &Event::Value { value });
                Ok(())
            }
            Command::VarHas { key } => {
                let value = u8::from(self.variable(id, name, &key)?.is_some());
                self.answer(id, tag, &Event::Flag { value });
                Ok(())
            }
            Command::DbKeys { prefix } => self.tell_variables(id, tag, name, prefix, None),
            Command::DbAll { prefix, form } => self.tell_variables(id, tag, name, prefix, Some(form)),
            Command::Watch { prefix, after, form, .. } => self.watch(id, tag, name, prefix, after, form),
            _ => Ok(()),
        }
    }

    fn select_database(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
    ) -> Result<(), RefusalCode> {
        // First, so that nobody learns what there is that is none of his.
        if !self.may(id, name, Access::Read) && !self.may(id, name, Access::Write) {
            return Err(RefusalCode::Denied);
        }
        if !self.databases.exists(name) {
            return Err(RefusalCode::NoSuchDatabase);
        }
        self.select(id, Some(name.clone()));
        self.answer(id, tag, &Event::DatabaseSelected { database: name.to_string() });
        Ok(())
    }

    fn create_database(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
        durable: bool,
    ) -> Result<(), RefusalCode> {
        let named = name.kind() == DatabaseKind::Named;
        if named && !self.may(id, name, Access::Write) {
            return Err(RefusalCode::Denied);
        }
        if durable && !self.storing.is_on() {
            return Err(RefusalCode::NotOffered);
        }
        let user = self.connections.get(id).and_then(|connection| connection.user.clone());
        let user = user.ok_or(RefusalCode::Denied)?;
        self.databases.create(name, user.as_str(), durable)?;
        if durable {
            self.write_whole(id, tag, name)
        } else {
            self.answer(id, tag, &Event::Done {});
            Ok(())
        }
    }

    fn remove_database(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
    ) -> Result<(), RefusalCode> {
        if !self.may(id, name, Access::Write) {
            return Err(RefusalCode::Denied);
        }
        let saved = self.databases.is_saved(name);
        let watchers = self.databases.remove(name)?;
        if name.kind() == DatabaseKind::Named {
            self.tell_gone(name, &watchers);
        }
        if saved && self.storing.is_on() {
            self.ask_and_wait(id, tag, name, StoreWork::Remove);
        } else {
            self.answer(id, tag, &Event::Saved {});
        }
        Ok(())
    }

    fn save_database(&mut self, id: ConnectionId, tag: u32, name: &DatabaseName) -> Result<(), RefusalCode> {
        if !self.may(id, name, Access::Write) {
            return Err(RefusalCode::Denied);
        }
        if !self.storing.is_on() {
            return Err(RefusalCode::NotOffered);
        }
        self.write_whole(id, tag, name)
    }

    /// All of a database goes to the disk in one transaction.
    fn write_whole(&mut self, id: ConnectionId, tag: u32, name: &DatabaseName) -> Result<(), RefusalCode> {
        let about = self.databases.note_saved(name)?;
        let open = self.databases.open_mut(name)?;
        open.torn = false;
        let contents = open.pairs.contents();
        self.ask_and_wait(id, tag, name, StoreWork::Replace { about, contents });
        Ok(())
    }

    fn load_database(&mut self, id: ConnectionId, tag: u32, name: &DatabaseName) -> Result<(), RefusalCode> {
        if !self.may(id, name, Access::Write) {
            return Err(RefusalCode::Denied);
        }
        if !self.databases.is_saved(name) {
            return Err(RefusalCode::NoSuchDatabase);
        }
        match self.databases.reach(name) {
            // Nothing is in memory that could differ; the next command that needs it brings it.
            Reach::OnDisk | Reach::Coming(_) | Reach::Nowhere => self.answer(id, tag, &Event::Done {}),
            Reach::Here if self.databases.open(name).is_some_and(|open| open.durable) => {
                // What is in memory is on the disk, or on its way there.
                self.answer(id, tag, &Event::Done {});
            }
            Reach::Here => {
                self.ask_for(id, tag, name, StoreWork::Load, Purpose::Reload { connection: id, tag })
            }
        }
        Ok(())
    }

    fn set_variable(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
        key: &str,
        value: Option<Value>,
    ) -> Result<(), RefusalCode> {
        if !self.may(id, name, Access::Write) {
            return Err(RefusalCode::Denied);
        }
        check_key(key)?;
        if name.kind() != DatabaseKind::Named && key.starts_with(COMPUTED_PREFIX) {
            return Err(RefusalCode::Denied);
        }
        let changed = match &value {
            Some(value) => Some(self.databases.set(name, key, value.clone())?),
            None => self.databases.delete(name, key)?,
        };
        if changed.is_some() {
            self.tell_watchers(name, key);
            if key.starts_with(RIGHT_PREFIX) {
                self.rights_changed(name);
            }
        }
        let durable = self.storing.is_on() && self.databases.open(name).is_some_and(|open| open.durable);
        if !durable {
            if tag != 0 {
                self.answer(id, tag, &Event::Done {});
            }
            return Ok(());
        }
        self.write_change(id, tag, name, key, value)
    }

    /// One change that was made in memory goes to the disk.
    pub(super) fn write_change(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
        key: &str,
        value: Option<Value>,
    ) -> Result<(), RefusalCode> {
        if self.databases.open(name).is_some_and(|open| open.torn) {
            return self.write_whole(id, tag, name);
        }
        let about = self.databases.note_saved(name)?;
        self.ask_and_wait(id, tag, name, StoreWork::Change { about, key: key.into(), value });
        Ok(())
    }

    /// The value of a variable, whether it was set or is made up now.
    fn variable(
        &self,
        id: ConnectionId,
        name: &DatabaseName,
        key: &str,
    ) -> Result<Option<Value>, RefusalCode> {
        if !self.may(id, name, Access::Read) {
            return Err(RefusalCode::Denied);
        }
        check_key(key)?;
        if key.starts_with(COMPUTED_PREFIX) && name.kind() != DatabaseKind::Named {
            let computed = self.computed(name).into_iter().find(|(computed, _)| *computed == key);
            return Ok(computed.and_then(|(_, variant)| Value::new(&variant).ok()));
        }
        Ok(self.databases.open(name).and_then(|open| open.pairs.get(key).cloned()))
    }

    fn tell_variables(
        &mut self,
        id: ConnectionId,
        tag: u32,
        name: &DatabaseName,
        prefix: String,
        form: Option<Form>,
    ) -> Result<(), RefusalCode> {
        if !self.may(id, name, Access::Read) {
            return Err(RefusalCode::Denied);
        }
        let mut computed = self.computed(name);
        computed.retain(|(key, _)| key.starts_with(&prefix));
        let telling = Telling::Variables {
            database: name.clone(),
            prefix,
            after: None,
            computed: computed.into(),
            values: form.is_some(),
        };
        self.tell_list(id, tag, form.unwrap_or_default(), telling);
        Ok(())
    }

    // ---- entities ----

    /// A flow, a channel or an account is there, and its database with it.
    pub(super) fn entity_began(&mut self, kind: DatabaseKind, name: &Name, entity: Entity) {
        if let Some(name) = DatabaseName::of(kind, name) {
            self.databases.add_entity(name, entity);
        }
    }

    /// It is gone. Its database goes with it, and whoever had that selected or watched it is told.
    pub(super) fn entity_ended(&mut self, kind: DatabaseKind, name: &Name, entity: Entity) {
        let Some(name) = DatabaseName::of(kind, name) else { return };
        if let Some(watchers) = self.databases.remove_entity(&name, entity) {
            self.tell_gone(&name, &watchers);
        }
    }

    fn tell_gone(&mut self, name: &DatabaseName, watchers: &[Watcher]) {
        for watcher in watchers {
            let id = ConnectionId::from_wire(watcher.connection);
            if let Some(connection) = self.connections.get_mut(id) {
                connection.desk.forget_watch(watcher.tag);
                self.answer(id, watcher.tag, &Event::WatchOver {});
            }
        }
        for id in self.selected.of(name) {
            self.select(id, None);
            self.answer(id, 0, &Event::DatabaseSelected { database: String::new() });
        }
    }

    /// A connection ends: nobody is to be told any more, and a flow's database goes.
    pub(super) fn leave_databases(&mut self, id: ConnectionId) {
        self.select(id, None);
        let Some(connection) = self.connections.get_mut(id) else { return };
        let watches = connection.desk.end();
        let flow = connection.flow.clone();
        for (name, tag) in watches {
            self.drop_watcher(&name, Watcher { connection: id.wire(), tag });
        }
        if let Some(flow) = flow {
            self.entity_ended(DatabaseKind::Flow, &flow, Entity::Flow(id.wire()));
        }
    }

    fn is_synchronous(&self, id: ConnectionId) -> bool {
        self.connections
            .get(id)
            .is_some_and(|connection| connection.inbound.state() == State::Synchronous)
    }
}
