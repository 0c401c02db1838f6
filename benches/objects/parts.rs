//! The parts of the bench, each for a process of its own.

use sk_benches::{Amount, BenchError, Sheet};
use sk_core::prelude::*;
use std::time::Instant as Moment;

/// The stack in which the deepest chain is buried.
const SMALL_STACK_BYTES: usize = 256 * 1024;

/// The unit of the kernel's figure on the machines we measure on.
const PAGE_BYTES: f64 = 4096.0;

/// What a part does.
type Work = fn(&mut Sheet, Amount) -> Result<(), BenchError>;

/// Every part and its name.
pub(crate) const ALL: [(&str, Work); 6] = [
    ("flat", |sheet, amount| flat(sheet, amount, false)),
    ("connected", |sheet, amount| flat(sheet, amount, true)),
    ("chain", |sheet, amount| chain(sheet, "objects/chain", amount.pick(100_000, 10))),
    ("deep", deep),
    ("order", |sheet, amount| random_order(sheet, amount.pick(10_000, 10))),
    ("order-large", |sheet, amount| random_order(sheet, amount.pick(1_000_000, 20))),
];

#[derive(Default)]
struct Thing {
    sum: i64,
    number: Signal<i64>,
}
impl Thing {
    fn take(&mut self, _cx: &mut Cx, number: i64) {
        self.sum = self.sum.wrapping_add(number);
    }
}
object! { Thing { signals { number(i64) } slots { take(i64) } } }

/// Measures one side of a life at a time.
struct Scale<'a> {
    sheet: &'a mut Sheet,
    case: String,
    count: usize,
}

impl Scale<'_> {
    fn tell(&mut self, metric: &str, began: Moment) {
        let each = began.elapsed().as_nanos() as f64 / self.count as f64;
        self.sheet.figure(&self.case, metric, "ns", each);
    }

    fn tell_bytes(&mut self, before: f64) -> Result<(), BenchError> {
        let bytes = (resident_bytes()? - before) / self.count as f64;
        self.sheet.figure(&self.case, "bytes", "B", bytes);
        Ok(())
    }
}

fn app() -> Result<SkApp, BenchError> {
    let built = SkApp::builder().mode(TimingMode::NoTiming).build();
    built.map_err(|error| BenchError::Ours(error.to_string()))
}

/// Pulses until only so many objects live.
fn bury(app: &mut SkApp, living: u32) {
    while app.cx().stats().objects > living {
        app.pulse();
    }
}

fn flat(sheet: &mut Sheet, amount: Amount, connected: bool) -> Result<(), BenchError> {
    let count = amount.pick(1_000_000, 10);
    let case = if connected { "objects/connected" } else { "objects/flat" };
    let mut scale = Scale { sheet, case: case.to_owned(), count };
    let mut app = app()?;
    let common = app.cx().spawn(Thing::default());
    let nobody = common;
    // The list of handles is touched before, so that only the objects are counted.
    let mut things = vec![nobody; count];
    app.pulse();
    let living = app.cx().stats().objects;
    let before = resident_bytes()?;
    let began = Moment::now();
    for thing in &mut things {
        *thing = app.cx().spawn(Thing::default());
    }
    if connected {
        for thing in &things {
            attach!(app.cx(), thing.number => common.take);
        }
        app.pulse();
    }
    scale.tell("create_ns", began);
    scale.tell_bytes(before)?;
    let began = Moment::now();
    for thing in &things {
        app.cx().destroy_later(*thing);
    }
    bury(&mut app, living);
    scale.tell("bury_ns", began);
    Ok(())
}

fn chain(sheet: &mut Sheet, case: &str, depth: usize) -> Result<(), BenchError> {
    let mut scale = Scale { sheet, case: case.to_owned(), count: depth };
    let mut app = app()?;
    app.pulse();
    let living = app.cx().stats().objects;
    let before = resident_bytes()?;
    let began = Moment::now();
    let root = app.cx().spawn(Thing::default());
    let mut last = root;
    for _ in 1..depth {
        last = app.cx().under(last).spawn(Thing::default());
    }
    scale.tell("create_ns", began);
    scale.tell_bytes(before)?;
    let began = Moment::now();
    app.cx().destroy_later(root);
    bury(&mut app, living);
    scale.tell("bury_ns", began);
    Ok(())
}

/// A million deep, in a thread whose stack would overflow if the burial nested.
fn deep(sheet: &mut Sheet, amount: Amount) -> Result<(), BenchError> {
    let depth = amount.pick(1_000_000, 1_000);
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(SMALL_STACK_BYTES);
        let work = thread.spawn_scoped(scope, || chain(sheet, "objects/chain/1000000", depth))?;
        work.join()
            .map_err(|_| BenchError::Ours("the thread of the deep chain panicked".into()))?
    })
}

fn random_order(sheet: &mut Sheet, count: usize) -> Result<(), BenchError> {
    let case = format!("objects/bury-order/random/{count}");
    let mut scale = Scale { sheet, case, count };
    let mut app = app()?;
    let parent = app.cx().spawn(Thing::default());
    let mut children: Vec<_> = (0..count).map(|_| app.cx().under(parent).spawn(Thing::default())).collect();
    shuffle(&mut children);
    app.pulse();
    let living = app.cx().stats().objects - count as u32;
    let began = Moment::now();
    for child in &children {
        app.cx().destroy_later(*child);
    }
    bury(&mut app, living);
    scale.tell("bury_ns", began);
    Ok(())
}

/// The same order in every run: the generator is Knuth's for 64 bits, and its upper half is used.
fn shuffle<T>(items: &mut [T]) {
    let mut state = 1u64;
    for last in (1..items.len()).rev() {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        items.swap(last, (state >> 33) as usize % (last + 1));
    }
}

/// The memory of the process that lies in RAM.
fn resident_bytes() -> Result<f64, BenchError> {
    let statm = std::fs::read_to_string("/proc/self/statm")?;
    let pages = statm.split(' ').nth(1).and_then(|pages| pages.parse::<f64>().ok());
    let unread = || BenchError::Ours("/proc/self/statm is not as expected".into());
    Ok(pages.ok_or_else(unread)? * PAGE_BYTES)
}
