//! What was written into databases, as their writers know it, and what may therefore be found in them.
//!
//! A variable has one writer. What it wrote last of what was acknowledged must be there, or something later; what was
//! never answered may be there or not. When a hub begins anew, the disk decides about that for good.

use std::collections::BTreeMap;
use std::fmt::Write as _;

/// How many sorts of filling a value has, by its number: from nothing to several pages of a disk.
const FILLINGS: [usize; 5] = [0, 30, 500, 2000, 9000];

/// A variable: the database's name and the key.
pub(crate) type Place = (String, String);

/// How many variables a saved database has.
const PARTS: usize = 3;
/// The name under which all of a saved database is one place.
pub(crate) const WHOLE: &str = "*";

/// What a writer knows of something it wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    UnderWay,
    /// It is kept, said the hub.
    Kept,
    /// It was under way when a store was damaged: whatever is said of it, it may be there or not.
    Void,
    /// The hub said no, or was lost before it said anything.
    Unknown,
}

/// Something that was written: a value's number, or none for a variable that was deleted.
#[derive(Clone, Copy, Debug)]
struct Written {
    order: u64,
    value: Option<u64>,
    state: State,
}

/// Everything that was written, and may still matter.
#[derive(Debug, Default)]
pub(crate) struct Archive {
    places: BTreeMap<Place, Vec<Written>>,
    orders: u64,
    /// The store was damaged on purpose since a hub looked at it.
    pub(crate) rotten: bool,
    /// How often something was acknowledged.
    pub(crate) kept: u64,
}

/// A value: its number, and enough to tell it from any other, and from a part of itself.
pub(crate) fn value_of(place: &Place, number: u64) -> String {
    let mut text = format!("{number} {} {} ", place.0, place.1);
    let filling = FILLINGS[number as usize % FILLINGS.len()];
    text.extend(std::iter::repeat_n('.', filling));
    // Writing to a string does not fail.
    let _ = write!(text, " {:08x}", crc32fast::hash(text.as_bytes()));
    text
}

/// The number of a value that was written at that place, if it is one, and whole.
pub(crate) fn number_of(place: &Place, text: &str) -> Option<u64> {
    let number = text.split(' ').next()?.parse().ok()?;
    (value_of(place, number) == text).then_some(number)
}

impl Archive {
    /// Something is about to be written; answers its number in the order of all.
    pub(crate) fn begin(&mut self, place: &Place, value: Option<u64>) -> u64 {
        self.orders += 1;
        let written = Written { order: self.orders, value, state: State::UnderWay };
        self.places.entry(place.clone()).or_default().push(written);
        self.orders
    }

    /// It is kept, or its fate is not known.
    pub(crate) fn finish(&mut self, place: &Place, order: u64, kept: bool) {
        let Some(written) = self.places.get_mut(place) else { return };
        let Some(index) = written.iter().position(|written| written.order == order) else { return };
        if written[index].state != State::UnderWay {
            return;
        }
        written[index].state = if kept { State::Kept } else { State::Unknown };
        if kept {
            self.kept += 1;
            // What was kept before cannot come back.
            let mut before = index;
            written.retain(|written| {
                let old = before > 0 && written.state == State::Kept;
                before = before.saturating_sub(1);
                !old
            });
        }
    }

    /// A writer is no more: nobody hears what becomes of what it had under way.
    pub(crate) fn abandon(&mut self, of: impl Fn(&str) -> bool) {
        for ((database, _), written) in &mut self.places {
            if of(database) {
                let under_way = written.iter_mut().filter(|written| written.state == State::UnderWay);
                under_way.for_each(|written| written.state = State::Unknown);
            }
        }
    }

    /// Whether that may be found at a place now.
    fn may_be(&self, place: &Place, found: Option<u64>) -> bool {
        let Some(written) = self.places.get(place) else { return found.is_none() };
        let kept = written.iter().rposition(|written| written.state == State::Kept);
        let nothing_yet = kept.is_none() && found.is_none();
        let mut all = written.iter().enumerate();
        nothing_yet
            || all.any(|(index, written)| {
                let old = kept.is_some_and(|kept| index < kept) && written.state == State::Kept;
                written.value == found && !old
            })
    }

    /// What was last acknowledged for a place, in words.
    fn last_kept(&self, place: &Place) -> String {
        let written = self.places.get(place);
        let kept = written.and_then(|all| all.iter().rfind(|written| written.state == State::Kept));
        kept.map_or_else(|| "nothing".to_owned(), |kept| said(kept.value))
    }

    /// That was found on the disk of a hub that begins: the past is settled, and what comes is under way.
    fn settle(&mut self, place: &Place, found: Option<u64>) {
        let Some(written) = self.places.get_mut(place) else { return };
        let may_come = [State::UnderWay, State::Void];
        written.retain(|written| may_come.contains(&written.state) && written.value != found);
        written.insert(0, Written { order: 0, value: found, state: State::Kept });
    }

    /// All places of the databases that are on the disk if they are anywhere.
    fn places(&self) -> Vec<Place> {
        self.places.keys().cloned().collect()
    }
}

fn said(value: Option<u64>) -> String {
    value.map_or_else(|| "that it is deleted".to_owned(), |number| format!("value {number}"))
}

/// What the disk of a hub that begins has: databases with their variables.
pub(crate) type OnDisk = BTreeMap<String, BTreeMap<String, String>>;

impl Archive {
    /// A hub begins and has opened its store: nothing acknowledged is missing, and nothing is there that was not
    /// written so. Answers what is wrong.
    pub(crate) fn hub_found(&mut self, on_disk: &OnDisk, damage: Option<&str>) -> Vec<String> {
        let mut wrong = Vec::new();
        if let Some(why) = damage
            && !self.rotten
        {
            wrong.push(format!("the store is damaged though nothing did that: {why}"));
        }
        for place in self.places() {
            let found = found_at(&place, on_disk);
            let (number, whole) = match found {
                Found::Nothing => (None, true),
                Found::Value(number) => (Some(number), true),
                Found::Other(text) => {
                    wrong.push(format!("{} of {} is {text}", place.1, place.0));
                    (None, false)
                }
            };
            if whole && damage.is_none() && !self.may_be(&place, number) {
                let (found, kept) = (said(number), self.last_kept(&place));
                let text = format!("{} of {}: {kept} was acknowledged, {found} is found", place.1, place.0);
                wrong.push(text);
            }
            self.settle(&place, number);
        }
        if damage.is_some() {
            // What a hub before this one promised may still be on its way, and is worth nothing any more.
            let all = self.places.values_mut().flatten();
            let under_way = all.filter(|written| written.state == State::UnderWay);
            under_way.for_each(|written| written.state = State::Void);
        }
        self.rotten = false;
        wrong
    }

    /// What is wrong with a text that was read at a place, if something is.
    pub(crate) fn wrong_value(place: &Place, text: &str) -> Option<String> {
        let is_right = number_of(place, text).is_some();
        (!is_right).then(|| format!("{} of {} is said to be {:?}", place.1, place.0, start_of(text)))
    }
}

fn found_at((database, key): &Place, on_disk: &OnDisk) -> Found {
    let Some(variables) = on_disk.get(database) else { return Found::Nothing };
    let number = |key: &str| {
        let place = (database.clone(), key.to_owned());
        variables
            .get(key)
            .map(|text| number_of(&place, text).ok_or_else(|| text.clone()))
    };
    let told = |text: &str| Found::Other(format!("{:?}, which nobody wrote there", start_of(text)));
    if key != WHOLE {
        return match number(key) {
            None => Found::Nothing,
            Some(Ok(number)) => Found::Value(number),
            Some(Err(text)) => told(&text),
        };
    }
    let parts: Vec<_> = variables.keys().map(|key| number(key)).collect();
    match parts.first() {
        None => Found::Nothing,
        Some(Some(Ok(first)))
            if parts.len() == PARTS && parts.iter().all(|part| *part == Some(Ok(*first))) =>
        {
            Found::Value(*first)
        }
        _ => Found::Other(format!(
            "not of one moment: {:?}",
            variables.values().map(|v| start_of(v)).collect::<Vec<_>>()
        )),
    }
}

fn start_of(text: &str) -> String {
    text.chars().take(60).collect()
}

enum Found {
    Nothing,
    Value(u64),
    Other(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place() -> Place {
        ("n3.d".to_owned(), "k1".to_owned())
    }

    #[test]
    fn a_value_is_known_by_its_text_and_by_no_part_of_it() {
        for number in 0..10 {
            let text = value_of(&place(), number);
            assert_eq!(number_of(&place(), &text), Some(number));
            assert_eq!(number_of(&place(), &text[..text.len() - 1]), None);
            assert_eq!(number_of(&("n4.d".to_owned(), "k1".to_owned()), &text), None);
        }
    }

    #[test]
    fn the_last_that_was_kept_or_anything_later_or_unanswered_may_be_found() {
        let mut archive = Archive::default();
        assert!(archive.may_be(&place(), None) && !archive.may_be(&place(), Some(1)));
        let orders: Vec<u64> = (1..=5).map(|number| archive.begin(&place(), Some(number))).collect();
        assert!(archive.may_be(&place(), None) && archive.may_be(&place(), Some(5)));
        archive.finish(&place(), orders[0], true);
        archive.finish(&place(), orders[1], false);
        archive.finish(&place(), orders[2], true);
        let may: Vec<bool> = (0..=5)
            .map(|number| archive.may_be(&place(), (number > 0).then_some(number)))
            .collect();
        assert_eq!(may, [false, false, true, true, true, true]);
        archive.settle(&place(), Some(2));
        assert!(archive.may_be(&place(), Some(2)) && !archive.may_be(&place(), Some(3)));
        assert!(archive.may_be(&place(), Some(4)), "it is still under way");
    }
}
