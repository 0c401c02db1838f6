//! A satellite's commands to blob channels.

use super::super::blob::BlobEntry;
use super::super::{ChannelRef, Command, Event, Flags, Message, Path};
use super::databases::List;
use super::sending::{Kind, Stream};
use super::{SatelliteCore, SatelliteError, SatelliteEvent};
use bytes::Bytes;
use sk_flat::SkVariant;

/// The lines of the table that are about what stands in blob channels, but for `blob_write`.
const BLOB_COMMANDS: std::ops::RangeInclusive<u8> = 0x31..=0x3a;

impl SatelliteCore {
    /// Asks for a blob channel; `Created` or `Refused` with the tag answers. What was in it when it was there last
    /// is there again.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the connection is no ready flow.
    pub fn create_blob(&mut self, name: &str, properties: &SkVariant) -> Result<u32, SatelliteError> {
        let blob = |name, properties| Command::CreateBlob { name, properties };
        self.create_as("create_blob", blob, name, properties)
    }

    /// Sends a command of the blob channels, any but `BlobWrite`. What answers has its tag.
    ///
    /// # Errors
    /// If it is another command, the connection is not ready or not of the kind that has it, or too much waits.
    pub fn blob(&mut self, command: &Command) -> Result<u32, SatelliteError> {
        let line = command.definition();
        let legal = line.states.has(self.inbound.state()) && BLOB_COMMANDS.contains(&line.id);
        if !legal || line.fragment || !self.is_ready() {
            return Err(SatelliteError::State(line.name));
        }
        let tag = match *command {
            // Pieces of the upload before at the same path may wait; the hub must not take them for this one's.
            Command::BlobBegin { channel, .. } | Command::BlobAbort { channel, .. } => {
                let tag = self.tag();
                let fits = self.outbox.command_after(Stream::Upload(channel), command, tag);
                if fits { tag } else { return Err(SatelliteError::Full) }
            }
            _ => self.command(command)?,
        };
        match command {
            Command::BlobList { .. } => drop(self.lists.insert(tag, List::Blobs(Vec::new()))),
            Command::BlobRead { .. } => drop(self.downloads.insert(tag)),
            _ => {}
        }
        Ok(tag)
    }

    /// Sends a piece of an upload that was begun; `Done` with the tag answers when the hub has written it.
    ///
    /// # Errors
    /// If the connection is no ready flow, the piece is too long, or too much waits to be sent.
    pub fn blob_write(
        &mut self,
        channel: ChannelRef,
        path: &str,
        offset: u64,
        payload: Bytes,
    ) -> Result<u32, SatelliteError> {
        self.need_flow("blob_write")?;
        let (length, max) = (payload.len(), self.inbound.message_bytes_max());
        if length > max {
            return Err(SatelliteError::TooLong { length, max });
        }
        let tag = self.tag();
        let kind = Kind::Upload { tag, channel, path: Path(path.to_owned()), offset };
        if self.outbox.message(kind, payload) { Ok(tag) } else { Err(SatelliteError::Full) }
    }

    pub(super) fn on_blob_event(&mut self, tag: u32, flags: Flags, event: Event) {
        let told = match event {
            Event::BlobResume { offset } => SatelliteEvent::BlobResume { tag, offset },
            Event::BlobEntry { directory, bytes, checksum } => {
                let entry = BlobEntry { name: String::new(), is_folder: directory != 0, bytes };
                SatelliteEvent::BlobLooked { tag, entry, checksum }
            }
            Event::BlobListed { name, directory, bytes } => {
                if let Some(List::Blobs(entries)) = self.lists.get_mut(&tag) {
                    entries.push(BlobEntry { name, is_folder: directory != 0, bytes });
                }
                return;
            }
            Event::BlobData { payload } if self.downloads.contains(&tag) => {
                let last = flags.has(Flags::LAST);
                if last {
                    self.downloads.remove(&tag);
                }
                SatelliteEvent::BlobData { tag, payload, last }
            }
            _ => return,
        };
        self.events.push_back(told);
    }

    /// What is left of a piece may still be sent; the hub drops it.
    pub(super) fn on_blob_refused(&mut self, tag: u32) {
        self.downloads.remove(&tag);
    }
}
