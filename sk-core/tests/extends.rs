//! A class offers the signals and slots of a field as its own, and classes may be generic.

mod objects;

use objects::*;
use sk_core::prelude::*;
use std::collections::VecDeque;

#[derive(Default)]
pub struct Device {
    name: String,
    failed: Signal<str>,
    resets: u32,
    log: Log,
    own: Handle<Device>,
}
impl Device {
    fn watch(&mut self, cx: &mut Cx) {
        self.own = cx.this(self);
        let this = self.own;
        attach!(cx, cx.fast_zone().pulse => this.reset);
    }
    fn reset(&mut self, _cx: &mut Cx) {
        self.resets += 1;
    }
    fn fail(&mut self, cx: &mut Cx, why: &str) {
        self.failed.emit(cx, why);
    }
    fn on_spawn(&mut self, _cx: &mut Cx) {
        self.log.note("device spawned");
    }
    fn on_destroy(&mut self, _cx: &mut Cx) {
        self.log.note("device goes");
    }
}
object! { pub Device { signals { failed(&str) } slots { watch() reset() fail(&str) } hooks { on_spawn on_destroy } } }

#[derive(Default)]
pub struct Motor {
    device: Device,
    stalled: Signal<f32>,
}
impl Motor {
    fn set_speed(&mut self, cx: &mut Cx, speed: f32) {
        if speed > 9.0 {
            self.stalled.emit(cx, speed);
            self.device.fail(cx, "too fast");
        }
    }
    fn on_spawn(&mut self, _cx: &mut Cx) {
        self.device.log.note("motor spawned");
    }
    fn on_destroy(&mut self, _cx: &mut Cx) {
        self.device.log.note("motor goes");
    }
}
object! { pub Motor : device = Device { signals { stalled(f32) } slots { set_speed(f32) } hooks { on_spawn on_destroy } } }

#[derive(Default)]
pub struct Wheel {
    motor: Motor,
    turned: Signal<()>,
}
impl Wheel {
    fn turn(&mut self, cx: &mut Cx) {
        self.motor.set_speed(cx, 10.0);
        self.turned.emit(cx, ());
    }
    /// Hides the base's slot of the same name.
    fn reset(&mut self, cx: &mut Cx) {
        self.motor.device.log.note("wheel reset");
        self.motor.device.reset(cx);
    }
}
object! { pub Wheel : motor = Motor { signals { turned() } slots { turn() reset() } } }

#[derive(Default)]
struct Seen {
    texts: Vec<String>,
    speeds: Vec<f32>,
}
impl Seen {
    fn text(&mut self, _cx: &mut Cx, text: &str) {
        self.texts.push(text.to_owned());
    }
    fn speed(&mut self, _cx: &mut Cx, speed: f32) {
        self.speeds.push(speed);
    }
}
object! { Seen { slots { text(&str) speed(f32) } } }

fn wheel(log: &Log) -> Wheel {
    let device = Device { name: "left".into(), log: log.clone(), ..Default::default() };
    Wheel { motor: Motor { device, ..Default::default() }, ..Default::default() }
}

#[test]
fn s10_a_base_offers_its_signals_and_slots() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (wheel, seen) = (cx.spawn(wheel(&log)), cx.spawn(Seen::default()));
    attach!(cx, wheel.stalled => seen.speed);
    attach!(cx, wheel.failed => seen.text);
    attach!(cx, wheel.turned => wheel.watch, Queued);
    cx.attach_by_name(wheel, "failed", seen, "text", Mode::Queued).unwrap();
    app.pulse();
    app.cx().with(wheel, |wheel, cx| wheel.turn(cx)).unwrap();
    let (texts, speeds) = app
        .cx()
        .with(seen, |seen, _| (seen.texts.clone(), seen.speeds.clone()))
        .unwrap();
    assert_eq!((texts, speeds), (vec!["too fast".to_owned()], vec![10.0]));
    assert_eq!(app.cx().counters().duplicates, 1, "by name it is the same link");
    app.pulse();
    app.pulse();
    let cx = app.cx();
    assert_eq!(cx.with(wheel, |wheel, _| wheel.motor.device.resets), Ok(1), "the base linked itself");
}

#[test]
fn the_nearest_class_hides_a_name_of_its_base() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let wheel = cx.spawn(wheel(&log));
    log.take();
    cx.invoke_method(wheel, "reset", &[]).unwrap();
    cx.invoke_method(wheel, "watch", &[]).unwrap();
    attach!(cx, cx.fast_zone().pulse => wheel.reset);
    app.pulse();
    assert_eq!(log.take(), ["wheel reset"], "by name");
    app.pulse();
    assert_eq!(log.take(), ["wheel reset"], "and by type, beside the base's own link");
    let classes: Vec<&str> = app.cx().class_of(wheel).unwrap().lineage().map(|class| class.name).collect();
    assert_eq!(classes, ["Wheel", "Motor", "Device"]);
}

#[test]
fn this_of_a_base_is_a_handle_of_the_base_type() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let wheel = cx.named("left").spawn(wheel(&log));
    let device = cx
        .with(wheel, |wheel, cx| {
            wheel.motor.device.watch(cx);
            wheel.motor.device.own
        })
        .unwrap();
    assert_eq!(device.id(), wheel.id());
    assert_eq!(cx.with(device, |device, _| device.name.clone()), Ok("left".to_owned()));
    assert_eq!(cx.find_as::<Device>("left"), Some(device));
    assert_eq!(cx.find_as::<Seen>("left"), None);
    let stranger: Handle<Seen> = cx.this(&Seen::default());
    assert_eq!(stranger, Handle::nobody(), "nobody's slot runs");
}

#[test]
fn hooks_of_the_base_run_first_at_spawn_and_last_at_burial() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let wheel = app.cx().spawn(wheel(&log));
    app.cx().destroy_later(wheel);
    app.pulse();
    assert_eq!(log.take(), ["device spawned", "motor spawned", "motor goes", "device goes"]);
}

struct Filter<T: Clone + 'static> {
    window: VecDeque<T>,
    size: usize,
    out: Signal<Vec<T>>,
    /// Not `Send`, which is allowed.
    owner: Rc<str>,
}
impl<T: Clone + 'static> Filter<T> {
    fn new(size: usize) -> Self {
        Filter { window: VecDeque::new(), size, out: Signal::new(), owner: "me".into() }
    }
    fn push(&mut self, cx: &mut Cx, value: &T) {
        self.window.push_back(value.clone());
        if self.window.len() == self.size {
            self.out.emit(cx, Vec::from(std::mem::take(&mut self.window)));
        }
    }
}
object! { for[T] where[T: Clone + 'static] Filter<T> { signals { out(Vec<T>) } slots { push(&T) } } }

#[derive(Default)]
struct Batches(Vec<String>);
impl Batches {
    fn floats(&mut self, _cx: &mut Cx, batch: &Vec<f32>) {
        self.0.push(format!("{batch:?}"));
    }
    fn words(&mut self, _cx: &mut Cx, batch: &[String]) {
        self.0.push(batch.join(" "));
    }
}
object! { Batches { slots { floats(&Vec<f32>) words(&[String]) } } }

#[test]
fn a_generic_object_works_for_each_of_its_types() {
    let (log, (_world, mut app)) = (Log::default(), world());
    let cx = app.cx();
    let (floats, words) = (cx.spawn(Filter::<f32>::new(2)), cx.spawn(Filter::<String>::new(2)));
    let batches = cx.spawn(Batches::default());
    let wheel = cx.spawn(wheel(&log));
    attach!(cx, wheel.stalled => floats.push);
    attach!(cx, floats.out => batches.floats);
    attach!(cx, words.out => batches.words);
    app.pulse();
    for _ in 0..2 {
        app.cx().with(wheel, |wheel, cx| wheel.turn(cx)).unwrap();
        app.cx()
            .with(words, |words, cx| words.push(cx, &"too fast".to_owned()))
            .unwrap();
    }
    let batches = app.cx().with(batches, |batches, _| batches.0.clone()).unwrap();
    assert_eq!(batches, ["[10.0, 10.0]", "too fast too fast"]);
    assert_eq!(app.cx().with(floats, |filter, _| filter.owner.clone()).as_deref(), Ok("me"));
}

#[test]
fn s46_one_table_declares_signals_and_slots() {
    #[derive(Default)]
    struct Probe {
        measured: Signal<(f32, String)>,
    }
    impl Probe {
        fn read(&mut self, cx: &mut Cx, unit: &str) -> Result<(), String> {
            self.measured.emit(cx, (20.5, unit.to_owned()));
            Ok(())
        }
    }
    object! { Probe { signals { measured(f32, &str) } slots { read(&str) } } }
    let (_world, mut app) = world();
    let probe = app.cx().spawn(Probe::default());
    let class = app.cx().class_of(probe).unwrap();
    assert_eq!(format!("{:?} {:?}", class.signals, class.slots), "[measured(f32, &str)] [read(&str)]");
    app.cx().invoke_method(probe, "read", &["C".into()]).unwrap();
    app.pulse();
    assert_eq!(app.cx().counters().queued_calls, 1);
}
