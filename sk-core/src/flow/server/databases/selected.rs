//! Who has which database selected, so that the end of one concerns only those, however many connections there are.

use super::super::super::database::DatabaseName;
use super::super::{ConnectionId, ServerCore};
use std::collections::BTreeSet;

/// The connections that have each database selected.
#[derive(Debug, Default)]
pub(in super::super) struct Selected(BTreeSet<(DatabaseName, ConnectionId)>);

impl Selected {
    /// Those who have it selected.
    pub(super) fn of(&self, name: &DatabaseName) -> Vec<ConnectionId> {
        let first = (name.clone(), ConnectionId::from_wire(0));
        let those = self.0.range(first..).take_while(|(selected, _)| selected == name);
        those.map(|(_, id)| *id).collect()
    }

    /// How many connections have one selected.
    #[cfg(test)]
    pub(in super::super) fn len(&self) -> usize {
        self.0.len()
    }
}

impl ServerCore {
    /// Makes a database the current one of a connection, or none; answers the one before.
    pub(in super::super) fn select(
        &mut self,
        id: ConnectionId,
        name: Option<DatabaseName>,
    ) -> Option<DatabaseName> {
        let connection = self.connections.get_mut(id)?;
        if let Some(name) = &name {
            self.selected.0.insert((name.clone(), id));
        }
        let before = std::mem::replace(&mut connection.desk.selected, name);
        if let Some(before) = before
            .as_ref()
            .filter(|before| connection.desk.selected.as_ref() != Some(before))
        {
            self.selected.0.remove(&(before.clone(), id));
        }
        before
    }
}
