//! Small objects that the tests of the framework share.
#![allow(dead_code, missing_docs, reason = "each test file takes what it needs")]

use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::cell::RefCell;

pub const TICK: Duration = Duration::from_millis(10);

pub fn ms(n: u64) -> Duration {
    Duration::from_millis(n)
}

/// A simulated world with an application that ticks every 10 ms.
pub fn world() -> (Simulation, SkApp) {
    let simulation = Simulation::new(1);
    let app = simulation.app();
    (simulation, app)
}

/// What slots wrote down, in the order in which they ran.
#[derive(Clone, Default)]
pub struct Log(Rc<RefCell<Vec<String>>>);

impl Log {
    pub fn note(&self, what: impl Into<String>) {
        self.0.borrow_mut().push(what.into());
    }

    /// What was written since the last time.
    pub fn take(&self) -> Vec<String> {
        self.0.take()
    }
}

/// Has a signal that a test triggers from outside any slot, or by its slots.
#[derive(Default)]
pub struct Button {
    pub pressed: Signal<u32>,
    pub presses: u32,
}

impl Button {
    pub fn press(&mut self, cx: &mut Cx) {
        self.presses += 1;
        self.pressed.emit(cx, self.presses);
    }
    pub fn push(&mut self, cx: &mut Cx, n: u32) {
        self.pressed.emit(cx, n);
    }
}
object! { pub Button { signals { pressed(u32) } slots { press() push(u32) } } }

/// Triggers the button's signal with `n`, outside any round.
pub fn push(app: &mut SkApp, button: Handle<Button>, n: u32) {
    app.cx().with(button, |button, cx| button.push(cx, n)).unwrap();
}

/// Writes down what reaches it, also its end.
pub struct Lamp {
    pub name: &'static str,
    pub log: Log,
    pub sum: u32,
}

impl Lamp {
    pub fn new(name: &'static str, log: &Log) -> Lamp {
        Lamp { name, log: log.clone(), sum: 0 }
    }
    pub fn on(&mut self, _cx: &mut Cx, n: u32) {
        self.sum += n;
        self.log.note(format!("{} {n}", self.name));
    }
    pub fn blink(&mut self, _cx: &mut Cx) {
        self.log.note(format!("{} blinks", self.name));
    }
    fn on_destroy(&mut self, _cx: &mut Cx) {
        self.log.note(format!("{} goes", self.name));
    }
}
object! { pub Lamp { slots { on(u32) blink() } hooks { on_destroy } } }

impl Drop for Lamp {
    fn drop(&mut self) {
        self.log.note(format!("{} dropped", self.name));
    }
}

/// What the script of an [`Actor`] is played on.
pub struct Stage<'a> {
    pub me: Handle<Actor>,
    pub out: &'a Signal<u32>,
}

type Script = Box<dyn FnMut(&mut Cx, &Stage<'_>, u32)>;

/// An object whose slot does what the test says.
pub struct Actor {
    script: Script,
    pub out: Signal<u32>,
}

impl Actor {
    pub fn new(script: impl FnMut(&mut Cx, &Stage<'_>, u32) + 'static) -> Actor {
        Actor { script: Box::new(script), out: Signal::new() }
    }
    pub fn act(&mut self, cx: &mut Cx, n: u32) {
        let stage = Stage { me: cx.this(self), out: &self.out };
        (self.script)(cx, &stage, n);
    }
    pub fn go(&mut self, cx: &mut Cx) {
        self.act(cx, 0);
    }
}
object! { pub Actor { signals { out(u32) } slots { act(u32) go() } } }
