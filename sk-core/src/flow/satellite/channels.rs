//! What a satellite can do with channels beside publishing and hearing: change, repeat, poll.

use super::super::{ChannelRef, Command, Form, Properties};
use super::{SatelliteCore, SatelliteError};
use sk_flat::SkVariant;

impl SatelliteCore {
    /// Changes what a channel of one's own says about itself; `HeaderChanged` or `Refused` with the tag answers.
    ///
    /// # Errors
    /// If the properties cannot be sent, or the connection is no ready flow.
    pub fn change_header(
        &mut self,
        channel: ChannelRef,
        properties: &SkVariant,
    ) -> Result<u32, SatelliteError> {
        self.need_flow("change_header")?;
        let properties = Properties::new(properties)?;
        self.command(&Command::ChangeHeader { channel, properties })
    }

    /// Lets a channel of one's own repeat another one; `Attached` or `Refused` with the tag answers.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn attach(&mut self, replica: ChannelRef, source: ChannelRef) -> Result<u32, SatelliteError> {
        self.need_flow("attach")?;
        self.command(&Command::Attach { replica, source })
    }

    /// Ends the repeating; `Detached` with the tag answers.
    ///
    /// # Errors
    /// If the connection is no ready flow, or too much waits.
    pub fn detach(&mut self, replica: ChannelRef) -> Result<u32, SatelliteError> {
        self.need_flow("detach")?;
        self.command(&Command::Detach { replica })
    }

    /// Asks the hub to keep the newest message of a channel for this connection; `Done` or `Refused` answers.
    ///
    /// # Errors
    /// If the connection is not a ready synchronous one.
    pub fn poll_register(&mut self, channel: ChannelRef) -> Result<u32, SatelliteError> {
        self.need_synchronous("poll_register")?;
        self.command(&Command::PollRegister { channel })
    }

    /// Ends that; `Done` answers.
    ///
    /// # Errors
    /// If the connection is not a ready synchronous one.
    pub fn poll_deregister(&mut self, channel: ChannelRef) -> Result<u32, SatelliteError> {
        self.need_synchronous("poll_deregister")?;
        self.command(&Command::PollDeregister { channel })
    }

    /// Asks for the newest message of a channel that was registered for; `Latest` or `Refused` answers.
    ///
    /// # Errors
    /// If the connection is not a ready synchronous one.
    pub fn poll(&mut self, channel: ChannelRef) -> Result<u32, SatelliteError> {
        self.need_synchronous("poll")?;
        self.command(&Command::Poll { channel })
    }

    /// Asks what the hub knows of itself; `Value` or `Refused` with the tag answers. The subjects, and the types
    /// to read the answers with, are those of [`report`](crate::flow::report).
    ///
    /// # Errors
    /// If the connection is not ready, or too much waits.
    pub fn inspect(&mut self, subject: &str) -> Result<u32, SatelliteError> {
        if !self.is_ready() {
            return Err(SatelliteError::State("inspect"));
        }
        self.command(&Command::Inspect { subject: subject.to_owned(), form: Form::Binary })
    }

    fn need_synchronous(&self, command: &'static str) -> Result<(), SatelliteError> {
        if self.wants_flow || !self.is_ready() { Err(SatelliteError::State(command)) } else { Ok(()) }
    }
}
