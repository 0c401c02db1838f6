//! The rules of the files: nothing half is seen, nothing outside is touched, nothing is taken beyond the quota.

use super::*;
use crate::world::{DiskFaults, RealStorage, Rng, SimulatedRng, SimulatedStorage};
use bytes::Bytes;
use proptest::prelude::*;
use std::fs;
use std::os::unix::fs::symlink;

fn name(text: &str) -> Name {
    text.parse().expect("a name")
}

fn path(text: &str) -> BlobPath {
    BlobPath::parse_folder(text).expect("a path")
}

fn maps() -> Name {
    name("robot.maps")
}

fn store(disk: &Arc<SimulatedStorage>) -> BlobStore {
    BlobStore::open(disk.clone(), "/state/blobs".into()).expect("the disk works")
}

/// Bytes that differ from place to place.
fn content(length: usize, seed: u64) -> Bytes {
    let mut bytes = vec![0; length];
    SimulatedRng::new(seed, 7).fill(&mut bytes);
    bytes.into()
}

impl BlobStore {
    fn ask(&mut self, work: BlobWork) -> Outcome {
        self.ask_of("robot.maps", work)
    }

    fn ask_of(&mut self, channel: &str, work: BlobWork) -> Outcome {
        self.take(BlobRequest { number: 1, channel: name(channel), work });
        self.step().expect("an answer").outcome
    }

    fn begin_of(&mut self, at: &str, content: &[u8]) -> Outcome {
        let (bytes, checksum) = (content.len() as u64, crc32fast::hash(content));
        self.ask(BlobWork::Begin { path: path(at), bytes, checksum })
    }

    fn write_of(&mut self, at: &str, offset: usize, content: &Bytes) -> Outcome {
        let pieces = [content.slice(offset..)].into_iter().collect();
        self.ask(BlobWork::Write { path: path(at), offset: offset as u64, pieces })
    }

    /// A whole upload.
    fn upload(&mut self, at: &str, content: &Bytes) -> Outcome {
        let offset = resumed(self.begin_of(at, content))?;
        if offset < content.len() {
            self.write_of(at, offset, content)?;
        }
        self.ask(BlobWork::Commit { path: path(at) })
    }

    fn contents(&mut self, at: &str) -> Option<Bytes> {
        let read = BlobWork::Read { path: path(at), file: None, offset: 0, bytes: 1 << 20 };
        match self.ask(read) {
            Ok(BlobDone::Data { bytes, .. }) => Some(bytes),
            _ => None,
        }
    }

    fn names(&mut self, at: &str) -> Vec<String> {
        match self.ask(BlobWork::List { path: path(at), after: None }) {
            Ok(BlobDone::Entries { entries, .. }) => entries.into_iter().map(|entry| entry.name).collect(),
            other => panic!("no entries, but {other:?}"),
        }
    }
}

fn resumed(outcome: Outcome) -> Result<usize, BlobFailure> {
    match outcome? {
        BlobDone::Resume { offset } => Ok(offset as usize),
        other => panic!("no offset, but {other:?}"),
    }
}

fn refused(outcome: Outcome) -> RefusalCode {
    match outcome {
        Err(BlobFailure::Refused(code)) => code,
        other => panic!("not refused, but {other:?}"),
    }
}

fn make_folder(at: &str) -> BlobWork {
    BlobWork::MakeFolder { path: path(at) }
}

fn remove(at: &str) -> BlobWork {
    BlobWork::Remove { path: path(at) }
}

fn move_to(from: &str, to: &str) -> BlobWork {
    BlobWork::Move { from: path(from), to: path(to) }
}

#[test]
fn an_upload_is_seen_when_it_is_committed_and_not_before() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk);
    let (old, new) = (content(100, 1), content(5000, 2));
    assert!(matches!(store.upload("floor.png", &old), Ok(BlobDone::Saved)));
    assert!(matches!(store.begin_of("floor.png", &new), Ok(BlobDone::Resume { offset: 0 })));
    assert!(matches!(store.write_of("floor.png", 0, &new.slice(..4000)), Ok(BlobDone::Done)));
    assert_eq!(store.contents("floor.png"), Some(old.clone()), "half of the new one is there");
    assert_eq!(refused(store.ask(BlobWork::Commit { path: path("floor.png") })), RefusalCode::BadChecksum);
    assert!(matches!(store.write_of("floor.png", 4000, &new), Ok(BlobDone::Done)));
    assert!(matches!(store.ask(BlobWork::Commit { path: path("floor.png") }), Ok(BlobDone::Saved)));
    assert_eq!(store.contents("floor.png"), Some(new));
    assert_eq!(store.names(""), ["floor.png"]);
}

#[test]
fn a_piece_at_the_wrong_place_or_beyond_the_end_is_refused_and_nothing_changed() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk);
    let new = content(1000, 2);
    assert_eq!(refused(store.write_of("a", 0, &new)), RefusalCode::BadOffset, "nothing was begun");
    assert_eq!(refused(store.ask(BlobWork::Commit { path: path("a") })), RefusalCode::BadOffset);
    store.begin_of("a", &new).expect("begun");
    assert_eq!(refused(store.write_of("a", 1, &new)), RefusalCode::BadOffset);
    let longer = content(1001, 2);
    assert_eq!(refused(store.write_of("a", 0, &longer)), RefusalCode::BadChecksum);
    store.write_of("a", 0, &new).expect("written");
    assert_eq!(refused(store.write_of("a", 0, &new)), RefusalCode::BadOffset, "a second time");
    assert!(matches!(store.ask(BlobWork::Commit { path: path("a") }), Ok(BlobDone::Saved)));
}

#[test]
fn other_bytes_than_announced_never_become_a_file() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk);
    store.begin_of("a", &content(1000, 2)).expect("begun");
    store.write_of("a", 0, &content(1000, 3)).expect("written");
    assert_eq!(refused(store.ask(BlobWork::Commit { path: path("a") })), RefusalCode::BadChecksum);
    assert_eq!(store.names(""), [""; 0]);
    assert!(
        matches!(store.begin_of("a", &content(1000, 2)), Ok(BlobDone::Resume { offset: 0 })),
        "forgotten"
    );
}

#[test]
fn an_upload_goes_on_where_it_was_while_the_channel_or_the_hub_was_gone() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store_now = store(&disk);
    let new = content(700_000, 4);
    store_now.begin_of("a", &new).expect("begun");
    for start in (0..500_000).step_by(100_000) {
        store_now.write_of("a", start, &new.slice(..start + 100_000)).expect("written");
    }
    assert_eq!(resumed(store_now.begin_of("a", &new)), Ok(500_000), "the same connection");
    store_now.ask(BlobWork::Close).expect("closed");
    assert_eq!(resumed(store_now.begin_of("a", &new)), Ok(500_000), "the channel has come back");
    drop(store_now);
    let mut later = store(&disk);
    assert_eq!(resumed(later.begin_of("a", &new)), Ok(500_000), "the hub has come back");
    assert!(matches!(later.upload("a", &new), Ok(BlobDone::Saved)));
    assert_eq!(later.contents("a"), Some(new.clone()));
    assert_eq!(resumed(later.begin_of("a", &new)), Ok(0), "what was committed is over");
    let other = content(700_001, 4);
    later.write_of("a", 0, &new).expect("written");
    assert_eq!(resumed(later.begin_of("a", &other)), Ok(0), "another file at the same path begins anew");
}

#[test]
fn folders_are_made_moved_listed_and_removed() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk);
    assert_eq!(store.names(""), [""; 0], "a channel without anything");
    assert_eq!(refused(store.ask(make_folder("a/b"))), RefusalCode::NoSuchPath);
    store.ask(make_folder("a")).expect("made");
    assert_eq!(refused(store.ask(make_folder("a"))), RefusalCode::WrongPath);
    store.ask(make_folder("a/b")).expect("made");
    let file = content(10, 1);
    store.upload("a/b/f", &file).expect("saved");
    assert_eq!(refused(store.ask(make_folder("a/b/f/x"))), RefusalCode::WrongPath);
    assert_eq!(refused(store.begin_of("a/b/f/x", &file)), RefusalCode::WrongPath);
    assert_eq!(refused(store.begin_of("a/b", &file)), RefusalCode::WrongPath);
    assert_eq!(refused(store.begin_of("none/f", &file)), RefusalCode::NoSuchPath);
    assert_eq!(refused(store.ask(remove("a"))), RefusalCode::NotEmpty);
    assert_eq!(refused(store.ask(move_to("a", "a/b/c"))), RefusalCode::WrongPath, "into itself");
    assert_eq!(refused(store.ask(move_to("a/b/f", "a"))), RefusalCode::WrongPath);
    assert_eq!(refused(store.ask(move_to("a", "a/b/f"))), RefusalCode::WrongPath);
    assert_eq!(refused(store.ask(move_to("gone", "x"))), RefusalCode::NoSuchPath);
    store.ask(move_to("a/b", "c")).expect("moved");
    assert_eq!(store.contents("c/f"), Some(file.clone()));
    store.upload("g", &content(20, 2)).expect("saved");
    store.ask(move_to("c/f", "g")).expect("in place of a file");
    assert_eq!(store.contents("g"), Some(file));
    for gone in ["c", "a", "g"] {
        assert!(matches!(store.ask(remove(gone)), Ok(BlobDone::Saved)), "{gone}");
    }
    assert_eq!(store.names(""), [""; 0]);
    assert_eq!(refused(store.ask(remove("g"))), RefusalCode::NoSuchPath);
    assert_eq!(store.count("robot").ok(), Some(quota::FOLDER_CHARGE), "all but the channel's own folder");
}

#[test]
fn a_folder_is_not_moved_to_where_its_files_would_have_no_path() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk);
    let deep = |parts: usize| vec!["d"; parts].join("/");
    for parts in 1..=14 {
        store.ask(make_folder(&deep(parts))).expect("made");
    }
    store.ask(make_folder("t")).expect("made");
    store.ask(make_folder("t/u")).expect("made");
    store.ask(move_to("t", &deep(15))).expect("its entry is the sixteenth part");
    store.ask(make_folder("t")).expect("made");
    store.ask(make_folder("t/u")).expect("made");
    assert_eq!(refused(store.ask(move_to("t", &format!("{}/e", deep(15))))), RefusalCode::BadPath);
}

#[test]
fn a_long_folder_is_listed_in_parts_without_gap_or_repetition() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk);
    let count = tree::ENTRIES_PER_ANSWER * 2 + 3;
    for index in 0..count {
        store.ask(make_folder(&format!("f{index}"))).expect("made");
    }
    let (mut all, mut after) = (Vec::new(), None);
    loop {
        match store.ask(BlobWork::List { path: path(""), after: after.take() }) {
            Ok(BlobDone::Entries { entries, end }) => {
                all.extend(entries.into_iter().map(|entry| entry.name));
                if end {
                    break;
                }
            }
            other => panic!("no entries, but {other:?}"),
        }
        after = all.last().cloned();
    }
    assert_eq!(all.len(), count);
    assert!(all.is_sorted() && all.windows(2).all(|pair| pair[0] != pair[1]));
}

#[test]
fn the_quota_is_one_account_s_and_counted_exactly() {
    let disk = Arc::new(SimulatedStorage::new());
    // A folder for the channel and three blocks.
    let mut store = store(&disk).with_quota(4 * 4096);
    for (length, fits) in [(2 * 4096, true), (4096, true), (1, false)] {
        let at = format!("f{length}");
        assert_eq!(store.upload(&at, &content(length, 1)).is_ok(), fits, "{length} bytes");
    }
    assert_eq!(refused(store.begin_of("g", b"x")), RefusalCode::Quota);
    assert_eq!(refused(store.ask(make_folder("d"))), RefusalCode::Quota, "folders count too");
    let elsewhere = BlobWork::MakeFolder { path: path("d") };
    assert_eq!(refused(store.ask_of("robot.other", elsewhere.clone())), RefusalCode::Quota, "one account");
    assert!(store.ask_of("nao.maps", elsewhere).is_ok(), "another account");
    store.ask(remove("f4096")).expect("removed");
    assert!(store.upload("g", &content(1, 1)).is_ok(), "there is room again");
    assert_eq!(refused(store.begin_of("h", &[0; 5 * 4096])), RefusalCode::Quota, "more than all");
}

#[test]
fn an_upload_that_was_left_gives_way_when_the_room_is_needed() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store = store(&disk).with_quota(5 * 4096);
    let big = content(4 * 4096, 1);
    store.begin_of("a", &big).expect("begun");
    store.write_of("a", 0, &big.slice(..3 * 4096)).expect("written");
    assert_eq!(refused(store.begin_of("b", &big)), RefusalCode::Quota, "it is under way");
    store.ask(BlobWork::Close).expect("closed");
    assert!(matches!(store.upload("b", &big), Ok(BlobDone::Saved)));
    assert_eq!(store.count("robot").ok(), Some(5 * 4096));
}

#[test]
fn a_look_tells_the_checksum_of_what_is_there_now() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store_now = store(&disk);
    let (first, second) = (content(9_000_000, 1), content(9_000_000, 2));
    let look = |store: &mut BlobStore, at: &str| match store.ask(BlobWork::Look { path: path(at) }) {
        Ok(BlobDone::Entry { entry, checksum }) => (entry.is_folder, entry.bytes, checksum),
        other => panic!("no entry, but {other:?}"),
    };
    store_now.upload("a", &first).expect("saved");
    assert_eq!(look(&mut store_now, "a"), (false, 9_000_000, crc32fast::hash(&first)));
    assert_eq!(look(&mut store(&disk), "a"), (false, 9_000_000, crc32fast::hash(&first)), "read through");
    store_now.upload("b", &second).expect("saved");
    store_now.ask(move_to("b", "a")).expect("moved");
    assert_eq!(look(&mut store_now, "a").2, crc32fast::hash(&second));
    assert_eq!(look(&mut store_now, ""), (true, 0, 0));
}

#[test]
fn channels_take_turns_and_each_keeps_its_order() {
    let disk = Arc::new(SimulatedStorage::new());
    let mut store_now = store(&disk);
    store_now.upload("big", &content(20_000_000, 1)).expect("saved");
    let mut store = store(&disk);
    let request = |number, channel: &str, work| BlobRequest { number, channel: name(channel), work };
    store.take(request(1, "robot.maps", BlobWork::Look { path: path("big") }));
    store.take(request(2, "robot.maps", make_folder("after")));
    store.take(request(3, "robot.other", make_folder("light")));
    let order: Vec<u64> = std::iter::from_fn(|| store.step()).map(|answer| answer.number).collect();
    assert_eq!(order, [3, 1, 2]);
    assert!(store.is_idle());
}

/// A folder of the machine's that goes when the test is over.
struct Place(PathBuf);

impl Place {
    fn new(test: &str) -> Place {
        let place = std::env::temp_dir().join(format!("sk-blobs-{test}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&place);
        fs::create_dir_all(&place).expect("a folder for the test");
        Place(place)
    }

    fn store(&self) -> BlobStore {
        BlobStore::open(Arc::new(RealStorage::new()), self.0.join("blobs")).expect("opened")
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn links_and_special_files_that_somebody_planted_are_neither_followed_nor_opened() {
    let place = Place::new("planted");
    let mut store = place.store();
    let secret = place.0.join("secret");
    fs::write(&secret, "outside").expect("written");
    fs::create_dir(place.0.join("elsewhere")).expect("made");
    store.ask(make_folder("d")).expect("made");
    let files = place.0.join("blobs/robot.maps/files");
    symlink(&secret, files.join("link")).expect("planted");
    symlink(place.0.join("elsewhere"), files.join("away")).expect("planted");
    symlink("d", files.join("near")).expect("planted");
    nix::unistd::mkfifo(&files.join("pipe"), nix::sys::stat::Mode::S_IRWXU).expect("planted");
    let file = content(10, 1);
    for strange in ["link", "pipe", "away", "near"] {
        assert_eq!(store.contents(strange), None, "{strange}");
        assert_eq!(refused(store.ask(BlobWork::Look { path: path(strange) })), RefusalCode::NoSuchPath);
        assert_eq!(refused(store.begin_of(strange, &file)), RefusalCode::WrongPath, "{strange}");
        assert_eq!(refused(store.ask(move_to(strange, "moved"))), RefusalCode::NoSuchPath, "{strange}");
    }
    for below in ["away/x", "near/x", "link/x"] {
        assert_eq!(refused(store.begin_of(below, &file)), RefusalCode::WrongPath, "{below}");
        assert_eq!(refused(store.ask(make_folder(below))), RefusalCode::WrongPath, "{below}");
        assert_eq!(refused(store.ask(remove(below))), RefusalCode::WrongPath, "{below}");
        assert_eq!(refused(store.ask(move_to("d", below))), RefusalCode::WrongPath, "{below}");
    }
    assert_eq!(store.names(""), ["d"]);
    assert_eq!(
        refused(store.ask(BlobWork::List { path: path("away"), after: None })),
        RefusalCode::WrongPath
    );
    store.ask(remove("link")).expect("the link goes, not what it points to");
    assert_eq!(fs::read_to_string(&secret).expect("there"), "outside");
    assert_eq!(fs::read_dir(place.0.join("elsewhere")).expect("there").count(), 0);
}

#[test]
fn a_link_in_place_of_a_channel_s_own_folders_leads_nowhere() {
    let place = Place::new("roots");
    let elsewhere = place.0.join("elsewhere");
    fs::create_dir_all(elsewhere.join("files")).expect("made");
    fs::create_dir_all(elsewhere.join("parts")).expect("made");
    let mut store = place.store();
    symlink(&elsewhere, place.0.join("blobs/robot.maps")).expect("planted");
    assert!(matches!(store.ask(make_folder("d")), Err(BlobFailure::Disk(_))));
    assert!(matches!(store.upload("f", &content(10, 1)), Err(BlobFailure::Disk(_))));
    assert_eq!(fs::read_dir(elsewhere.join("files")).expect("there").count(), 0);
    symlink(&elsewhere, place.0.join("linked")).expect("planted");
    assert!(BlobStore::open(Arc::new(RealStorage::new()), place.0.join("linked")).is_err());
}

#[test]
fn a_real_disk_keeps_what_a_simulated_one_does() {
    let place = Place::new("real");
    let mut store = place.store();
    let new = content(700_000, 4);
    store.ask(make_folder("d")).expect("made");
    store.begin_of("d/f", &new).expect("begun");
    store.write_of("d/f", 0, &new.slice(..300_000)).expect("written");
    drop(store);
    let mut store = place.store();
    assert_eq!(resumed(store.begin_of("d/f", &new)), Ok(300_000));
    assert!(matches!(store.upload("d/f", &new), Ok(BlobDone::Saved)));
    assert_eq!(store.contents("d/f"), Some(new.clone()));
    store.ask(move_to("d/f", "g")).expect("moved");
    store.ask(remove("d")).expect("removed");
    assert_eq!(store.names(""), ["g"]);
    let on_disk = place.0.join("blobs/robot.maps");
    assert_eq!(fs::read(on_disk.join("files/g")).expect("there"), new);
    assert_eq!(fs::read_dir(on_disk.join("parts")).expect("there").count(), 0, "nothing is left over");
}

#[test]
fn a_download_goes_on_with_the_file_that_it_began_with() {
    let place = Place::new("replaced");
    let mut store = place.store();
    let (old, new) = (content(1000, 1), content(1000, 2));
    store.upload("f", &old).expect("saved");
    let first = store.ask(BlobWork::Read { path: path("f"), file: None, offset: 0, bytes: 500 });
    let Ok(BlobDone::Data { bytes, file }) = first else { panic!("no data, but {first:?}") };
    assert_eq!(bytes, old[..500]);
    store.upload("f", &new).expect("saved");
    let second = store.ask(BlobWork::Read { path: path("f"), file: Some(file), offset: 500, bytes: 600 });
    let Ok(BlobDone::Data { bytes, .. }) = second else { panic!("no data, but {second:?}") };
    assert_eq!(bytes, old[500..]);
}

/// Runs until the disk gives out, then with a power cut, and checks what came back. Answers whether the new file was
/// said to be saved.
fn one_life(seed: u64) -> bool {
    let disk = Arc::new(SimulatedStorage::new());
    let mut rng = SimulatedRng::new(seed, 1);
    let (old, new) = (content(40_000, seed), content(200_000, seed + 1));
    store(&disk).upload("f", &old).expect("nothing is wrong yet");
    let faults = DiskFaults { sync_errors: (seed % 3) as u16 * 100, ..DiskFaults::default() };
    disk.set_faults(faults, SimulatedRng::new(seed, 2));
    disk.give_out_after(rng.below(30));
    let process: Arc<dyn Storage> = Arc::new(disk.for_process());
    let mut saved = false;
    if let Ok(mut store) = BlobStore::open(process, "/state/blobs".into())
        && let Ok(mut offset) = resumed(store.begin_of("f", &new))
    {
        while offset < new.len() {
            let end = (offset + 1 + rng.below(90_000) as usize).min(new.len());
            if store.write_of("f", offset, &new.slice(..end)).is_err() {
                break;
            }
            offset = end;
        }
        saved = offset == new.len() && store.ask(BlobWork::Commit { path: path("f") }).is_ok();
    }
    disk.power_cut_by_chance(&mut rng);
    disk.set_faults(DiskFaults::default(), SimulatedRng::new(seed, 3));
    let mut after = store(&disk);
    let there = after.contents("f").expect("the old file or the new one");
    assert!(
        there == new || !saved && there == old,
        "seed {seed}: saved {saved}, {} bytes",
        there.len()
    );
    assert_eq!(after.names(""), ["f"], "seed {seed}");
    assert!(
        matches!(after.upload("f", &new), Ok(BlobDone::Saved)),
        "seed {seed}: resumed and finished"
    );
    assert_eq!(after.contents("f"), Some(new), "seed {seed}");
    saved
}

#[test]
fn whatever_a_power_cut_leaves_a_file_is_the_old_one_or_the_new_one_and_the_upload_can_be_finished() {
    let saved = (0..400).filter(|seed| one_life(*seed)).count();
    assert!((50..350).contains(&saved), "{saved} of 400 were saved before the cut: both must happen");
}

#[derive(Clone, Debug)]
enum Deed {
    Upload(u8, u16),
    Half(u8, u16),
    Folder(u8),
    Move(u8, u8),
    Remove(u8),
    Close,
    Restart,
}

fn deeds() -> impl Strategy<Value = Vec<Deed>> {
    let one = prop_oneof![
        (any::<u8>(), any::<u16>()).prop_map(|(at, length)| Deed::Upload(at, length)),
        (any::<u8>(), any::<u16>()).prop_map(|(at, length)| Deed::Half(at, length)),
        any::<u8>().prop_map(Deed::Folder),
        (any::<u8>(), any::<u8>()).prop_map(|(from, to)| Deed::Move(from, to)),
        any::<u8>().prop_map(Deed::Remove),
        Just(Deed::Close),
        Just(Deed::Restart),
    ];
    prop::collection::vec(one, 0..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_counted_as_used_is_what_is_there(deeds in deeds(), faults in any::<bool>()) {
        const PATHS: [&str; 6] = ["a", "b", "a/b", "a/c", "b/a", "a/b/c"];
        let at = |index: u8| PATHS[index as usize % PATHS.len()];
        let disk = Arc::new(SimulatedStorage::new());
        let quota = 300_000;
        let mut store_now = store(&disk).with_quota(quota);
        if faults {
            let some = DiskFaults { write_errors: 60, sync_errors: 60, read_errors: 30, bytes_max: Some(250_000) };
            disk.set_faults(some, SimulatedRng::new(5, 5));
        }
        for deed in deeds {
            // Each may be refused: that is not what this is about.
            let _ = match deed {
                Deed::Upload(index, length) => store_now.upload(at(index), &content(length.into(), 3)),
                Deed::Half(index, length) => {
                    let whole = content(usize::from(length) + 10, 4);
                    store_now
                        .begin_of(at(index), &whole)
                        .and_then(|_| store_now.write_of(at(index), 0, &whole.slice(..usize::from(length) / 2)))
                }
                Deed::Folder(index) => store_now.ask(make_folder(at(index))),
                Deed::Move(from, to) => store_now.ask(move_to(at(from), at(to))),
                Deed::Remove(index) => store_now.ask(remove(at(index))),
                Deed::Close => store_now.ask(BlobWork::Close),
                Deed::Restart => {
                    store_now = match BlobStore::open(disk.clone(), "/state/blobs".into()) {
                        Ok(opened) => opened.with_quota(quota),
                        Err(_) => continue,
                    };
                    Ok(BlobDone::Done)
                }
            };
        }
        disk.set_faults(DiskFaults::default(), SimulatedRng::new(1, 1));
        let counted = store_now.count("robot").expect("the disk works");
        prop_assert!(counted <= quota, "{counted} bytes are beyond the quota");
        prop_assert!(store_now.charge(&maps(), 0, 0).is_ok());
        let free = quota - counted;
        prop_assert!(matches!(store_now.charge(&maps(), free, 0), Ok(true)), "there should be {free} left");
        prop_assert!(matches!(store_now.charge(&maps(), 1, 0), Ok(false)), "there is nothing left");
    }
}
