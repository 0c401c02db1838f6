//! The objects of one loop: a slab with generations, in which every entry knows its place in the trees.

use crate::object::{AnyNode, ObjectId};
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};

const NONE: u32 = u32::MAX;
/// How many objects one loop can hold at once.
pub(crate) const OBJECTS_MAX: u32 = u32::MAX - 1;

/// Loops are numbered so that an id that strays to another loop names nobody there. The number is an
/// identity and nothing else: no behaviour, order or output depends on it.
static NEXT_LOOP: AtomicU32 = AtomicU32::new(1);

/// Why a name was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NameError {
    /// Names are parts of paths.
    #[error("the name {0:?} is empty or contains `/`, which separates the names of a path")]
    Malformed(String),
    /// A sibling bears it.
    #[error("the name {0:?} is taken by a sibling")]
    Taken(String),
    /// The parent does not exist any more.
    #[error("the parent {0} is gone")]
    NoParent(ObjectId),
}

/// Where a new object is put.
#[derive(Clone, Copy, Default)]
pub(crate) struct Placement<'a> {
    pub parent: Option<ObjectId>,
    pub name: Option<&'a str>,
}

/// 40 bytes beside the node itself. `first_child.previous` is the last child, so that appending and
/// unlinking are O(1) without a second pointer in the parent.
struct Entry {
    node: Option<Rc<dyn AnyNode>>,
    generation: u32,
    parent: u32,
    first_child: u32,
    previous: u32,
    /// The next sibling, or the next free entry.
    next: u32,
    occupied: bool,
    named: bool,
}

pub(crate) struct Table {
    entries: Vec<Entry>,
    free: u32,
    first_root: u32,
    loop_number: u32,
    living: u32,
    /// Only named objects stand here. Ordered, so that no hash order can reach any output.
    by_name: BTreeMap<(u32, Box<str>), u32>,
    names: BTreeMap<u32, Box<str>>,
}

impl Table {
    pub(crate) fn new() -> Table {
        Table {
            entries: Vec::new(),
            free: NONE,
            first_root: NONE,
            loop_number: NEXT_LOOP.fetch_add(1, Ordering::Relaxed),
            living: 0,
            by_name: BTreeMap::new(),
            names: BTreeMap::new(),
        }
    }

    pub(crate) fn loop_number(&self) -> u32 {
        self.loop_number
    }

    /// How many objects there are.
    pub(crate) fn living(&self) -> u32 {
        self.living
    }

    fn entry(&self, id: ObjectId) -> Option<&Entry> {
        let entry = self.entries.get(id.index as usize)?;
        (entry.generation == id.generation && entry.occupied && id.loop_number == self.loop_number)
            .then_some(entry)
    }

    pub(crate) fn exists(&self, id: ObjectId) -> bool {
        self.entry(id).is_some()
    }

    /// The node, unless the object is gone or still being constructed.
    pub(crate) fn node(&self, id: ObjectId) -> Option<&Rc<dyn AnyNode>> {
        self.entry(id)?.node.as_ref()
    }

    /// Takes an entry and links it into its tree; the node follows with [`fill`](Table::fill).
    pub(crate) fn reserve(&mut self, placement: Placement<'_>) -> Result<ObjectId, NameError> {
        let parent = match placement.parent {
            None => NONE,
            Some(id) => self.entry(id).map(|_| id.index).ok_or(NameError::NoParent(id))?,
        };
        if let Some(name) = placement.name {
            self.check_name(parent, name)?;
        }
        let index = self.take_free();
        self.link(index, parent);
        if let Some(name) = placement.name {
            self.entries[index as usize].named = true;
            self.by_name.insert((parent, name.into()), index);
            self.names.insert(index, name.into());
        }
        self.living += 1;
        Ok(ObjectId {
            loop_number: self.loop_number,
            index,
            generation: self.entries[index as usize].generation,
        })
    }

    fn check_name(&self, parent: u32, name: &str) -> Result<(), NameError> {
        if name.is_empty() || name.contains('/') {
            return Err(NameError::Malformed(name.into()));
        }
        if self.by_name.contains_key(&(parent, name.into())) {
            return Err(NameError::Taken(name.into()));
        }
        Ok(())
    }

    fn take_free(&mut self) -> u32 {
        if self.free != NONE {
            let index = self.free;
            let entry = &mut self.entries[index as usize];
            self.free = entry.next;
            entry.occupied = true;
            return index;
        }
        let index = self.entries.len() as u32;
        assert!(index < OBJECTS_MAX, "a loop holds at most {OBJECTS_MAX} objects");
        self.entries.push(Entry {
            node: None,
            generation: 0,
            parent: NONE,
            first_child: NONE,
            previous: NONE,
            next: NONE,
            occupied: true,
            named: false,
        });
        index
    }

    fn first_of(&self, parent: u32) -> u32 {
        if parent == NONE { self.first_root } else { self.entries[parent as usize].first_child }
    }

    fn set_first_of(&mut self, parent: u32, first: u32) {
        if parent == NONE {
            self.first_root = first;
        } else {
            self.entries[parent as usize].first_child = first;
        }
    }

    /// Appends as the last child, so that burial meets siblings in the order of their birth.
    fn link(&mut self, index: u32, parent: u32) {
        let first = self.first_of(parent);
        let last = if first == NONE { index } else { self.entries[first as usize].previous };
        if first == NONE {
            self.set_first_of(parent, index);
        } else {
            self.entries[last as usize].next = index;
            self.entries[first as usize].previous = index;
        }
        let entry = &mut self.entries[index as usize];
        entry.parent = parent;
        entry.previous = last;
        entry.next = NONE;
        entry.first_child = NONE;
    }

    fn unlink(&mut self, index: u32) {
        let Entry { parent, previous, next, .. } = self.entries[index as usize];
        let first = self.first_of(parent);
        let is_first = first == index;
        if is_first {
            self.set_first_of(parent, next);
        } else {
            self.entries[previous as usize].next = next;
        }
        if next != NONE {
            // `previous` of the first is the last; taking the first away hands that on.
            self.entries[next as usize].previous = previous;
        } else if !is_first {
            // The last went: the first knows the new one.
            self.entries[first as usize].previous = previous;
        }
    }

    /// Places the constructed node into its reserved entry.
    pub(crate) fn fill(&mut self, id: ObjectId, node: Rc<dyn AnyNode>) {
        if self.entry(id).is_some() {
            self.entries[id.index as usize].node = Some(node);
        }
    }

    /// Takes a childless object out; its id names nobody from now on.
    pub(crate) fn release(&mut self, id: ObjectId) -> Option<Rc<dyn AnyNode>> {
        let entry = self.entry(id)?;
        debug_assert_eq!(entry.first_child, NONE, "children are buried first");
        if entry.named {
            self.forget_name(id.index);
        }
        self.unlink(id.index);
        self.living -= 1;
        let entry = &mut self.entries[id.index as usize];
        entry.occupied = false;
        // An entry whose generations are used up is never given out again.
        if let Some(generation) = entry.generation.checked_add(1) {
            entry.generation = generation;
            entry.next = self.free;
            self.free = id.index;
        }
        entry.node.take()
    }

    fn forget_name(&mut self, index: u32) {
        let entry = &mut self.entries[index as usize];
        entry.named = false;
        if let Some(name) = self.names.remove(&index) {
            self.by_name.remove(&(entry.parent, name));
        }
    }

    /// The object that stands at an index now.
    pub(crate) fn id_at(&self, index: u32) -> Option<ObjectId> {
        (index != NONE).then(|| ObjectId {
            loop_number: self.loop_number,
            index,
            generation: self.entries[index as usize].generation,
        })
    }

    pub(crate) fn parent(&self, id: ObjectId) -> Option<ObjectId> {
        self.entry(id).and_then(|entry| self.id_at(entry.parent))
    }

    pub(crate) fn first_child(&self, id: ObjectId) -> Option<ObjectId> {
        self.entry(id).and_then(|entry| self.id_at(entry.first_child))
    }

    pub(crate) fn next_sibling(&self, id: ObjectId) -> Option<ObjectId> {
        self.entry(id).and_then(|entry| self.id_at(entry.next))
    }

    pub(crate) fn first_root(&self) -> Option<ObjectId> {
        self.id_at(self.first_root)
    }

    /// The object after `id` in the walk of the subtree below `top`, parents before children.
    pub(crate) fn next_below(&self, top: ObjectId, id: ObjectId) -> Option<ObjectId> {
        if let Some(child) = self.first_child(id) {
            return Some(child);
        }
        let mut at = id;
        while at != top {
            if let Some(next) = self.next_sibling(at) {
                return Some(next);
            }
            at = self.parent(at)?;
        }
        None
    }

    pub(crate) fn name(&self, id: ObjectId) -> Option<&str> {
        self.entry(id).filter(|entry| entry.named)?;
        self.names.get(&id.index).map(|name| &**name)
    }

    /// `base/left`: the names from the root down; an unnamed object stands as its id.
    pub(crate) fn path(&self, id: ObjectId) -> String {
        let mut parts = Vec::new();
        let mut at = Some(id);
        while let Some(here) = at {
            parts.push(self.name(here).map_or_else(|| here.to_string(), str::to_owned));
            at = self.parent(here);
        }
        parts.reverse();
        parts.join("/")
    }

    pub(crate) fn find(&self, path: &str) -> Option<ObjectId> {
        let mut at = NONE;
        for part in path.split('/') {
            at = *self.by_name.get(&(at, part.into()))?;
        }
        self.id_at(at)
    }

    /// Every object there is, in order of index.
    pub(crate) fn ids(&self) -> impl Iterator<Item = ObjectId> + '_ {
        (0..self.entries.len() as u32)
            .filter(|&index| self.entries[index as usize].occupied)
            .filter_map(|index| self.id_at(index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn children(table: &Table, of: ObjectId) -> Vec<ObjectId> {
        std::iter::successors(table.first_child(of), |&id| table.next_sibling(id)).collect()
    }

    fn child(table: &mut Table, of: ObjectId) -> ObjectId {
        table.reserve(Placement { parent: Some(of), name: None }).unwrap()
    }

    #[test]
    fn children_stay_in_order_whichever_leaves() {
        for leaver in 0..4 {
            let mut table = Table::new();
            let top = table.reserve(Placement::default()).unwrap();
            let mut all: Vec<_> = (0..4).map(|_| child(&mut table, top)).collect();
            table.release(all.remove(leaver));
            assert_eq!(children(&table, top), all);
            all.push(child(&mut table, top));
            assert_eq!(children(&table, top), all);
            for id in all {
                table.release(id);
            }
            assert_eq!(table.first_child(top), None);
            let again = child(&mut table, top);
            assert_eq!(children(&table, top), [again]);
        }
    }

    #[test]
    fn a_stale_id_names_nobody() {
        let mut table = Table::new();
        let old = table.reserve(Placement::default()).unwrap();
        table.release(old);
        let new = table.reserve(Placement::default()).unwrap();
        assert_eq!(old.index, new.index);
        assert!(!table.exists(old) && table.exists(new));
        assert!(!Table::new().exists(new), "nor does an id of another loop");
    }

    #[test]
    fn names_are_unique_among_siblings_and_make_paths() {
        let mut table = Table::new();
        let base = table.reserve(Placement { parent: None, name: Some("base") }).unwrap();
        let left = table.reserve(Placement { parent: Some(base), name: Some("left") }).unwrap();
        let taken = table.reserve(Placement { parent: Some(base), name: Some("left") });
        assert_eq!(taken, Err(NameError::Taken("left".into())));
        assert!(table.reserve(Placement { parent: None, name: Some("left") }).is_ok());
        assert!(table.reserve(Placement { parent: None, name: Some("a/b") }).is_err());
        assert_eq!(table.path(left), "base/left");
        assert_eq!(table.find("base/left"), Some(left));
        table.release(left);
        assert_eq!(table.find("base/left"), None);
        assert!(table.reserve(Placement { parent: Some(base), name: Some("left") }).is_ok());
    }

    #[test]
    fn the_walk_meets_parents_before_children() {
        let mut table = Table::new();
        let top = table.reserve(Placement::default()).unwrap();
        let a = child(&mut table, top);
        let b = child(&mut table, a);
        let c = child(&mut table, top);
        let other = table.reserve(Placement::default()).unwrap();
        let walk: Vec<_> = std::iter::successors(Some(top), |&id| table.next_below(top, id)).collect();
        assert_eq!(walk, [top, a, b, c]);
        assert!(table.exists(other));
    }
}
