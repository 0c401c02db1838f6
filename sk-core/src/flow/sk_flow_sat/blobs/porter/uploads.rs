//! Files on their way to the hub.

use super::super::errands::{Errand, Source};
use super::super::objects::BlobProgress;
use super::{Porter, Sent, Told};
use crate::flow::satellite::SatelliteCore;
use crate::flow::{Command, Path};
use bytes::Bytes;
use std::rc::Rc;

/// How long a piece is.
const PIECE_BYTES: u64 = 256 * 1024;
/// How much may be on its way without an answer.
const AHEAD_BYTES_MAX: u64 = 4 * PIECE_BYTES;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Its length and checksum are being found out.
    Surveying,
    /// It waits for its channel.
    Ready,
    Begun,
    Sending {
        sent: u64,
        done: u64,
        /// A piece is being read from its file.
        reading: bool,
    },
    Committing,
}

pub(super) struct Upload {
    pub(super) blob: Rc<str>,
    pub(super) path: String,
    source: Source,
    bytes: u64,
    checksum: u32,
    stage: Stage,
}

impl Upload {
    pub(super) fn new(blob: Rc<str>, path: &str, source: Source) -> Upload {
        Upload { blob, path: path.to_owned(), source, bytes: 0, checksum: 0, stage: Stage::Surveying }
    }

    /// The hub or the channel is gone; it begins anew when they are there again.
    pub(super) fn pause(&mut self) {
        if self.stage != Stage::Surveying {
            self.stage = Stage::Ready;
        }
    }

    pub(super) fn resumed(&mut self, offset: u64) {
        if self.stage == Stage::Begun {
            self.stage = Stage::Sending { sent: offset, done: offset, reading: false };
        }
    }
}

impl Porter {
    pub(super) fn surveyed(&mut self, id: u64, outcome: Result<(u64, u32), String>) {
        let Some(upload) = self.uploads.get_mut(&id) else { return };
        match outcome {
            Ok((bytes, checksum)) => {
                (upload.bytes, upload.checksum) = (bytes, checksum);
                upload.stage = Stage::Ready;
            }
            Err(why) => self.upload_failed(id, why),
        }
    }

    pub(super) fn piece_done(&mut self, id: u64, bytes: u64) {
        let Some(upload) = self.uploads.get_mut(&id) else { return };
        let Stage::Sending { done, .. } = &mut upload.stage else { return };
        *done += bytes;
        let (bytes, of) = (*done, upload.bytes);
        let progress = BlobProgress { path: upload.path.clone(), bytes, of };
        if let Some(own) = self.own.get(&upload.blob) {
            self.told.push_back(Told::Progress(own.object, progress));
        }
    }

    pub(super) fn committed(&mut self, id: u64) {
        if let Some(upload) = self.uploads.remove(&id)
            && let Some(own) = self.own.get(&upload.blob)
        {
            self.told.push_back(Told::Saved(own.object, upload.path));
        }
    }

    pub(super) fn upload_failed(&mut self, id: u64, why: String) {
        if let Some(upload) = self.uploads.remove(&id)
            && let Some(own) = self.own.get(&upload.blob)
        {
            self.told.push_back(Told::Refused(own.object, upload.path, why));
        }
    }

    pub(super) fn piece_read(&mut self, id: u64, offset: u64, outcome: Result<Bytes, String>) {
        let Some(upload) = self.uploads.get_mut(&id) else { return };
        let Stage::Sending { sent, reading, .. } = upload.stage else { return };
        // A piece that was asked for before the hub was lost is of no use any more.
        if sent != offset || !reading {
            return;
        }
        match outcome {
            Ok(piece) => self.errands.push_back(Errand::Send { id, offset, piece }),
            Err(why) => self.upload_failed(id, why),
        }
    }

    pub(super) fn go_on_uploading(&mut self, core: &mut SatelliteCore) {
        let ids: Vec<u64> = self.uploads.keys().copied().collect();
        for id in ids {
            while self.send_more(core, id) {}
        }
    }

    /// Sends one thing of an upload; answers whether there may be more to send.
    fn send_more(&mut self, core: &mut SatelliteCore, id: u64) -> bool {
        let Some(upload) = self.uploads.get_mut(&id) else { return false };
        let Some(channel) = self.own.get(&upload.blob).and_then(|own| own.channel) else { return false };
        let path = Path(upload.path.clone());
        match upload.stage {
            Stage::Surveying | Stage::Begun | Stage::Committing => false,
            Stage::Ready => {
                let (bytes, checksum) = (upload.bytes, upload.checksum);
                if let Ok(tag) = core.blob(&Command::BlobBegin { channel, path, bytes, checksum }) {
                    upload.stage = Stage::Begun;
                    self.sent.insert(tag, Sent::Begin(id));
                }
                false
            }
            Stage::Sending { done, .. } if done == upload.bytes => {
                if let Ok(tag) = core.blob(&Command::BlobCommit { channel, path }) {
                    upload.stage = Stage::Committing;
                    self.sent.insert(tag, Sent::Commit(id));
                }
                false
            }
            Stage::Sending { sent, done, reading } => {
                let length = PIECE_BYTES.min(upload.bytes - sent);
                if reading || length == 0 || sent - done + length > AHEAD_BYTES_MAX {
                    return false;
                }
                match &upload.source {
                    Source::Bytes(bytes) => {
                        let piece = bytes.slice(sent as usize..(sent + length) as usize);
                        self.send_piece(core, id, sent, piece)
                    }
                    Source::File(file) => {
                        let (file, offset) = (file.clone(), sent);
                        upload.stage = Stage::Sending { sent, done, reading: true };
                        self.errands.push_back(Errand::ReadPiece { id, file, offset, bytes: length });
                        false
                    }
                }
            }
        }
    }

    /// Sends a piece; answers whether there was room for it.
    pub(in super::super) fn send_piece(
        &mut self,
        core: &mut SatelliteCore,
        id: u64,
        offset: u64,
        piece: Bytes,
    ) -> bool {
        let Some(upload) = self.uploads.get_mut(&id) else { return false };
        let Some(channel) = self.own.get(&upload.blob).and_then(|own| own.channel) else { return false };
        let Stage::Sending { sent, reading, .. } = &mut upload.stage else { return false };
        let length = piece.len() as u64;
        if *sent != offset {
            return false;
        }
        // What finds no room now is read again.
        *reading = false;
        let Ok(tag) = core.blob_write(channel, &upload.path, offset, piece) else { return false };
        *sent += length;
        self.sent.insert(tag, Sent::Piece(id, length));
        true
    }
}
