//! Watches: what there is, then what changes; slow watchers, those who come back, and ends.

use super::*;
use crate::flow::{Right, Value};
use proptest::prelude::*;
use std::collections::BTreeMap;

fn number(number: i64) -> Value {
    Value::new(&number.into()).expect("small")
}

fn set(key: &str, value: i64) -> Command {
    Command::VarSet { key: key.into(), value: number(value) }
}

fn delete(key: &str) -> Command {
    Command::VarDelete { key: key.into() }
}

fn watch(prefix: &str, after: u64) -> Command {
    Command::Watch { database: "arm".into(), prefix: prefix.into(), after, form: Form::Binary }
}

fn writer(hub: &mut ServerCore) -> Raw {
    let mut writer = Raw::flow(hub, OWNER);
    writer.ask(hub, &Command::DbCreate { database: "arm".into(), durable: 0 });
    writer.ask(hub, &Command::DbSelect { database: "arm".into() });
    writer
}

/// What a client that follows the protocol's page knows of a database after these events.
#[derive(Default)]
struct Known {
    values: BTreeMap<String, i64>,
    told: std::collections::BTreeSet<String>,
    sequence: u64,
    whole: u32,
}

impl Known {
    /// While everything is being told, numbers say nothing of what is still to come.
    fn heard(&mut self, sequence: u64) {
        if self.sequence != 0 {
            assert!(sequence > self.sequence, "changes come in order");
            self.sequence = sequence;
        }
    }

    fn hear(&mut self, events: impl IntoIterator<Item = Event>) {
        for event in events {
            match event {
                Event::Changed { sequence, key, value } => {
                    self.told.insert(key.clone());
                    self.values.insert(key, i64::try_from(&value.variant()).expect("a number"));
                    self.heard(sequence);
                }
                Event::Deleted { sequence, key } => {
                    self.values.remove(&key);
                    self.heard(sequence);
                }
                Event::Watching { sequence, whole } => {
                    let told = std::mem::take(&mut self.told);
                    if whole == 1 {
                        self.whole += 1;
                        self.values.retain(|key, _| told.contains(key));
                    }
                    self.sequence = sequence;
                }
                other => panic!("not of a watch: {other:?}"),
            }
        }
    }
}

#[test]
fn a_watch_tells_what_there_is_then_every_change_of_its_prefix() {
    let mut hub = hub();
    let mut writer = writer(&mut hub);
    for (key, value) in [("gain.p", 1), ("gain.i", 2), ("mode", 3)] {
        writer.ask(&mut hub, &set(key, value));
    }
    let mut watcher = Raw::flow(&mut hub, OWNER);
    let mut known = Known::default();
    let first = watcher.ask(&mut hub, &watch("gain.", 0));
    assert!(matches!(first.last(), Some(Event::Watching { whole: 1, .. })), "{first:?}");
    assert_eq!(first.len(), 3);
    known.hear(first);
    writer.ask(&mut hub, &set("gain.p", 10));
    writer.ask(&mut hub, &set("mode", 30));
    writer.ask(&mut hub, &delete("gain.i"));
    writer.ask(&mut hub, &set("gain.d", 5));
    let events = watcher.read(&mut hub);
    assert!(events.iter().all(|event| event.tag == 79), "with the tag of the watch");
    assert_eq!(events.len(), 3);
    known.hear(messages(events));
    assert_eq!(known.values, BTreeMap::from([("gain.p".into(), 10), ("gain.d".into(), 5)]));
    assert_eq!(watcher.ask(&mut hub, &Command::Unwatch { watch: 79 }), [Event::Done {}]);
    writer.ask(&mut hub, &set("gain.p", 11));
    assert_eq!(messages(watcher.read(&mut hub)), []);
}

#[test]
fn s108_a_change_reaches_the_component_while_it_runs() {
    let mut hub = hub();
    let mut arm = Raw::flow(&mut hub, OWNER);
    let name = format!("flow:robot.flow-{}", arm.id.wire());
    let (database, prefix) = (name.clone(), "parameter.".to_owned());
    arm.ask(&mut hub, &Command::Watch { database, prefix, after: 0, form: Form::Binary });
    let mut operator = Raw::synchronous(&mut hub, OWNER);
    operator.ask(&mut hub, &Command::DbSelect { database: name });
    operator.ask(&mut hub, &set("parameter.speed", 3));
    let heard = messages(arm.read(&mut hub));
    assert!(
        matches!(&heard[..], [Event::Changed { key, .. }] if key == "parameter.speed"),
        "{heard:?}"
    );
}

#[test]
fn a_watcher_that_does_not_read_hears_of_the_newest_value_and_takes_no_memory_meanwhile() {
    let mut hub = hub();
    let writer = writer(&mut hub);
    let mut watcher = Raw::flow(&mut hub, OWNER);
    watcher.ask(&mut hub, &watch("", 0));
    for round in 0..1000 {
        for key in 0..10 {
            writer.send(&mut hub, 0, &set(&format!("k{key}"), round));
            while hub.work(at(0)) {}
        }
    }
    let events = messages(watcher.read(&mut hub));
    assert_eq!(events.len(), 10, "one for each variable, not one for each change");
    assert!(
        events
            .iter()
            .all(|event| matches!(event, Event::Changed { value, .. } if *value == number(999)))
    );
}

proptest! {
    #[test]
    fn whoever_watches_at_whatever_pace_ends_up_with_what_there_is(
        steps in prop::collection::vec((0..8_u8, any::<i8>(), 0..5_usize, any::<bool>()), 0..80),
    ) {
        let mut hub = hub();
        let writer = writer(&mut hub);
        let mut model = BTreeMap::new();
        let mut known = Known::default();
        let mut watcher = Raw::flow(&mut hub, OWNER);
        watcher.send(&mut hub, 79, &watch("k", 0));
        for (key, value, frames, returns) in steps {
            let key = format!("k{key}");
            if value > -40 {
                writer.send(&mut hub, 0, &set(&key, value.into()));
                model.insert(key, i64::from(value));
            } else {
                writer.send(&mut hub, 0, &delete(&key));
                model.remove(&key);
            }
            for _ in 0..frames {
                known.hear(messages(watcher.read_one(&mut hub)));
            }
            if returns {
                known.told.clear();
                hub.left(watcher.id, at(0));
                watcher = Raw::flow(&mut hub, OWNER);
                watcher.send(&mut hub, 79, &watch("k", known.sequence));
            }
        }
        known.hear(messages(watcher.read(&mut hub)));
        prop_assert_eq!(known.values, model);
    }
}

#[test]
fn a_watch_goes_on_where_an_earlier_one_stopped() {
    let mut hub = hub();
    let mut writer = writer(&mut hub);
    for (key, value) in [("a", 1), ("b", 2), ("c", 3)] {
        writer.ask(&mut hub, &set(key, value));
    }
    let mut known = Known::default();
    let mut watcher = Raw::flow(&mut hub, OWNER);
    known.hear(watcher.ask(&mut hub, &watch("", 0)));
    hub.left(watcher.id, at(0));
    writer.ask(&mut hub, &set("a", 10));
    writer.ask(&mut hub, &delete("b"));
    let mut watcher = Raw::flow(&mut hub, OWNER);
    let missed = watcher.ask(&mut hub, &watch("", known.sequence));
    assert_eq!(missed.len(), 3, "only what changed, and the end of it: {missed:?}");
    assert!(matches!(missed.last(), Some(Event::Watching { whole: 0, .. })));
    known.hear(missed);
    assert_eq!(known.values, BTreeMap::from([("a".into(), 10), ("c".into(), 3)]));
    assert_eq!(known.whole, 1);
}

#[test]
fn who_was_away_for_too_long_or_comes_from_another_run_of_the_hub_is_told_everything() {
    let mut hub = hub();
    let writer = writer(&mut hub);
    let mut known = Known::default();
    let mut watcher = Raw::flow(&mut hub, OWNER);
    for key in 0..DELETIONS_KEPT_MAX + 2 {
        writer.send(&mut hub, 0, &set(&format!("k{key}"), 1));
        while hub.work(at(0)) {}
    }
    known.hear(watcher.ask(&mut hub, &watch("", 0)));
    hub.left(watcher.id, at(0));
    for key in 0..DELETIONS_KEPT_MAX + 1 {
        writer.send(&mut hub, 0, &delete(&format!("k{key}")));
        while hub.work(at(0)) {}
    }
    let mut watcher = Raw::flow(&mut hub, OWNER);
    known.hear(watcher.ask(&mut hub, &watch("", known.sequence)));
    assert_eq!((known.values.len(), known.whole), (1, 2));
    watcher.ask(&mut hub, &Command::Unwatch { watch: 79 });
    for stranger in [1, known.sequence + 1, u64::MAX] {
        let told = watcher.ask(&mut hub, &watch("", stranger));
        assert!(matches!(told.last(), Some(Event::Watching { whole: 1, .. })), "{stranger}: {told:?}");
        watcher.ask(&mut hub, &Command::Unwatch { watch: 79 });
    }
}

#[test]
fn a_watcher_that_misses_forgotten_deletions_while_it_watches_is_told_everything_anew() {
    let mut hub = hub();
    let writer = writer(&mut hub);
    let mut known = Known::default();
    let mut watcher = Raw::flow(&mut hub, OWNER);
    known.hear(watcher.ask(&mut hub, &watch("", 0)));
    for key in 0..2 * DELETIONS_KEPT_MAX {
        writer.send(&mut hub, 0, &set(&format!("k{key}"), 1));
        while hub.work(at(0)) {}
    }
    known.hear(messages(watcher.read(&mut hub)));
    assert_eq!(known.values.len(), 2 * DELETIONS_KEPT_MAX);
    // The last value told before the deletions must not be taken for one of what follows.
    for key in 1..2 * DELETIONS_KEPT_MAX {
        writer.send(&mut hub, 0, &delete(&format!("k{key}")));
        while hub.work(at(0)) {}
    }
    known.hear(messages(watcher.read(&mut hub)));
    assert_eq!(known.values, BTreeMap::from([("k0".into(), 1)]));
    assert_eq!(known.whole, 2);
}

#[test]
fn a_watch_ends_with_its_database_and_with_the_right_to_it() {
    let mut hub = hub();
    let mut writer = writer(&mut hub);
    let mut watcher = Raw::flow(&mut hub, OWNER);
    watcher.ask(&mut hub, &watch("", 0));
    writer.ask(&mut hub, &Command::DbRemove { database: "arm".into() });
    assert_eq!(tagged(&watcher.read(&mut hub), 79), [Event::WatchOver {}]);
    writer.ask(&mut hub, &Command::DbCreate { database: "arm".into(), durable: 0 });
    writer.ask(&mut hub, &Command::DbSelect { database: "arm".into() });
    watcher.ask(&mut hub, &watch("", 0));
    hub.change_rights(watcher.id, Rights::NONE.with(Right::Subscribe));
    assert_eq!(tagged(&watcher.read(&mut hub), 79), [Event::WatchOver {}]);
    writer.ask(&mut hub, &set("x", 1));
    assert_eq!(messages(watcher.read(&mut hub)), []);
    let denied = watcher.ask(&mut hub, &watch("", 0));
    assert!(matches!(denied[..], [Event::Refused { code, .. }] if code == RefusalCode::Denied.code()));
}

#[test]
fn a_flow_has_at_most_256_watches_and_a_tag_for_each() {
    let mut hub = hub();
    writer(&mut hub);
    let mut watcher = Raw::flow(&mut hub, OWNER);
    for index in 0..WATCHES_PER_FLOW_MAX + 1 {
        let tag = 1000 + index as u32;
        watcher.send(&mut hub, tag, &watch("", 0));
        while hub.work(at(0)) {}
        let expected = (index == WATCHES_PER_FLOW_MAX).then_some(RefusalCode::TooManyWatches);
        assert_eq!(refusal(&watcher.read(&mut hub), tag), expected, "watch {index}");
    }
    watcher.ask(&mut hub, &Command::Unwatch { watch: 1000 });
    watcher.send(&mut hub, 1001, &watch("", 0));
    assert_eq!(refusal(&watcher.read(&mut hub), 1001), Some(RefusalCode::Exists));
}

#[test]
fn a_watched_flow_that_goes_ends_the_watch_and_nobody_is_told_after_he_left() {
    let mut hub = hub();
    let arm = Raw::flow(&mut hub, OWNER);
    let name = format!("flow:robot.flow-{}", arm.id.wire());
    let mut watchers = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    for watcher in &mut watchers {
        let (database, prefix) = (name.clone(), String::new());
        watcher.ask(&mut hub, &Command::Watch { database, prefix, after: 0, form: Form::Binary });
    }
    let [gone, mut stays] = watchers;
    hub.left(gone.id, at(0));
    hub.left(arm.id, at(0));
    assert_eq!(tagged(&stays.read(&mut hub), 79), [Event::WatchOver {}]);
}

#[test]
fn a_watch_with_much_to_pass_over_takes_turns_with_others() {
    let mut hub = hub();
    let mut writer = writer(&mut hub);
    let mut watcher = Raw::flow(&mut hub, OWNER);
    let first = watcher.ask(&mut hub, &watch("gain.", 0));
    let Some(Event::Watching { sequence, .. }) = first.last() else { panic!("{first:?}") };
    watcher.ask(&mut hub, &Command::Unwatch { watch: 79 });
    for number in 0..8000 {
        writer.ask(&mut hub, &set(&format!("noise.{number}"), 1));
    }
    writer.ask(&mut hub, &set("gain.p", 1));
    let mut heard = watcher.ask(&mut hub, &watch("gain.", *sequence));
    assert_eq!(heard, [], "8,000 changes are too many for one turn");
    let mut turns = 0;
    while !matches!(heard.last(), Some(Event::Watching { .. })) {
        assert!(hub.has_work(), "it goes on by itself");
        hub.work(at(0));
        turns += 1;
        heard.extend(tagged(&watcher.read(&mut hub), 79));
    }
    assert!(
        turns > 1 && matches!(&heard[0], Event::Changed { key, .. } if key == "gain.p"),
        "{heard:?}"
    );
}
