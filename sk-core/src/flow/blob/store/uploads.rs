//! Uploads: they grow in a place of their own, and become files whole or not at all.

use super::super::super::error::RefusalCode;
use super::super::super::fragment::Pieces;
use super::super::path::BlobPath;
use super::super::request::{BlobDone, BlobFailure};
use super::checking::{LOG_HEAD_BYTES, MARK_BYTES, MARK_EVERY_BYTES, Resuming, log_head, mark};
use super::quota::{FOLDER_CHARGE, account, charge};
use super::{BlobStore, Outcome, Progress, Step, paths};
use crate::testing::{Bug, is_planted};
use crate::world::{Found, StoredFile};
use crc32fast::Hasher;
use sk_flat::Name;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How many uploads of one account may be under way. Each has two files open.
const UPLOADS_PER_ACCOUNT_MAX: usize = 64;

/// A file that is on its way.
pub(super) struct Upload {
    pub(super) bytes: u64,
    checksum: u32,
    offset: u64,
    hasher: Hasher,
    data: Arc<dyn StoredFile>,
    log: Arc<dyn StoredFile>,
    marks: u64,
    marked: u64,
}

impl BlobStore {
    pub(super) fn begin(
        &mut self,
        channel: &Name,
        path: &BlobPath,
        bytes: u64,
        checksum: u32,
    ) -> Result<Step, BlobFailure> {
        let place = (channel.clone(), path.clone());
        if let Some(upload) = self.uploads.get(&place) {
            if (upload.bytes, upload.checksum) == (bytes, checksum) {
                return Ok(Step::Over(BlobDone::Resume { offset: upload.offset }));
            }
            self.discard(channel, path)?;
        }
        self.make_channel(channel)?;
        self.check_target(channel, path)?;
        if bytes > self.quota.bytes_max {
            return Err(RefusalCode::Quota.into());
        }
        let of_account = |(of, _): &&(Name, BlobPath)| account(of.as_str()) == account(channel.as_str());
        if self.uploads.keys().filter(of_account).count() >= UPLOADS_PER_ACCOUNT_MAX {
            return Err(RefusalCode::TooManyRequests.into());
        }
        let (data, log) = part_paths(channel, path);
        if let (Some(data), Some(log)) = (self.left(&data)?, self.left(&log)?) {
            let left = Resuming::new(path.clone(), (bytes, checksum), data, log).map_err(paths::disk)?;
            if let Some(resuming) = left {
                return Ok(Step::More(Progress::Resuming(Box::new(resuming))));
            }
        }
        self.discard(channel, path)?;
        self.promise(channel, path, charge(bytes), 0)?;
        let begun = self.begin_anew(&data, &log, bytes, checksum);
        let (data, log) = begun.map_err(paths::disk)?;
        let (offset, marks, marked) = (0, 0, 0);
        let hasher = Hasher::new();
        self.uploads
            .insert(place, Upload { bytes, checksum, offset, hasher, data, log, marks, marked });
        Ok(Step::Over(BlobDone::Resume { offset }))
    }

    /// A file of an upload that was left, if it is there.
    fn left(&self, path: &Path) -> Result<Option<Arc<dyn StoredFile>>, BlobFailure> {
        match self.folder.open(path) {
            Ok(file) => Ok(Some(file)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            // Somebody else put something strange here; it is removed like an upload of no use.
            Err(error) if error.kind() == ErrorKind::InvalidInput => Ok(None),
            Err(error) => Err(paths::disk(error)),
        }
    }

    fn begin_anew(
        &self,
        data: &Path,
        log: &Path,
        bytes: u64,
        checksum: u32,
    ) -> io::Result<(Arc<dyn StoredFile>, Arc<dyn StoredFile>)> {
        // The files are new, so that no older bytes can turn up in them after a power cut.
        let (data, log) = (self.folder.create(data)?, self.folder.create(log)?);
        log.write_at(0, &log_head(bytes, checksum))?;
        Ok((data, log))
    }

    pub(super) fn go_on_resuming(
        &mut self,
        channel: &Name,
        mut resuming: Box<Resuming>,
    ) -> Result<Step, BlobFailure> {
        if !resuming.step().map_err(paths::disk)? {
            return Ok(Step::More(Progress::Resuming(resuming)));
        }
        let Resuming { path, bytes, checksum, data, log, length, offset, marks, hasher, .. } = *resuming;
        self.promise(channel, &path, charge(bytes), charge(length))?;
        let upload = Upload { bytes, checksum, offset, hasher, data, log, marks, marked: offset };
        self.uploads.insert((channel.clone(), path), upload);
        Ok(Step::Over(BlobDone::Resume { offset }))
    }

    /// Charges the account what the upload will take. If there is no room, other uploads of the channel that were
    /// left and not resumed give way.
    fn promise(&mut self, channel: &Name, path: &BlobPath, more: u64, less: u64) -> Result<(), BlobFailure> {
        if self.charge(channel, more, less).map_err(paths::disk)? {
            return Ok(());
        }
        self.sweep(channel, path)?;
        if self.charge(channel, more, less).map_err(paths::disk)? {
            Ok(())
        } else {
            Err(RefusalCode::Quota.into())
        }
    }

    fn sweep(&mut self, channel: &Name, but: &BlobPath) -> Result<(), BlobFailure> {
        let active = self.uploads.keys().filter(|(of, _)| of == channel);
        let mut kept: Vec<String> = active.map(|(_, path)| paths::part_name(path)).collect();
        kept.push(paths::part_name(but));
        let folder = paths::parts(channel.as_str());
        for name in self.folder.list(&folder).map_err(paths::disk)? {
            let part = name.split('.').next().unwrap_or_default();
            if !kept.iter().any(|kept| kept == part) {
                self.remove_part(channel, &folder.join(&name), !name.contains('.'))?;
            }
        }
        Ok(())
    }

    /// Removes one file of an upload, if it is there.
    fn remove_part(&mut self, channel: &Name, path: &Path, is_charged: bool) -> Result<(), BlobFailure> {
        let found = match self.folder.look(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            found => found.map_err(paths::disk)?,
        };
        self.folder.remove(path).map_err(paths::disk)?;
        if let (Found::File { bytes }, true) = (found, is_charged) {
            self.quota.change(channel, 0, charge(bytes));
        }
        Ok(())
    }

    /// Forgets an upload and removes what is there of it.
    fn discard(&mut self, channel: &Name, path: &BlobPath) -> Result<(), BlobFailure> {
        let active = self.uploads.remove(&(channel.clone(), path.clone()));
        let (data, log) = part_paths(channel, path);
        self.remove_part(channel, &data, active.is_none())?;
        if let Some(upload) = active {
            self.quota.change(channel, 0, charge(upload.bytes));
        }
        self.remove_part(channel, &log, false)
    }

    /// Makes the folders of a channel that has none yet.
    pub(super) fn make_channel(&mut self, channel: &Name) -> Result<(), BlobFailure> {
        let missing = |error: &io::Error| error.kind() == ErrorKind::NotFound;
        for (index, folder) in paths::folders(channel).iter().enumerate() {
            match self.folder.look(folder) {
                Ok(Found::Folder) => continue,
                Err(error) if missing(&error) => {}
                Ok(_) => return Err(BlobFailure::Disk(format!("{} is no folder", folder.display()))),
                Err(error) => return Err(paths::disk(error)),
            }
            // The channel is charged for one folder, that of its files.
            if index == 1 && !self.charge(channel, FOLDER_CHARGE, 0).map_err(paths::disk)? {
                return Err(RefusalCode::Quota.into());
            }
            self.folder.create_dir(folder).map_err(paths::disk)?;
        }
        Ok(())
    }

    /// A file can come to stand there: the folder above it is there, and it is none itself.
    fn check_target(&self, channel: &Name, path: &BlobPath) -> Result<(), BlobFailure> {
        let target = paths::file(channel, path);
        if let Some(above) = target.parent()
            && self.folder.look(above).map_err(paths::failure)? != Found::Folder
        {
            return Err(RefusalCode::WrongPath.into());
        }
        match self.folder.look(&target) {
            Ok(Found::File { .. }) => Ok(()),
            Ok(Found::Folder | Found::Other) => Err(RefusalCode::WrongPath.into()),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            Err(error) => Err(paths::failure(error)),
        }
    }

    pub(super) fn write(&mut self, channel: &Name, path: &BlobPath, offset: u64, pieces: &Pieces) -> Outcome {
        let upload = self.uploads.get_mut(&(channel.clone(), path.clone()));
        let upload = upload.filter(|upload| upload.offset == offset).ok_or(RefusalCode::BadOffset)?;
        let length: u64 = pieces.iter().map(|piece| piece.len() as u64).sum();
        if length > upload.bytes - upload.offset {
            return Err(RefusalCode::BadChecksum.into());
        }
        upload.add(pieces).map_err(paths::disk)?;
        Ok(BlobDone::Done)
    }

    pub(super) fn commit(&mut self, channel: &Name, path: &BlobPath) -> Outcome {
        let place = (channel.clone(), path.clone());
        let upload = self.uploads.get(&place).ok_or(RefusalCode::BadOffset)?;
        if upload.offset < upload.bytes {
            // It may go on.
            return Err(RefusalCode::BadChecksum.into());
        }
        if upload.hasher.clone().finalize() != upload.checksum {
            self.discard(channel, path)?;
            return Err(RefusalCode::BadChecksum.into());
        }
        let (bytes, checksum) = (upload.bytes, upload.checksum);
        let synced = if is_planted(Bug::BlobUnsynced) { Ok(()) } else { upload.data.sync() };
        if let Err(error) = synced {
            // What the disk did not take once it cannot be asked to take again: the upload is of no use any more.
            self.discard(channel, path)?;
            return Err(paths::disk(error));
        }
        self.check_target(channel, path)?;
        let (data, log) = part_paths(channel, path);
        let target = paths::file(channel, path);
        let before = match self.folder.look(&target) {
            Ok(Found::File { bytes }) => charge(bytes),
            _ => 0,
        };
        self.forget_checksums(channel, path);
        if let Err(error) = self.folder.rename(&data, &target) {
            // It may have been renamed and not be durable: whoever begins again sees what is there.
            self.uploads.remove(&place);
            return Err(paths::disk(error));
        }
        self.uploads.remove(&place);
        self.quota.change(channel, 0, before);
        self.remember(channel, path, bytes, checksum);
        // A log without its upload does no harm.
        let _ = self.folder.remove(&log);
        Ok(BlobDone::Saved)
    }

    pub(super) fn abort(&mut self, channel: &Name, path: &BlobPath) -> Outcome {
        self.discard(channel, path)?;
        Ok(BlobDone::Done)
    }

    /// The channel has gone: its uploads wait in their files.
    pub(super) fn close(&mut self, channel: &Name) {
        let (closed, kept) = std::mem::take(&mut self.uploads)
            .into_iter()
            .partition(|((of, _), _)| of == channel);
        self.uploads = kept;
        let closed: std::collections::BTreeMap<_, Upload> = closed;
        for upload in closed.into_values() {
            match upload.data.len() {
                Ok(length) => self.quota.change(channel, charge(length), charge(upload.bytes)),
                Err(_) => self.quota.forget(channel),
            }
        }
    }
}

impl Upload {
    /// Adds bytes to the end. If that fails, it is as long as before.
    fn add(&mut self, pieces: &Pieces) -> io::Result<()> {
        let (mut hasher, mut end) = (self.hasher.clone(), self.offset);
        for piece in pieces {
            self.data.write_at(end, piece)?;
            hasher.update(piece);
            end += piece.len() as u64;
        }
        if end - self.marked >= MARK_EVERY_BYTES || end == self.bytes && end > self.marked {
            let mark = mark(end, hasher.clone().finalize());
            self.log.write_at(LOG_HEAD_BYTES + self.marks * MARK_BYTES, &mark)?;
            self.marks += 1;
            self.marked = end;
        }
        (self.hasher, self.offset) = (hasher, end);
        Ok(())
    }
}

fn part_paths(channel: &Name, path: &BlobPath) -> (PathBuf, PathBuf) {
    let data = paths::parts(channel.as_str()).join(paths::part_name(path));
    let log = data.with_extension("log");
    (data, log)
}
