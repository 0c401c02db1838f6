//! A satellite that keeps things in the hub's databases, and watches those of others.
//!
//! It has a durable database, where every change is kept when the hub says so, and one that it saves as a whole: of its
//! three variables all are of one number whenever it is saved. Each has one command under way at a time, so that
//! it is known which one an answer is for.

use crate::action::Action;
use crate::archive::{Place, WHOLE, value_of};
use crate::identity::Identity;
use crate::ledger;
use crate::rule::Rule;
use crate::script::Way;
use crate::wishes::Wishes;
use sk_core::flow::{FlowDatabase, SkFlowSat, Variable};
use sk_core::prelude::*;
use sk_flat::SkVariant;
use std::collections::{BTreeMap, VecDeque};

/// The variables of a durable database.
const KEYS: [&str; 4] = ["k0", "k1", "k2", "k3"];
/// Those of one that is saved as a whole.
const PARTS: [&str; 3] = ["a", "b", "c"];
/// One change of so many deletes.
const DELETES: u64 = 6;

/// What is to be done with a database.
#[derive(Clone, Copy, Debug)]
enum Order {
    Set(&'static str, u64),
    Delete(&'static str),
    /// The last of a moment: all parts have this number.
    Save(u64),
    Load,
}

/// One of its databases.
struct Desk {
    database: Handle<FlowDatabase>,
    name: String,
    durable: bool,
    orders: VecDeque<Order>,
    /// The order under way, and its number in the archive if it is one that is to be kept.
    under_way: Option<(Order, Option<u64>)>,
    /// The hub was lost meanwhile: what is in the memory of the next one is another matter.
    lost: bool,
}

/// A program around an `SkFlowSat`.
pub(crate) struct Scribe {
    who: Identity,
    hub: Handle<SkFlowSat>,
    durable: Desk,
    saved: Desk,
    /// By name.
    watched: BTreeMap<String, Handle<FlowDatabase>>,
    number: u64,
    ready: bool,
}

object! {
    pub(crate) Scribe {
        slots {
            let_in() lose() kept(&str) not_kept(&str) saved(&str) not_saved(&str) told(&Variable)
        }
    }
}

/// The durable database of a node, and the one that a life of it saves.
pub(crate) fn names_of(node: u16, life: u16) -> [String; 2] {
    [format!("n{node}.d"), format!("n{node}.s{life}")]
}

impl Scribe {
    pub(crate) fn start(cx: &mut Cx, who: Identity, way: Way) -> Option<Handle<Scribe>> {
        let hub = SkFlowSat::connect_as(cx, &way.address(who.hub), way.credentials(who.home));
        let [durable, saved] = names_of(who.node, who.life);
        let desk = |cx: &mut Cx, name: String, durable| {
            let database = hub.database(cx, &name).ok()?;
            database.create(cx, durable);
            Some(Desk { database, name, durable, orders: VecDeque::new(), under_way: None, lost: false })
        };
        let (durable, saved) = (desk(cx, durable, true)?, desk(cx, saved, false)?);
        let (first, second) = (durable.database, saved.database);
        let number = u64::from(who.life) << 32;
        let scribe = Scribe { who, hub, durable, saved, watched: BTreeMap::new(), number, ready: false };
        let this = cx.spawn(scribe);
        attach!(cx, hub.ready => this.let_in);
        attach!(cx, hub.lost => this.lose());
        attach!(cx, first.done => this.kept);
        attach!(cx, first.refused => this.not_kept);
        attach!(cx, second.done => this.saved);
        attach!(cx, second.refused => this.not_saved);
        Some(this)
    }

    pub(crate) fn act(&mut self, cx: &mut Cx, action: Action) {
        match action {
            Action::Write(count) => {
                for _ in 0..count {
                    self.number += 1;
                    let chance = cx.world().rng.next_u64();
                    let key = KEYS[chance as usize % KEYS.len()];
                    let deletes = (chance >> 32).is_multiple_of(DELETES);
                    let order = if deletes { Order::Delete(key) } else { Order::Set(key, self.number) };
                    self.durable.orders.push_back(order);
                }
                self.durable.go_on(cx);
            }
            Action::Save => {
                self.number += 1;
                let parts = PARTS.into_iter().map(|key| Order::Set(key, self.number));
                self.saved.orders.extend(parts.chain([Order::Save(self.number)]));
                self.saved.go_on(cx);
            }
            Action::Load => {
                self.saved.orders.push_back(Order::Load);
                self.saved.go_on(cx);
            }
            Action::Watch(node) => names_of(node, 0).into_iter().for_each(|name| self.watch(cx, name)),
            Action::Ask => self.ask(cx),
            _ => {}
        }
    }

    /// What it should find at its hub.
    pub(crate) fn wishes(&self, cx: &mut Cx) -> Wishes {
        Wishes { ready: self.ready, connection: self.hub.connection(cx), ..Wishes::default() }
    }

    /// What it still has to do, in words.
    pub(crate) fn unfinished(&self) -> Option<String> {
        let desks = [&self.durable, &self.saved];
        let waiting = desks
            .into_iter()
            .find(|desk| desk.under_way.is_some() || !desk.orders.is_empty())?;
        Some(format!("{:?} of {} has no answer", waiting.under_way, waiting.name))
    }

    fn watch(&mut self, cx: &mut Cx, name: String) {
        let this = cx.this(self);
        let Ok(database) = self.hub.database(cx, &name) else { return };
        if self.watched.insert(name, database).is_none() {
            attach!(cx, database.changed => this.told);
            database.watch(cx, "");
        }
    }

    /// Asks the hub for all that it watches: it must know the same.
    fn ask(&mut self, cx: &mut Cx) {
        let node = self.who.node;
        for (name, &database) in &self.watched {
            let keys = if name.ends_with(".d") { &KEYS[..] } else { &PARTS[..] };
            for key in keys {
                let place: Place = (name.clone(), (*key).to_owned());
                database.get(cx, key, move |cx, value| {
                    // A database that is no more is not asked about again.
                    let Ok(value) = value else { return };
                    let known = database.known(cx, &place.1);
                    if known != value {
                        let text = format!(
                            "n{node} was told {} of {} is {}, and it is {}",
                            place.1,
                            place.0,
                            told_of(known.as_ref()),
                            told_of(value.as_ref())
                        );
                        ledger::with(|ledger| ledger.complain(Rule::Watched, text));
                    }
                });
            }
        }
    }

    fn told(&mut self, cx: &mut Cx, variable: &Variable) {
        let place: Place = (variable.database().to_owned(), variable.key().to_owned());
        let text = variable.value().map(|value| value.as_str().unwrap_or("(no text)").to_owned());
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            let length = text.as_ref().map_or(0, String::len) as u64;
            ledger.note(&[12, self.who.node.into(), length, cx.clock_now().as_nanos()]);
            if let Some(text) = text {
                ledger.was_read(&place, &text);
            }
        });
    }

    fn let_in(&mut self, cx: &mut Cx) {
        self.ready = true;
        let connection = self.hub.connection(cx).unwrap_or(0);
        ledger::with(|ledger| ledger.was_let_in(self.who, connection));
    }

    fn lose(&mut self, _: &mut Cx) {
        self.ready = false;
        for desk in [&mut self.durable, &mut self.saved] {
            desk.lost = desk.under_way.is_some();
        }
    }

    fn kept(&mut self, cx: &mut Cx, key: &str) {
        self.durable.answered(cx, Some(key));
    }

    fn not_kept(&mut self, cx: &mut Cx, _why: &str) {
        self.durable.answered(cx, None);
    }

    fn saved(&mut self, cx: &mut Cx, key: &str) {
        self.saved.answered(cx, Some(key));
    }

    fn not_saved(&mut self, cx: &mut Cx, _why: &str) {
        self.saved.answered(cx, None);
    }
}

impl Desk {
    /// The place that an order changes on the disk, and what is there afterwards.
    fn effect(&self, order: Order) -> Option<(Place, Option<u64>)> {
        let place = |key: &str| (self.name.clone(), key.to_owned());
        match order {
            Order::Set(key, number) => self.durable.then(|| (place(key), Some(number))),
            Order::Delete(key) => self.durable.then(|| (place(key), None)),
            Order::Save(number) => Some((place(WHOLE), Some(number))),
            Order::Load => None,
        }
    }

    fn go_on(&mut self, cx: &mut Cx) {
        while self.under_way.is_none()
            && let Some(order) = self.orders.pop_front()
        {
            let effect = self.effect(order);
            let begin = |(place, value): &(Place, Option<u64>)| {
                ledger::with(|ledger| ledger.archive.begin(place, *value))
            };
            self.under_way = Some((order, effect.as_ref().map(begin)));
            let text =
                |key: &str, number| SkVariant::from(value_of(&(self.name.clone(), key.to_owned()), number));
            let accepted = match order {
                Order::Set(key, number) => self.database.set(cx, key, text(key, number)),
                Order::Delete(key) => self.database.delete(cx, key),
                Order::Save(_) => self.database.save(cx),
                Order::Load => self.database.load(cx),
            };
            if !accepted {
                self.finish(false);
            }
        }
    }

    /// The hub has answered: that it is done, with the key it is about, or that it is not.
    fn answered(&mut self, cx: &mut Cx, done: Option<&str>) {
        let expected = match self.under_way {
            Some((Order::Set(key, _) | Order::Delete(key), _)) => Some(key),
            Some((Order::Save(_) | Order::Load, _)) => Some(""),
            None => None,
        };
        if expected.is_none() || done.is_some_and(|key| Some(key) != expected) {
            let text = format!("{}: {done:?} was answered, {:?} was asked", self.name, self.under_way);
            ledger::with(|ledger| ledger.complain(Rule::Kept, text));
        }
        ledger::with(|ledger| {
            ledger.now = cx.clock_now();
            ledger.note(&[13, done.is_some().into(), cx.clock_now().as_nanos()]);
        });
        self.finish(done.is_some());
        self.go_on(cx);
    }

    fn finish(&mut self, well: bool) {
        let Some((order, number)) = self.under_way.take() else { return };
        let well = well && (self.durable || !std::mem::take(&mut self.lost));
        if let (Some((place, _)), Some(number)) = (self.effect(order), number) {
            ledger::with(|ledger| ledger.archive.finish(&place, number, well));
        }
        if !well && !self.durable && matches!(order, Order::Set(..)) {
            // The rest of that moment would save what is not of one moment.
            while let Some(order) = self.orders.pop_front() {
                if matches!(order, Order::Save(_)) {
                    break;
                }
            }
        }
    }
}

fn told_of(value: Option<&SkVariant>) -> String {
    let text = value.map(|value| value.as_str().unwrap_or("(no text)").chars().take(30).collect());
    text.unwrap_or_else(|| "nothing".to_owned())
}
