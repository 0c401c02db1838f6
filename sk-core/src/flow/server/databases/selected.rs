//! Who has which database selected, so that the end of one concerns only those, however many connections there are.

use super::super::super::database::DatabaseName;
use super::super::{ConnectionId, ServerCore};
use std::collections::{BTreeMap, BTreeSet};

/// The connections that have each database selected.
#[derive(Debug, Default)]
pub(in super::super) struct Selected {
    by_database: BTreeMap<DatabaseName, BTreeSet<ConnectionId>>,
}

impl Selected {
    fn add(&mut self, name: &DatabaseName, id: ConnectionId) {
        match self.by_database.get_mut(name) {
            Some(those) => drop(those.insert(id)),
            None => drop(self.by_database.insert(name.clone(), BTreeSet::from([id]))),
        }
    }

    fn remove(&mut self, name: &DatabaseName, id: ConnectionId) {
        if let Some(those) = self.by_database.get_mut(name) {
            those.remove(&id);
            if those.is_empty() {
                self.by_database.remove(name);
            }
        }
    }

    /// Those who have it selected.
    pub(super) fn of(&self, name: &DatabaseName) -> Vec<ConnectionId> {
        self.by_database.get(name).into_iter().flatten().copied().collect()
    }

    /// How many databases somebody has selected.
    #[cfg(test)]
    pub(in super::super) fn len(&self) -> usize {
        self.by_database.len()
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
            self.selected.add(name, id);
        }
        let before = std::mem::replace(&mut connection.desk.selected, name);
        if let Some(before) = before
            .as_ref()
            .filter(|before| connection.desk.selected.as_ref() != Some(before))
        {
            self.selected.remove(before, id);
        }
        before
    }
}
