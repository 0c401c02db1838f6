//! All databases of a hub: which there are, which are in memory, which only on the disk, and what accounts use.

use super::name::{DatabaseKind, DatabaseName};
use super::pairs::{Contents, PairDatabase, Room};
use crate::flow::limits::{ACCOUNT_BYTES_MAX, ACCOUNT_KEYS_MAX, DATABASES_PER_ACCOUNT_MAX};
use crate::flow::{ChannelRef, RefusalCode, Value};
use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;

/// What a database that is not named by command belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entity {
    /// The flow of this connection.
    Flow(u64),
    /// A channel.
    Channel(ChannelRef),
    /// An account.
    User,
    /// The hub itself.
    Hub,
}

/// What is known of a database that is on the disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Saved {
    /// The account that it counts for.
    pub account: Arc<str>,
    /// Whether every change goes to the disk.
    pub durable: bool,
    /// How many variables it had when it was last looked at.
    pub keys: usize,
    /// The bytes of its keys and values then.
    pub bytes: usize,
}

/// Who watches a database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watcher {
    /// The connection.
    pub connection: u64,
    /// The tag of its `watch`.
    pub tag: u32,
}

/// A database in memory.
#[derive(Debug)]
pub struct Open {
    /// What it holds.
    pub pairs: PairDatabase,
    /// Whether every change goes to the disk.
    pub durable: bool,
    /// Whether the disk does not have the state that the next change rests on: it failed at one, or what was saved was
    /// removed.
    pub torn: bool,
    /// Those who are to be told of changes.
    pub watchers: Vec<Watcher>,
    account: Arc<str>,
}

/// Where the contents of a database are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// There is no such database.
    Nowhere,
    /// In memory, or nothing was ever set.
    Here,
    /// On the disk: they must be asked for.
    OnDisk,
    /// On their way from the disk, by the request of this number.
    Coming(u64),
}

/// How much one account may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccountRoom {
    /// Databases that are there without a flow or channel: named and saved ones.
    pub databases: usize,
    /// Variables of all its databases in memory.
    pub keys: usize,
    /// Bytes of all its databases in memory.
    pub bytes: usize,
}

impl Default for AccountRoom {
    fn default() -> AccountRoom {
        AccountRoom { databases: DATABASES_PER_ACCOUNT_MAX, keys: ACCOUNT_KEYS_MAX, bytes: ACCOUNT_BYTES_MAX }
    }
}

/// What an account has of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Databases that are there without a flow or channel.
    pub databases: usize,
    /// Variables.
    pub keys: usize,
    /// Bytes.
    pub bytes: usize,
}

#[derive(Debug, Default)]
struct Place {
    entity: Option<Entity>,
    saved: Option<Box<Saved>>,
    contents: Held,
}

/// A flow that never set a variable costs its place here and nothing more.
#[derive(Debug, Default)]
enum Held {
    #[default]
    None,
    Coming(u64),
    Open(Box<Open>),
}

impl Place {
    fn exists(&self, kind: DatabaseKind) -> bool {
        self.entity.is_some() || kind == DatabaseKind::Named
    }
}

/// A line of a list of databases.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// The name.
    pub name: DatabaseName,
    /// Whether every change goes to the disk.
    pub durable: bool,
    /// How many variables it has.
    pub keys: usize,
    /// The bytes of its keys and values.
    pub bytes: usize,
}

/// The databases of a hub. Those of flows, channels and accounts are there as long as these are, and take
/// memory only once something was set in them.
///
/// ```
/// use sk_core::flow::database::{DatabaseName, Databases, Entity};
/// use sk_core::flow::{RefusalCode, Value};
///
/// let mut databases = Databases::default();
/// let arm = DatabaseName::parse("flow:robot.arm").expect("a name");
/// let value = Value::new(&1.5.into())?;
/// assert_eq!(databases.set(&arm, "gain.p", value.clone()), Err(RefusalCode::NoSuchDatabase));
/// databases.add_entity(arm.clone(), Entity::Flow(1));
/// assert!(databases.set(&arm, "gain.p", value).is_ok());
/// databases.remove_entity(&arm, Entity::Flow(1));
/// assert!(!databases.exists(&arm), "it goes with its flow");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct Databases {
    places: BTreeMap<DatabaseName, Place>,
    accounts: BTreeMap<Arc<str>, Usage>,
    room: AccountRoom,
    /// Mixed into the numbers at which databases begin.
    salt: u64,
    opened: u64,
}

impl Databases {
    /// Databases with other limits for each account.
    pub fn with_room(room: AccountRoom) -> Databases {
        Databases { room, ..Databases::default() }
    }

    /// Mixes in what an earlier run of the hub did not have, so that a sequence number from then is not taken
    /// for one of now.
    pub fn stir(&mut self, random: &[u8; 32]) {
        let mut word = [0; 8];
        word.copy_from_slice(&random[..8]);
        self.salt = self.salt.rotate_left(7) ^ u64::from_le_bytes(word);
    }

    /// The first sequence number of a new database: the upper bits are by chance, the lower count changes.
    fn base(&mut self) -> u64 {
        self.opened += 1;
        let mixed = (self.salt ^ self.opened).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed >> 41) + 1) << 40
    }

    /// Notes that a flow, channel or account is there.
    pub fn add_entity(&mut self, name: DatabaseName, entity: Entity) {
        self.places.entry(name).or_default().entity = Some(entity);
    }

    /// Notes that it is gone, and with it what its database held in memory. Answers who watched.
    pub fn remove_entity(&mut self, name: &DatabaseName, entity: Entity) -> Option<Vec<Watcher>> {
        let place = self.places.get_mut(name).filter(|place| place.entity == Some(entity))?;
        place.entity = None;
        let watchers = self.close(name);
        if self.places.get(name).is_some_and(|place| place.saved.is_none()) {
            self.places.remove(name);
        }
        Some(watchers)
    }

    /// Takes the contents out of memory.
    fn close(&mut self, name: &DatabaseName) -> Vec<Watcher> {
        let Some(place) = self.places.get_mut(name) else { return Vec::new() };
        match std::mem::take(&mut place.contents) {
            Held::Open(open) => {
                let (keys, bytes) = (open.pairs.len(), open.pairs.bytes());
                self.use_more(&open.account, -(keys as isize), -(bytes as isize));
                open.watchers
            }
            Held::None | Held::Coming(_) => Vec::new(),
        }
    }

    /// Whom a database belongs to, if it is not a named one.
    pub fn entity(&self, name: &DatabaseName) -> Option<Entity> {
        self.places.get(name)?.entity
    }

    /// Whether there is such a database.
    pub fn exists(&self, name: &DatabaseName) -> bool {
        self.places.get(name).is_some_and(|place| place.exists(name.kind()))
    }

    /// Where its contents are.
    pub fn reach(&self, name: &DatabaseName) -> Reach {
        match self.places.get(name).filter(|place| place.exists(name.kind())) {
            None => Reach::Nowhere,
            Some(Place { contents: Held::Open(_), .. }) => Reach::Here,
            Some(Place { contents: Held::Coming(request), .. }) => Reach::Coming(*request),
            Some(place) if place.saved.is_some() => Reach::OnDisk,
            Some(_) => Reach::Here,
        }
    }

    /// A database in memory; none if nothing was ever set in it.
    pub fn open(&self, name: &DatabaseName) -> Option<&Open> {
        match &self.places.get(name)?.contents {
            Held::Open(open) => Some(open),
            Held::None | Held::Coming(_) => None,
        }
    }

    /// The same, to be noted on; made if there is nothing yet.
    ///
    /// # Errors
    /// `NoSuchDatabase`, also while its contents are not here.
    pub fn open_mut(&mut self, name: &DatabaseName) -> Result<&mut Open, RefusalCode> {
        if self.reach(name) != Reach::Here {
            return Err(RefusalCode::NoSuchDatabase);
        }
        if self.open(name).is_none() {
            let base = self.base();
            let account = name.account().unwrap_or_default().into();
            let durable = matches!(name.kind(), DatabaseKind::User | DatabaseKind::Hub);
            self.put(name, base, account, durable);
        }
        match self.places.get_mut(name).map(|place| &mut place.contents) {
            Some(Held::Open(open)) => Ok(open),
            _ => Err(RefusalCode::NoSuchDatabase),
        }
    }

    fn put(&mut self, name: &DatabaseName, base: u64, account: Arc<str>, durable: bool) {
        let pairs = PairDatabase::with_room(base, Room::default());
        let open = Open { pairs, durable, torn: false, watchers: Vec::new(), account };
        self.places.entry(name.clone()).or_default().contents = Held::Open(Box::new(open));
    }

    /// What an account uses.
    pub fn usage(&self, account: &str) -> Usage {
        self.accounts.get(account).copied().unwrap_or_default()
    }

    fn use_more(&mut self, account: &Arc<str>, keys: isize, bytes: isize) {
        let usage = self.accounts.entry(account.clone()).or_default();
        usage.keys = usage.keys.saturating_add_signed(keys);
        usage.bytes = usage.bytes.saturating_add_signed(bytes);
    }

    /// Creates a named database.
    ///
    /// # Errors
    /// `BadName` for one of an entity, `Exists`, or `TooManyDatabases` if the account has as many as it may.
    pub fn create(&mut self, name: &DatabaseName, account: &str, durable: bool) -> Result<(), RefusalCode> {
        if name.kind() != DatabaseKind::Named {
            return Err(RefusalCode::BadName);
        }
        if self.places.contains_key(name) {
            return Err(RefusalCode::Exists);
        }
        self.count_one_more(account)?;
        let base = self.base();
        self.put(name, base, account.into(), durable);
        Ok(())
    }

    fn count_one_more(&mut self, account: &str) -> Result<(), RefusalCode> {
        let usage = self.accounts.entry(account.into()).or_default();
        if usage.databases >= self.room.databases {
            return Err(RefusalCode::TooManyDatabases);
        }
        usage.databases += 1;
        Ok(())
    }

    fn count_one_less(&mut self, account: &str) {
        if let Some(usage) = self.accounts.get_mut(account) {
            usage.databases = usage.databases.saturating_sub(1);
        }
    }

    /// Removes a named database; of one that belongs to an entity, what was saved. Answers who watched it.
    ///
    /// # Errors
    /// `NoSuchDatabase`, also for an entity's that was never saved.
    pub fn remove(&mut self, name: &DatabaseName) -> Result<Vec<Watcher>, RefusalCode> {
        let place = self.places.get_mut(name).ok_or(RefusalCode::NoSuchDatabase)?;
        let saved = place.saved.take();
        if name.kind() == DatabaseKind::Named {
            let account = saved.map(|saved| saved.account);
            let account = account.or_else(|| self.open(name).map(|open| open.account.clone()));
            self.count_one_less(&account.unwrap_or_default());
            let watchers = self.close(name);
            self.places.remove(name);
            return Ok(watchers);
        }
        let saved = saved.ok_or(RefusalCode::NoSuchDatabase)?;
        if let Held::Open(open) = &mut place.contents {
            // What is in memory is not on the disk any more: the next change takes all of it there.
            open.torn = true;
        }
        if name.kind() != DatabaseKind::User {
            self.count_one_less(&saved.account);
        }
        if self.places.get(name).is_some_and(|place| place.entity.is_none()) {
            self.places.remove(name);
        }
        Ok(Vec::new())
    }

    /// Sets a variable; answers the number of the change.
    ///
    /// # Errors
    /// `NoSuchDatabase`, `BadKey`, or `DatabaseFull` if the database or all those of its account have as many
    /// variables or bytes as they may.
    pub fn set(&mut self, name: &DatabaseName, key: &str, value: Value) -> Result<u64, RefusalCode> {
        let open = self.open_mut(name)?;
        let (keys, bytes) = open.pairs.growth(key, &value)?;
        let account = open.account.clone();
        let usage = self.usage(&account);
        if usage.keys + keys > self.room.keys || usage.bytes.saturating_add_signed(bytes) > self.room.bytes {
            return Err(RefusalCode::DatabaseFull);
        }
        let sequence = self.open_mut(name)?.pairs.set(key, value)?;
        self.use_more(&account, keys as isize, bytes);
        Ok(sequence)
    }

    /// Deletes a variable; answers the number of the change, or none if there was no such variable.
    ///
    /// # Errors
    /// `NoSuchDatabase`.
    pub fn delete(&mut self, name: &DatabaseName, key: &str) -> Result<Option<u64>, RefusalCode> {
        if self.reach(name) == Reach::Here && self.open(name).is_none() {
            return Ok(None);
        }
        let open = self.open_mut(name)?;
        let before = open.pairs.bytes();
        let Some(sequence) = open.pairs.delete(key) else { return Ok(None) };
        let freed = before - open.pairs.bytes();
        let account = open.account.clone();
        self.use_more(&account, -1, -(freed as isize));
        Ok(Some(sequence))
    }

    /// Makes `contents` all that the database holds.
    ///
    /// # Errors
    /// `NoSuchDatabase`, or `DatabaseFull`.
    pub fn replace(&mut self, name: &DatabaseName, contents: &Contents) -> Result<(), RefusalCode> {
        let open = self.open_mut(name)?;
        let (keys, bytes) = (open.pairs.len() as isize, open.pairs.bytes() as isize);
        open.pairs.replace(contents)?;
        let (keys, bytes) = (open.pairs.len() as isize - keys, open.pairs.bytes() as isize - bytes);
        let account = open.account.clone();
        self.use_more(&account, keys, bytes);
        Ok(())
    }

    // ---- the disk ----

    /// Takes in what is on the disk, when the hub starts.
    pub fn found(&mut self, name: DatabaseName, saved: Saved) {
        if !matches!(name.kind(), DatabaseKind::User | DatabaseKind::Hub) {
            self.accounts.entry(saved.account.clone()).or_default().databases += 1;
        }
        self.places.entry(name).or_default().saved = Some(Box::new(saved));
    }

    /// Notes that a database goes to the disk, and answers what is to be known of it there.
    ///
    /// # Errors
    /// `NoSuchDatabase`, or `TooManyDatabases` if it was never saved and the account has as many as it may.
    pub fn note_saved(&mut self, name: &DatabaseName) -> Result<Saved, RefusalCode> {
        let open = self.open_mut(name)?;
        let (keys, bytes) = (open.pairs.len(), open.pairs.bytes());
        let saved = Saved { account: open.account.clone(), durable: open.durable, keys, bytes };
        let known = self.places.get(name).is_some_and(|place| place.saved.is_some());
        if !known && matches!(name.kind(), DatabaseKind::Flow | DatabaseKind::Channel) {
            self.count_one_more(&saved.account)?;
        }
        if let Some(place) = self.places.get_mut(name) {
            place.saved = Some(Box::new(saved.clone()));
        }
        Ok(saved)
    }

    /// What was saved of this name.
    pub fn saved(&self, name: &DatabaseName) -> Option<&Saved> {
        self.places.get(name)?.saved.as_deref()
    }

    /// Whether something of this name was saved.
    pub fn is_saved(&self, name: &DatabaseName) -> bool {
        self.saved(name).is_some()
    }

    /// Notes that the contents were asked for.
    pub fn expect(&mut self, name: &DatabaseName, request: u64) {
        if let Some(place) = self.places.get_mut(name) {
            place.contents = Held::Coming(request);
        }
    }

    /// Takes in the contents that this request brought; none means that the disk has nothing of this name.
    /// They are dropped if nobody waits for them any more.
    pub fn arrived(&mut self, name: &DatabaseName, request: u64, contents: Option<&Contents>) {
        if self.reach(name) != Reach::Coming(request) {
            return;
        }
        let base = self.base();
        let Some(place) = self.places.get_mut(name) else { return };
        place.contents = Held::None;
        let Some(contents) = contents else {
            // It was never really saved. Of a named one nothing is left then.
            if self.remove(name).is_err() && self.entity(name).is_none() {
                self.places.remove(name);
            }
            return;
        };
        let saved = place.saved.as_deref().cloned();
        let account = saved.as_ref().map(|saved| saved.account.clone());
        let account = account.unwrap_or_else(|| name.account().unwrap_or_default().into());
        let durable = saved.is_some_and(|saved| saved.durable);
        self.put(name, base, account, durable);
        if let Err(error) = self.replace(name, contents) {
            tracing::error!(database = %name, "what was saved does not fit any more: {error}");
        }
    }

    /// Notes that the disk could not bring them; the next one who asks tries again.
    pub fn failed_to_arrive(&mut self, name: &DatabaseName, request: u64) {
        if let Some(place) = self.places.get_mut(name)
            && matches!(place.contents, Held::Coming(expected) if expected == request)
        {
            place.contents = Held::None;
        }
    }

    // ---- lists ----

    /// The first database behind `after` whose name begins with `prefix`.
    pub fn next(&self, prefix: &str, after: Option<&DatabaseName>) -> Option<Line> {
        let from = match after {
            Some(after) if after.as_str() >= prefix => Bound::Excluded(after.as_str()),
            _ => Bound::Included(prefix),
        };
        let mut rest = self.places.range::<str, _>((from, Bound::Unbounded));
        let (name, place) =
            rest.find(|(name, place)| name.kind() != DatabaseKind::Hub && place.exists(name.kind()))?;
        if !name.as_str().starts_with(prefix) {
            return None;
        }
        let saved = place.saved.as_deref();
        let (durable, keys, bytes) = match &place.contents {
            Held::Open(open) => (open.durable, open.pairs.len(), open.pairs.bytes()),
            Held::None | Held::Coming(_) => {
                saved.map_or((false, 0, 0), |saved| (saved.durable, saved.keys, saved.bytes))
            }
        };
        Some(Line { name: name.clone(), durable, keys, bytes })
    }
}
