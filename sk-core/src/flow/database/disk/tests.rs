//! The store over a disk that fails: power cuts in the middle of everything, no room, turned bits, cut files.

use super::*;
use crate::flow::Value;
use crate::flow::database::{Contents, DatabaseName, Saved};
use crate::world::{DiskFaults, SimulatedRng, SimulatedStorage, StoredFile, StoredFolder};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::Mutex;

const FILE_PATH: &str = "/state/databases.redb";

/// What a store should hold: databases with their variables.
type Model = BTreeMap<String, BTreeMap<String, i64>>;

/// A disk that runs out: of operations, and then the power fails, or of room.
struct Failing {
    disk: Arc<SimulatedStorage>,
    trouble: Arc<Mutex<Trouble>>,
}

struct Trouble {
    rng: SimulatedRng,
    /// Changes until the power fails.
    changes_left: Option<u32>,
    /// How long a file may become.
    room: u64,
}

struct FailingFile {
    file: Arc<dyn StoredFile>,
    disk: Arc<SimulatedStorage>,
    trouble: Arc<Mutex<Trouble>>,
}

impl FailingFile {
    fn change(&self, needs: u64) -> io::Result<()> {
        let mut trouble = self.trouble.lock().expect("one thread");
        if needs > trouble.room {
            return Err(io::ErrorKind::StorageFull.into());
        }
        match &mut trouble.changes_left {
            Some(0) => {
                self.disk.power_cut_by_chance(&mut trouble.rng);
                trouble.changes_left = None;
            }
            Some(left) => *left -= 1,
            None => {}
        }
        Ok(())
    }
}

impl StoredFile for FailingFile {
    fn len(&self) -> io::Result<u64> {
        self.file.len()
    }
    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        self.file.read_at(offset, into)
    }
    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.change(offset + bytes.len() as u64)?;
        self.file.write_at(offset, bytes)
    }
    fn set_len(&self, len: u64) -> io::Result<()> {
        self.change(len)?;
        self.file.set_len(len)
    }
    fn sync(&self) -> io::Result<()> {
        self.change(0)?;
        self.file.sync()
    }
}

impl Storage for Failing {
    fn open(&self, path: &Path, create: bool) -> io::Result<Arc<dyn StoredFile>> {
        let file = self.disk.open(path, create)?;
        Ok(Arc::new(FailingFile { file, disk: self.disk.clone(), trouble: self.trouble.clone() }))
    }
    fn open_to_read(&self, path: &Path) -> io::Result<Arc<dyn StoredFile>> {
        self.open(path, false)
    }
    fn read(&self, path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
        self.disk.read(path, bytes_max)
    }
    fn replace(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.disk.replace(path, bytes)
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.disk.rename(from, to)
    }
    fn remove(&self, path: &Path) -> io::Result<()> {
        self.disk.remove(path)
    }
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.disk.create_dir(path)
    }
    fn folder(&self, path: &Path) -> io::Result<Arc<dyn StoredFolder>> {
        self.disk.folder(path)
    }
    fn list(&self, path: &Path) -> io::Result<Vec<PathBuf>> {
        self.disk.list(path)
    }
    fn owner_and_mode(&self, path: &Path) -> io::Result<(u32, u32)> {
        self.disk.owner_and_mode(path)
    }
}

impl Failing {
    fn new(seed: u64) -> Failing {
        let trouble = Trouble { rng: SimulatedRng::new(seed, 1), changes_left: None, room: u64::MAX };
        Failing { disk: Arc::new(SimulatedStorage::new()), trouble: Arc::new(Mutex::new(trouble)) }
    }

    fn cut_after(&self, changes: Option<u32>) {
        self.trouble.lock().expect("one thread").changes_left = changes;
    }

    fn room(&self, room: u64) {
        self.trouble.lock().expect("one thread").room = room;
    }

    fn storage(&self) -> Arc<dyn Storage> {
        Arc::new(Failing { disk: self.disk.clone(), trouble: self.trouble.clone() })
    }
}

fn opened(storage: Arc<dyn Storage>) -> Opened {
    Store::open(storage, FILE_PATH.into()).expect("the disk works")
}

fn name(text: &str) -> DatabaseName {
    DatabaseName::parse(text).expect("a name")
}

fn about(durable: bool) -> Saved {
    Saved { account: "robot".into(), durable, keys: 0, bytes: 0 }
}

fn value(number: i64) -> Value {
    Value::new(&number.into()).expect("small")
}

fn change(database: &str, key: &str, number: Option<i64>) -> StoreRequest {
    let work = StoreWork::Change { about: about(true), key: key.into(), value: number.map(value) };
    StoreRequest { number: 1, database: name(database), work }
}

fn numbers(contents: &Contents) -> BTreeMap<String, i64> {
    contents
        .iter()
        .map(|(key, value)| (key.to_string(), i64::try_from(&value.variant()).expect("a number")))
        .collect()
}

/// All that a store holds.
fn held(opened: &mut Opened) -> Model {
    let saved = opened.saved.clone();
    let held = saved.into_iter().map(|(database, about)| {
        let load = StoreRequest { number: 7, database: database.clone(), work: StoreWork::Load };
        let answer = opened.store.perform(vec![load]).remove(0);
        let Ok(Stored::Contents(Some(contents))) = answer.outcome else { panic!("{answer:?}") };
        let bytes: usize = contents.iter().map(|(key, value)| key.len() + value.encoded().len()).sum();
        assert_eq!((about.keys, about.bytes), (contents.len(), bytes), "{database}");
        (database.to_string(), numbers(&contents))
    });
    held.collect()
}

/// A group of requests by chance, and what it makes of the model.
fn group(rng: &mut SimulatedRng, model: &mut Model) -> Vec<StoreRequest> {
    let mut requests = Vec::new();
    for _ in 0..1 + rng.below(5) {
        let database = ["arm", "flow:robot.leg", "user:robot"][rng.below(3) as usize];
        let key = format!("k{}", rng.below(12));
        let number = rng.below(1_000_000) as i64;
        let variables = model.entry(database.to_owned()).or_default();
        match rng.below(10) {
            0 => {
                model.remove(database);
                let work = StoreWork::Remove;
                requests.push(StoreRequest { number: 1, database: name(database), work });
            }
            1 => {
                *variables = (0..rng.below(9)).map(|key| (format!("k{key}"), number)).collect();
                let contents = variables.iter().map(|(key, number)| (key.as_str().into(), value(*number)));
                let work = StoreWork::Replace { about: about(false), contents: contents.collect() };
                requests.push(StoreRequest { number: 1, database: name(database), work });
            }
            2 | 3 => {
                variables.remove(&key);
                requests.push(change(database, &key, None));
            }
            _ => {
                variables.insert(key.clone(), number);
                requests.push(change(database, &key, Some(number)));
            }
        }
    }
    requests
}

/// One life of a store with power cuts; the last one falls into the middle of whatever is going on.
fn survive_power_cuts(seed: u64) {
    let mut rng = SimulatedRng::new(seed, 0);
    let failing = Failing::new(seed);
    let mut acknowledged = Model::new();
    for _life in 0..3 {
        failing.cut_after(None);
        let mut store = opened(failing.storage());
        assert_eq!(store.damage, None, "seed {seed}");
        assert_eq!(held(&mut store), acknowledged, "seed {seed}");
        failing.cut_after(Some(rng.below(60) as u32));
        loop {
            let mut wished = acknowledged.clone();
            let requests = group(&mut rng, &mut wished);
            let written = store.store.perform(requests).iter().all(|answer| answer.outcome.is_ok());
            if written {
                acknowledged = wished;
                continue;
            }
            // Not acknowledged: the whole of it may be there or nothing of it.
            drop(store);
            let mut after = opened(failing.storage());
            assert_eq!(after.damage, None, "seed {seed}: a power cut is no damage");
            let found = held(&mut after);
            assert!(found == acknowledged || found == wished, "seed {seed}: {found:?}");
            acknowledged = found;
            break;
        }
    }
}

#[test]
fn s103_what_was_acknowledged_survives_power_cuts_at_any_moment() {
    // More of them by hand: `SK_SEEDS=10000 cargo test -p specialk-core power_cuts`.
    let seeds = std::env::var("SK_SEEDS").ok().and_then(|seeds| seeds.parse().ok());
    for seed in 0..seeds.unwrap_or(400) {
        survive_power_cuts(seed);
    }
}

#[test]
fn a_power_cut_while_the_file_is_made_leaves_none_or_a_whole_one() {
    for cut in 0..40 {
        let failing = Failing::new(cut.into());
        failing.cut_after(Some(cut));
        let first = Store::open(failing.storage(), FILE_PATH.into());
        let done = first.is_ok();
        drop(first);
        failing.cut_after(None);
        let mut after = opened(failing.storage());
        assert_eq!(after.damage, None, "after {cut} changes");
        assert_eq!(held(&mut after), Model::new());
        if done {
            return;
        }
    }
    panic!("it was never made");
}

#[test]
fn a_full_disk_is_told_and_the_store_works_on_when_there_is_room_again() {
    for seed in 0..8 {
        let failing = Failing::new(seed);
        let mut store = opened(failing.storage());
        let length = failing.disk.read(Path::new(FILE_PATH), 1 << 30).expect("there").len() as u64;
        failing.room(length + seed * 40_960);
        let (mut stored, mut refused) = (Model::new(), 0);
        for index in 0..12 {
            let key = format!("k{index:02}");
            let contents: Contents =
                vec![(key.as_str().into(), Value::new(&"x".repeat(100_000).into()).expect("short"))];
            let work = StoreWork::Replace { about: about(true), contents };
            let database = name(&format!("d{index}"));
            let answers = store.store.perform(vec![StoreRequest { number: 3, database, work }]);
            match &answers[0].outcome {
                Ok(Stored::Written) => drop(stored.insert(format!("d{index}"), BTreeMap::new())),
                Ok(other) => panic!("{other:?}"),
                Err(failure) => {
                    assert!(!failure.0.is_empty());
                    refused += 1;
                }
            }
        }
        assert!(refused > 0, "the disk was never full");
        failing.room(u64::MAX);
        assert_eq!(store.store.perform(vec![change("after", "k", Some(1))])[0].outcome, Ok(Stored::Written));
        drop(store);
        let after = opened(failing.storage());
        assert_eq!(after.damage, None);
        let names: Vec<&str> = after.saved.iter().map(|(name, _)| name.as_str()).collect();
        for acknowledged in stored.keys() {
            assert!(names.contains(&acknowledged.as_str()), "{acknowledged} of {names:?}");
        }
    }
}

/// A file with something of everything in it, closed in an orderly way or left by a process that died.
fn a_used_file(orderly: bool) -> (Vec<u8>, Model) {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = opened(disk.clone());
    let mut rng = SimulatedRng::new(5, 5);
    let mut model = Model::new();
    for _ in 0..30 {
        let requests = group(&mut rng, &mut model);
        assert!(store.store.perform(requests).iter().all(|answer| answer.outcome.is_ok()));
    }
    if orderly {
        drop(store);
        return (disk.read(Path::new(FILE_PATH), 1 << 30).expect("there"), model);
    }
    disk.power_cut();
    (disk.read(Path::new(FILE_PATH), 1 << 30).expect("there"), model)
}

/// Opens a file that something has happened to: either nothing is missing, or the damage is told.
fn is_found(bytes: &[u8], model: &Model, what: &str) -> bool {
    let disk = Arc::new(SimulatedStorage::new());
    disk.create_dir(Path::new("/state")).expect("a folder");
    disk.replace(Path::new(FILE_PATH), bytes).expect("a file");
    let mut store = opened(disk.clone());
    if let Some(damage) = &store.damage {
        assert!(store.saved.is_empty(), "{what}: a damaged file is not used");
        assert_eq!(disk.read(&damage.set_aside, 1 << 30).expect("set aside").len(), bytes.len(), "{what}");
        return true;
    }
    assert_eq!(held(&mut store), *model, "{what}: not told");
    false
}

#[test]
fn every_turned_bit_that_matters_is_found() {
    for orderly in [true, false] {
        let (file, model) = a_used_file(orderly);
        let mut rng = SimulatedRng::new(9, 9);
        let mut found = 0;
        // The head of the file whole, and places by chance where something is written.
        let written: Vec<usize> = (0..file.len()).filter(|at| file[*at] != 0).collect();
        let mut places: Vec<usize> = (0..320).collect();
        places.extend((0..400).map(|_| written[rng.below(written.len() as u64) as usize]));
        for at in places {
            let bit = rng.below(8);
            let mut turned = file.clone();
            turned[at] ^= 1 << bit;
            found +=
                u32::from(is_found(&turned, &model, &format!("bit {bit} of byte {at}, orderly {orderly}")));
        }
        assert!(found > 100, "only {found} were of importance");
    }
}

#[test]
fn every_file_that_was_cut_is_found() {
    let (file, model) = a_used_file(true);
    let mut rng = SimulatedRng::new(10, 10);
    for length in [0, 1, 100, 512, 4096, file.len() - 1]
        .into_iter()
        .chain((0..100).map(|_| rng.below(file.len() as u64) as usize))
    {
        assert!(is_found(&file[..length], &model, &format!("cut to {length}")), "cut to {length}");
    }
}

#[test]
fn damaged_files_are_set_aside_one_beside_the_other_and_told_in_words() {
    let disk = Arc::new(SimulatedStorage::new());
    disk.create_dir(Path::new("/state")).expect("a folder");
    for number in 1..3 {
        disk.replace(Path::new(FILE_PATH), b"this is no store").expect("a file");
        let opened = opened(disk.clone());
        let damage = opened.damage.expect("found");
        assert_eq!(damage.set_aside, PathBuf::from(format!("{FILE_PATH}.damaged-{number}")));
        assert!(damage.to_string().contains("set aside as /state/databases.redb.damaged-"), "{damage}");
    }
}

/// Found by the simulation: the next start finds no file and no damage, so this one has to tell.
#[test]
fn a_start_that_fails_behind_a_damage_tells_the_damage() {
    let disk = Arc::new(SimulatedStorage::new());
    disk.create_dir(Path::new("/state")).expect("a folder");
    disk.replace(Path::new(FILE_PATH), b"this is no store").expect("a file");
    let faults = DiskFaults { sync_errors: 1024, ..DiskFaults::default() };
    disk.set_faults(faults, SimulatedRng::new(1, 1));
    let refused = Store::open(disk.clone(), FILE_PATH.into());
    let Err(error @ StoreError::NotBegun { .. }) = refused else { panic!("{refused:?}") };
    assert!(error.to_string().contains("databases.redb.damaged-1"), "{error}");
    disk.set_faults(DiskFaults::default(), SimulatedRng::new(1, 1));
    assert!(opened(disk).damage.is_none());
}

#[test]
fn a_file_of_another_format_is_left_alone() {
    let disk: Arc<dyn Storage> = Arc::new(SimulatedStorage::new());
    drop(opened(disk.clone()));
    {
        let engine = opening::open_engine(&disk, Path::new(FILE_PATH)).expect("good");
        let transaction = engine.begin_write().expect("alone");
        transaction
            .open_table(FILE)
            .expect("there")
            .insert("format", STORE_FORMAT + 1)
            .expect("room");
        transaction.commit().expect("the disk works");
    }
    for _ in 0..2 {
        let refused = Store::open(disk.clone(), FILE_PATH.into());
        let Err(error @ StoreError::Format { found: 2, .. }) = refused else { panic!("{refused:?}") };
        assert!(error.to_string().contains("format 2"), "{error}");
        assert_eq!(disk.list(Path::new("/state")).expect("a folder").len(), 1);
    }
}

#[test]
fn a_disk_that_fails_at_the_start_is_told_and_the_file_is_not_set_aside() {
    let failing = Failing::new(1);
    drop(opened(failing.storage()));
    failing.room(0);
    assert!(matches!(Store::open(failing.storage(), FILE_PATH.into()), Err(StoreError::Disk { .. })));
    assert_eq!(failing.disk.list(Path::new("/state")).expect("a folder").len(), 1);
}
