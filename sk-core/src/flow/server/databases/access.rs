//! Who may read and write which database.

use super::super::super::channel::Owner;
use super::super::super::database::{DatabaseKind, DatabaseName, Entity};
use super::super::super::{Right, Rights};
use super::super::{ConnectionId, ServerCore};

/// What somebody wants to do with a database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
}

impl ServerCore {
    /// Changes what a connection may do, from its next command on. Watches that it has no right to any more end.
    pub fn change_rights(&mut self, id: ConnectionId, rights: Rights) {
        if let Some(connection) = self.connections.get_mut(id) {
            connection.rights = rights;
            self.recheck_watches(id);
            self.settle();
        }
    }

    /// The one check of rights to a database. Flows write their own, owners those of their channels,
    /// administrators all, and named ones are open to whoever has the right to write databases. Everybody with
    /// the right to read may read, but for another account's.
    pub(super) fn may(&self, id: ConnectionId, name: &DatabaseName, access: Access) -> bool {
        let Some(connection) = self.connections.get(id) else { return false };
        if connection.rights.has(Right::Administer) {
            return true;
        }
        let own_account = || {
            let user = connection.user.as_ref();
            user.is_some_and(|user| name.account() == Some(user.as_str()))
        };
        match (access, name.kind()) {
            (Access::Read, DatabaseKind::User) => connection.rights.has(Right::DatabaseRead) && own_account(),
            (Access::Read, _) => connection.rights.has(Right::DatabaseRead),
            (Access::Write, DatabaseKind::User) => false,
            (Access::Write, DatabaseKind::Named) => connection.rights.has(Right::DatabaseWrite),
            (Access::Write, DatabaseKind::Flow | DatabaseKind::Channel) => {
                let own = match self.databases.entity(name) {
                    Some(Entity::Flow(flow)) => flow == id.wire(),
                    Some(Entity::Channel(channel)) => {
                        let known = self.channels.get(channel);
                        known.is_some_and(|(channel, _)| channel.owner == Owner::Flow(id.wire()))
                    }
                    Some(Entity::User) => false,
                    // What was saved of one that is not there now.
                    None => own_account(),
                };
                connection.rights.has(Right::DatabaseWrite) && own
            }
        }
    }
}
