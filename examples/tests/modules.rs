//! The example modules, as processes.

use sk_core::flow::{FlowMessage, HubAddress, SkFlowSat};
use sk_core::prelude::*;
use sk_robot::Hub;
use sk_robot::places::Places;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

/// A process that is ended with its test.
struct Example(Child);

impl Example {
    /// Cargo builds the examples beside the tests of their package.
    fn start(name: &str, state: &Path) -> Example {
        let own = std::env::current_exe().unwrap();
        let folder: PathBuf = own.parent().unwrap().parent().unwrap().join("examples");
        let mut command = Command::new(folder.join(name));
        Example(command.env("SKROBOT_STATE_DIR", state).spawn().unwrap())
    }
}

impl Drop for Example {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Hears three voltages and ends the loop.
#[derive(Default)]
struct Ear {
    volts: Vec<f64>,
}
impl Ear {
    fn hear(&mut self, cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        assert_eq!(message.name(), "robot.battery.volts");
        let unit = message.channel().properties.variant().get("unit").cloned();
        assert_eq!(unit, Some("V".into()));
        self.volts.push(f64::try_from(&message.value()?)?);
        if self.volts.len() == 3 {
            cx.quit();
        }
        Ok(())
    }
}
object! { Ear { slots { hear(&FlowMessage) } } }

fn heard(app: &mut SkApp, address: &HubAddress) -> Vec<f64> {
    let cx = app.cx();
    let satellite = SkFlowSat::connect(cx, address);
    satellite.subscribe(cx, "robot.battery.volts").unwrap();
    let ear = cx.spawn(Ear::default());
    attach!(cx, satellite.message => ear.hear);
    app.run();
    app.cx().destroy_later(satellite);
    app.cx().with(ear, |ear, _| ear.volts.clone()).unwrap()
}

#[test]
fn s171_one_module_source_runs_in_a_hub_and_as_a_satellite() {
    let folder = std::env::temp_dir().join(format!("sk-modules-{}", std::process::id()));
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();

    // In a hub of its own, another process; it is looked for until it is there.
    let inside = folder.join("inside");
    let hub = Example::start("12_module_in_a_hub", &inside);
    let volts = heard(&mut app, &Places::find(Some(&inside)).unwrap().address());
    assert!(volts.windows(2).all(|pair| pair[1] < pair[0]), "{volts:?}");
    drop(hub);

    // As a satellite of a hub that is not its own: the same channel, with the same properties.
    let outside = folder.join("outside");
    let hub = Hub::builder().state_dir(&outside).no_tcp().start(app.cx()).unwrap();
    let satellite = Example::start("13_module_as_satellite", &outside);
    let volts = heard(&mut app, &hub.addresses()[0]);
    assert!(volts.windows(2).all(|pair| pair[1] < pair[0]), "{volts:?}");
    drop(satellite);
    hub.stop(app.cx());
    drop(app);
    std::fs::remove_dir_all(&folder).unwrap();
}
