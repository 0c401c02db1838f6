//! What a connection may do: one question for every command.

use super::super::{ConnectionId, ServerCore};
use crate::flow::channel::{Channel, Owner};
use crate::flow::rights::Grants;
use crate::flow::{ChannelKind, ChannelRef, Right, Rights};
use std::sync::Arc;

/// What a connection may do. Before the login that is nothing.
#[derive(Clone, Debug)]
pub(in super::super) struct Permission {
    /// The rights that it has for any name at all.
    rights: Rights,
    /// For which names; none: for every name.
    grants: Option<Arc<Grants>>,
}

impl Permission {
    pub(in super::super) const NONE: Permission = Permission { rights: Rights::NONE, grants: None };

    /// These rights, for every name.
    pub(in super::super) fn of(rights: Rights) -> Permission {
        Permission { rights, grants: None }
    }

    /// Those of an account.
    pub(in super::super) fn granted(grants: &Arc<Grants>) -> Permission {
        Permission { rights: grants.rights(), grants: Some(grants.clone()) }
    }

    /// Whether it comes from an account's database, and changes with that.
    pub(in super::super) fn is_of_account(&self) -> bool {
        self.grants.is_some()
    }

    /// Whether it has a right for any name at all: no command goes further without.
    pub(in super::super) fn has(&self, right: Right) -> bool {
        self.rights.has(right)
    }

    /// Whether it has a right for this name.
    pub(in super::super) fn allows(&self, right: Right, name: &str) -> bool {
        self.has(right) && self.grants.as_ref().is_none_or(|grants| grants.has(right, name))
    }

    /// Whether it has a right for every name.
    pub(in super::super) fn allows_everywhere(&self, right: Right) -> bool {
        self.has(right) && self.grants.as_ref().is_none_or(|grants| grants.has_everywhere(right))
    }

    /// Whether a connection with it hears of a channel: of its own, of those that it may list or administer, and of
    /// those that it may make use of.
    pub(in super::super) fn sees(&self, own: ConnectionId, channel: &Channel) -> bool {
        let name = channel.name.as_str();
        channel.owner == Owner::Flow(own.wire())
            || self.allows(Right::List, name)
            || self.allows(using_right(channel.kind), name)
            || self.allows(Right::Administer, name)
    }
}

/// The right to own a channel of this kind.
pub(in super::super) fn owning_right(kind: ChannelKind) -> Right {
    match kind {
        ChannelKind::Stream | ChannelKind::Sync => Right::Publish,
        ChannelKind::Service => Right::Serve,
        ChannelKind::Blob => Right::BlobWrite,
    }
}

/// The right to make use of another's channel of this kind.
fn using_right(kind: ChannelKind) -> Right {
    match kind {
        ChannelKind::Stream | ChannelKind::Sync => Right::Subscribe,
        ChannelKind::Service => Right::Call,
        ChannelKind::Blob => Right::BlobRead,
    }
}

impl ServerCore {
    /// The question that every command asks for the name that it is about.
    pub(in super::super) fn is_allowed(&self, id: ConnectionId, right: Right, name: &str) -> bool {
        self.connections
            .get(id)
            .is_some_and(|connection| connection.rights.allows(right, name))
    }

    /// The same about a channel; one that is gone is nobody's.
    pub(in super::super) fn is_allowed_on(
        &self,
        id: ConnectionId,
        right: Right,
        channel: ChannelRef,
    ) -> bool {
        let known = self.channels.get(channel);
        known.is_some_and(|(known, _)| self.is_allowed(id, right, known.name.as_str()))
    }
}
