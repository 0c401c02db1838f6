//! What a module publishes, inside a hub and as a satellite.

use crate::probe::{Ear, Hub, POLICY};
use sk_core::flow::server::Settings;
use sk_core::flow::{Flow, FlowMessage, Rights, SkFlowSat, SkFlowServer};
use sk_core::module::*;
use sk_core::prelude::*;

#[test]
fn what_a_module_publishes_reaches_a_subscriber_of_the_hub_also_after_a_restart() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    let cx = hub.app.cx();
    let seed = hub.server.pipe(cx, Rights::ALL).unwrap();
    let other = SkFlowSat::inside(cx, seed);
    let ear = cx.spawn(Ear::default());
    other.subscribe(cx, "robot.a.level").unwrap();
    attach!(cx, other.message => ear.hear);
    hub.run_ms(500);
    let heard = hub.app.cx().with(ear, |ear, _| ear.values.len()).unwrap();
    assert!(heard > 5, "{heard}");
    let module = a.module(hub.app.cx()).unwrap();
    hub.app.cx().destroy_later(module);
    hub.run_ms(50);
    a.set(hub.app.cx(), "level", &6.into()).unwrap();
    hub.run_ms(500);
    let values = hub.app.cx().with(ear, |ear, _| ear.values.clone()).unwrap();
    assert_eq!((values.first(), values.last()), (Some(&5), Some(&6)));
}

/// Runs anywhere; ends its program when the hub is lost.
struct Remote {
    flow: Flow,
}
impl AbstractModule for Remote {
    const NAME: &'static str = "a";
    type Parameters = ();
    type Error = String;
    fn new(cx: &mut Cx, this: Handle<Self>, flow: Flow, _: &()) -> Result<Self, String> {
        attach!(cx, cx.fast_zone().pulse => this.tick);
        attach!(cx, flow.satellite().lost => this.leave());
        Ok(Remote { flow })
    }
    fn reconfigure(&mut self, _: &mut Cx, _: &()) -> Result<(), String> {
        Ok(())
    }
}
impl Remote {
    fn tick(&mut self, cx: &mut Cx) {
        self.flow.publish(cx, "level", 5i64);
    }
    fn leave(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}
object! { Remote { slots { tick() leave() } } }

/// Ends the loop with the first value.
struct First;
impl First {
    fn hear(&mut self, cx: &mut Cx, message: &FlowMessage) {
        assert_eq!(message.name(), "robot.a.level");
        cx.quit();
    }
}
object! { First { slots { hear(&FlowMessage) } } }

#[test]
fn the_same_module_runs_as_a_satellite_of_its_own() {
    let path = std::env::temp_dir().join(format!("sk-module-{}.sock", std::process::id()));
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let cx = app.cx();
    let owner_uid = Some(nix::unistd::getuid().as_raw());
    let server = SkFlowServer::start(cx, Settings { user: "robot".parse().unwrap(), token: None, owner_uid });
    let address = server.listen(cx, &path.as_path().into()).unwrap();
    let satellite = std::thread::spawn(move || SkFlowSat::run::<Remote>(&address.to_string()));
    let seed = server.pipe(cx, Rights::ALL).unwrap();
    let inside = SkFlowSat::inside(cx, seed);
    let first = cx.spawn(First);
    inside.subscribe(cx, "robot.a.level").unwrap();
    attach!(cx, inside.message => first.hear);
    app.run();
    drop(app);
    assert!(satellite.join().unwrap().is_ok());
    assert!(SkFlowSat::run::<Remote>("nowhere").is_err());
}
