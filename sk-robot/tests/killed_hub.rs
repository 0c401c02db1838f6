//! A hub that is killed at any moment has what it acknowledged when it is there again.

mod program;

use program::{new_folder, skrobot};
use sk_core::SkVariant;
use sk_core::flow::database::disk::Store;
use sk_core::flow::{FlowDatabase, HubAddress, SkFlowSat};
use sk_core::prelude::*;
use sk_core::world::RealStorage;
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::Arc;

/// How often the hub is killed.
const KILLS: u32 = 20;
/// How many sets a client has under way: they share synchronisations.
const UNDER_WAY: usize = 24;
const KEYS: i64 = 40;

/// One client that sets durable variables to ever larger numbers.
struct Client {
    killer: Handle<Killer>,
    database: Handle<FlowDatabase>,
    /// What was sent and not answered, by key, in order.
    sent: BTreeMap<String, VecDeque<i64>>,
    /// The newest value of each variable that the hub has acknowledged.
    acknowledged: BTreeMap<String, i64>,
    next: i64,
}

impl Client {
    fn set_more(&mut self, cx: &mut Cx) {
        while self.sent.values().map(VecDeque::len).sum::<usize>() < UNDER_WAY {
            let key = format!("k{}", self.next % KEYS);
            assert!(self.database.set(cx, &key, self.next));
            self.sent.entry(key).or_default().push_back(self.next);
            self.next += 1;
        }
    }

    /// The hub is there, for the first time or again: all that it acknowledged must be.
    fn check(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        for (key, value) in self.acknowledged.clone() {
            self.database
                .get(cx, &key.clone(), move |cx, found| check_one(cx, this, &key, value, found));
        }
        self.set_more(cx);
    }

    fn lost(&mut self, _cx: &mut Cx) {
        // Whether they happened nobody knows; the values stay below those that come.
        self.sent.clear();
    }

    fn done(&mut self, cx: &mut Cx, key: String) {
        let value = self.sent.get_mut(&key).and_then(VecDeque::pop_front).expect("it was sent");
        self.acknowledged.insert(key, value);
        self.set_more(cx);
        let _ = cx.with(self.killer, |killer, cx| killer.acknowledged(cx));
    }

    fn refused(&mut self, _cx: &mut Cx, why: String) {
        assert!(why.contains("lost"), "{why}");
    }
}
object! { Client { slots { check() lost() done(String) refused(String) } } }

fn check_one(
    cx: &mut Cx,
    client: Handle<Client>,
    key: &str,
    acknowledged: i64,
    found: Result<Option<SkVariant>, String>,
) {
    // A hub that is killed while it is asked is asked again when it is back.
    let Ok(found) = found else { return };
    let found = found.and_then(|found| i64::try_from(&found).ok());
    let killer = cx.with(client, |client, _| client.killer).expect("it lives");
    let _ = cx.with(killer, |killer, _| {
        killer.checked += 1;
        if found.is_none_or(|found| found < acknowledged) {
            killer
                .missing
                .push(format!("{key} is {found:?}, {acknowledged} was acknowledged"));
        }
    });
}

/// Ends the hub's process without warning, now and then, and starts it anew.
struct Killer {
    folder: PathBuf,
    process: Child,
    timer: Handle<Timer>,
    armed: bool,
    kills: u32,
    checked: u32,
    missing: Vec<String>,
}

impl Killer {
    /// Some life there must be, so that there is something to lose; then it may happen at any moment.
    fn acknowledged(&mut self, cx: &mut Cx) {
        if std::mem::replace(&mut self.armed, true) {
            return;
        }
        let mut random = [0; 2];
        cx.world().rng.fill(&mut random);
        let after = Duration::from_micros(u64::from(u16::from_le_bytes(random)));
        self.timer.start_once(cx, after).unwrap();
    }

    fn kill(&mut self, cx: &mut Cx) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
        self.kills += 1;
        self.armed = false;
        if self.kills == KILLS {
            cx.quit();
        } else {
            self.process = spawn(&self.folder);
        }
    }
}
object! { Killer { slots { kill() } } }

fn spawn(folder: &Path) -> Child {
    let mut command = skrobot(folder);
    command.stdout(Stdio::null()).spawn().unwrap()
}

fn client(cx: &mut Cx, killer: Handle<Killer>, at: &HubAddress, name: &str) -> Handle<Client> {
    let hub = SkFlowSat::connect(cx, at);
    let database = hub.database(cx, name).unwrap();
    database.create(cx, true);
    let (sent, acknowledged) = (BTreeMap::new(), BTreeMap::new());
    let client = cx.spawn(Client { killer, database, sent, acknowledged, next: 0 });
    attach!(cx, hub.ready => client.check());
    attach!(cx, hub.lost => client.lost());
    attach!(cx, database.done => client.done);
    attach!(cx, database.refused => client.refused);
    client
}

#[test]
fn what_was_acknowledged_is_there_after_every_one_of_many_kills() {
    let folder = new_folder();
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let cx = app.cx();
    let timer = cx.spawn(Timer::default());
    let killer = cx.spawn(Killer {
        process: spawn(&folder),
        folder: folder.clone(),
        timer,
        armed: false,
        kills: 0,
        checked: 0,
        missing: Vec::new(),
    });
    attach!(cx, timer.timeout => killer.kill);
    let at = HubAddress::Unix(folder.join("hub.sock"));
    let clients = ["left", "right"].map(|name| client(cx, killer, &at, name));
    app.run();
    let cx = app.cx();
    let (missing, checked) = cx.with(killer, |killer, _| (killer.missing.clone(), killer.checked)).unwrap();
    assert_eq!(missing, [""; 0]);
    assert!(checked > KILLS, "only {checked} values were looked at");
    // After the last kill the file itself is looked at.
    let opened = Store::open(Arc::new(RealStorage::new()), folder.join("databases.redb")).unwrap();
    assert_eq!(opened.damage, None, "a kill is no damage");
    for (client, name) in clients.into_iter().zip(["left", "right"]) {
        let acknowledged = cx.with(client, |client, _| client.acknowledged.len()).unwrap();
        let saved = opened.saved.iter().find(|(saved, _)| saved.as_str() == name);
        assert!(saved.is_some_and(|(_, saved)| saved.keys >= acknowledged), "{name}: {saved:?}");
    }
    let _ = std::fs::remove_dir_all(&folder);
}
