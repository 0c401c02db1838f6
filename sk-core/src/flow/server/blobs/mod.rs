//! Blob channels at the hub: who may do what, uploads in, listings and downloads out. The files themselves are the
//! disk's business.

mod answers;
pub(super) mod desk;

use super::super::blob::{BlobPath, BlobRequest, BlobWork};
use super::super::channel::Owner;
use super::super::error::{ProtocolError, RefusalCode};
use super::super::fragment::Gathered;
use super::super::limits::{BLOB_READS_PER_CONNECTION_MAX, BLOB_REQUESTS_PER_CONNECTION_MAX};
use super::super::{ChannelKind, ChannelRef, Command, Flags, Form, Properties, Right};
use super::connection::incoming::Incoming;
use super::connection::telling::Telling;
use super::{ConnectionId, ServerCore};
use crate::testing::{Bug, is_planted};
use bytes::Bytes;
use desk::{Listing, Purpose, Reading, Waiting};
use sk_flat::Name;
use std::collections::VecDeque;

/// The fields of a `blob_write`.
pub(super) struct UploadPiece {
    pub(super) channel: ChannelRef,
    pub(super) path: String,
    pub(super) offset: u64,
    pub(super) payload: Bytes,
}

/// What one wants of a blob channel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wish {
    Read,
    Change,
}

impl ServerCore {
    /// Offers blob channels, from here on. Whoever runs the hub hands the requests of
    /// [`next_blob_request`](ServerCore::next_blob_request) to a [`BlobStore`](super::super::blob::BlobStore) and
    /// its answers to [`blob_done`](ServerCore::blob_done).
    pub fn keep_blobs(&mut self) {
        self.filing.on = true;
    }

    /// The next thing for the disk to do with blobs. Those of one channel are to be done in this order.
    pub fn next_blob_request(&mut self) -> Option<BlobRequest> {
        self.filing.requests.pop_front()
    }

    /// Whether [`next_blob_request`](ServerCore::next_blob_request) would answer one.
    pub fn has_blob_requests(&self) -> bool {
        !self.filing.requests.is_empty()
    }

    /// How many requests about blobs somebody waits for.
    pub fn unanswered_blob_requests(&self) -> usize {
        self.filing.waiting.len()
    }

    pub(super) fn create_blob(&mut self, id: ConnectionId, tag: u32, name: &str, properties: Properties) {
        if self.filing.on {
            self.create_channel(id, tag, ChannelKind::Blob, name, properties);
        } else {
            self.refuse(id, tag, RefusalCode::NotOffered);
        }
    }

    /// The channel is gone; its files stay.
    pub(super) fn end_blob(&mut self, name: &Name) {
        self.filing.tell(name, BlobWork::Close);
    }

    /// The full name of a blob channel, if this connection may do there what it wants. It is asked again for each
    /// piece of a listing or a download, so that a right that is revoked ends what is under way.
    fn blob_channel(&self, id: ConnectionId, channel: ChannelRef, wish: Wish) -> Result<Name, RefusalCode> {
        let (known, _) = self.channels.get(channel).ok_or(RefusalCode::Gone)?;
        let right = match wish {
            Wish::Read => Right::BlobRead,
            Wish::Change => Right::BlobWrite,
        };
        if !self.is_allowed(id, right, known.name.as_str()) && !is_planted(Bug::RightsSkipped) {
            return Err(RefusalCode::Denied);
        }
        if known.kind != ChannelKind::Blob {
            return Err(RefusalCode::WrongKind);
        }
        if wish == Wish::Change && known.owner != Owner::Flow(id.wire()) {
            return Err(RefusalCode::NotOwner);
        }
        Ok(known.name.clone())
    }

    pub(super) fn blob_command(&mut self, id: ConnectionId, tag: u32, command: Command) {
        if let Err(code) = self.do_blob_command(id, tag, command) {
            self.refuse(id, tag, code);
        }
    }

    fn do_blob_command(&mut self, id: ConnectionId, tag: u32, command: Command) -> Result<(), RefusalCode> {
        let change = |channel| self.blob_channel(id, channel, Wish::Change);
        let (name, work) = match command {
            Command::BlobBegin { channel, path, bytes, checksum } => {
                (change(channel)?, BlobWork::Begin { path: BlobPath::parse(&path.0)?, bytes, checksum })
            }
            Command::BlobCommit { channel, path } => {
                (change(channel)?, BlobWork::Commit { path: BlobPath::parse(&path.0)? })
            }
            Command::BlobAbort { channel, path } => {
                (change(channel)?, BlobWork::Abort { path: BlobPath::parse(&path.0)? })
            }
            Command::BlobMkdir { channel, path } => {
                (change(channel)?, BlobWork::MakeFolder { path: BlobPath::parse(&path.0)? })
            }
            Command::BlobMove { channel, from, to } => {
                let (from, to) = (BlobPath::parse(&from.0)?, BlobPath::parse(&to.0)?);
                (change(channel)?, BlobWork::Move { from, to })
            }
            Command::BlobRemove { channel, path } => {
                (change(channel)?, BlobWork::Remove { path: BlobPath::parse(&path.0)? })
            }
            Command::BlobStat { channel, path } => {
                let name = self.blob_channel(id, channel, Wish::Read)?;
                (name, BlobWork::Look { path: BlobPath::parse_folder(&path.0)? })
            }
            Command::BlobList { channel, path } => return self.blob_list(id, tag, channel, &path.0),
            Command::BlobRead { channel, path, offset, bytes } => {
                return self.blob_read(
                    id,
                    tag,
                    channel,
                    &path.0,
                    offset..offset.saturating_add(bytes.into()),
                );
            }
            _ => return Err(RefusalCode::NotOffered),
        };
        self.ask_disk(id, tag, &name, work, Purpose::Tell);
        Ok(())
    }

    fn ask_disk(&mut self, id: ConnectionId, tag: u32, name: &Name, work: BlobWork, purpose: Purpose) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.blobs.waiting += 1;
        self.filing.ask(name, work, Waiting { connection: id, tag, purpose });
    }

    fn blob_list(
        &mut self,
        id: ConnectionId,
        tag: u32,
        channel: ChannelRef,
        path: &str,
    ) -> Result<(), RefusalCode> {
        self.blob_channel(id, channel, Wish::Read)?;
        let path = BlobPath::parse_folder(path)?;
        let (entries, after) = (VecDeque::new(), None);
        let listing = Listing { channel, path, entries, after, asked: false, end: false };
        self.tell_list(id, tag, Form::Binary, Telling::Blobs(listing));
        self.go_on_listing(id);
        Ok(())
    }

    /// Asks the disk for more of the listing that is being told to this connection, if it waits for that.
    pub(super) fn go_on_listing(&mut self, id: ConnectionId) {
        let Some(replay) = self.connections.get_mut(id).and_then(|found| found.replay.as_mut()) else {
            return;
        };
        let tag = replay.tag;
        let Telling::Blobs(listing) = &mut replay.what else { return };
        if listing.asked || !listing.waits() {
            return;
        }
        listing.asked = true;
        let (channel, path, after) = (listing.channel, listing.path.clone(), listing.after.clone());
        match self.blob_channel(id, channel, Wish::Read) {
            Ok(name) => self.ask_disk(id, tag, &name, BlobWork::List { path, after }, Purpose::List),
            Err(code) => self.end_listing(id, tag, code),
        }
    }

    fn end_listing(&mut self, id: ConnectionId, tag: u32, code: RefusalCode) {
        if let Some(connection) = self.connections.get_mut(id) {
            connection.replay = None;
            self.refuse(id, tag, code);
            self.resume(id);
        }
    }

    fn blob_read(
        &mut self,
        id: ConnectionId,
        tag: u32,
        channel: ChannelRef,
        path: &str,
        range: std::ops::Range<u64>,
    ) -> Result<(), RefusalCode> {
        self.blob_channel(id, channel, Wish::Read)?;
        let path = BlobPath::parse(path)?;
        let connection = self.connections.get_mut(id).ok_or(RefusalCode::Denied)?;
        let reads = &mut connection.blobs.reads;
        if reads.len() >= BLOB_READS_PER_CONNECTION_MAX || reads.contains_key(&tag) {
            return Err(RefusalCode::TooManyRequests);
        }
        let (next, end) = (range.start, range.end);
        reads.insert(tag, Reading { channel, path, file: None, next, end, asked: false, begun: false });
        self.go_on_reading(id);
        Ok(())
    }

    /// One fragment of a piece of an upload. A piece that is refused at its first fragment leaves no trace: what
    /// follows of it is dropped and counted.
    pub(super) fn blob_write(
        &mut self,
        id: ConnectionId,
        tag: u32,
        flags: Flags,
        piece: UploadPiece,
    ) -> Result<(), ProtocolError> {
        let Some(connection) = self.connections.get(id) else { return Ok(()) };
        let known = connection.blobs.writing.contains(&tag);
        if flags.has(Flags::FIRST) {
            if known {
                return Err(ProtocolError::BadValue { kind: "blob_write", field: "tag", value: tag.into() });
            }
            let is_crowded = connection.blobs.writing.len() >= BLOB_REQUESTS_PER_CONNECTION_MAX;
            let room = if is_crowded { Err(RefusalCode::TooManyRequests) } else { Ok(()) };
            let checked = room.and_then(|()| self.blob_channel(id, piece.channel, Wish::Change));
            if let Err(code) = checked.and_then(|_| BlobPath::parse(&piece.path)) {
                self.late_fragments += u64::from(!flags.has(Flags::LAST));
                self.refuse(id, tag, code);
                return Ok(());
            }
        } else if !known {
            self.late_fragments += 1;
            return Ok(());
        }
        self.make_room_for_fragment(id, flags, piece.payload.len());
        let Some(connection) = self.connections.get_mut(id) else { return Ok(()) };
        let bytes_max = connection.inbound.message_bytes_max();
        let gathered =
            connection
                .gathering
                .take(Incoming::Upload(tag), tag, flags, piece.payload, bytes_max)?;
        let writing = &mut connection.blobs.writing;
        match gathered {
            Gathered::More => drop(writing.insert(tag)),
            Gathered::Ignored => {}
            Gathered::Aborted => drop(writing.remove(&tag)),
            Gathered::Overfull => self.give_up_piece(id, tag),
            Gathered::Whole(pieces) => {
                writing.remove(&tag);
                let checked = self.blob_channel(id, piece.channel, Wish::Change);
                match checked.and_then(|name| Ok((name, BlobPath::parse(&piece.path)?))) {
                    Ok((name, path)) => {
                        let bytes = pieces.iter().map(Bytes::len).sum();
                        if let Some(connection) = self.connections.get_mut(id) {
                            connection.blobs.bytes_ahead += bytes;
                        }
                        let work = BlobWork::Write { path, offset: piece.offset, pieces };
                        self.ask_disk(id, tag, &name, work, Purpose::Piece { bytes });
                    }
                    Err(code) => self.refuse(id, tag, code),
                }
            }
        }
        Ok(())
    }

    /// There is no room for a piece that is coming in.
    pub(super) fn give_up_piece(&mut self, id: ConnectionId, tag: u32) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.gathering.forget(Incoming::Upload(tag));
        connection.blobs.writing.remove(&tag);
        self.refuse(id, tag, RefusalCode::Full);
    }
}
