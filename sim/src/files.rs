//! What stands in blob channels, as their owners know it, and what may therefore be found there.
//!
//! Of each place it is known what may stand there: what was acknowledged last, or besides what was asked for and never
//! answered. When a hub begins anew its disk decides about that. A content is known by its bytes: where it was made,
//! which version, how long, and a checksum; of no other bytes a file consists.

use bytes::{BufMut, Bytes, BytesMut};
use std::collections::{BTreeMap, BTreeSet};

/// The paths that owners use; the last one is of a folder.
pub(crate) const PATHS: [&str; 6] = ["f0", "f1", "f2", "d0/f0", "d0/f1", "d0"];
/// Where a hub keeps the files of its blob channels.
pub(crate) const FOLDER: &str = "/blobs";

const HEAD_BYTES: usize = 2 + 2 + 4;
const CHECK_BYTES: usize = 4;
/// The shortest content.
pub(crate) const BYTES_MIN: u32 = (HEAD_BYTES + CHECK_BYTES) as u32;

/// A file's content: of which node, which version, and how long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Content {
    pub(crate) node: u16,
    pub(crate) version: u16,
    pub(crate) bytes: u32,
}

impl Content {
    /// Its bytes, of which there are at least [`BYTES_MIN`].
    pub(crate) fn make(self) -> Bytes {
        let length = self.bytes as usize;
        let mut made = BytesMut::with_capacity(length);
        made.put_u16_le(self.node);
        made.put_u16_le(self.version);
        made.put_u32_le(self.bytes);
        // No two pages of it are the same.
        let mut word = u32::from(self.node) << 16 | u32::from(self.version);
        while made.len() < length - CHECK_BYTES {
            word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let left = (length - CHECK_BYTES - made.len()).min(4);
            made.extend_from_slice(&word.to_le_bytes()[..left]);
        }
        let check = crc32fast::hash(&made);
        made.put_u32_le(check);
        made.freeze()
    }

    /// The content that consists of these bytes.
    pub(crate) fn of(bytes: &[u8]) -> Option<Content> {
        let (body, check) = bytes.split_last_chunk::<CHECK_BYTES>()?;
        let [a, b, c, d, e, f, g, h, ..] = *body else { return None };
        let content = Content {
            node: u16::from_le_bytes([a, b]),
            version: u16::from_le_bytes([c, d]),
            bytes: u32::from_le_bytes([e, f, g, h]),
        };
        let is_whole =
            content.bytes as usize == bytes.len() && crc32fast::hash(body) == u32::from_le_bytes(*check);
        is_whole.then_some(content)
    }
}

/// What stands at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Thing {
    Nothing,
    Folder,
    File(Content),
}

/// A place: whose channel, and the path there.
pub(crate) type Spot = (u16, &'static str);

/// A change of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    Put(&'static str, Content),
    MakeFolder(&'static str),
    Move(&'static str, &'static str),
    Remove(&'static str),
}

/// What was found where only things of a place may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Sight {
    Thing(Thing),
    /// A file of that length.
    Length(u64),
    /// Bytes that are no content.
    Other(String),
}

/// What may stand at a place.
#[derive(Clone, Debug)]
struct Standing {
    may: BTreeSet<Thing>,
    /// All that ever might.
    ever: BTreeSet<Thing>,
    /// How often that changed.
    changes: u64,
}

impl Default for Standing {
    fn default() -> Standing {
        let nothing = BTreeSet::from([Thing::Nothing]);
        Standing { may: nothing.clone(), ever: nothing, changes: 0 }
    }
}

impl Standing {
    fn add(&mut self, things: impl IntoIterator<Item = Thing>) {
        let before = self.may.len();
        self.may.extend(things);
        self.ever.extend(self.may.iter().copied());
        self.changes += u64::from(self.may.len() != before);
    }

    fn settle(&mut self, things: impl IntoIterator<Item = Thing>) {
        self.may = things.into_iter().collect();
        self.ever.extend(self.may.iter().copied());
        self.changes += 1;
    }
}

/// All blob channels.
#[derive(Debug, Default)]
pub(crate) struct Files {
    spots: BTreeMap<Spot, Standing>,
    /// What each node has under way, with what it may move.
    under_way: BTreeMap<u16, (Change, BTreeSet<Thing>)>,
}

impl Files {
    fn at(&mut self, node: u16, path: &'static str) -> &mut Standing {
        self.spots.entry((node, path)).or_default()
    }

    /// A node asks for a change; it has no other under way.
    pub(crate) fn begins(&mut self, node: u16, change: Change) {
        let mut moved = BTreeSet::new();
        match change {
            Change::Put(path, content) => self.at(node, path).add([Thing::File(content)]),
            Change::MakeFolder(path) => self.at(node, path).add([Thing::Folder]),
            Change::Remove(path) => self.at(node, path).add([Thing::Nothing]),
            Change::Move(from, to) => {
                let files = |thing: &&Thing| matches!(thing, Thing::File(_));
                moved = self.at(node, from).may.iter().filter(files).copied().collect();
                self.at(node, to).add(moved.iter().copied());
                self.at(node, from).add([Thing::Nothing]);
            }
        }
        self.under_way.insert(node, (change, moved));
    }

    /// It has its answer: that it is done and kept, or one that leaves open whether it was.
    pub(crate) fn ended(&mut self, node: u16, well: bool) {
        let Some((change, moved)) = self.under_way.remove(&node) else { return };
        if !well {
            return;
        }
        match change {
            Change::Put(path, content) => self.at(node, path).settle([Thing::File(content)]),
            Change::MakeFolder(path) => self.at(node, path).settle([Thing::Folder]),
            Change::Remove(path) => self.at(node, path).settle([Thing::Nothing]),
            Change::Move(from, to) => {
                self.at(node, from).settle([Thing::Nothing]);
                self.at(node, to).settle(moved);
            }
        }
    }

    /// A node's process is no more: nobody hears what becomes of what it had under way.
    pub(crate) fn abandon(&mut self, node: u16) {
        self.under_way.remove(&node);
    }

    /// A hub begins, and this is all that its disk has. Answers what is wrong with it.
    pub(crate) fn hub_found(&mut self, on_disk: &BTreeMap<(u16, String), Sight>) -> Vec<String> {
        let mut wrong = Vec::new();
        for ((node, path), sight) in on_disk {
            if !self.spots.keys().any(|(of, known)| of == node && known == path) {
                wrong.push(format!("{path} of n{node} is {sight:?}, and nobody put anything there"));
            }
        }
        let spots: Vec<Spot> = self.spots.keys().copied().collect();
        for (node, path) in spots {
            let found = on_disk.get(&(node, path.to_owned())).cloned();
            let found = found.unwrap_or(Sight::Thing(Thing::Nothing));
            let standing = self.at(node, path);
            match found {
                Sight::Thing(thing) if standing.may.contains(&thing) => standing.settle([thing]),
                other => wrong.push(format!("{path} of n{node} may be {:?}, and is {other:?}", standing.may)),
            }
        }
        // What is under way may still come to be.
        for (node, (change, _)) in std::mem::take(&mut self.under_way) {
            self.begins(node, change);
        }
        wrong
    }

    /// What may be seen at a place from now on.
    pub(crate) fn look(&self, node: u16, path: &'static str) -> Look {
        Look { spot: (node, path), changes: self.spots.get(&(node, path)).map_or(0, |spot| spot.changes) }
    }

    /// Somebody looked at a place, and this was there. Answers what is wrong with it.
    pub(crate) fn saw(&self, look: Look, sight: &Sight) -> Option<String> {
        let nothing = Standing::default();
        let standing = self.spots.get(&look.spot).unwrap_or(&nothing);
        // What changed meanwhile may have been seen before or after.
        let may = if standing.changes == look.changes { &standing.may } else { &standing.ever };
        let is_right = may.iter().any(|thing| match (thing, sight) {
            (thing, Sight::Thing(seen)) => thing == seen,
            (Thing::File(content), Sight::Length(bytes)) => u64::from(content.bytes) == *bytes,
            _ => false,
        });
        let (node, path) = look.spot;
        (!is_right).then(|| format!("{path} of n{node} was seen as {sight:?}, and may be {may:?}"))
    }
}

impl Files {
    /// What somebody was sent of a place was not what had been announced. Answers what is wrong: nothing, if something
    /// changed there meanwhile.
    pub(crate) fn saw_pieces(&self, look: Look) -> Option<String> {
        let (node, path) = look.spot;
        let is_same = self.look(node, path).changes == look.changes;
        is_same.then(|| format!("{path} of n{node} is not what it is said to be, and nobody changed it"))
    }
}

/// The beginning of a look at a place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    spot: Spot,
    changes: u64,
}

/// What bytes are as a thing.
pub(crate) fn sight_of(bytes: &[u8]) -> Sight {
    match Content::of(bytes) {
        Some(content) => Sight::Thing(Thing::File(content)),
        None => Sight::Other(format!("{} bytes that nobody put there", bytes.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(version: u16) -> Content {
        Content { node: 3, version, bytes: 1000 + u32::from(version) }
    }

    fn thing(version: u16) -> Thing {
        Thing::File(content(version))
    }

    fn on_disk(path: &str, thing: Thing) -> BTreeMap<(u16, String), Sight> {
        BTreeMap::from([((3, path.to_owned()), Sight::Thing(thing))])
    }

    #[test]
    fn a_content_is_known_by_all_of_its_bytes() {
        let made = content(5).make();
        assert_eq!((made.len(), Content::of(&made)), (1005, Some(content(5))));
        assert_eq!(Content { bytes: BYTES_MIN, ..content(5) }.make().len(), BYTES_MIN as usize);
        for at in 0..made.len() {
            let mut changed = made.to_vec();
            changed[at] ^= 1;
            assert_eq!(Content::of(&changed), None, "byte {at}");
        }
        assert_eq!(Content::of(&made[..900]), None);
    }

    #[test]
    fn what_was_acknowledged_is_there_and_what_was_not_may_be() {
        let mut files = Files::default();
        files.begins(3, Change::Put("f0", content(1)));
        files.ended(3, true);
        files.begins(3, Change::Put("f0", content(2)));
        for version in [1, 2] {
            let mut files = Files { spots: files.spots.clone(), under_way: files.under_way.clone() };
            assert_eq!(files.hub_found(&on_disk("f0", thing(version))), [""; 0]);
            files.ended(3, true);
            assert!(files.saw(files.look(3, "f0"), &Sight::Thing(thing(1))).is_some());
            assert_eq!(files.saw(files.look(3, "f0"), &Sight::Length(1002)), None);
        }
        assert_eq!(files.hub_found(&on_disk("f0", Thing::Nothing)).len(), 1);
        assert_eq!(files.hub_found(&on_disk("f9", thing(1))).len(), 2, "nobody put that there");
    }

    #[test]
    fn a_move_takes_what_was_there() {
        let mut files = Files::default();
        files.begins(3, Change::Put("f0", content(1)));
        files.ended(3, true);
        files.begins(3, Change::Move("f0", "f1"));
        let before = files.look(3, "f0");
        assert_eq!(files.saw(before, &Sight::Thing(Thing::Nothing)), None);
        files.ended(3, true);
        assert_eq!(files.saw(before, &Sight::Thing(thing(1))), None, "it was there while it was looked at");
        assert!(files.saw(files.look(3, "f0"), &Sight::Thing(thing(1))).is_some());
        assert_eq!(files.saw(files.look(3, "f1"), &Sight::Thing(thing(1))), None);
    }
}
