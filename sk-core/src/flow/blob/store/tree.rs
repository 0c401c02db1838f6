//! Folders and files of a channel: made, moved, removed, listed and read.

use super::super::super::error::RefusalCode;
use super::super::super::limits::PATH_BYTES_MAX;
use super::super::path::{BlobPath, PATH_PARTS_MAX, is_name};
use super::super::request::{BlobDone, BlobEntry, BlobFailure, BlobFile};
use super::quota::{FOLDER_CHARGE, charge};
use super::{BlobStore, Outcome, paths};
use crate::world::Found;
use bytes::Bytes;
use sk_flat::Name;
use std::io::ErrorKind;
use std::path::Path;

/// How many entries one answer has.
pub(super) const ENTRIES_PER_ANSWER: usize = 256;

impl BlobStore {
    pub(super) fn make_folder(&mut self, channel: &Name, path: &BlobPath) -> Outcome {
        self.make_channel(channel)?;
        let target = paths::file(channel, path);
        match self.folder.look(&target) {
            Ok(_) => return Err(RefusalCode::WrongPath.into()),
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(paths::failure(error)),
        }
        if !self.charge(channel, FOLDER_CHARGE, 0).map_err(paths::disk)? {
            return Err(RefusalCode::Quota.into());
        }
        if let Err(error) = self.folder.create_dir(&target) {
            self.quota.change(channel, 0, FOLDER_CHARGE);
            return Err(paths::failure(error));
        }
        Ok(BlobDone::Saved)
    }

    pub(super) fn move_to(&mut self, channel: &Name, from: &BlobPath, to: &BlobPath) -> Outcome {
        let (old, new) = (paths::file(channel, from), paths::file(channel, to));
        let moved = self.folder.look(&old).map_err(paths::failure)?;
        let there = match self.folder.look(&new) {
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            there => Some(there.map_err(paths::failure)?),
        };
        if from == to {
            return Ok(BlobDone::Saved);
        }
        match (moved, there) {
            (Found::Other, _) => return Err(RefusalCode::NoSuchPath.into()),
            (_, Some(Found::Folder | Found::Other)) | (Found::Folder, Some(Found::File { .. })) => {
                return Err(RefusalCode::WrongPath.into());
            }
            (Found::Folder, None) if from.holds(to) => return Err(RefusalCode::WrongPath.into()),
            (Found::Folder, None) => self.check_reach(&old, to)?,
            (Found::File { .. }, _) => {}
        }
        self.forget_checksums(channel, from);
        self.forget_checksums(channel, to);
        self.folder.rename(&old, &new).map_err(paths::failure)?;
        if let Some(Found::File { bytes }) = there {
            self.quota.change(channel, 0, charge(bytes));
        }
        Ok(BlobDone::Saved)
    }

    /// What stands in a folder can still be named after the folder was moved.
    fn check_reach(&self, folder: &Path, to: &BlobPath) -> Result<(), BlobFailure> {
        let mut folders = vec![(folder.to_owned(), to.parts(), to.as_str().len())];
        while let Some((folder, parts, bytes)) = folders.pop() {
            for name in self.folder.list(&folder).map_err(paths::failure)? {
                let (parts, bytes) = (parts + 1, bytes + 1 + name.len());
                if parts > PATH_PARTS_MAX || bytes > PATH_BYTES_MAX {
                    return Err(RefusalCode::BadPath.into());
                }
                let path = folder.join(name);
                if self.folder.look(&path).map_err(paths::failure)? == Found::Folder {
                    folders.push((path, parts, bytes));
                }
            }
        }
        Ok(())
    }

    pub(super) fn remove(&mut self, channel: &Name, path: &BlobPath) -> Outcome {
        let target = paths::file(channel, path);
        let charged = match self.folder.look(&target).map_err(paths::failure)? {
            Found::Folder => {
                self.folder.remove_dir(&target).map_err(paths::failure)?;
                FOLDER_CHARGE
            }
            Found::File { bytes } => {
                self.folder.remove(&target).map_err(paths::failure)?;
                charge(bytes)
            }
            Found::Other => {
                self.folder.remove(&target).map_err(paths::failure)?;
                0
            }
        };
        self.forget_checksums(channel, path);
        self.quota.change(channel, 0, charged);
        Ok(BlobDone::Saved)
    }

    /// The next entries of a folder. What is neither file nor folder, or has a name that no path has, is not one.
    pub(super) fn list(&mut self, channel: &Name, path: &BlobPath, after: Option<&str>) -> Outcome {
        let folder = paths::file(channel, path);
        let mut names = match self.folder.list(&folder) {
            Err(error) if error.kind() == ErrorKind::NotFound && path.is_root() => Vec::new(),
            names => names.map_err(paths::failure)?,
        };
        names.retain(|name| is_name(name) && after.is_none_or(|after| name.as_str() > after));
        let end = names.len() <= ENTRIES_PER_ANSWER;
        names.truncate(ENTRIES_PER_ANSWER);
        let mut entries = Vec::with_capacity(names.len());
        for name in names {
            match self.folder.look(&folder.join(&name)).map_err(paths::failure)? {
                Found::Folder => entries.push(BlobEntry { name, is_folder: true, bytes: 0 }),
                Found::File { bytes } => entries.push(BlobEntry { name, is_folder: false, bytes }),
                Found::Other => {}
            }
        }
        Ok(BlobDone::Entries { entries, end })
    }

    pub(super) fn read(
        &mut self,
        channel: &Name,
        path: &BlobPath,
        file: Option<BlobFile>,
        offset: u64,
        bytes: usize,
    ) -> Outcome {
        let file = match file {
            Some(file) => file,
            None => BlobFile(self.folder.open(&paths::file(channel, path)).map_err(paths::failure)?),
        };
        let left = file.0.len().map_err(paths::disk)?.saturating_sub(offset);
        let mut room = vec![0; bytes.min(usize::try_from(left).unwrap_or(bytes))];
        if !room.is_empty() {
            file.0.read_at(offset, &mut room).map_err(paths::disk)?;
        }
        Ok(BlobDone::Data { bytes: Bytes::from(room), file })
    }
}
