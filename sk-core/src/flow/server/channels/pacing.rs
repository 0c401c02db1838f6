//! What is told to everybody is limited in bytes: whoever announces much waits, so that the queues of others do not fill
//! faster than they can be written.

use super::super::super::Command;
use super::super::super::definition::Tagged;
use super::super::super::limits::ANNOUNCED_BYTES_MAX;
use super::super::{ConnectionId, ServerCore};

/// What was announced since deadlines were looked at last, and who waits with more.
#[derive(Debug, Default)]
pub(in super::super) struct Announced {
    bytes: usize,
    /// In the order in which they came.
    waiting: Vec<ConnectionId>,
}

impl Announced {
    /// Notes that so many bytes went to each of many.
    pub(super) fn add(&mut self, bytes: usize) {
        self.bytes += bytes;
    }
}

impl ServerCore {
    /// Whether a command has to wait for what was announced before it.
    pub(in super::super) fn must_wait(&self, command: &Command) -> bool {
        self.announced.bytes >= ANNOUNCED_BYTES_MAX
            && matches!(
                command,
                Command::CreateStream { .. }
                    | Command::CreateSync { .. }
                    | Command::CreateService { .. }
                    | Command::CreateBlob { .. }
                    | Command::ChangeHeader { .. }
                    | Command::RemoveChannel { .. }
            )
    }

    /// The command, and those of the connection behind it, are looked at again when deadlines are.
    pub(in super::super) fn pace(&mut self, id: ConnectionId, command: Tagged<Command>) {
        if let Some(connection) = self.connections.get_mut(id) {
            connection.paced = Some(Box::new(command));
            connection.is_paced = true;
            self.announced.waiting.push(id);
        }
    }

    /// What was announced has had time to be written.
    pub(in super::super) fn go_on_announcing(&mut self) {
        self.announced.bytes = 0;
        for id in std::mem::take(&mut self.announced.waiting) {
            if let Some(connection) = self.connections.get_mut(id) {
                connection.is_paced = false;
                self.enqueue(id);
            }
        }
    }
}
