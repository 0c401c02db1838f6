//! Databases on a disk: acknowledged when it has them, there again after the hub's end, refused when it fails.

use super::accounts::{flow_of, name, verifier};
use super::*;
use crate::flow::Value;
use crate::flow::database::disk::Store;
use crate::flow::database::{
    DatabaseName, DatabaseStore, Saved, StoreAnswer, StoreFailure, StoreRequest, StoreWork, Stored,
};
use crate::world::SimulatedStorage;
use sk_flat::IntoVariant as _;
use std::sync::Arc;

fn number(number: i64) -> Value {
    Value::new(&number.into()).expect("small")
}

fn set(key: &str, value: i64) -> Command {
    Command::VarSet { key: key.into(), value: number(value) }
}

fn get(key: &str) -> Command {
    Command::VarGet { key: key.into(), form: Form::Binary }
}

fn select(name: &str) -> Command {
    Command::DbSelect { database: name.into() }
}

fn create(name: &str, durable: u8) -> Command {
    Command::DbCreate { database: name.into(), durable }
}

fn name_of(flow: &Raw) -> String {
    format!("flow:robot.flow-{}", flow.id.wire())
}

fn refused(code: RefusalCode) -> Vec<Event> {
    vec![Event::Refused { code: code.code(), text: code.to_string() }]
}

/// A hub with its store, on a disk that outlives both.
pub(super) struct Robot {
    pub(super) hub: ServerCore,
    store: Store,
    disk: Arc<SimulatedStorage>,
}

impl Robot {
    fn start(disk: Arc<SimulatedStorage>) -> Robot {
        let mut opened = Store::open(disk.clone(), "/state/databases.redb".into()).expect("the disk works");
        assert_eq!(opened.damage, None);
        let mut hub = hub();
        hub.keep_databases(opened.saved);
        let database = DatabaseName::accounts();
        let load = StoreRequest { number: 0, database, work: StoreWork::Load };
        if let Ok(Stored::Contents(Some(accounts))) = &opened.store.perform(vec![load])[0].outcome {
            hub.keep_accounts(accounts).expect("they are what was written");
        }
        Robot { hub, store: opened.store, disk }
    }

    pub(super) fn new() -> Robot {
        Robot::start(Arc::new(SimulatedStorage::new()))
    }

    /// The hub is killed and the power fails; what comes back has only the disk.
    pub(super) fn die_and_return(self) -> Robot {
        let Robot { hub, store, disk } = self;
        drop(hub);
        disk.power_cut();
        drop(store);
        let mut back = Robot::start(disk);
        // Another run of the hub draws other random numbers.
        let connection = back.hub.open(OWNER, [99; 32], at(0)).expect("a place");
        back.hub.left(connection, at(0));
        back
    }

    fn requests(&mut self) -> Vec<StoreRequest> {
        std::iter::from_fn(|| self.hub.next_store_request()).collect()
    }

    /// What a worker would do: all that waits in one go. Answers how much that was.
    pub(super) fn work(&mut self) -> usize {
        let requests = self.requests();
        let count = requests.len();
        for answer in self.store.perform(requests) {
            self.hub.stored(answer, at(0));
        }
        while self.hub.work(at(0)) {}
        count
    }

    /// The disk fails at all that waits.
    pub(super) fn fail(&mut self) {
        for request in self.requests() {
            let outcome = Err(StoreFailure("no space left".into()));
            self.hub.stored(StoreAnswer { number: request.number, outcome }, at(0));
        }
        while self.hub.work(at(0)) {}
    }

    pub(super) fn ask(&mut self, raw: &mut Raw, command: &Command) -> Vec<Event> {
        let mut answers = raw.ask(&mut self.hub, command);
        while self.work() > 0 {
            answers.extend(tagged(&raw.read(&mut self.hub), 79));
        }
        answers
    }

    fn durable_database(&mut self, raw: &mut Raw, name: &str) {
        assert_eq!(self.ask(raw, &create(name, 1)), [Event::Saved {}]);
        self.ask(raw, &select(name));
    }
}

#[test]
fn a_durable_set_is_seen_at_once_and_acknowledged_when_the_disk_has_it() {
    let mut robot = Robot::new();
    let mut writer = Raw::flow(&mut robot.hub, OWNER);
    let mut reader = Raw::flow(&mut robot.hub, OWNER);
    robot.durable_database(&mut writer, "arm");
    reader.ask(&mut robot.hub, &select("arm"));
    for index in 0..100 {
        writer.send(&mut robot.hub, 1000 + index, &set(&format!("k{index}"), index.into()));
        while robot.hub.work(at(0)) {}
    }
    assert_eq!(messages(writer.read(&mut robot.hub)), [], "nothing is on the disk yet");
    assert_eq!(reader.ask(&mut robot.hub, &get("k99")), [Event::Value { value: number(99) }]);
    assert_eq!(robot.work(), 100, "all of them go together");
    let answers = writer.read(&mut robot.hub);
    assert!(answers.iter().map(|answer| answer.tag).eq(1000..1100));
    assert!(answers.iter().all(|answer| answer.message == Event::Saved {}));
    let mut robot = robot.die_and_return();
    let mut reader = Raw::synchronous(&mut robot.hub, OWNER);
    reader.ask(&mut robot.hub, &select("arm"));
    assert_eq!(robot.ask(&mut reader, &get("k99")), [Event::Value { value: number(99) }]);
    assert_eq!(reader.ask(&mut robot.hub, &get("k0")), [Event::Value { value: number(0) }]);
}

#[test]
fn s104_the_answers_of_a_synchronous_connection_stay_in_order_and_nobody_else_waits() {
    let mut robot = Robot::new();
    let mut writer = Raw::synchronous(&mut robot.hub, OWNER);
    robot.durable_database(&mut writer, "arm");
    writer.send(&mut robot.hub, 1, &set("x", 1));
    writer.send(&mut robot.hub, 2, &get("x"));
    writer.send(&mut robot.hub, 3, &Command::Ping {});
    assert_eq!(messages(writer.read(&mut robot.hub)), []);
    let mut other = Raw::synchronous(&mut robot.hub, OWNER);
    other.ask(&mut robot.hub, &select("arm"));
    assert_eq!(other.ask(&mut robot.hub, &get("x")), [Event::Value { value: number(1) }]);
    robot.work();
    let expected = [Event::Saved {}, Event::Value { value: number(1) }, Event::Pong {}];
    assert_eq!(messages(writer.read(&mut robot.hub)), expected);
}

#[test]
fn what_is_not_durable_is_on_the_disk_when_it_was_saved() {
    let mut robot = Robot::new();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    raw.ask(&mut robot.hub, &create("arm", 0));
    raw.ask(&mut robot.hub, &select("arm"));
    raw.ask(&mut robot.hub, &set("x", 1));
    assert_eq!(robot.requests(), [], "a set goes nowhere");
    assert_eq!(robot.ask(&mut raw, &Command::DbSave {}), [Event::Saved {}]);
    raw.ask(&mut robot.hub, &set("x", 2));
    raw.ask(&mut robot.hub, &set("y", 3));
    assert_eq!(robot.ask(&mut raw, &Command::DbLoad {}), [Event::Done {}]);
    assert_eq!(raw.ask(&mut robot.hub, &get("x")), [Event::Value { value: number(1) }]);
    assert_eq!(raw.ask(&mut robot.hub, &get("y")), refused(RefusalCode::NoSuchVariable));
    raw.ask(&mut robot.hub, &set("x", 5));
    let mut robot = robot.die_and_return();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    raw.ask(&mut robot.hub, &select("arm"));
    assert_eq!(robot.ask(&mut raw, &get("x")), [Event::Value { value: number(1) }]);
}

#[test]
fn loading_is_told_to_watchers_as_changes() {
    let mut robot = Robot::new();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    raw.ask(&mut robot.hub, &create("arm", 0));
    raw.ask(&mut robot.hub, &select("arm"));
    for (key, value) in [("same", 1), ("other", 2)] {
        raw.ask(&mut robot.hub, &set(key, value));
    }
    robot.ask(&mut raw, &Command::DbSave {});
    for (key, value) in [("other", 20), ("new", 30)] {
        raw.ask(&mut robot.hub, &set(key, value));
    }
    let mut watcher = Raw::flow(&mut robot.hub, OWNER);
    let (database, prefix) = ("arm".to_owned(), String::new());
    watcher.ask(&mut robot.hub, &Command::Watch { database, prefix, after: 0, form: Form::Binary });
    robot.ask(&mut raw, &Command::DbLoad {});
    let told = messages(watcher.read(&mut robot.hub));
    assert!(
        matches!(&told[..], [Event::Deleted { key: gone, .. }, Event::Changed { key, value, .. }]
            if gone == "new" && key == "other" && *value == number(2)),
        "{told:?}"
    );
}

#[test]
fn a_saved_database_is_there_again_when_an_entity_of_its_name_returns() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    owner.create(&mut robot.hub, "imu");
    owner.ask(&mut robot.hub, &select("chan:robot.imu"));
    owner.ask(&mut robot.hub, &set("offset", 7));
    assert_eq!(robot.ask(&mut owner, &Command::DbSave {}), [Event::Saved {}]);
    owner.ask(&mut robot.hub, &set("offset", 8));
    for dies in [false, true] {
        robot.hub.left(owner.id, at(0));
        if dies {
            robot = robot.die_and_return();
        }
        let mut other = Raw::flow(&mut robot.hub, OWNER);
        let exists = Command::DbExists { database: "chan:robot.imu".into() };
        assert_eq!(other.ask(&mut robot.hub, &exists), [Event::Flag { value: 0 }], "not without the channel");
        owner = Raw::flow(&mut robot.hub, OWNER);
        owner.create(&mut robot.hub, "imu");
        owner.ask(&mut robot.hub, &select("chan:robot.imu"));
        assert_eq!(owner.ask(&mut robot.hub, &get("offset")), [], "it is on its way");
        robot.work();
        assert_eq!(messages(owner.read(&mut robot.hub)), [Event::Value { value: number(7) }]);
    }
}

#[test]
fn an_entity_that_goes_while_its_database_is_on_its_way_leaves_nobody_waiting() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = owner.create(&mut robot.hub, "imu");
    owner.ask(&mut robot.hub, &select("chan:robot.imu"));
    owner.ask(&mut robot.hub, &set("offset", 7));
    robot.ask(&mut owner, &Command::DbSave {});
    owner.send(&mut robot.hub, 4, &Command::RemoveChannel { channel });
    let channel = owner.create(&mut robot.hub, "imu");
    let mut reader = Raw::flow(&mut robot.hub, OWNER);
    reader.ask(&mut robot.hub, &select("chan:robot.imu"));
    assert_eq!(reader.ask(&mut robot.hub, &get("offset")), []);
    owner.send(&mut robot.hub, 5, &Command::RemoveChannel { channel });
    robot.work();
    let answers = tagged(&reader.read(&mut robot.hub), 79);
    assert_eq!(answers, refused(RefusalCode::NoDatabase));
    assert_eq!(robot.hub.unanswered_store_requests(), 0);
}

#[test]
fn a_removed_database_is_removed_from_the_disk() {
    let mut robot = Robot::new();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    robot.durable_database(&mut raw, "arm");
    robot.ask(&mut raw, &set("x", 1));
    let remove = Command::DbRemove { database: "arm".into() };
    assert_eq!(robot.ask(&mut raw, &remove), [Event::Saved {}]);
    robot.durable_database(&mut raw, "arm");
    assert_eq!(raw.ask(&mut robot.hub, &get("x")), refused(RefusalCode::NoSuchVariable));
    robot.ask(&mut raw, &remove);
    let mut robot = robot.die_and_return();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    assert_eq!(raw.ask(&mut robot.hub, &select("arm")), refused(RefusalCode::NoSuchDatabase));
}

#[test]
fn a_failing_disk_is_told_to_those_who_wait_and_the_next_write_brings_all_of_it() {
    let mut robot = Robot::new();
    let mut writer = Raw::flow(&mut robot.hub, OWNER);
    let mut bystander = Raw::flow(&mut robot.hub, OWNER);
    robot.durable_database(&mut writer, "arm");
    assert_eq!(robot.ask(&mut writer, &set("a", 1)), [Event::Saved {}]);
    writer.send(&mut robot.hub, 5, &set("b", 2));
    writer.send(&mut robot.hub, 6, &Command::VarDelete { key: "a".into() });
    robot.fail();
    let events = writer.read(&mut robot.hub);
    for tag in [5, 6] {
        assert_eq!(refusal(&events, tag), Some(RefusalCode::Storage));
    }
    assert_eq!(messages(bystander.read(&mut robot.hub)), []);
    assert_eq!(bystander.ask(&mut robot.hub, &Command::Ping {}), [Event::Pong {}]);
    assert_eq!(robot.ask(&mut writer, &set("c", 3)), [Event::Saved {}]);
    let mut robot = robot.die_and_return();
    let mut reader = Raw::synchronous(&mut robot.hub, OWNER);
    reader.ask(&mut robot.hub, &select("arm"));
    let keys = robot.ask(&mut reader, &Command::DbKeys { prefix: String::new() });
    let key = |key: &str| Event::KeyListed { key: key.into() };
    assert_eq!(keys, [key("b"), key("c"), Event::ListEnd { count: 2 }]);
}

#[test]
fn a_disk_that_fails_to_load_is_told_and_asked_again() {
    let mut robot = Robot::new();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    robot.durable_database(&mut raw, "arm");
    robot.ask(&mut raw, &set("x", 1));
    let mut robot = robot.die_and_return();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    raw.ask(&mut robot.hub, &select("arm"));
    raw.send(&mut robot.hub, 5, &get("x"));
    raw.send(&mut robot.hub, 6, &Command::Ping {});
    robot.fail();
    let events = raw.read(&mut robot.hub);
    assert_eq!(refusal(&events, 5), Some(RefusalCode::Storage));
    assert_eq!(tagged(&events, 6), [Event::Pong {}]);
    assert_eq!(robot.ask(&mut raw, &get("x")), [Event::Value { value: number(1) }]);
}

#[test]
fn named_and_saved_databases_of_an_account_are_64_in_all_also_after_a_restart() {
    let mut robot = Robot::new();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    for index in 0..DATABASES_PER_ACCOUNT_MAX - 1 {
        assert_eq!(robot.ask(&mut raw, &create(&format!("d{index}"), 1)), [Event::Saved {}]);
    }
    let mut flows = [(); 2].map(|()| Raw::flow(&mut robot.hub, OWNER));
    for (flow, expected) in flows
        .iter_mut()
        .zip([vec![Event::Saved {}], refused(RefusalCode::TooManyDatabases)])
    {
        flow.ask(&mut robot.hub, &select(&name_of(flow)));
        assert_eq!(flow.ask(&mut robot.hub, &set("x", 1)), [Event::Done {}], "in memory there is room");
        assert_eq!(robot.ask(flow, &Command::DbSave {}), expected);
    }
    let saved = name_of(&flows[0]);
    let mut robot = robot.die_and_return();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    assert_eq!(raw.ask(&mut robot.hub, &create("more", 0)), refused(RefusalCode::TooManyDatabases));
    assert_eq!(robot.ask(&mut raw, &Command::DbRemove { database: saved }), [Event::Saved {}]);
    assert_eq!(raw.ask(&mut robot.hub, &create("more", 0)), [Event::Done {}]);
}

#[test]
fn a_flow_that_writes_faster_than_the_disk_waits_at_1024() {
    let mut robot = Robot::new();
    let mut writer = Raw::flow(&mut robot.hub, OWNER);
    robot.durable_database(&mut writer, "arm");
    for index in 0..UNSAVED_PER_FLOW_MAX as i64 + 10 {
        writer.send(&mut robot.hub, 5, &set("x", index));
        while robot.hub.work(at(0)) {}
    }
    assert!(!robot.hub.wants_input(writer.id));
    assert_eq!(robot.hub.unanswered_store_requests(), UNSAVED_PER_FLOW_MAX);
    assert_eq!(robot.work(), UNSAVED_PER_FLOW_MAX);
    assert_eq!(robot.work(), 10, "the rest comes of itself");
    assert_eq!(tagged(&writer.read(&mut robot.hub), 5).len(), UNSAVED_PER_FLOW_MAX + 10);
}

#[test]
fn a_watcher_from_before_the_hubs_end_is_told_everything() {
    let mut robot = Robot::new();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    robot.durable_database(&mut raw, "arm");
    robot.ask(&mut raw, &set("x", 1));
    let watch =
        |after| Command::Watch { database: "arm".into(), prefix: String::new(), after, form: Form::Binary };
    let told = robot.ask(&mut raw, &watch(0));
    let Some(Event::Watching { sequence, .. }) = told.last() else { panic!("{told:?}") };
    let mut robot = robot.die_and_return();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    let told = robot.ask(&mut raw, &watch(*sequence));
    assert!(matches!(told.last(), Some(Event::Watching { whole: 1, .. })), "{told:?}");
}

#[test]
fn a_connection_that_waits_for_a_slow_disk_is_not_taken_for_silent() {
    let mut robot = Robot::new();
    let mut raw = Raw::synchronous(&mut robot.hub, OWNER);
    robot.durable_database(&mut raw, "arm");
    raw.send(&mut robot.hub, 5, &set("x", 1));
    for second in 1..60 {
        robot.hub.tick(at(second * 1000));
    }
    robot.work();
    assert_eq!(tagged(&raw.read(&mut robot.hub), 5), [Event::Saved {}]);
}

#[test]
fn what_is_in_memory_after_its_saved_form_was_removed_goes_to_the_disk_whole_with_the_next_change() {
    let mut robot = Robot::new();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    robot.ask(&mut raw, &select("user:robot"));
    for (key, value) in [("a", 1), ("b", 2)] {
        assert_eq!(robot.ask(&mut raw, &set(key, value)), [Event::Saved {}]);
    }
    let remove = Command::DbRemove { database: "user:robot".into() };
    assert_eq!(robot.ask(&mut raw, &remove), [Event::Saved {}]);
    assert_eq!(robot.ask(&mut raw, &set("c", 3)), [Event::Saved {}]);
    let mut robot = robot.die_and_return();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    robot.ask(&mut raw, &select("user:robot"));
    for (key, value) in [("a", 1), ("b", 2), ("c", 3)] {
        assert_eq!(robot.ask(&mut raw, &get(key)), [Event::Value { value: number(value) }], "{key}");
    }
}

#[test]
fn for_whom_a_database_is_not_nothing_is_brought_from_the_disk() {
    let mut robot = Robot::new();
    let mut raw = Raw::flow(&mut robot.hub, OWNER);
    robot.durable_database(&mut raw, "arm");
    let mut robot = robot.die_and_return();
    robot.hub.add_account(name("ada"), verifier());
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    robot.ask(&mut owner, &select("user:ada"));
    let value = Value::new(&SkVariant::list(["ada.*"])).expect("small");
    let grant = Command::VarSet { key: "right.database_read".into(), value };
    assert_eq!(robot.ask(&mut owner, &grant), [Event::Saved {}]);
    let mut ada = flow_of(&mut robot.hub, "ada");
    let (database, prefix) = ("arm".to_owned(), String::new());
    let watch = Command::Watch { database, prefix, after: 0, form: Form::Binary };
    assert_eq!(ada.ask(&mut robot.hub, &watch), refused(RefusalCode::Denied));
    assert!(!robot.hub.has_store_requests());
    for known in ["arm", "not-there"] {
        assert_eq!(ada.ask(&mut robot.hub, &select(known)), refused(RefusalCode::Denied), "{known}");
    }
}

#[test]
fn a_flow_that_writes_more_than_the_disk_takes_waits_at_four_mebibytes() {
    let mut robot = Robot::new();
    let mut writer = Raw::flow(&mut robot.hub, OWNER);
    robot.durable_database(&mut writer, "arm");
    let value = Value::new(&vec![7_u8; 1_000_000].into_variant()).expect("less than a mebibyte");
    for tag in 1..=9 {
        let set = Command::VarSet { key: "map".into(), value: value.clone() };
        for part in set.encode(tag, Flags::NONE).to_vec().chunks(FRAGMENT_BYTES_MAX) {
            robot.hub.receive(writer.id, part, at(0));
        }
    }
    assert!(!robot.hub.wants_input(writer.id));
    let many = UNSAVED_BYTES_PER_FLOW_MAX.div_ceil(1_000_000);
    assert_eq!(robot.hub.unanswered_store_requests(), many);
    assert_eq!(robot.work(), many);
    assert!(robot.work() > 0, "the rest comes of itself");
    while robot.work() > 0 {}
    let answers = writer.read(&mut robot.hub);
    assert!((1..=9).all(|tag| tagged(&answers, tag) == [Event::Saved {}]));
}

#[test]
fn whole_databases_are_not_loaded_all_at_once() {
    let mut hub = hub();
    let large = |account: &str| Saved {
        account: account.into(),
        durable: false,
        keys: 10,
        bytes: LOADING_BYTES_MAX * 2 / 3,
    };
    let parse = |text| DatabaseName::parse(text).expect("a name");
    hub.keep_databases([(parse("arm"), large("ada")), (parse("leg"), large("bob"))]);
    let mut raws = ["arm", "leg"].map(|name| {
        let mut raw = Raw::flow(&mut hub, OWNER);
        raw.ask(&mut hub, &select(name));
        raw.send(&mut hub, 5, &get("x"));
        raw
    });
    let first = hub.next_store_request().expect("the first is wanted");
    assert!(
        !hub.has_store_requests() && hub.next_store_request().is_none(),
        "the second waits its turn"
    );
    let nothing = || Ok(Stored::Contents(Some(Vec::new())));
    hub.stored(StoreAnswer { number: first.number, outcome: nothing() }, at(0));
    let second = hub.next_store_request().expect("now there is room");
    hub.stored(StoreAnswer { number: second.number, outcome: nothing() }, at(0));
    while hub.work(at(0)) {}
    for raw in &mut raws {
        assert_eq!(refusal(&raw.read(&mut hub), 5), Some(RefusalCode::NoSuchVariable), "it was answered");
    }
}
