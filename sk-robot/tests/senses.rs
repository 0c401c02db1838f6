//! The host module in a hub in virtual time: what it does follows from who listens.

use sk_core::flow::{Flow, SkFlowSat};
use sk_core::module::AbstractModule;
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_robot::{Hub, HubBuilder, registry};

/// A module that does nothing, so that the hub's own timers can be told from those of senses.
struct Idle;
impl AbstractModule for Idle {
    const NAME: &'static str = "idle";
    type Parameters = ();
    type Error = String;
    fn new(_cx: &mut Cx, _this: Handle<Self>, _flow: Flow, _: &()) -> Result<Self, String> {
        Ok(Idle)
    }
    fn reconfigure(&mut self, _cx: &mut Cx, _: &()) -> Result<(), String> {
        Ok(())
    }
}
object! { Idle {} }

/// How often timers fire in ten seconds, with a satellite that listens to that channel, if to any.
fn timers_fired(hub: HubBuilder, listened: Option<&str>) -> u64 {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    // The owner of a simulated folder is the user every simulated process has.
    let hub = hub.state_dir("/state".as_ref()).no_tcp().start(cx).unwrap();
    assert_eq!(cx.world().storage.owner_and_mode("/state".as_ref()).unwrap().0, USER_ID);
    let satellite = SkFlowSat::connect(cx, &hub.addresses()[0]);
    if let Some(channel) = listened {
        satellite.subscribe(cx, channel).unwrap();
    }
    simulation.run_for(&mut app, Duration::from_secs(10));
    app.cx().counters().timers_fired
}

#[test]
fn senses_are_read_only_while_somebody_listens() {
    let host = || registry::builtin(Hub::builder());
    let own = timers_fired(Hub::builder().module::<Idle>(), None);
    assert_eq!(timers_fired(host(), None), own, "unheard senses have no timer that fires");
    // Heard from the first rounds on: nine or ten readings a second apart, and of this one sense only.
    let heard = timers_fired(host(), Some("robot.host.memory")) - own;
    assert!((9..=10).contains(&heard), "{heard} readings");
}
