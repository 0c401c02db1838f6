//! What must hold of the files of blob channels, whatever paths and commands a peer sends. The fuzz target and the
//! test over the committed seeds include this file.

use sk_core::flow::blob::{BlobPath, BlobStore, PATH_PARTS_MAX};
use sk_core::flow::limits::{MAGIC, VERSION, VERSION_OLDEST};
use sk_core::flow::server::{ConnectionId, Origin, ServerCore, Settings};
use sk_core::flow::{Command, Flags, Form, Message, Properties, State};
use sk_core::world::{Found, SimulatedStorage, Storage};
use sk_flat::{Instant, SkVariant};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const UID: u32 = 1000;
const ROOT: &str = "/state/blobs";
const OUTSIDE: &str = "/state/secret";
/// The folder of the owner's channel.
const OWN: &str = "robot.store/";
const QUOTA_BYTES: u64 = 16 * 4096;
const SEEN_MAX: usize = 10_000;

/// The first byte says who sends the rest: the owner of the channel, or one who may read it. As a text the rest is
/// a path too.
pub fn commands(data: &[u8]) {
    let Some((who, bytes)) = data.split_first() else { return };
    a_path_is_safe_or_refused(&String::from_utf8_lossy(bytes));
    let mut robot = Robot::new();
    let (owner, reader) = (robot.flow(), robot.flow());
    robot.fill(owner);
    let before = robot.files();
    let sender = if who % 2 == 0 { owner } else { reader };
    let cut = bytes.len() / 2;
    for part in [&bytes[..cut], &bytes[cut..]] {
        robot.hub.receive(sender, part, Instant::ZERO);
        robot.settle();
    }
    let after = robot.files();
    let taken: usize = after.values().map(Vec::len).sum();
    assert!(taken as u64 <= QUOTA_BYTES, "{taken} bytes are beyond the quota");
    if sender == reader {
        let of_owner = |files: &BTreeMap<String, Vec<u8>>| {
            let own = files.iter().filter(|(path, _)| path.starts_with(OWN));
            own.map(|(path, whole)| (path.clone(), whole.clone())).collect::<Vec<_>>()
        };
        assert_eq!(of_owner(&before), of_owner(&after), "who is not the owner changes nothing");
        let lives = robot.hub.connection(owner).map(|(state, _)| state);
        assert_eq!(lives, Some(State::Flow), "nobody else is touched");
    }
    robot.nothing_outside_is_touched();
    robot.hub.left(sender, Instant::ZERO);
    robot.settle();
    assert_eq!(robot.hub.unanswered_blob_requests(), 0);
}

/// What is accepted stays below its folder.
fn a_path_is_safe_or_refused(text: &str) {
    let Ok(path) = BlobPath::parse_folder(text) else {
        assert!(!text.is_empty());
        return;
    };
    assert_eq!(path.as_str(), text);
    let names: Vec<&str> = text.split('/').filter(|_| !text.is_empty()).collect();
    assert!(names.len() == path.parts() && names.len() <= PATH_PARTS_MAX);
    for name in names {
        assert!(!matches!(name, "" | "." | ".."), "{text:?}");
        assert!(
            name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_.-".contains(&byte)),
            "{text:?}"
        );
    }
}

/// A hub with the files of its blob channels on a simulated disk.
struct Robot {
    hub: ServerCore,
    store: BlobStore,
    disk: Arc<SimulatedStorage>,
    connections: Vec<ConnectionId>,
}

impl Robot {
    fn new() -> Robot {
        let disk = Arc::new(SimulatedStorage::new());
        let works = "the disk works";
        disk.create_dir(Path::new("/state")).expect(works);
        disk.replace(Path::new(OUTSIDE), b"token").expect(works);
        let store = BlobStore::open(disk.clone(), ROOT.into()).expect(works).with_quota(QUOTA_BYTES);
        let settings = Settings { user: "robot".parse().expect("a name"), token: None, owner_uid: Some(UID) };
        let mut hub = ServerCore::new(settings, Instant::ZERO);
        hub.keep_blobs();
        Robot { hub, store, disk, connections: Vec::new() }
    }

    fn flow(&mut self) -> ConnectionId {
        let id = self
            .hub
            .open(Origin::Unix { uid: UID }, [1; 32], Instant::ZERO)
            .expect("a place");
        let (version, version_oldest, nonce) = (VERSION, VERSION_OLDEST, [0; 32]);
        let (magic, fragment_bytes, message_bytes) = (MAGIC, 1024, 1 << 20);
        self.connections.push(id);
        for command in [
            Command::Hello { magic, version, version_oldest, fragment_bytes, message_bytes, nonce },
            Command::LoginPeer {},
            Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Binary },
        ] {
            self.send(id, &command);
        }
        id
    }

    /// The owner's channel is the first one of all, and has the file `maps/floor-1.png`.
    fn fill(&mut self, owner: ConnectionId) {
        let properties = Properties::new(&SkVariant::map::<&str>([])).expect("they are none");
        self.send(owner, &Command::CreateBlob { name: "store".to_owned(), properties });
        let channel = self.hub.channels().next().expect("it was made").0.reference;
        let path = |text: &str| sk_core::flow::Path(text.to_owned());
        let at = || path("maps/floor-1.png");
        self.send(owner, &Command::BlobMkdir { channel, path: path("maps") });
        self.send(owner, &Command::BlobBegin { channel, path: at(), bytes: 5, checksum: 0x3610_a686 });
        let payload = bytes::Bytes::from_static(b"hello");
        let piece = Command::BlobWrite { channel, path: at(), offset: 0, payload };
        self.hub.receive(owner, &piece.encode(1, Flags::WHOLE).to_vec(), Instant::ZERO);
        self.send(owner, &Command::BlobCommit { channel, path: at() });
        assert_eq!(self.files().values().next().map(Vec::as_slice), Some(&b"hello"[..]));
    }

    fn send(&mut self, id: ConnectionId, command: &Command) {
        self.hub.receive(id, &command.encode(1, Flags::NONE).to_vec(), Instant::ZERO);
        self.settle();
    }

    /// Until hub, disk and those who read what they are sent have nothing left to do.
    fn settle(&mut self) {
        for _ in 0..SEEN_MAX {
            let mut idle = true;
            while self.hub.work(Instant::ZERO) {}
            while let Some(request) = self.hub.next_blob_request() {
                self.store.take(request);
            }
            while let Some(answer) = self.store.step() {
                self.hub.blob_done(answer, Instant::ZERO);
                idle = false;
            }
            for id in self.connections.clone() {
                while self.hub.has_output(id) && self.hub.take(id).is_some() {
                    idle = false;
                }
            }
            while self.hub.next_notice().is_some() {}
            if idle && !self.hub.has_blob_requests() && !self.hub.has_work() {
                return;
            }
        }
        let (requests, work) = (self.hub.has_blob_requests(), self.hub.has_work());
        panic!("hub and disk do not come to rest: requests {requests}, work {work}");
    }

    /// All files below the hub's folder, with what is in them. Every name there is a safe one.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let root = self.disk.folder(Path::new(ROOT)).expect("it was made");
        let mut files = BTreeMap::new();
        let mut folders = vec![String::new()];
        while let Some(folder) = folders.pop() {
            for name in root.list(Path::new(&folder)).expect("it is a folder") {
                let path = if folder.is_empty() { name.clone() } else { format!("{folder}/{name}") };
                assert!(files.len() < SEEN_MAX && !matches!(name.as_str(), "" | "." | ".."), "{path:?}");
                match root.look(Path::new(&path)).expect("it was listed") {
                    Found::Folder => folders.push(path),
                    Found::File { .. } => {
                        let whole = self.disk.read(&Path::new(ROOT).join(&path), QUOTA_BYTES);
                        files.insert(path, whole.expect("it is within the quota"));
                    }
                    Found::Other => panic!("{path} is neither file nor folder"),
                }
            }
        }
        files
    }

    fn nothing_outside_is_touched(&self) {
        let told = self.disk.read(Path::new(OUTSIDE), 100).expect("it is there");
        assert_eq!(told, b"token");
        let names = self.disk.list(Path::new("/state")).expect("it is a folder");
        assert_eq!(names, ["blobs", "secret"].map(PathBuf::from));
    }
}
