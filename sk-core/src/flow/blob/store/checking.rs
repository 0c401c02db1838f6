//! Reading files through, a bounded piece at a time: for their checksum, and to see how far an upload that was left
//! can be trusted.

use super::super::path::BlobPath;
use crate::world::StoredFile;
use crc32fast::Hasher;
use std::io;
use std::sync::Arc;

/// How much is read in one step.
const STEP_BYTES: u64 = 4 * 1024 * 1024;
/// How much is read at once.
const READ_BYTES: usize = 256 * 1024;
/// How an upload's log begins.
const LOG_MAGIC: [u8; 4] = *b"SKB1";
pub(super) const LOG_HEAD_BYTES: u64 = 16;
pub(super) const MARK_BYTES: u64 = 12;
/// An upload makes a mark in its log each time that so much has come.
pub(super) const MARK_EVERY_BYTES: u64 = 64 * 1024;

/// Adds `from..to` of a file to a checksum.
fn sum(file: &dyn StoredFile, hasher: &mut Hasher, from: u64, to: u64) -> io::Result<()> {
    let mut room = vec![0; READ_BYTES.min(usize::try_from(to - from).unwrap_or(READ_BYTES))];
    let mut at = from;
    while at < to {
        let piece = READ_BYTES.min(usize::try_from(to - at).unwrap_or(READ_BYTES));
        file.read_at(at, &mut room[..piece])?;
        hasher.update(&room[..piece]);
        at += piece as u64;
    }
    Ok(())
}

/// The checksum of a file while it is calculated.
pub(super) struct Summing {
    path: BlobPath,
    file: Arc<dyn StoredFile>,
    bytes: u64,
    at: u64,
    hasher: Hasher,
}

impl Summing {
    pub(super) fn new(path: BlobPath, file: Arc<dyn StoredFile>) -> io::Result<Summing> {
        let bytes = file.len()?;
        Ok(Summing { path, file, bytes, at: 0, hasher: Hasher::new() })
    }

    /// Answers whether it is done.
    pub(super) fn step(&mut self) -> io::Result<bool> {
        let to = self.bytes.min(self.at + STEP_BYTES);
        sum(&*self.file, &mut self.hasher, self.at, to)?;
        self.at = to;
        Ok(to == self.bytes)
    }

    pub(super) fn end(self) -> (BlobPath, u64, u32) {
        (self.path, self.bytes, self.hasher.finalize())
    }
}

/// How the log of an upload begins.
pub(super) fn log_head(bytes: u64, checksum: u32) -> [u8; LOG_HEAD_BYTES as usize] {
    let mut head = [0; LOG_HEAD_BYTES as usize];
    head[..4].copy_from_slice(&LOG_MAGIC);
    head[4..12].copy_from_slice(&bytes.to_le_bytes());
    head[12..].copy_from_slice(&checksum.to_le_bytes());
    head
}

/// One entry of the log: up to here the upload has this checksum.
pub(super) fn mark(end: u64, checksum: u32) -> [u8; MARK_BYTES as usize] {
    let mut mark = [0; MARK_BYTES as usize];
    mark[..8].copy_from_slice(&end.to_le_bytes());
    mark[8..].copy_from_slice(&checksum.to_le_bytes());
    mark
}

/// An upload that was left, while it is found out how much of it is good. Nothing of it was ever synchronised, so
/// a power cut may have left anything; what agrees with the marks of the log is what was sent.
pub(super) struct Resuming {
    pub(super) path: BlobPath,
    pub(super) bytes: u64,
    pub(super) checksum: u32,
    pub(super) data: Arc<dyn StoredFile>,
    pub(super) log: Arc<dyn StoredFile>,
    /// What the part took on the disk when it was found.
    pub(super) length: u64,
    log_length: u64,
    /// How far it is good, how many marks say so, and the checksum up to there.
    pub(super) offset: u64,
    pub(super) marks: u64,
    pub(super) hasher: Hasher,
}

impl Resuming {
    /// `None` if the log is of another file or version of it.
    pub(super) fn new(
        path: BlobPath,
        (bytes, checksum): (u64, u32),
        data: Arc<dyn StoredFile>,
        log: Arc<dyn StoredFile>,
    ) -> io::Result<Option<Resuming>> {
        let (length, log_length) = (data.len()?, log.len()?);
        if log_length < LOG_HEAD_BYTES || length > bytes {
            return Ok(None);
        }
        let mut head = [0; LOG_HEAD_BYTES as usize];
        log.read_at(0, &mut head)?;
        let (offset, marks, hasher) = (0, 0, Hasher::new());
        Ok((head == log_head(bytes, checksum)).then_some(Resuming {
            path,
            bytes,
            checksum,
            data,
            log,
            length,
            log_length,
            offset,
            marks,
            hasher,
        }))
    }

    /// Follows the marks for a while; answers whether that is done.
    pub(super) fn step(&mut self) -> io::Result<bool> {
        let until = self.offset + STEP_BYTES;
        while self.offset < until {
            let place = LOG_HEAD_BYTES + self.marks * MARK_BYTES;
            if place + MARK_BYTES > self.log_length {
                return Ok(true);
            }
            let mut mark = [0; MARK_BYTES as usize];
            self.log.read_at(place, &mut mark)?;
            let [end @ .., a, b, c, d] = mark;
            let (end, checksum) = (u64::from_le_bytes(end), u32::from_le_bytes([a, b, c, d]));
            if end <= self.offset || end > self.length {
                return Ok(true);
            }
            let mut hasher = self.hasher.clone();
            sum(&*self.data, &mut hasher, self.offset, end)?;
            if hasher.clone().finalize() != checksum {
                return Ok(true);
            }
            (self.offset, self.hasher) = (end, hasher);
            self.marks += 1;
        }
        Ok(false)
    }
}
