//! Opening the file: it is made whole or not at all, checked through, and set aside if it is damaged.

use super::backend::Backend;
use super::transactions::{FileError, contents, of_engine, read_about};
use super::{CACHE_BYTES_MAX, DATABASES, FILE, STORE_FORMAT, Store, VARIABLES, contained};
use crate::flow::database::{DatabaseName, Saved};
use crate::testing::{Bug, is_planted};
use crate::world::{Storage, StoredFile};
use redb::{Builder, Database, ReadableDatabase, ReadableTable, ReadableTableMetadata};
use std::ffi::OsString;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// The key under which the file says its format.
const FORMAT_KEY: &str = "format";

/// A store that is ready, and what was found.
#[derive(Debug)]
pub struct Opened {
    /// The store.
    pub store: Store,
    /// The databases in it.
    pub saved: Vec<(DatabaseName, Saved)>,
    /// The file that was there was damaged, and a new one was begun.
    pub damage: Option<Damage>,
}

/// A damaged file was found. It is kept for whoever wants to look into it, and not used any more.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("the hub's databases were damaged ({why}) and are set aside as {}; new ones were begun", set_aside.display())]
pub struct Damage {
    /// What is wrong with it.
    pub why: String,
    /// Where it is now.
    pub set_aside: PathBuf,
}

/// Why there is no store.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The disk failed.
    #[error("the hub's databases at {} cannot be opened: {error}", path.display())]
    Disk {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        error: io::Error,
    },
    /// The file was damaged and is set aside, and then the disk failed before there was a new one. Nobody is told of
    /// the damage later.
    #[error("{damage}; but that failed: {error}")]
    NotBegun {
        /// What was found.
        damage: Damage,
        /// What the system said.
        #[source]
        error: io::Error,
    },
    /// The file was written by another version. It is left as it is.
    #[error(
        "the hub's databases at {} are of the format {found}, this build knows {STORE_FORMAT}: start the version that wrote them, or move the file away",
        path.display()
    )]
    Format {
        /// The file.
        path: PathBuf,
        /// The format that it has.
        found: u64,
    },
}

/// Why a file cannot be used.
enum Unusable {
    /// The disk says so: it may be better tomorrow.
    Disk(io::Error),
    Format(u64),
    /// It is not what was written.
    Damaged(String),
}

impl Store {
    /// Opens the file of a hub's databases, or begins one. All that it holds is read and checked. A damaged file
    /// is renamed and told of in [`Opened::damage`]. Blocks: for before the loop runs.
    ///
    /// # Errors
    /// If the disk fails, or the file is of another format.
    pub fn open(storage: Arc<dyn Storage>, path: PathBuf) -> Result<Opened, StoreError> {
        let disk = |error| StoreError::Disk { path: path.clone(), error };
        let damage = match try_open(&storage, &path) {
            Ok((engine, saved)) => {
                let store = Store { storage, path, engine: Some(engine) };
                return Ok(Opened { store, saved, damage: None });
            }
            Err(Unusable::Disk(error)) if error.kind() == ErrorKind::NotFound => None,
            Err(Unusable::Disk(error)) => return Err(disk(error)),
            Err(Unusable::Format(found)) => return Err(StoreError::Format { path, found }),
            Err(Unusable::Damaged(why)) => {
                let set_aside = set_aside(&*storage, &path).map_err(disk)?;
                Some(Damage { why, set_aside }).filter(|_| !is_planted(Bug::DamageUntold))
            }
        };
        let not_begun = |error| match damage.clone() {
            Some(damage) => StoreError::NotBegun { damage, error },
            None => disk(error),
        };
        begin(&storage, &path).map_err(not_begun)?;
        let (engine, saved) = try_open(&storage, &path).map_err(|unusable| match unusable {
            Unusable::Disk(error) => not_begun(error),
            Unusable::Format(found) => StoreError::Format { path: path.clone(), found },
            Unusable::Damaged(why) => not_begun(io::Error::other(why)),
        })?;
        Ok(Opened { store: Store { storage, path, engine: Some(engine) }, saved, damage })
    }
}

/// Opens a file that is there.
fn try_open(
    storage: &Arc<dyn Storage>,
    path: &Path,
) -> Result<(Database, Vec<(DatabaseName, Saved)>), Unusable> {
    let opened = contained(|| {
        let engine = open_engine(storage, path)?;
        let saved = look_through(&engine)?;
        Ok((engine, saved))
    });
    match opened {
        Ok(Ok(found)) => Ok(found),
        Ok(Err(error)) => Err(unusable(error)),
        Err(panic) => Err(Unusable::Damaged(panic)),
    }
}

fn unusable(error: FileError) -> Unusable {
    match error {
        FileError::Format(found) => Unusable::Format(found),
        // The engine reads where its own numbers point to: beyond the end of a file that was cut, or into one
        // that never was a store.
        FileError::Engine(redb::Error::Io(error))
            if !matches!(error.kind(), ErrorKind::UnexpectedEof | ErrorKind::InvalidData) =>
        {
            Unusable::Disk(error)
        }
        damaged => Unusable::Damaged(damaged.to_string()),
    }
}

/// Opens the engine on a file that is there. It walks through all pages and compares their check numbers.
pub(super) fn open_engine(storage: &Arc<dyn Storage>, path: &Path) -> Result<Database, FileError> {
    let io = |error: io::Error| FileError::Engine(redb::Error::Io(error));
    let file = storage.open(path, false).map_err(io)?;
    if file.is_empty().map_err(io)? {
        // The engine would take it for a new one, but a new one gets its name only when it is whole.
        return Err(io(io::Error::new(ErrorKind::UnexpectedEof, "the file is empty")));
    }
    engine_on(file)
}

fn engine_on(file: Arc<dyn StoredFile>) -> Result<Database, FileError> {
    let mut builder = Builder::new();
    builder.set_cache_size(CACHE_BYTES_MAX).set_check_integrity_on_open(true);
    builder.create_with_backend(Backend(file)).map_err(of_engine)
}

/// Checks all that the file holds, and answers which databases there are.
fn look_through(engine: &Database) -> Result<Vec<(DatabaseName, Saved)>, FileError> {
    let transaction = engine.begin_read().map_err(of_engine)?;
    let file = transaction.open_table(FILE).map_err(of_engine)?;
    match file.get(FORMAT_KEY).map_err(of_engine)?.map(|format| format.value()) {
        Some(STORE_FORMAT) => {}
        Some(other) => return Err(FileError::Format(other)),
        None => return Err(FileError::NoFormat),
    }
    let databases = transaction.open_table(DATABASES).map_err(of_engine)?;
    let variables = transaction.open_table(VARIABLES).map_err(of_engine)?;
    let mut saved = Vec::new();
    let mut expected = 0;
    for entry in databases.iter().map_err(of_engine)? {
        let (name, bytes) = entry.map_err(of_engine)?;
        let about = read_about(name.value(), bytes.value())?;
        contents(&variables, name.value(), about.keys)?;
        expected += about.keys;
        let damaged = |_| FileError::Record { what: "the name", database: name.value().to_owned() };
        saved.push((DatabaseName::parse_stored(name.value()).map_err(damaged)?, about));
    }
    let found = usize::try_from(variables.len().map_err(of_engine)?).unwrap_or(usize::MAX);
    if found != expected {
        return Err(FileError::Count { database: "of all".to_owned(), found, expected });
    }
    Ok(saved)
}

/// Makes a file with nothing in it, under a name of its own until it is whole.
fn begin(storage: &Arc<dyn Storage>, path: &Path) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        storage.create_dir(folder)?;
    }
    let new = beside(path, ".new");
    match storage.remove(&new) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let made = contained(|| {
        let io = |error: io::Error| FileError::Engine(redb::Error::Io(error));
        let database = engine_on(storage.open(&new, true).map_err(io)?)?;
        let mut transaction = database.begin_write().map_err(of_engine)?;
        transaction.set_two_phase_commit(true);
        transaction
            .open_table(FILE)
            .map_err(of_engine)?
            .insert(FORMAT_KEY, STORE_FORMAT)
            .map_err(of_engine)?;
        transaction.open_table(DATABASES).map_err(of_engine)?;
        transaction.open_table(VARIABLES).map_err(of_engine)?;
        transaction.commit().map_err(of_engine)
    });
    match made {
        Ok(Ok(())) => storage.rename(&new, path),
        Ok(Err(FileError::Engine(redb::Error::Io(error)))) => Err(error),
        Ok(Err(error)) => Err(io::Error::other(error.to_string())),
        Err(panic) => Err(io::Error::other(panic)),
    }
}

/// Gives a damaged file a name that nobody has.
fn set_aside(storage: &dyn Storage, path: &Path) -> io::Result<PathBuf> {
    let taken = storage.list(path.parent().unwrap_or(Path::new("")))?;
    let mut number = 1;
    loop {
        let aside = beside(path, &format!(".damaged-{number}"));
        if !taken.iter().any(|name| Some(name.as_os_str()) == aside.file_name()) {
            storage.rename(path, &aside)?;
            return Ok(aside);
        }
        number += 1;
    }
}

fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name: OsString = path.file_name().unwrap_or_default().to_owned();
    name.push(ending);
    path.with_file_name(name)
}
