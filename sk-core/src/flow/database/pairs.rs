//! One database: sorted variables, and the order in which they changed.

use super::name::check_key;
use crate::flow::limits::{DATABASE_BYTES_MAX, DATABASE_KEYS_MAX, DELETIONS_KEPT_MAX};
use crate::flow::{RefusalCode, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;
use std::sync::Arc;

/// How much a database may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Variables.
    pub keys: usize,
    /// Bytes of keys and values.
    pub bytes: usize,
    /// Deletions that are remembered for those who watch.
    pub deletions: usize,
}

impl Default for Room {
    fn default() -> Room {
        Room { keys: DATABASE_KEYS_MAX, bytes: DATABASE_BYTES_MAX, deletions: DELETIONS_KEPT_MAX }
    }
}

/// The key-value store of the papers (`SkFlowPairDatabase`) without its label: variants under names, sorted,
/// kept encoded so that a value is handed on as it came.
///
/// Each change has a sequence number. A variable is in the list of changes once, with its last one, so whoever
/// remembers a number learns all that changed since, each variable's newest value once, at no cost to the
/// database. Deletions are in the list too, a bounded number of them: who was away for longer than they reach
/// back starts anew, see [`knows_since`](PairDatabase::knows_since).
///
/// ```
/// use sk_core::flow::{Value, database::{Change, PairDatabase}};
///
/// let mut arm = PairDatabase::new(0);
/// arm.set("gain.p", Value::new(&1.5.into())?).expect("room");
/// let seen = arm.sequence();
/// arm.set("gain.p", Value::new(&1.6.into())?).expect("room");
/// arm.set("gain.p", Value::new(&1.7.into())?).expect("room");
/// arm.delete("gain.i"); // was never there
///
/// let Some(Change { sequence, key, value }) = arm.change_after(seen) else { panic!("a change") };
/// assert_eq!((key, value.map(|value| value.variant())), ("gain.p", Some(1.7.into())));
/// assert!(arm.change_after(sequence).is_none(), "the value between is of no interest any more");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct PairDatabase {
    /// All variables, and those deleted ones that are remembered.
    entries: BTreeMap<Arc<str>, Entry>,
    /// Every entry once, by its sequence number.
    changes: BTreeMap<u64, Arc<str>>,
    /// The sequence numbers of the deleted ones.
    gone: BTreeSet<u64>,
    bytes: usize,
    sequence: u64,
    /// Deletions up to this number may have been forgotten.
    forgotten: u64,
    room: Room,
}

#[derive(Clone, Debug)]
struct Entry {
    sequence: u64,
    /// None: deleted.
    value: Option<Value>,
}

/// A change: the newest there is of its variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change<'a> {
    /// Its number.
    pub sequence: u64,
    /// The variable.
    pub key: &'a str,
    /// Its value; none if it was deleted.
    pub value: Option<&'a Value>,
}

/// The content of a database, as it goes to the disk and comes back.
pub type Contents = Vec<(Arc<str>, Value)>;

impl PairDatabase {
    /// An empty database whose changes are numbered from `base` on. Two databases of one name that do not
    /// continue each other have bases far apart, so that a number from one says nothing in the other.
    pub fn new(base: u64) -> PairDatabase {
        PairDatabase::with_room(base, Room::default())
    }

    /// As [`new`](PairDatabase::new), with other limits.
    pub fn with_room(base: u64, room: Room) -> PairDatabase {
        PairDatabase {
            entries: BTreeMap::new(),
            changes: BTreeMap::new(),
            gone: BTreeSet::new(),
            bytes: 0,
            sequence: base,
            forgotten: base,
            room,
        }
    }

    /// How many variables there are.
    pub fn len(&self) -> usize {
        self.entries.len() - self.gone.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bytes of all keys and values.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// The number of the last change.
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// The value of a variable.
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.entries.get(key)?.value.as_ref()
    }

    /// Whether setting this variable is possible, and by how many variables and bytes it makes the database
    /// grow: negative for a shorter value.
    ///
    /// # Errors
    /// `BadKey`, or `DatabaseFull` if it has as many variables or bytes as it may.
    pub fn growth(&self, key: &str, value: &Value) -> Result<(usize, isize), RefusalCode> {
        check_key(key)?;
        let before = self.get(key).map(|value| key.len() + value.encoded().len());
        let (keys, after) = (usize::from(before.is_none()), key.len() + value.encoded().len());
        let bytes = self.bytes - before.unwrap_or(0) + after;
        if self.len() + keys > self.room.keys || bytes > self.room.bytes {
            return Err(RefusalCode::DatabaseFull);
        }
        Ok((keys, after as isize - before.unwrap_or(0) as isize))
    }

    /// Sets a variable; answers the number of the change.
    ///
    /// # Errors
    /// As [`growth`](PairDatabase::growth); nothing has changed then.
    pub fn set(&mut self, key: &str, value: Value) -> Result<u64, RefusalCode> {
        self.growth(key, &value)?;
        self.put(key, value);
        Ok(self.sequence)
    }

    fn put(&mut self, key: &str, value: Value) {
        let before = self.get(key).map_or(0, |value| key.len() + value.encoded().len());
        self.bytes = self.bytes - before + key.len() + value.encoded().len();
        let key = self
            .entries
            .get_key_value(key)
            .map_or_else(|| key.into(), |(key, _)| key.clone());
        self.note(key, Some(value));
    }

    /// Deletes a variable; answers the number of the change, or none if there was no such variable.
    pub fn delete(&mut self, key: &str) -> Option<u64> {
        let (shared, entry) = self.entries.get_key_value(key)?;
        self.bytes -= key.len() + entry.value.as_ref()?.encoded().len();
        self.note(shared.clone(), None);
        while self.gone.len() > self.room.deletions {
            self.forget_oldest_deletion();
        }
        Some(self.sequence)
    }

    fn note(&mut self, key: Arc<str>, value: Option<Value>) {
        self.sequence += 1;
        if value.is_none() {
            self.gone.insert(self.sequence);
        }
        self.changes.insert(self.sequence, key.clone());
        let entry = Entry { sequence: self.sequence, value };
        if let Some(before) = self.entries.insert(key, entry) {
            self.changes.remove(&before.sequence);
            self.gone.remove(&before.sequence);
        }
    }

    fn forget_oldest_deletion(&mut self) {
        let Some(oldest) = self.gone.pop_first() else { return };
        if let Some(key) = self.changes.remove(&oldest) {
            self.entries.remove(&key);
        }
        self.forgotten = oldest;
    }

    /// Makes `contents` all that there is; what is the same already does not change.
    ///
    /// # Errors
    /// If it has no room for them or one has a key that cannot be; then nothing has changed.
    pub fn replace(&mut self, contents: &Contents) -> Result<(), RefusalCode> {
        let bytes: usize = contents.iter().map(|(key, value)| key.len() + value.encoded().len()).sum();
        if contents.len() > self.room.keys || bytes > self.room.bytes {
            return Err(RefusalCode::DatabaseFull);
        }
        contents.iter().try_for_each(|(key, _)| check_key(key))?;
        let kept: BTreeSet<Arc<str>> = contents.iter().map(|(key, _)| key.clone()).collect();
        let others: Vec<Arc<str>> = self
            .iter("", None)
            .map(|(key, _)| key)
            .filter(|key| !kept.contains(*key))
            .cloned()
            .collect();
        for key in others {
            self.delete(&key);
        }
        for (key, value) in contents {
            if self.get(key).is_none_or(|there| there.encoded() != value.encoded()) {
                self.put(key, value.clone());
            }
        }
        Ok(())
    }

    /// The variables whose keys begin with `prefix`, sorted, from the one behind `after` on.
    pub fn iter<'a>(
        &'a self,
        prefix: &'a str,
        after: Option<&str>,
    ) -> impl Iterator<Item = (&'a Arc<str>, &'a Value)> + use<'a> {
        let from = match after {
            Some(after) if after >= prefix => Bound::Excluded(after),
            _ => Bound::Included(prefix),
        };
        self.entries
            .range::<str, _>((from, Bound::Unbounded))
            .take_while(move |(key, _)| key.starts_with(prefix))
            .filter_map(|(key, entry)| Some((key, entry.value.as_ref()?)))
    }

    /// The number of a variable's last change.
    pub fn changed(&self, key: &str) -> Option<u64> {
        self.entries.get(key).map(|entry| entry.sequence)
    }

    /// Whether someone who knows the database as of this number learns all from the changes after it.
    pub fn knows_since(&self, sequence: u64) -> bool {
        (self.forgotten..=self.sequence).contains(&sequence)
    }

    /// The first change after this number.
    pub fn change_after(&self, sequence: u64) -> Option<Change<'_>> {
        let (&sequence, key) = self.changes.range((Bound::Excluded(sequence), Bound::Unbounded)).next()?;
        let value = self.entries.get(key)?.value.as_ref();
        Some(Change { sequence, key, value })
    }

    /// All that it holds, for the disk. The values are shared, not copied.
    pub fn contents(&self) -> Contents {
        self.iter("", None).map(|(key, value)| (key.clone(), value.clone())).collect()
    }
}
