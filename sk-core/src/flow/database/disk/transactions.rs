//! What is read from the file and written to it.

use super::{DATABASES, STORE_FORMAT, VARIABLES, record};
use crate::flow::database::{Contents, DatabaseName, Saved, StoreRequest, StoreWork};
use redb::{Database, ReadableDatabase, ReadableTable, Table};
use std::collections::BTreeMap;
use std::sync::Arc;
use thiserror::Error;

/// What can go wrong with a file that is open.
#[derive(Debug, Error)]
pub(super) enum FileError {
    #[error(transparent)]
    Engine(#[from] redb::Error),
    #[error("{what} of the database {database} is damaged")]
    Record { what: &'static str, database: String },
    #[error("the database {database} has {found} variables, {expected} were written")]
    Count { database: String, found: usize, expected: usize },
    #[error("it does not say of which format it is")]
    NoFormat,
    #[error("it is of the format {0}, this build knows {STORE_FORMAT}")]
    Format(u64),
}

/// The engine has an error type for each of its calls.
pub(super) fn of_engine<E: Into<redb::Error>>(error: E) -> FileError {
    FileError::Engine(error.into())
}

type Variables<'t> = Table<'t, (&'static str, &'static str), &'static [u8]>;

/// All variables of a database, each checked, and their number.
pub(super) fn load(engine: &Database, name: &DatabaseName) -> Result<Option<Contents>, FileError> {
    let transaction = engine.begin_read().map_err(of_engine)?;
    let databases = transaction.open_table(DATABASES).map_err(of_engine)?;
    let variables = transaction.open_table(VARIABLES).map_err(of_engine)?;
    let Some(about) = databases.get(name.as_str()).map_err(of_engine)? else { return Ok(None) };
    let about = read_about(name.as_str(), about.value())?;
    contents(&variables, name.as_str(), about.keys).map(Some)
}

pub(super) fn read_about(name: &str, bytes: &[u8]) -> Result<Saved, FileError> {
    let damaged = || FileError::Record { what: "the description", database: name.to_owned() };
    record::read_about(name, bytes).ok_or_else(damaged)
}

pub(super) fn contents(
    variables: &impl ReadableTable<(&'static str, &'static str), &'static [u8]>,
    name: &str,
    expected: usize,
) -> Result<Contents, FileError> {
    let mut contents = Contents::new();
    for entry in variables.range((name, "")..).map_err(of_engine)? {
        let (at, bytes) = entry.map_err(of_engine)?;
        let (database, key) = at.value();
        if database != name {
            break;
        }
        let damaged = || FileError::Record { what: "a variable", database: name.to_owned() };
        let value = record::read_variable(name, key, bytes.value()).ok_or_else(damaged)?;
        contents.push((key.into(), value));
    }
    let found = contents.len();
    if found != expected {
        return Err(FileError::Count { database: name.to_owned(), found, expected });
    }
    Ok(contents)
}

/// Writes these in one transaction. When it returns they are on the disk.
pub(super) fn write(engine: &Database, requests: &[StoreRequest]) -> Result<(), FileError> {
    let mut transaction = engine.begin_write().map_err(of_engine)?;
    transaction.set_two_phase_commit(true);
    {
        let mut databases = transaction.open_table(DATABASES).map_err(of_engine)?;
        let mut variables = transaction.open_table(VARIABLES).map_err(of_engine)?;
        // What is known of each database after these requests; none: it is no more.
        let mut known: BTreeMap<&DatabaseName, Option<Saved>> = BTreeMap::new();
        for StoreRequest { database, work, .. } in requests {
            if !known.contains_key(database) {
                let bytes = databases.get(database.as_str()).map_err(of_engine)?;
                let about = bytes.map(|bytes| read_about(database.as_str(), bytes.value())).transpose()?;
                known.insert(database, about);
            }
            let before = known.get(database).cloned().flatten();
            let after = apply(&mut variables, database.as_str(), before, work)?;
            known.insert(database, after);
        }
        for (name, about) in known {
            match about {
                Some(about) => {
                    let bytes = record::about(name.as_str(), &about);
                    databases.insert(name.as_str(), &bytes[..]).map_err(of_engine)?;
                }
                None => drop(databases.remove(name.as_str()).map_err(of_engine)?),
            }
        }
    }
    transaction.commit().map_err(of_engine)
}

/// One request. The numbers of what a database holds are counted here and not taken from the request: after a
/// failure the hub may know more than the disk.
fn apply(
    variables: &mut Variables<'_>,
    name: &str,
    before: Option<Saved>,
    work: &StoreWork,
) -> Result<Option<Saved>, FileError> {
    match work {
        StoreWork::Load => Ok(before),
        StoreWork::Remove => {
            for key in keys(variables, name)? {
                variables.remove((name, &*key)).map_err(of_engine)?;
            }
            Ok(None)
        }
        StoreWork::Change { about, key, value } => {
            let (keys, bytes) = before.map_or((0, 0), |before| (before.keys, before.bytes));
            let old = match value {
                Some(value) => {
                    let record = record::variable(name, key, value);
                    let old = variables.insert((name, &**key), &record[..]).map_err(of_engine)?;
                    old.map(|old| old.value().len())
                }
                None => variables
                    .remove((name, &**key))
                    .map_err(of_engine)?
                    .map(|old| old.value().len()),
            };
            let size = |record: usize| key.len() + record.saturating_sub(4);
            let (had, had_bytes) = old.map_or((0, 0), |old| (1, size(old)));
            let (has, has_bytes) =
                value.as_ref().map_or((0, 0), |value| (1, key.len() + value.encoded().len()));
            Ok(Some(Saved {
                keys: (keys + has).saturating_sub(had),
                bytes: (bytes + has_bytes).saturating_sub(had_bytes),
                ..about.clone()
            }))
        }
        StoreWork::Replace { about, contents } => {
            let kept: BTreeMap<&str, ()> = contents.iter().map(|(key, _)| (&**key, ())).collect();
            for key in keys(variables, name)? {
                if !kept.contains_key(&*key) {
                    variables.remove((name, &*key)).map_err(of_engine)?;
                }
            }
            let mut bytes = 0;
            for (key, value) in contents {
                bytes += key.len() + value.encoded().len();
                let record = record::variable(name, key, value);
                let there = variables.get((name, &**key)).map_err(of_engine)?;
                if there.is_none_or(|there| there.value() != record) {
                    variables.insert((name, &**key), &record[..]).map_err(of_engine)?;
                }
            }
            Ok(Some(Saved { keys: contents.len(), bytes, ..about.clone() }))
        }
    }
}

fn keys(variables: &Variables<'_>, name: &str) -> Result<Vec<Arc<str>>, FileError> {
    let mut keys = Vec::new();
    for entry in variables.range((name, "")..).map_err(of_engine)? {
        let (at, _) = entry.map_err(of_engine)?;
        let (database, key) = at.value();
        if database != name {
            break;
        }
        keys.push(key.into());
    }
    Ok(keys)
}
