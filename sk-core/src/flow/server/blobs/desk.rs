//! What a connection has to do with blobs, and what the hub has asked of the disk.

use super::super::super::blob::{BlobEntry, BlobFile, BlobPath, BlobRequest, BlobWork};
use super::super::super::limits::{BLOB_BYTES_AHEAD_MAX, BLOB_REQUESTS_PER_CONNECTION_MAX};
use super::super::super::{ChannelRef, Encoded, Event, Flags, Message as _};
use super::super::ConnectionId;
use rustc_hash::FxHashMap;
use sk_flat::Name;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// A connection's own state with blobs.
#[derive(Debug, Default)]
pub(in super::super) struct BlobDesk {
    /// How many requests to the disk it waits for.
    pub(super) waiting: usize,
    /// Bytes of its uploads that the disk does not have yet.
    pub(super) bytes_ahead: usize,
    /// The tags of pieces that are coming in.
    pub(super) writing: BTreeSet<u32>,
    /// Downloads under way, by tag.
    pub(super) reads: BTreeMap<u32, Reading>,
}

impl BlobDesk {
    /// Whether nothing more is to be taken from the connection until the disk has done something.
    pub(in super::super) fn is_held(&self) -> bool {
        self.waiting >= BLOB_REQUESTS_PER_CONNECTION_MAX || self.bytes_ahead >= BLOB_BYTES_AHEAD_MAX
    }

    /// Whether the disk owes it something.
    pub(in super::super) fn awaits_disk(&self) -> bool {
        self.waiting > 0
    }

    /// Whether something that was asked has not been answered.
    pub(in super::super) fn is_waiting(&self) -> bool {
        self.waiting > 0 || !self.reads.is_empty()
    }
}

/// A download while it goes on.
#[derive(Debug)]
pub(super) struct Reading {
    pub(super) channel: ChannelRef,
    pub(super) path: BlobPath,
    /// The file, once it was opened.
    pub(super) file: Option<BlobFile>,
    pub(super) next: u64,
    pub(super) end: u64,
    /// The disk is at it.
    pub(super) asked: bool,
    /// Bytes of it have been queued for the peer.
    pub(super) begun: bool,
}

/// A listing of a folder while it is being told.
#[derive(Clone, Debug)]
pub(in super::super) struct Listing {
    pub(super) channel: ChannelRef,
    pub(super) path: BlobPath,
    pub(super) entries: VecDeque<BlobEntry>,
    /// The last name that the disk told.
    pub(super) after: Option<String>,
    pub(super) asked: bool,
    /// The disk has no more.
    pub(super) end: bool,
}

impl Listing {
    /// Whether it cannot go on before the disk has said more.
    pub(in super::super) fn waits(&self) -> bool {
        self.entries.is_empty() && !self.end
    }

    /// The next line.
    pub(in super::super) fn line(&mut self, tag: u32) -> Option<Encoded> {
        let BlobEntry { name, is_folder, bytes } = self.entries.pop_front()?;
        Some(Event::BlobListed { name, directory: is_folder.into(), bytes }.encode(tag, Flags::NONE))
    }
}

/// The hub's half of its files: requests on their way out, and what their answers are for.
#[derive(Debug, Default)]
pub(in super::super) struct Filing {
    pub(super) on: bool,
    last: u64,
    pub(super) requests: VecDeque<BlobRequest>,
    pub(super) waiting: FxHashMap<u64, Waiting>,
}

/// Who waits for an answer of the disk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    pub(super) connection: ConnectionId,
    pub(super) tag: u32,
    pub(super) purpose: Purpose,
}

/// What an answer is for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Purpose {
    /// To be told to the one who asked.
    Tell,
    /// To be told; so many bytes have gone to the disk then.
    Piece { bytes: usize },
    /// Entries for the listing that is being told.
    List,
    /// Bytes for a download.
    Read,
}

impl Filing {
    /// Queues a request that nobody waits for.
    pub(super) fn tell(&mut self, channel: &Name, work: BlobWork) -> u64 {
        self.last += 1;
        self.requests
            .push_back(BlobRequest { number: self.last, channel: channel.clone(), work });
        self.last
    }

    pub(super) fn ask(&mut self, channel: &Name, work: BlobWork, waiting: Waiting) {
        let number = self.tell(channel, work);
        self.waiting.insert(number, waiting);
    }
}
