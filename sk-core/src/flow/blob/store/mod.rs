//! The files of all blob channels of a hub, below one folder of its disk.
//!
//! A channel has a folder of its own name there, with the folders `files` and `parts`. An upload grows in `parts`
//! and is renamed into `files` when it is whole, checked and on the disk, so that no half file is ever seen.

mod checking;
mod paths;
mod quota;
#[cfg(test)]
mod tests;
mod tree;
mod uploads;

use super::super::error::RefusalCode;
use super::path::BlobPath;
use super::request::{BlobAnswer, BlobDone, BlobEntry, BlobFailure, BlobRequest, BlobWork};
use crate::world::{Found, Storage, StoredFolder};
use checking::{Resuming, Summing};
use quota::Quota;
use sk_flat::Name;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use uploads::Upload;

/// What the files of one account's blob channels may take together.
pub const QUOTA_BYTES_DEFAULT: u64 = 1024 * 1024 * 1024;
/// How many checksums are remembered, so that a file is not read through each time that somebody asks.
const CHECKSUMS_KEPT_MAX: usize = 4_096;

type Outcome = Result<BlobDone, BlobFailure>;
/// A file of a channel.
type Place = (Name, BlobPath);

/// The files of a hub's blob channels. It may block, so it is used on a worker: requests go in with
/// [`take`](BlobStore::take), and each [`step`](BlobStore::step) does a bounded piece of work. Channels take turns;
/// the requests of one channel are done in their order.
///
/// ```
/// use sk_core::flow::blob::{BlobDone, BlobPath, BlobRequest, BlobStore, BlobWork};
/// use sk_core::world::SimulatedStorage;
/// use std::sync::Arc;
///
/// let disk = Arc::new(SimulatedStorage::new());
/// let mut store = BlobStore::open(disk.clone(), "/blobs".into())?;
/// let path = BlobPath::parse("hello.txt").expect("a path");
/// let works = [
///     BlobWork::Begin { path: path.clone(), bytes: 5, checksum: 0x3610_a686 },
///     BlobWork::Write { path: path.clone(), offset: 0, pieces: vec!["hello".into()].into() },
///     BlobWork::Commit { path },
/// ];
/// for (number, work) in (1..).zip(works) {
///     store.take(BlobRequest { number, channel: "robot.notes".parse()?, work });
/// }
/// let outcomes: Vec<_> = std::iter::from_fn(|| store.step()).map(|answer| answer.outcome).collect();
/// assert!(matches!(outcomes[..], [Ok(BlobDone::Resume { offset: 0 }), Ok(BlobDone::Done), Ok(BlobDone::Saved)]));
/// disk.power_cut(); // what was said to be saved is
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct BlobStore {
    folder: Arc<dyn StoredFolder>,
    quota: Quota,
    uploads: BTreeMap<Place, Upload>,
    checksums: BTreeMap<Place, (u64, u32)>,
    queues: BTreeMap<Name, VecDeque<Pending>>,
    /// Channels with something to do, in turn.
    turns: VecDeque<Name>,
    /// The request that is being done.
    current: Option<u64>,
}

/// A request that waits, or is half done.
struct Pending {
    number: u64,
    work: BlobWork,
    progress: Progress,
}

/// How far a request of many steps has come.
enum Progress {
    Begun,
    Resuming(Box<Resuming>),
    Summing(Box<Summing>),
}

/// What one step led to.
enum Step {
    More(Progress),
    Over(BlobDone),
}

impl fmt::Debug for BlobStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BlobStore")
            .field("uploads", &self.uploads.len())
            .field("busy", &self.turns.len())
            .finish_non_exhaustive()
    }
}

impl BlobStore {
    /// The files below this folder, which is made if it is missing.
    ///
    /// # Errors
    /// If it cannot be opened, or is no folder but a link to one.
    pub fn open(storage: Arc<dyn Storage>, root: PathBuf) -> io::Result<BlobStore> {
        storage.create_dir(&root)?;
        Ok(BlobStore {
            folder: storage.folder(&root)?,
            quota: Quota::new(QUOTA_BYTES_DEFAULT),
            uploads: BTreeMap::new(),
            checksums: BTreeMap::new(),
            queues: BTreeMap::new(),
            turns: VecDeque::new(),
            current: None,
        })
    }

    /// The same with another limit for what the files of one account take together.
    pub fn with_quota(mut self, bytes_max: u64) -> BlobStore {
        self.quota = Quota::new(bytes_max);
        self
    }

    /// Takes a request, to be done after those that it has of this channel.
    pub fn take(&mut self, request: BlobRequest) {
        let BlobRequest { number, channel, work } = request;
        let queue = self.queues.entry(channel.clone()).or_default();
        if queue.is_empty() {
            self.turns.push_back(channel);
        }
        queue.push_back(Pending { number, work, progress: Progress::Begun });
    }

    /// Whether everything is done.
    pub fn is_idle(&self) -> bool {
        self.turns.is_empty()
    }

    /// Works until a request is answered; `None` if there is none. Between two steps of a long one other channels
    /// have their turn.
    pub fn step(&mut self) -> Option<BlobAnswer> {
        loop {
            if let Some(answer) = self.step_once()? {
                return Some(answer);
            }
        }
    }

    /// Does one bounded piece of work: `None` if nothing is to be done, else the answer if there is one.
    pub fn step_once(&mut self) -> Option<Option<BlobAnswer>> {
        let channel = self.turns.pop_front()?;
        let mut pending = self.queues.get_mut(&channel)?.pop_front()?;
        self.current = Some(pending.number);
        let stepped = self.perform(&channel, &mut pending);
        self.current = None;
        let number = pending.number;
        let outcome = match stepped {
            Ok(Step::More(progress)) => {
                pending.progress = progress;
                self.queues.entry(channel.clone()).or_default().push_front(pending);
                None
            }
            Ok(Step::Over(done)) => Some(Ok(done)),
            Err(failure) => {
                if let BlobFailure::Disk(_) = failure {
                    // What the disk did is not known, so what the files take is counted anew.
                    self.quota.forget(&channel);
                }
                Some(Err(failure))
            }
        };
        if self.queues.get(&channel).is_some_and(VecDeque::is_empty) {
            self.queues.remove(&channel);
        } else {
            self.turns.push_back(channel);
        }
        Some(outcome.map(|outcome| BlobAnswer { number, outcome }))
    }

    /// To be called after a panic in a step: the answer to the request that was being done, and the way on for the
    /// others.
    pub fn recover(&mut self) -> Option<BlobAnswer> {
        self.turns = self.queues.keys().cloned().collect();
        self.queues.retain(|_, queue| !queue.is_empty());
        self.turns.retain(|channel| self.queues.contains_key(channel));
        let number = self.current.take()?;
        Some(BlobAnswer { number, outcome: Err(BlobFailure::Disk("the store panicked".to_owned())) })
    }

    fn perform(&mut self, channel: &Name, pending: &mut Pending) -> Result<Step, BlobFailure> {
        match std::mem::replace(&mut pending.progress, Progress::Begun) {
            Progress::Begun => {}
            Progress::Resuming(resuming) => return self.go_on_resuming(channel, resuming),
            Progress::Summing(summing) => return self.go_on_summing(channel, summing),
        }
        let done = match &mut pending.work {
            BlobWork::Begin { path, bytes, checksum } => {
                return self.begin(channel, path, *bytes, *checksum);
            }
            BlobWork::Look { path } => return self.look(channel, path),
            BlobWork::Write { path, offset, pieces } => {
                self.write(channel, path, *offset, &std::mem::take(pieces))
            }
            BlobWork::Commit { path } => self.commit(channel, path),
            BlobWork::Abort { path } => self.abort(channel, path),
            BlobWork::MakeFolder { path } => self.make_folder(channel, path),
            BlobWork::Move { from, to } => self.move_to(channel, from, to),
            BlobWork::Remove { path } => self.remove(channel, path),
            BlobWork::List { path, after } => self.list(channel, path, after.as_deref()),
            BlobWork::Read { path, file, offset, bytes } => {
                self.read(channel, path, file.take(), *offset, *bytes)
            }
            BlobWork::Close => {
                self.close(channel);
                Ok(BlobDone::Done)
            }
        };
        done.map(Step::Over)
    }

    /// What stands there; a file's checksum is calculated, in steps, unless it is known.
    fn look(&mut self, channel: &Name, path: &BlobPath) -> Result<Step, BlobFailure> {
        let found = match self.folder.look(&paths::file(channel, path)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound && path.is_root() => Found::Folder,
            found => found.map_err(paths::failure)?,
        };
        let entry = |is_folder, bytes| BlobEntry { name: String::new(), is_folder, bytes };
        match found {
            Found::Folder => Ok(Step::Over(BlobDone::Entry { entry: entry(true, 0), checksum: 0 })),
            Found::Other => Err(RefusalCode::NoSuchPath.into()),
            Found::File { bytes } => {
                let known = self.checksums.get(&(channel.clone(), path.clone()));
                if let Some((_, checksum)) = known.filter(|(length, _)| *length == bytes) {
                    return Ok(Step::Over(BlobDone::Entry {
                        entry: entry(false, bytes),
                        checksum: *checksum,
                    }));
                }
                let file = self.folder.open(&paths::file(channel, path)).map_err(paths::failure)?;
                let summing = Summing::new(path.clone(), file).map_err(paths::failure)?;
                Ok(Step::More(Progress::Summing(Box::new(summing))))
            }
        }
    }

    fn go_on_summing(&mut self, channel: &Name, mut summing: Box<Summing>) -> Result<Step, BlobFailure> {
        if !summing.step().map_err(paths::failure)? {
            return Ok(Step::More(Progress::Summing(summing)));
        }
        let (path, bytes, checksum) = summing.end();
        self.remember(channel, &path, bytes, checksum);
        let entry = BlobEntry { name: String::new(), is_folder: false, bytes };
        Ok(Step::Over(BlobDone::Entry { entry, checksum }))
    }

    fn remember(&mut self, channel: &Name, path: &BlobPath, bytes: u64, checksum: u32) {
        if self.checksums.len() >= CHECKSUMS_KEPT_MAX {
            self.checksums.pop_first();
        }
        self.checksums.insert((channel.clone(), path.clone()), (bytes, checksum));
    }

    /// Files at and below this path may be others now.
    fn forget_checksums(&mut self, channel: &Name, path: &BlobPath) {
        self.checksums.retain(|(of, known), _| of != channel || !path.holds(known));
    }
}
