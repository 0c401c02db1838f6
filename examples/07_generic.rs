//! Generic objects, non-Send state, 'extends'.
use sk_core::prelude::*;
use std::collections::VecDeque;

struct Filter<T: Clone + 'static> {
    window: VecDeque<T>,
    size: usize,
    out: Signal<Vec<T>>,
    owner: Rc<str>,
} // Rc: not Send, allowed
impl<T: Clone + 'static> Filter<T> {
    fn new(size: usize) -> Self {
        Filter { window: VecDeque::new(), size, out: Signal::new(), owner: "me".into() }
    }
    fn push(&mut self, cx: &mut Cx, v: &T) {
        self.window.push_back(v.clone());
        if self.window.len() == self.size {
            self.out.emit(cx, Vec::from(std::mem::take(&mut self.window)))
        }
    }
}
object! { for[T] where[T: Clone + 'static] Filter<T> { signals { out(Vec<T>) } slots { push(&T) } } }

// 'extends': a base, a derived, a derived of the derived
#[derive(Default)]
struct Device {
    name: String,
    failed: Signal<str>,
    resets: u32,
}
impl Device {
    /// a base that links itself: `this` is a Handle<Device>, though the object is a Wheel
    fn watch(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        attach!(cx, cx.slow_zone().pulse => this.reset)
    }
    fn reset(&mut self, _cx: &mut Cx) {
        self.resets += 1;
        println!("{} reset", self.name)
    }
    fn fail(&mut self, cx: &mut Cx, why: &str) {
        self.failed.emit(cx, why)
    }
}
object! { Device { signals { failed(&str) } slots { reset() fail(&str) } } }

#[derive(Default)]
struct Motor {
    device: Device,
    speed: f32,
    stalled: Signal<f32>,
}
impl Motor {
    fn set_speed(&mut self, cx: &mut Cx, s: f32) {
        self.speed = s;
        if s > 9.0 {
            self.stalled.emit(cx, s);
            self.device.fail(cx, "too fast")
        }
    }
}
object! { Motor : device = Device { signals { stalled(f32) } slots { set_speed(f32) } } }

#[derive(Default)]
struct Wheel {
    motor: Motor,
    turned: Signal<()>,
}
impl Wheel {
    fn turn(&mut self, cx: &mut Cx) {
        if cx.pulse().round == 2 {
            self.motor.device.watch(cx)
        }
        self.motor.set_speed(cx, 10.0);
        self.turned.emit(cx, ())
    }
}
object! { Wheel : motor = Motor { signals { turned() } slots { turn() } } }

#[derive(Default)]
struct Seen {
    strings: Vec<String>,
    batches: usize,
}
impl Seen {
    fn text(&mut self, _: &mut Cx, s: &str) {
        self.strings.push(s.into())
    }
    fn batch(&mut self, _: &mut Cx, b: &[f32]) {
        self.batches += b.len()
    }
}
object! { Seen { signals {} slots { text(&str) batch(&[f32]) } } }

fn main() {
    let mut app = SkApp::new();
    let cx = app.cx();
    let filter = cx.spawn(Filter::<f32>::new(4));
    let seen = cx.spawn(Seen::default());
    let wheel = cx.spawn(Wheel {
        motor: Motor { device: Device { name: "left".into(), ..Default::default() }, ..Default::default() },
        ..Default::default()
    });
    attach!(cx, filter.out => seen.batch);
    attach!(cx, wheel.stalled => filter.push); // Motor's signal, on a Wheel
    attach!(cx, wheel.failed => seen.text); // Device's signal, on a Wheel
    attach!(cx, wheel.turned => wheel.reset, Queued); // Device's slot, on a Wheel
    attach!(cx, cx.fast_zone().pulse => wheel.turn);
    cx.attach_by_name(wheel, "failed", seen, "text", Mode::Queued).unwrap(); // the same link: Ok, counted at rewire, changes nothing
    cx.attach_by_name(seen, "failed", seen, "text", Mode::Queued).unwrap_err();
    cx.invoke_method(wheel, "reset", &[]).unwrap(); // Device's slot by name, on a Wheel
    for _ in 0..10 {
        app.pulse()
    }
    app.cx()
        .with(seen, |s, _| println!("{:?} {}", s.strings.len(), s.batches))
        .unwrap();
    println!("duplicates {}", app.cx().counters().duplicates);
    app.cx().with(filter, |f, _| println!("{}", f.owner)).unwrap();
}
