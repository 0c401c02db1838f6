//! `sk db`: the databases of the hub.

use crate::arguments::{Arguments, json as parse};
use crate::names::missing;
use crate::output::{json, print, safe};
use crate::session::{Link, Visit};
use crate::table::{bytes, table};
use clap::{Args, Subcommand};
use sk_core::flow::satellite::DatabaseInfo;
use sk_core::flow::{FlowDatabase, Variable};
use sk_core::prelude::*;

#[derive(Subcommand, Debug, Clone)]
pub enum Database {
    /// List the databases
    Ls {
        /// Only those whose names begin with this
        prefix: Option<String>,
    },
    /// Print the value of a variable
    Get(Key),
    /// Set a variable; of a durable database it is on the disk when this command ends
    Set {
        #[command(flatten)]
        key: Key,
        /// The value, as JSON
        #[arg(value_parser = parse, allow_hyphen_values = true, value_name = "JSON")]
        value: SkVariant,
    },
    /// Delete a variable
    Delete(Key),
    /// List the keys of the variables
    Keys(Part),
    /// Print all variables
    All(Part),
    /// Create a database of a plain name
    Create {
        /// Its name
        database: String,
        /// Every change is on the disk before it is acknowledged
        #[arg(long)]
        durable: bool,
    },
    /// Remove a database, on the disk too
    Remove(Whole),
    /// Write a database to the disk
    Save(Whole),
    /// Put what was saved in place of what a database holds
    Load(Whole),
    /// Print what there is, then every change
    Watch {
        #[command(flatten)]
        part: Part,
        /// End after this many lines
        #[arg(short = 'n', long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
        count: Option<u64>,
    },
}

#[derive(Args, Debug, Clone)]
pub struct Key {
    /// The database: `arm`, `flow:robot.eye`, `user:robot`, `chan:robot.pendulum`
    pub database: String,
    /// The variable
    pub key: String,
}

#[derive(Args, Debug, Clone)]
pub struct Part {
    /// The database: `arm`, `flow:robot.eye`, `user:robot`, `chan:robot.pendulum`
    pub database: String,
    /// Only variables whose keys begin with this
    #[arg(default_value = "", hide_default_value = true)]
    pub prefix: String,
}

#[derive(Args, Debug, Clone)]
pub struct Whole {
    /// The database
    pub database: String,
}

impl Database {
    fn name(&self) -> &str {
        match self {
            Database::Ls { .. } => "",
            Database::Get(key) | Database::Set { key, .. } | Database::Delete(key) => &key.database,
            Database::Keys(part) | Database::All(part) | Database::Watch { part, .. } => &part.database,
            Database::Create { database, .. } => database,
            Database::Remove(whole) | Database::Save(whole) | Database::Load(whole) => &whole.database,
        }
    }
}

pub fn run(arguments: &Arguments, task: &Database) -> Result<(), String> {
    let (task, as_json) = (task.clone(), arguments.json);
    Visit::once(arguments, move |cx, link| {
        // A name that cannot be is refused here, a database that is not there by the hub.
        let database = match &task {
            Database::Ls { prefix } => {
                let prefix = prefix.clone().unwrap_or_default();
                return link.hub.databases(cx, &prefix, move |cx, list| {
                    link.end(cx, list.and_then(|list| listed(&list, as_json)));
                });
            }
            task => link.hub.database(cx, task.name()),
        };
        match database {
            Ok(database) => {
                let creates = matches!(task, Database::Create { .. });
                Work { link, name: task.name().to_owned(), creates, as_json }.begin(cx, database, task);
            }
            Err(error) => link.fail(cx, format!("{:?}: {error}", task.name())),
        }
    })
}

fn listed(list: &[DatabaseInfo], as_json: bool) -> Result<String, String> {
    if as_json {
        let object = |one: &DatabaseInfo| {
            json(&SkVariant::map([
                ("name", one.name.as_str().into()),
                ("durable", one.durable.into()),
                ("variables", one.variables.into()),
                ("bytes", one.bytes.into()),
            ]))
        };
        return list.iter().map(object).collect();
    }
    let row = |one: &DatabaseInfo| {
        let durable = if one.durable { "durable" } else { "" };
        vec![safe(&one.name), durable.to_owned(), one.variables.to_string(), bytes(one.bytes as f64)]
    };
    let rows: Vec<Vec<String>> = list.iter().map(row).collect();
    Ok(table(&["DATABASE", "KEPT", "VARIABLES", "SIZE"], &rows))
}

fn as_line(key: &str, value: Option<&SkVariant>, as_json: bool) -> Result<String, String> {
    if as_json {
        let known = [("key", Some(SkVariant::from(key))), ("value", value.cloned())];
        return json(&SkVariant::map(known.into_iter().filter_map(|(name, value)| Some((name, value?)))));
    }
    let value = value.map_or_else(|| Ok("(deleted)\n".to_owned()), json)?;
    Ok(format!("{}  {value}", safe(key)))
}

/// One command about one database.
#[derive(Clone)]
struct Work {
    link: Link,
    name: String,
    /// What is refused then is not that there is no such database.
    creates: bool,
    as_json: bool,
}

impl Work {
    fn begin(self, cx: &mut Cx, database: Handle<FlowDatabase>, task: Database) {
        let (link, as_json) = (self.link, self.as_json);
        match task {
            Database::Ls { .. } => {}
            Database::Get(key) => self.get(cx, database, key.key),
            Database::Set { key, value } => {
                self.hear_outcome(cx, database);
                if !database.set(cx, &key.key, value) {
                    link.fail(cx, format!("{:?} cannot be set: keys have 1 to 255 bytes without control characters, values at most 1 MiB", key.key));
                }
            }
            Database::Delete(key) => {
                self.hear_outcome(cx, database);
                if !database.delete(cx, &key.key) {
                    link.fail(cx, format!("{:?} is no key", key.key));
                }
            }
            Database::Keys(part) => database.keys(cx, &part.prefix, move |cx, keys| match keys {
                Ok(keys) => {
                    let line = |key: &String| match as_json {
                        true => json(&key.as_str().into()),
                        false => Ok(safe(key) + "\n"),
                    };
                    link.end(cx, keys.iter().map(line).collect());
                }
                Err(why) => self.fail(cx, why),
            }),
            Database::All(part) => database.all(cx, &part.prefix, move |cx, variables| match variables {
                Ok(variables) => {
                    let lines = variables.iter().map(|(key, value)| as_line(key, Some(value), as_json));
                    link.end(cx, lines.collect());
                }
                Err(why) => self.fail(cx, why),
            }),
            Database::Create { durable, .. } => {
                let name = self.name.clone();
                link.hub.create_database(cx, &name, durable, move |cx, done| self.end(cx, done));
            }
            Database::Remove(_) => {
                let name = self.name.clone();
                link.hub.remove_database(cx, &name, move |cx, done| self.end(cx, done));
            }
            Database::Save(_) => {
                self.hear_outcome(cx, database);
                database.save(cx);
            }
            Database::Load(_) => {
                self.hear_outcome(cx, database);
                database.load(cx);
            }
            Database::Watch { part, count } => self.watch(cx, database, part.prefix, count),
        }
    }

    fn get(self, cx: &mut Cx, database: Handle<FlowDatabase>, key: String) {
        let wanted = key.clone();
        database.get(cx, &wanted, move |cx, value| match value {
            Ok(Some(value)) => self.link.end(cx, json(&value)),
            // The one that may have been meant is asked for.
            Ok(None) => database.keys(cx, "", move |cx, keys| {
                let keys = keys.unwrap_or_default();
                let all = format!("`sk db keys {}` lists them", safe(&self.name));
                self.link
                    .fail(cx, missing("variable", &key, keys.iter().map(String::as_str), &all));
            }),
            Err(why) => self.fail(cx, why),
        });
    }

    fn end(self, cx: &mut Cx, done: Result<(), String>) {
        match done {
            Ok(()) => self.link.end(cx, Ok(String::new())),
            Err(why) => self.fail(cx, why),
        }
    }

    /// Fails with the hub's words, or with the database that may have been meant if there is none of this name.
    fn fail(self, cx: &mut Cx, why: String) {
        self.link.hub.databases(cx, "", move |cx, list| {
            let list = list.unwrap_or_default();
            let names = list.iter().map(|one| one.name.as_str());
            let (creates, exists) = (self.creates, list.iter().any(|one| one.name == self.name));
            let failure = match (creates, exists) {
                (true, true) => format!("there is a database {} already", safe(&self.name)),
                (false, false) => missing("database", &self.name, names, "`sk db ls` lists them"),
                _ => format!("{}: {}", safe(&self.name), safe(&why)),
            };
            self.link.fail(cx, failure);
        });
    }

    fn hear_outcome(&self, cx: &mut Cx, database: Handle<FlowDatabase>) {
        let outcome = cx.spawn(Outcome { work: self.clone() });
        attach!(cx, database.done => outcome.on_done());
        attach!(cx, database.refused => outcome.on_refused);
    }

    fn watch(self, cx: &mut Cx, database: Handle<FlowDatabase>, prefix: String, left: Option<u64>) {
        let (link, as_json) = (self.link, self.as_json);
        let watcher = cx.spawn(Watcher { link, as_json, left });
        attach!(cx, database.changed => watcher.on_changed);
        // A watch waits for its database; a name that is mistyped should not.
        database.keys(cx, &prefix.clone(), move |cx, keys| match keys {
            Ok(_) => database.watch(cx, &prefix),
            Err(why) => self.fail(cx, why),
        });
    }
}

/// Waits for what became of a command.
struct Outcome {
    work: Work,
}

object! { Outcome { slots { on_done() on_refused(String) } } }

impl Outcome {
    fn on_done(&mut self, cx: &mut Cx) {
        self.work.clone().end(cx, Ok(()));
    }

    fn on_refused(&mut self, cx: &mut Cx, why: String) {
        self.work.clone().fail(cx, why);
    }
}

/// Prints what changes.
struct Watcher {
    link: Link,
    as_json: bool,
    left: Option<u64>,
}

object! { Watcher { slots { on_changed(&Variable) } } }

impl Watcher {
    fn on_changed(&mut self, cx: &mut Cx, variable: &Variable) {
        if self.left == Some(0) {
            return;
        }
        let line = as_line(variable.key(), variable.value(), self.as_json);
        if let Err(failure) = line.and_then(|line| print(cx, &line)) {
            return self.link.fail(cx, failure);
        }
        if let Some(left) = &mut self.left {
            *left -= 1;
            if *left == 0 {
                cx.quit();
            }
        }
    }
}
