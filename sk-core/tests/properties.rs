//! Random programs against a small model: no call reaches the dead, each is buried once, nothing leaks.

mod objects;

use objects::world;
use proptest::prelude::*;
use sk_core::eventloop::Reason;
use sk_core::prelude::*;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

/// What happened to the objects, as they tell it themselves.
#[derive(Default)]
struct Chronicle {
    living: BTreeSet<usize>,
    buried: Vec<usize>,
    dropped: usize,
    calls: BTreeMap<usize, u64>,
    told: Vec<ObjectId>,
}

type Shared = Rc<RefCell<Chronicle>>;

struct Part {
    number: usize,
    chronicle: Shared,
    out: Signal<u32>,
}

impl Part {
    fn call(&mut self, cx: &mut Cx, depth: u32) {
        {
            let mut chronicle = self.chronicle.borrow_mut();
            assert!(chronicle.living.contains(&self.number), "{} was called after its burial", self.number);
            *chronicle.calls.entry(self.number).or_default() += 1;
        }
        assert!(cx.is_alive(cx.this(self)), "a marked object was called");
        if depth > 0 {
            self.out.emit(cx, depth - 1);
        }
    }
    fn end(&mut self, cx: &mut Cx, _depth: u32) {
        cx.destroy_later(cx.this(self));
    }
    fn on_destroy(&mut self, _cx: &mut Cx) {
        let mut chronicle = self.chronicle.borrow_mut();
        assert!(chronicle.living.remove(&self.number), "{} was buried twice", self.number);
        chronicle.buried.push(self.number);
    }
}
object! { Part { signals { out(u32) } slots { call(u32) end(u32) } hooks { on_destroy } } }

impl Drop for Part {
    fn drop(&mut self) {
        self.chronicle.borrow_mut().dropped += 1;
    }
}

struct Registrar(Shared);
impl Registrar {
    fn buried(&mut self, _cx: &mut Cx, id: ObjectId, _reason: Reason) {
        self.0.borrow_mut().told.push(id);
    }
}
object! { Registrar { slots { buried(ObjectId, Reason) } } }

#[derive(Clone, Debug)]
enum Step {
    Spawn { parent: Option<usize> },
    Attach { from: usize, to: usize, mode: u8, end: bool },
    Detach { from: usize, to: usize, end: bool },
    Emit { from: usize, depth: u32 },
    Destroy { who: usize },
    Pulse,
}

fn step() -> impl Strategy<Value = Step> {
    let who = || 0..40usize;
    prop_oneof![
        3 => proptest::option::of(who()).prop_map(|parent| Step::Spawn { parent }),
        5 => (who(), who(), 0..6u8, proptest::bool::weighted(0.1))
            .prop_map(|(from, to, mode, end)| Step::Attach { from, to, mode, end }),
        1 => (who(), who(), any::<bool>()).prop_map(|(from, to, end)| Step::Detach { from, to, end }),
        4 => (who(), 0..5u32).prop_map(|(from, depth)| Step::Emit { from, depth }),
        1 => who().prop_map(|who| Step::Destroy { who }),
        3 => Just(Step::Pulse),
    ]
}

const MODES: [Mode; 6] =
    [Mode::Direct, Mode::Queued, Mode::Latest, Mode::OneShot, Mode::Queued.once(), Mode::Latest.once()];

/// The model: who is whose child, and who is marked.
#[derive(Default)]
struct Model {
    parents: Vec<Option<usize>>,
}

impl Model {
    fn below(&self, top: usize) -> Vec<usize> {
        let is_below = |mut at: usize| loop {
            match (at == top, self.parents[at]) {
                (true, _) => break true,
                (false, Some(parent)) => at = parent,
                (false, None) => break false,
            }
        };
        (0..self.parents.len()).filter(|&at| is_below(at)).collect()
    }
}

fn run(steps: &[Step]) {
    let chronicle = Shared::default();
    let (_world, mut app) = world();
    let registrar = app.cx().spawn(Registrar(chronicle.clone()));
    let cx = app.cx();
    attach!(cx, cx.event_loop().buried => registrar.buried);
    app.pulse();
    let own = app.cx().stats().objects as usize;
    let (mut handles, mut model) = (Vec::new(), Model::default());
    for step in steps {
        let cx = app.cx();
        let at = |i: &usize| (!handles.is_empty()).then(|| i % handles.len());
        match step {
            Step::Spawn { parent } => {
                let number = handles.len();
                let parent = parent.as_ref().and_then(at).filter(|&i| cx.is_alive(handles[i]));
                chronicle.borrow_mut().living.insert(number);
                let part = Part { number, chronicle: chronicle.clone(), out: Signal::new() };
                let handle = match parent {
                    Some(parent) => cx.under(handles[parent]).spawn(part),
                    None => cx.spawn(part),
                };
                model.parents.push(parent);
                handles.push(handle);
            }
            Step::Attach { from, to, mode, end } => {
                let (Some(from), Some(to)) = (at(from), at(to)) else { continue };
                let slot = if *end { "end" } else { "call" };
                let asked = cx.attach_by_name(handles[from], "out", handles[to], slot, MODES[*mode as usize]);
                assert_eq!(asked.is_ok(), cx.exists(handles[from]) && cx.exists(handles[to]));
            }
            Step::Detach { from, to, end } => {
                let (Some(from), Some(to)) = (at(from), at(to)) else { continue };
                let slot = if *end { "end" } else { "call" };
                let _ = cx.detach_by_name(handles[from], "out", handles[to], slot);
            }
            Step::Emit { from, depth } => {
                let Some(from) = at(from) else { continue };
                let emitted = cx.with(handles[from], |part, cx| part.out.emit(cx, *depth));
                assert_eq!(emitted.is_ok(), cx.exists(handles[from]));
            }
            Step::Destroy { who } => {
                let Some(who) = at(who) else { continue };
                let was_there = cx.exists(handles[who]);
                cx.destroy_later(handles[who]);
                for id in model.below(who).into_iter().filter(|_| was_there) {
                    assert!(!cx.is_alive(handles[id]), "the whole subtree is marked");
                }
            }
            Step::Pulse => {
                let marked: Vec<usize> = (0..handles.len()).filter(|&i| !cx.is_alive(handles[i])).collect();
                app.pulse();
                for &i in &marked {
                    assert!(
                        !app.cx().exists(handles[i]),
                        "what was marked before the round is buried after it"
                    );
                }
                for (i, &handle) in handles.iter().enumerate() {
                    assert_eq!(app.cx().exists(handle), chronicle.borrow().living.contains(&i));
                }
            }
        }
        assert_eq!(app.cx().stats().objects as usize - own, chronicle.borrow().living.len());
    }
    app.pulse();
    app.pulse();
    let told: BTreeSet<ObjectId> = chronicle.borrow().told.iter().copied().collect();
    assert_eq!(told.len(), chronicle.borrow().told.len(), "each burial is told once");
    assert_eq!(told.len(), chronicle.borrow().buried.len());
    assert_eq!(app.cx().counters().panics, 0);
    drop(app);
    let chronicle = chronicle.borrow();
    assert_eq!(chronicle.dropped, handles.len(), "nothing leaks");
    assert_eq!(chronicle.buried.len(), handles.len());
    assert!(chronicle.living.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn random_programs_call_nobody_dead_bury_each_once_and_leak_nothing(
        steps in proptest::collection::vec(step(), 1..120)
    ) {
        run(&steps);
    }
}
