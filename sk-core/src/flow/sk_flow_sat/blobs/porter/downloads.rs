//! Files on their way from the hub.

use super::super::errands::Errand;
use super::super::objects::FlowDownload;
use super::{Porter, Sent, Told};
use crate::flow::blob::BlobEntry;
use crate::flow::limits::BLOB_READS_PER_CONNECTION_MAX;
use crate::flow::satellite::SatelliteCore;
use crate::flow::{Command, Path};
use crate::object::Handle;
use bytes::Bytes;
use crc32fast::Hasher;
use std::path::PathBuf;

/// How much is asked for at once. A file on this machine's disk has it before the next is asked for.
const RANGE_BYTES: u32 = 4 * 1024 * 1024;

/// Where the bytes go.
pub(in super::super) enum Sink {
    Signal,
    File { file: PathBuf, range: Vec<Bytes> },
}

impl Sink {
    pub(in super::super) fn file(file: PathBuf) -> Sink {
        Sink::File { file, range: Vec::new() }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// It waits for its channel.
    Waiting,
    /// It asked what there is.
    Looking,
    /// A range comes.
    Reading,
    /// The disk takes a range.
    Keeping,
    /// The next range is to be asked for.
    Ready,
}

pub(super) struct Download {
    channel: String,
    path: String,
    object: Handle<FlowDownload>,
    sink: Sink,
    /// Length and checksum, once they are known.
    whole: Option<(u64, u32)>,
    received: u64,
    hasher: Hasher,
    stage: Stage,
    /// The hub was lost while the disk took a range.
    lost: bool,
}

impl Download {
    pub(super) fn new(channel: &str, path: &str, object: Handle<FlowDownload>, sink: Sink) -> Download {
        Download {
            channel: channel.to_owned(),
            path: path.to_owned(),
            object,
            sink,
            whole: None,
            received: 0,
            hasher: Hasher::new(),
            stage: Stage::Waiting,
            lost: false,
        }
    }

    /// The hub is lost. What has come is kept; whether it is still the same file is asked when the hub is back.
    pub(super) fn pause(&mut self) {
        if self.stage == Stage::Keeping {
            self.lost = true;
        } else {
            self.stage = Stage::Waiting;
        }
    }
}

impl Porter {
    /// So many ranges at once as a hub reads for one connection; the other downloads wait for their turn.
    pub(super) fn go_on_downloading(&mut self, core: &mut SatelliteCore) {
        let reads = |download: &&Download| download.stage == Stage::Reading;
        let mut reading = self.downloads.values().filter(reads).count();
        for (id, download) in &mut self.downloads {
            if download.stage == Stage::Ready && reading >= BLOB_READS_PER_CONNECTION_MAX {
                continue;
            }
            let Some(channel) = core.channel(&download.channel).map(|info| info.channel) else { continue };
            let path = Path(download.path.clone());
            let (command, sent, stage) = match download.stage {
                Stage::Waiting => {
                    (Command::BlobStat { channel, path }, Sent::DownloadLook(*id), Stage::Looking)
                }
                Stage::Ready => {
                    let (offset, bytes) = (download.received, RANGE_BYTES);
                    let read = Command::BlobRead { channel, path, offset, bytes };
                    (read, Sent::DownloadRead(*id), Stage::Reading)
                }
                Stage::Looking | Stage::Reading | Stage::Keeping => continue,
            };
            if let Ok(tag) = core.blob(&command) {
                self.sent.insert(tag, sent);
                download.stage = stage;
                reading += usize::from(stage == Stage::Reading);
            }
        }
    }

    pub(super) fn download_looked(&mut self, id: u64, entry: &BlobEntry, checksum: u32) {
        let Some(download) = self.downloads.get_mut(&id) else { return };
        let found = (entry.bytes, checksum);
        if entry.is_folder {
            return self.download_failed(id, "it is a folder".to_owned());
        }
        if *download.whole.get_or_insert(found) != found {
            return self.download_failed(id, "the file was replaced during the download".to_owned());
        }
        download.stage = Stage::Ready;
        self.end_if_whole(id);
    }

    pub(super) fn download_came(&mut self, id: u64, payload: &Bytes, last: bool) {
        let Some(download) = self.downloads.get_mut(&id) else { return };
        let Some((bytes, _)) = download.whole.filter(|_| download.stage == Stage::Reading) else { return };
        download.received += payload.len() as u64;
        download.hasher.update(payload);
        if !payload.is_empty() {
            match &mut download.sink {
                Sink::Signal => self.told.push_back(Told::Data(download.object, payload.clone())),
                Sink::File { range, .. } => range.push(payload.clone()),
            }
            self.told.push_back(Told::Came(download.object, download.received, bytes));
        }
        if !last {
            return;
        }
        if payload.is_empty() && download.received < bytes {
            return self.download_failed(id, "the file was replaced during the download".to_owned());
        }
        download.stage = Stage::Ready;
        if let Sink::File { file, range } = &mut download.sink {
            let (file, range) = (file.clone(), std::mem::take(range));
            let length: usize = range.iter().map(Bytes::len).sum();
            let offset = download.received - length as u64;
            if length > 0 {
                download.stage = Stage::Keeping;
                return self.errands.push_back(Errand::KeepRange { id, file, offset, range });
            }
        }
        self.end_if_whole(id);
    }

    /// Checks it if all has come.
    fn end_if_whole(&mut self, id: u64) {
        let Some(download) = self.downloads.get_mut(&id) else { return };
        let Some((bytes, checksum)) = download.whole.filter(|(bytes, _)| download.received >= *bytes) else {
            return;
        };
        if download.received > bytes || download.hasher.clone().finalize() != checksum {
            return self.download_failed(id, "the file was replaced during the download".to_owned());
        }
        match &download.sink {
            Sink::File { file, .. } => {
                let file = file.clone();
                download.stage = Stage::Keeping;
                self.errands.push_back(Errand::KeepFile { id, file });
            }
            Sink::Signal => {
                let object = download.object;
                self.downloads.remove(&id);
                self.told.push_back(Told::Done(object));
            }
        }
    }

    /// The disk has a range, or all of the file.
    pub(super) fn download_kept(&mut self, id: u64, outcome: Result<bool, String>) {
        let Some(download) = self.downloads.get_mut(&id) else { return };
        match outcome {
            Ok(false) => {
                let lost = std::mem::take(&mut download.lost);
                download.stage = if lost { Stage::Waiting } else { Stage::Ready };
                if !lost {
                    self.end_if_whole(id);
                }
            }
            Ok(true) => {
                let object = download.object;
                self.downloads.remove(&id);
                self.told.push_back(Told::Done(object));
            }
            Err(why) => self.download_failed(id, why),
        }
    }

    /// Whoever destroyed the object of a download wants no more of it.
    pub(in super::super) fn give_up_downloads(&mut self, is_wanted: impl Fn(Handle<FlowDownload>) -> bool) {
        let unwanted: Vec<u64> = self
            .downloads
            .iter()
            .filter(|(_, download)| !is_wanted(download.object))
            .map(|(id, _)| *id)
            .collect();
        for id in unwanted {
            if let Some(Download { sink: Sink::File { file, .. }, .. }) = self.downloads.remove(&id) {
                self.errands.push_back(Errand::Drop { file });
            }
        }
    }

    pub(super) fn download_failed(&mut self, id: u64, why: String) {
        if let Some(download) = self.downloads.remove(&id) {
            if let Sink::File { file, .. } = download.sink {
                self.errands.push_back(Errand::Drop { file });
            }
            self.told.push_back(Told::Failed(download.object, why));
        }
    }
}
