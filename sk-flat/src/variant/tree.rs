//! The two containers of a variant. They are shared when cloned, and they fall without recursion.

use super::SkVariant;
use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

static NO_ITEMS: Vec<SkVariant> = Vec::new();
static NO_ENTRIES: BTreeMap<String, SkVariant> = BTreeMap::new();

/// A list of variants: a `Vec<SkVariant>` that is shared when cloned.
///
/// It reads and changes as the `Vec` it holds. The first change of a shared list copies its top
/// level only; what lies below stays shared. An empty list owns no memory.
///
/// ```
/// use sk_flat::{SkList, SkVariant};
///
/// let mut list = SkList::from(vec![SkVariant::from(1), SkVariant::from("two")]);
/// let before = list.clone();
/// list.push(SkVariant::Null);
/// assert_eq!((before.len(), list.len()), (2, 3));
/// ```
#[derive(Clone, Default)]
pub struct SkList(Option<Arc<Vec<SkVariant>>>);

/// A map of variants, ordered by key: a `BTreeMap<String, SkVariant>` that is shared when cloned.
///
/// It reads and changes as the `BTreeMap` it holds. The first change of a shared map copies its
/// top level only. An empty map owns no memory.
///
/// ```
/// use sk_flat::SkMap;
///
/// let mut map = SkMap::default();
/// map.insert("volt".into(), 12.4.into());
/// map.insert("amp".into(), 3.into());
/// assert_eq!(map.keys().collect::<Vec<_>>(), ["amp", "volt"]);
/// ```
#[derive(Clone, Default)]
pub struct SkMap(Option<Arc<BTreeMap<String, SkVariant>>>);

impl SkList {
    /// An empty list.
    pub const fn new() -> SkList {
        SkList(None)
    }

    /// The `Vec` inside: moved out if nobody shares it, else a copy of its top level.
    pub fn into_inner(mut self) -> Vec<SkVariant> {
        self.0.take().map(Arc::unwrap_or_clone).unwrap_or_default()
    }

    /// Whether both are the same memory, so that they are equal without a look.
    pub(super) fn same_memory(&self, other: &SkList) -> bool {
        match (&self.0, &other.0) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        }
    }
}

impl SkMap {
    /// An empty map.
    pub const fn new() -> SkMap {
        SkMap(None)
    }

    /// The `BTreeMap` inside: moved out if nobody shares it, else a copy of its top level.
    pub fn into_inner(mut self) -> BTreeMap<String, SkVariant> {
        self.0.take().map(Arc::unwrap_or_clone).unwrap_or_default()
    }

    /// Whether both are the same memory, so that they are equal without a look.
    pub(super) fn same_memory(&self, other: &SkMap) -> bool {
        match (&self.0, &other.0) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        }
    }
}

impl Deref for SkList {
    type Target = Vec<SkVariant>;
    fn deref(&self) -> &Vec<SkVariant> {
        self.0.as_deref().unwrap_or(&NO_ITEMS)
    }
}

impl DerefMut for SkList {
    fn deref_mut(&mut self) -> &mut Vec<SkVariant> {
        Arc::make_mut(self.0.get_or_insert_default())
    }
}

impl Deref for SkMap {
    type Target = BTreeMap<String, SkVariant>;
    fn deref(&self) -> &BTreeMap<String, SkVariant> {
        self.0.as_deref().unwrap_or(&NO_ENTRIES)
    }
}

impl DerefMut for SkMap {
    fn deref_mut(&mut self) -> &mut BTreeMap<String, SkVariant> {
        Arc::make_mut(self.0.get_or_insert_default())
    }
}

impl From<Vec<SkVariant>> for SkList {
    fn from(items: Vec<SkVariant>) -> SkList {
        SkList(if items.is_empty() { None } else { Some(Arc::new(items)) })
    }
}

impl From<BTreeMap<String, SkVariant>> for SkMap {
    fn from(entries: BTreeMap<String, SkVariant>) -> SkMap {
        SkMap(if entries.is_empty() { None } else { Some(Arc::new(entries)) })
    }
}

impl FromIterator<SkVariant> for SkList {
    fn from_iter<I: IntoIterator<Item = SkVariant>>(items: I) -> SkList {
        SkList::from(items.into_iter().collect::<Vec<_>>())
    }
}

impl FromIterator<(String, SkVariant)> for SkMap {
    fn from_iter<I: IntoIterator<Item = (String, SkVariant)>>(entries: I) -> SkMap {
        SkMap::from(entries.into_iter().collect::<BTreeMap<_, _>>())
    }
}

// A tree may be deeper than the stack can unwind, since a user's code builds what it likes. So the
// last owner of a container takes its children out and buries them from a heap-allocated stack.
impl Drop for SkList {
    fn drop(&mut self) {
        if self.iter().any(SkVariant::has_children) {
            bury(SkVariant::List(SkList(self.0.take())));
        }
    }
}

impl Drop for SkMap {
    fn drop(&mut self) {
        if self.values().any(SkVariant::has_children) {
            bury(SkVariant::Map(SkMap(self.0.take())));
        }
    }
}

fn bury(top: SkVariant) {
    let mut waiting = vec![top];
    while let Some(value) = waiting.pop() {
        match value {
            SkVariant::List(mut list) => {
                // `into_inner` answers the contents to exactly one of several last owners.
                if let Some(items) = list.0.take().and_then(Arc::into_inner) {
                    waiting.extend(items.into_iter().filter(SkVariant::has_children));
                }
            }
            SkVariant::Map(mut map) => {
                if let Some(entries) = map.0.take().and_then(Arc::into_inner) {
                    waiting.extend(entries.into_values().filter(SkVariant::has_children));
                }
            }
            _ => {}
        }
    }
}

impl SkVariant {
    fn has_children(&self) -> bool {
        match self {
            SkVariant::List(list) => !list.is_empty(),
            SkVariant::Map(map) => !map.is_empty(),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEPTH: usize = 100_000;

    fn deep_list() -> SkVariant {
        (0..DEPTH).fold(SkVariant::Null, |below, _| SkVariant::List(SkList::from(vec![below, 1.into()])))
    }

    fn deep_map() -> SkVariant {
        (0..DEPTH).fold(SkVariant::Null, |below, _| {
            SkVariant::Map([("below".to_owned(), below)].into_iter().collect())
        })
    }

    #[test]
    fn a_deep_tree_falls_without_recursion() {
        drop(deep_list());
        drop(deep_map());
    }

    #[test]
    fn a_deep_tree_that_is_shared_falls_with_its_last_owner() {
        let tree = deep_list();
        let twin = tree.clone();
        drop(tree);
        assert_eq!(twin.as_list().map(<[SkVariant]>::len), Some(2));
    }

    #[test]
    fn a_change_of_a_shared_container_is_not_seen_by_the_others() {
        let first = SkList::from(vec![SkVariant::from(1)]);
        let mut second = first.clone();
        second[0] = SkVariant::from(2);
        assert_eq!(first[0], SkVariant::from(1));
        assert_eq!(second.into_inner(), vec![SkVariant::from(2)]);
    }
}
