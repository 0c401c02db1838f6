//! A hub with a module that does not stop: on a thread of its own it is left behind in the end, on the hub's loop it
//! holds up the end until a second signal forces it.
//!
//! `stubborn thread STATE_DIR` or `stubborn inline STATE_DIR`, and Ctrl-C.

use sk_core::flow::Flow;
use sk_core::module::AbstractModule;
use sk_core::prelude::*;
use sk_robot::Hub;
use sk_robot::config::{LoopMode, ThreadSection};

/// Its `stop` never returns.
struct Stubborn {
    flow: Flow,
}

impl AbstractModule for Stubborn {
    const NAME: &'static str = "stubborn";
    type Parameters = ();
    type Error = String;
    fn new(cx: &mut Cx, this: Handle<Self>, flow: Flow, _: &()) -> Result<Self, String> {
        attach!(cx, cx.fast_zone().pulse => this.greet, OneShot);
        Ok(Stubborn { flow })
    }
    fn reconfigure(&mut self, _: &mut Cx, _: &()) -> Result<(), String> {
        Ok(())
    }
    fn stop(&mut self, _: &mut Cx) {
        println!("stubborn does not stop");
        loop {
            std::thread::park();
        }
    }
}

impl Stubborn {
    fn greet(&mut self, cx: &mut Cx) {
        self.flow.publish(cx, "greeting", "I stay");
        println!("stubborn runs");
    }
}
object! { Stubborn { slots { greet() } } }

/// Stops as it should.
struct Docile;

impl AbstractModule for Docile {
    const NAME: &'static str = "docile";
    type Parameters = ();
    type Error = String;
    fn new(_: &mut Cx, _: Handle<Self>, _: Flow, _: &()) -> Result<Self, String> {
        Ok(Docile)
    }
    fn reconfigure(&mut self, _: &mut Cx, _: &()) -> Result<(), String> {
        Ok(())
    }
    fn stop(&mut self, _: &mut Cx) {
        println!("docile stops");
    }
}
object! { Docile {} }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    sk_robot::logging::to_stderr("info")?;
    let mut arguments = std::env::args().skip(1);
    let on_thread = arguments.next().as_deref() == Some("thread");
    let folder = arguments.next().ok_or("stubborn thread|inline STATE_DIR")?;
    let hub = Hub::builder()
        .state_dir(folder.as_ref())
        .no_tcp()
        .module::<Docile>()
        .module::<Stubborn>();
    let hub = hub.change_module("stubborn", |module| {
        let thread = ThreadSection { mode: LoopMode::SelectIo, interval_us: 10_000 };
        module.thread = on_thread.then_some(thread);
    });
    hub.run()?;
    println!("the hub has ended");
    Ok(())
}
