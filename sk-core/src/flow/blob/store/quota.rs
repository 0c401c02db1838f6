//! What the files of each account take.

use super::{BlobStore, paths};
use crate::world::Found;
use sk_flat::Name;
use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

/// What the smallest file or folder is charged, so that their number is limited too.
const BLOCK_BYTES: u64 = 4_096;

/// What a file of that length is charged.
pub(super) fn charge(bytes: u64) -> u64 {
    bytes.div_ceil(BLOCK_BYTES).max(1).saturating_mul(BLOCK_BYTES)
}

/// What a folder is charged.
pub(super) const FOLDER_CHARGE: u64 = BLOCK_BYTES;

pub(super) fn account(channel: &str) -> &str {
    channel.split_once('.').map_or(channel, |(account, _)| account)
}

/// What is used, for the accounts that were counted.
pub(super) struct Quota {
    pub(super) bytes_max: u64,
    used: BTreeMap<String, u64>,
}

impl Quota {
    pub(super) fn new(bytes_max: u64) -> Quota {
        Quota { bytes_max, used: BTreeMap::new() }
    }

    /// The account of this channel is to be counted anew before it may take more.
    pub(super) fn forget(&mut self, channel: &Name) {
        self.used.remove(account(channel.as_str()));
    }

    /// What an account that was counted takes now is more and less by this.
    pub(super) fn change(&mut self, channel: &Name, more: u64, less: u64) {
        if let Some(used) = self.used.get_mut(account(channel.as_str())) {
            *used = used.saturating_add(more).saturating_sub(less);
        }
    }

    fn used(&self, channel: &Name) -> Option<u64> {
        self.used.get(account(channel.as_str())).copied()
    }
}

impl BlobStore {
    /// Whether the account may take that much more in place of `less`; if so it is charged.
    pub(super) fn charge(&mut self, channel: &Name, more: u64, less: u64) -> io::Result<bool> {
        let used = match self.quota.used(channel) {
            Some(used) => used,
            None => {
                let used = self.count(account(channel.as_str()))?;
                self.quota.used.insert(account(channel.as_str()).to_owned(), used);
                used
            }
        };
        let fits = used.saturating_sub(less).saturating_add(more) <= self.quota.bytes_max;
        if fits {
            self.quota.change(channel, more, less);
        }
        Ok(fits)
    }

    /// Counts what is there of an account's, on the disk and promised to uploads.
    pub(super) fn count(&self, of: &str) -> io::Result<u64> {
        let mut sum: u64 = 0;
        for channel in self.folder.list(&PathBuf::new())? {
            if account(&channel) == of {
                sum = sum.saturating_add(self.count_files(&channel)?);
                sum = sum.saturating_add(self.count_parts(&channel)?);
            }
        }
        Ok(sum)
    }

    fn count_files(&self, channel: &str) -> io::Result<u64> {
        let mut sum: u64 = 0;
        // Not by recursion: how deep somebody else nests folders here is not ours to say.
        let mut folders = vec![paths::files(channel)];
        while let Some(folder) = folders.pop() {
            let names = match self.folder.list(&folder) {
                Err(error) if is_nothing(&error) => continue,
                names => names?,
            };
            sum = sum.saturating_add(FOLDER_CHARGE);
            for name in names {
                let path = folder.join(name);
                match self.folder.look(&path)? {
                    Found::Folder => folders.push(path),
                    Found::File { bytes } => sum = sum.saturating_add(charge(bytes)),
                    Found::Other => {}
                }
            }
        }
        Ok(sum)
    }

    /// An upload under way is charged what it will be, another one what it has become.
    fn count_parts(&self, channel: &str) -> io::Result<u64> {
        let active: BTreeMap<String, u64> = self
            .uploads
            .iter()
            .filter(|((of, _), _)| of.as_str() == channel)
            .map(|((_, path), upload)| (paths::part_name(path), upload.bytes))
            .collect();
        let folder = paths::parts(channel);
        let names = match self.folder.list(&folder) {
            Err(error) if is_nothing(&error) => return Ok(0),
            names => names?,
        };
        let mut sum: u64 = 0;
        for name in names {
            match (active.get(&name), self.folder.look(&folder.join(&name))?) {
                (Some(bytes), _) => sum = sum.saturating_add(charge(*bytes)),
                (None, Found::File { bytes }) if !name.contains('.') => {
                    sum = sum.saturating_add(charge(bytes));
                }
                _ => {}
            }
        }
        Ok(sum)
    }
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}
