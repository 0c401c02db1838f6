//! Channels of one's own: asked for, wanted no more, removed.

use super::super::error::RefusalCode;
use super::super::{ChannelRef, Command, Properties};
use super::{SatelliteCore, SatelliteError, SatelliteEvent};
use sk_flat::{Name, SkVariant};
use std::collections::BTreeMap;

/// What was asked for and is not answered yet.
#[derive(Debug, Default)]
pub(super) struct Creating {
    /// By the tags of the commands.
    asked: BTreeMap<u32, Asked>,
}

#[derive(Debug)]
pub(super) struct Asked {
    full_name: String,
    /// It is wanted no more. It can be removed only once it is known what it is called.
    given_up: bool,
    /// What is to be asked for after that, under the same name.
    next: Option<(u32, Command)>,
}

impl Creating {
    fn insert(&mut self, tag: u32, full_name: String) {
        self.asked.insert(tag, Asked { full_name, given_up: false, next: None });
    }

    /// The hub has answered.
    pub(super) fn answered(&mut self, tag: u32) -> Option<Asked> {
        self.asked.remove(&tag)
    }

    fn is_asked(&self, full_name: &str) -> bool {
        let of_name = self.asked.values().filter(|asked| asked.full_name == full_name);
        of_name.into_iter().any(|asked| !asked.given_up || asked.next.is_some())
    }

    fn given_up(&mut self, full_name: &str) -> Option<&mut Asked> {
        self.asked
            .values_mut()
            .find(|asked| asked.given_up && asked.full_name == full_name)
    }

    fn give_up(&mut self, full_name: &str) {
        for asked in self.asked.values_mut().filter(|asked| asked.full_name == full_name) {
            asked.given_up = true;
            asked.next = None;
        }
    }
}

impl SatelliteCore {
    /// Whether a channel of this full name was asked for, and the hub has not answered.
    pub fn is_creating(&self, full_name: &str) -> bool {
        self.creating.is_asked(full_name)
    }

    /// Asks for a streaming channel; `Created` or `Refused` with the tag answers.
    ///
    /// # Errors
    /// If the name or the properties cannot be, or the connection is no ready flow.
    pub fn create(&mut self, name: &str, properties: &SkVariant) -> Result<u32, SatelliteError> {
        let stream = |name, properties| Command::CreateStream { name, properties };
        self.create_as("create_stream", stream, name, properties)
    }

    pub(super) fn create_as(
        &mut self,
        what: &'static str,
        command: impl FnOnce(String, Properties) -> Command,
        name: &str,
        properties: &SkVariant,
    ) -> Result<u32, SatelliteError> {
        let full = self.full_name(what, name)?;
        let command = command(name.to_owned(), Properties::new(properties)?);
        if self.creating.given_up(&full).is_some() {
            // The hub would refuse it while it has the one that was given up.
            let tag = self.tag();
            if let Some(former) = self.creating.given_up(&full) {
                former.next = Some((tag, command));
            }
            return Ok(tag);
        }
        let tag = self.command(&command)?;
        self.creating.insert(tag, full);
        Ok(tag)
    }

    /// Wants no channel of this name any more that was asked for and is not there yet: it is removed as soon as it
    /// is, and no `Created` tells of it.
    pub fn give_up_creating(&mut self, name: &str) {
        if let Ok(full) = self.full_name("remove_channel", name) {
            self.creating.give_up(&full);
        }
    }

    /// Asks for the end of a channel; `ChannelRemoved` or `Refused` answers.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn remove(&mut self, channel: ChannelRef) -> Result<u32, SatelliteError> {
        self.need_flow("remove_channel")?;
        self.command(&Command::RemoveChannel { channel })
    }

    fn full_name(&self, what: &'static str, name: &str) -> Result<String, SatelliteError> {
        let user = self.user.as_ref().filter(|_| self.is_flow());
        let user = user.ok_or(SatelliteError::State(what))?;
        Ok(Name::compose(user, &Name::new(name)?)?.to_string())
    }

    /// The hub has answered a command that asked for a channel: `channel` is there now, if any. Answers whether
    /// it is wanted.
    pub(super) fn creation_answered(&mut self, asked: Asked, channel: Option<ChannelRef>) -> bool {
        if let Some(channel) = channel.filter(|_| asked.given_up) {
            self.send(&Command::RemoveChannel { channel });
        }
        if let Some((tag, command)) = asked.next {
            if self.outbox.command(&command, tag) {
                self.creating.insert(tag, asked.full_name);
            } else {
                let code = RefusalCode::Full;
                let (code, text) = (code.code(), code.to_string());
                self.events.push_back(SatelliteEvent::Refused { tag, code, text });
            }
        }
        !asked.given_up
    }
}
