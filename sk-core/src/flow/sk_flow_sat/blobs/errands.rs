//! What is done on a worker for uploads and downloads: this machine's disk must not hold up the loop.

use crate::world::Storage;
use bytes::Bytes;
use crc32fast::Hasher;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

/// How much is read at once.
const READ_BYTES: u64 = 256 * 1024;

/// Where the bytes of an upload come from.
#[derive(Clone)]
pub(super) enum Source {
    Bytes(Bytes),
    File(PathBuf),
}

/// Something to be done.
pub(super) enum Errand {
    /// Find out length and checksum.
    Survey { id: u64, source: Source },
    /// Read a piece of a file.
    ReadPiece { id: u64, file: PathBuf, offset: u64, bytes: u64 },
    /// Write what came of a download.
    KeepRange { id: u64, file: PathBuf, offset: u64, range: Vec<Bytes> },
    /// All of a download has come: it gets its name.
    KeepFile { id: u64, file: PathBuf },
    /// A download came to nothing.
    Drop { file: PathBuf },
    /// A piece that was read is to be sent. This is done on the loop.
    Send { id: u64, offset: u64, piece: Bytes },
}

/// What came of it.
pub(super) enum Fetched {
    Surveyed {
        id: u64,
        outcome: Result<(u64, u32), String>,
    },
    Piece {
        id: u64,
        offset: u64,
        outcome: Result<Bytes, String>,
    },
    /// A range is written, or (`true`) the whole file is there.
    Kept {
        id: u64,
        outcome: Result<bool, String>,
    },
}

impl Errand {
    pub(super) fn run(self, storage: &dyn Storage) -> Option<Fetched> {
        match self {
            Errand::Survey { id, source } => {
                let outcome = survey(storage, &source).map_err(|error| error.to_string());
                Some(Fetched::Surveyed { id, outcome })
            }
            Errand::ReadPiece { id, file, offset, bytes } => {
                let outcome = read(storage, &file, offset, bytes).map_err(|error| error.to_string());
                Some(Fetched::Piece { id, offset, outcome })
            }
            Errand::KeepRange { id, file, offset, range } => {
                let outcome = keep(storage, &file, offset, &range).map(|()| false);
                Some(Fetched::Kept { id, outcome: outcome.map_err(|error| error.to_string()) })
            }
            Errand::KeepFile { id, file } => {
                let outcome = finish(storage, &file).map(|()| true);
                Some(Fetched::Kept { id, outcome: outcome.map_err(|error| error.to_string()) })
            }
            Errand::Drop { file } => {
                // It may never have been begun.
                let _ = storage.remove(&unfinished(&file));
                None
            }
            Errand::Send { .. } => None,
        }
    }
}

fn survey(storage: &dyn Storage, source: &Source) -> io::Result<(u64, u32)> {
    let file = match source {
        Source::Bytes(bytes) => return Ok((bytes.len() as u64, crc32fast::hash(bytes))),
        Source::File(file) => storage.open_to_read(file)?,
    };
    let (bytes, mut at, mut hasher) = (file.len()?, 0, Hasher::new());
    let mut room = vec![0; READ_BYTES as usize];
    while at < bytes {
        let piece = READ_BYTES.min(bytes - at);
        let room = &mut room[..piece as usize];
        file.read_at(at, room)?;
        hasher.update(room);
        at += piece;
    }
    Ok((bytes, hasher.finalize()))
}

fn read(storage: &dyn Storage, file: &Path, offset: u64, bytes: u64) -> io::Result<Bytes> {
    let mut room = vec![0; usize::try_from(bytes).unwrap_or(0)];
    storage.open_to_read(file)?.read_at(offset, &mut room)?;
    Ok(room.into())
}

/// What a download is called until it is whole.
fn unfinished(file: &Path) -> PathBuf {
    let mut name = file.file_name().map(OsString::from).unwrap_or_default();
    name.push(".part");
    file.with_file_name(name)
}

fn keep(storage: &dyn Storage, file: &Path, offset: u64, range: &[Bytes]) -> io::Result<()> {
    let part = storage.open(&unfinished(file), true)?;
    if offset == 0 {
        // Of an earlier attempt.
        part.set_len(0)?;
    }
    let mut at = offset;
    for piece in range {
        part.write_at(at, piece)?;
        at += piece.len() as u64;
    }
    Ok(())
}

fn finish(storage: &dyn Storage, file: &Path) -> io::Result<()> {
    let part = unfinished(file);
    storage.open(&part, true)?.sync()?;
    storage.rename(&part, file)
}
