//! Who may read and write which database.

use super::super::super::Right;
use super::super::super::channel::Owner;
use super::super::super::database::{DatabaseKind, DatabaseName, Entity};
use super::super::{ConnectionId, ServerCore};

/// What somebody wants to do with a database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
}

impl ServerCore {
    /// The one check of rights to a database. Flows write their own, owners those of their channels, for which
    /// the right for any name is enough; administrators all; named ones are open to whoever has the right for the
    /// name. So is reading, but for the database of another account.
    pub(super) fn may(&self, id: ConnectionId, name: &DatabaseName, access: Access) -> bool {
        let Some(connection) = self.connections.get(id) else { return false };
        let rights = &connection.rights;
        if rights.allows_everywhere(Right::Administer) {
            return true;
        }
        let kind = name.kind();
        match access {
            Access::Read if kind == DatabaseKind::User => {
                rights.has(Right::DatabaseRead) && self.is_of_account(id, name)
            }
            Access::Read => {
                rights.allows(Right::DatabaseRead, name.as_str())
                    || rights.has(Right::DatabaseRead) && self.is_own(id, name)
            }
            // Here are the rights themselves.
            Access::Write if matches!(kind, DatabaseKind::User | DatabaseKind::Hub) => false,
            Access::Write if rights.allows(Right::Administer, name.as_str()) => true,
            Access::Write if kind == DatabaseKind::Named => {
                rights.allows(Right::DatabaseWrite, name.as_str())
            }
            Access::Write => rights.has(Right::DatabaseWrite) && self.is_own(id, name),
        }
    }

    pub(in super::super) fn may_read(&self, id: ConnectionId, name: &DatabaseName) -> bool {
        self.may(id, name, Access::Read)
    }

    /// Whether it may know that there is such a database.
    pub(in super::super) fn may_see(&self, id: ConnectionId, name: &DatabaseName) -> bool {
        self.is_allowed(id, Right::List, name.as_str())
            || self.may(id, name, Access::Read)
            || self.may(id, name, Access::Write)
    }

    fn is_of_account(&self, id: ConnectionId, name: &DatabaseName) -> bool {
        let user = self.connections.get(id).and_then(|connection| connection.user.as_ref());
        user.is_some_and(|user| name.account() == Some(user.as_str()))
    }

    /// Whether it is this flow's, or of a channel of this flow's.
    fn is_own(&self, id: ConnectionId, name: &DatabaseName) -> bool {
        match self.databases.entity(name) {
            Some(Entity::Flow(flow)) => flow == id.wire(),
            Some(Entity::Channel(channel)) => {
                let known = self.channels.get(channel);
                known.is_some_and(|(channel, _)| channel.owner == Owner::Flow(id.wire()))
            }
            Some(Entity::User | Entity::Hub) => false,
            // What was saved of one that is not there now.
            None => self.is_of_account(id, name),
        }
    }
}
