//! What the disk answered about blobs, and the downloads that go on with it.

use super::super::super::Event;
use super::super::super::blob::{BlobAnswer, BlobDone, BlobFailure, BlobWork};
use super::super::super::error::{ClosingReason, RefusalCode};
use super::super::super::limits::BLOB_CHUNK_BYTES;
use super::super::super::{Flags, Message as _};
use super::super::connection::talk::{Kind, Talk, TalkKey};
use super::super::connection::telling::Telling;
use super::super::{ConnectionId, ServerCore};
use super::Wish;
use super::desk::{Purpose, Waiting};
use sk_flat::Instant;

/// How many pieces of one download wait for the peer before the disk is asked for the next.
const CHUNKS_AHEAD: usize = 2;

impl ServerCore {
    /// Takes an answer of the disk and tells it to exactly those who wait for it.
    pub fn blob_done(&mut self, answer: BlobAnswer, now: Instant) {
        self.now = now;
        let Some(waiting) = self.filing.waiting.remove(&answer.number) else { return };
        let Waiting { connection: id, tag, purpose } = waiting;
        if let Some(connection) = self.connections.get_mut(id) {
            let blobs = &mut connection.blobs;
            blobs.waiting -= 1;
            if let Purpose::Piece { bytes } = purpose {
                blobs.bytes_ahead -= bytes;
            }
            match answer.outcome {
                // Whoever is being sent away hears nothing more.
                _ if connection.closing.is_some() => {}
                Ok(done) => self.tell_blob(id, tag, purpose, done),
                Err(failure) => {
                    let code = self.code_of(&failure);
                    self.refuse_blob(id, tag, purpose, code);
                }
            }
            self.resume(id);
        }
        self.settle();
    }

    /// What is said of a failure. How the disk fails is for the log, not for peers.
    fn code_of(&mut self, failure: &BlobFailure) -> RefusalCode {
        match failure {
            BlobFailure::Refused(code) => *code,
            BlobFailure::Disk(why) => {
                if let Some(silenced) = self.log.pass(self.now) {
                    tracing::error!(silenced, "the disk failed at a blob: {why}");
                }
                RefusalCode::Storage
            }
        }
    }

    fn refuse_blob(&mut self, id: ConnectionId, tag: u32, purpose: Purpose, code: RefusalCode) {
        match purpose {
            Purpose::Tell | Purpose::Piece { .. } => self.refuse(id, tag, code),
            Purpose::List => self.end_listing(id, tag, code),
            Purpose::Read => self.end_reading(id, tag, code),
        }
    }

    fn tell_blob(&mut self, id: ConnectionId, tag: u32, purpose: Purpose, done: BlobDone) {
        match (purpose, done) {
            (Purpose::List, BlobDone::Entries { entries, end }) => {
                let Some(connection) = self.connections.get_mut(id) else { return };
                let Some(replay) = connection.replay.as_mut().filter(|replay| replay.tag == tag) else {
                    return;
                };
                if let Telling::Blobs(listing) = &mut replay.what {
                    listing.asked = false;
                    listing.after = entries.last().map(|entry| entry.name.clone()).or(listing.after.take());
                    listing.entries.extend(entries);
                    listing.end = end;
                }
                // A page may have had nothing in it that is told.
                self.go_on_listing(id);
                self.mark_dirty(id);
            }
            (Purpose::Read, BlobDone::Data { bytes, file }) => {
                if let Some(reading) = self.reading(id, tag) {
                    reading.file = Some(file);
                }
                self.tell_data(id, tag, bytes);
            }
            (_, BlobDone::Done) => self.answer(id, tag, &Event::Done {}),
            (_, BlobDone::Saved) => self.answer(id, tag, &Event::Saved {}),
            (_, BlobDone::Resume { offset }) => self.answer(id, tag, &Event::BlobResume { offset }),
            (_, BlobDone::Entry { entry, checksum }) => {
                let directory = entry.is_folder.into();
                self.answer(id, tag, &Event::BlobEntry { directory, bytes: entry.bytes, checksum });
            }
            (_, BlobDone::Entries { .. } | BlobDone::Data { .. }) => {
                self.refuse_blob(id, tag, purpose, RefusalCode::Storage);
            }
        }
    }

    fn reading(&mut self, id: ConnectionId, tag: u32) -> Option<&mut super::desk::Reading> {
        self.connections.get_mut(id)?.blobs.reads.get_mut(&tag)
    }

    /// Queues bytes of a download for the peer.
    fn tell_data(&mut self, id: ConnectionId, tag: u32, bytes: bytes::Bytes) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        let Some(reading) = connection.blobs.reads.get_mut(&tag) else { return };
        reading.asked = false;
        let wanted = chunk(reading.next, reading.end);
        let last = bytes.len() < wanted || reading.next + bytes.len() as u64 >= reading.end;
        let kind = Kind::Blob { tag, first: !reading.begun, last };
        let length = bytes.len() as u64;
        // What finds no room is read again when there is some.
        if connection
            .output
            .talk(Talk::new(kind, [bytes].into_iter().collect(), &self.budget))
        {
            reading.next += length;
            reading.begun = true;
            if last {
                connection.blobs.reads.remove(&tag);
            }
            self.mark_dirty(id);
        }
        self.go_on_reading(id);
    }

    /// A download ends before its end; that must not overtake what was queued of it.
    fn end_reading(&mut self, id: ConnectionId, tag: u32, code: RefusalCode) {
        let Some(connection) = self.connections.get_mut(id) else { return };
        connection.blobs.reads.remove(&tag);
        if connection.closing.is_some() {
            return;
        }
        let frame = Event::Refused { code: code.code(), text: code.to_string() }.encode(tag, Flags::NONE);
        if !connection.output.control_after(TalkKey::Blob(tag), frame) {
            self.to_close.push_back((id, ClosingReason::ControlFull));
        }
        self.mark_dirty(id);
    }

    /// Asks the disk for what the downloads of a connection want next: no more than its peer takes, so that a slow
    /// one costs little.
    pub(in super::super) fn go_on_reading(&mut self, id: ConnectionId) {
        let Some(connection) = self.connections.get(id) else { return };
        if connection.blobs.reads.is_empty() || connection.closing.is_some() {
            return;
        }
        let output = &connection.output;
        let has_room = output.has_room_for(BLOB_CHUNK_BYTES);
        let dry = |tag: u32| output.talks_waiting(TalkKey::Blob(tag)) < CHUNKS_AHEAD;
        let tags: Vec<u32> = connection
            .blobs
            .reads
            .iter()
            .filter(|(tag, reading)| !reading.asked && has_room && dry(**tag))
            .map(|(tag, _)| *tag)
            .collect();
        for tag in tags {
            let Some(reading) = self.reading(id, tag) else { continue };
            reading.asked = true;
            let (channel, path, file) = (reading.channel, reading.path.clone(), reading.file.clone());
            let (offset, bytes) = (reading.next, chunk(reading.next, reading.end));
            match self.blob_channel(id, channel, Wish::Read) {
                Ok(name) => {
                    let work = BlobWork::Read { path, file, offset, bytes };
                    self.ask_disk(id, tag, &name, work, Purpose::Read);
                }
                Err(code) => self.end_reading(id, tag, code),
            }
        }
    }
}

/// How many bytes the next piece of a download has at most.
fn chunk(next: u64, end: u64) -> usize {
    usize::try_from(end.saturating_sub(next)).map_or(BLOB_CHUNK_BYTES, |left| left.min(BLOB_CHUNK_BYTES))
}
