//! Proof that the simulation finds what is wrong: every planted bug, switched on alone.
#![cfg(feature = "planted-bugs")]

use sk_core::flow::server::Settings;
use sk_core::flow::{HubAddress, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Bug, Simulation, USER_ID, plant};
use sk_flat::SkVariant;
use sk_sim::{generate, run::run};

/// Seeds that are enough for every one of them.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=1500;

#[test]
fn every_planted_bug_is_found() {
    for (bug, name) in Bug::ALL {
        plant(Some(bug));
        let found = SEEDS.into_iter().find(|seed| run(&generate::script(*seed)).complaint.is_some());
        plant(None);
        assert!(found.is_some(), "{name} is not found");
    }
}

struct Ear {
    lost: u32,
}
impl Ear {
    fn lose(&mut self, _: &mut Cx) {
        self.lost += 1;
    }
}
object! { Ear { slots { lose() } } }

/// A hub that panics while it serves a satellite is destroyed: the connections end, and the loop goes on.
#[test]
fn a_hub_that_panics_ends_and_takes_no_other_with_it() {
    let simulation = Simulation::new(1);
    let address: HubAddress = "unix:/run/hub.sock".parse().expect("an address");
    let hub_node =
        simulation.node(simulation.world(), "hub", |settings| settings.mode = TimingMode::SelectIo);
    let server = hub_node.with(|cx| {
        let user = "robot".parse().expect("a name");
        let server = SkFlowServer::start(cx, Settings { user, token: None, owner_uid: Some(USER_ID) });
        server.listen(cx, &address).expect("a free place");
        server
    });
    let machine = simulation.world().machine();
    let node = simulation.node(&machine, "client", |settings| settings.mode = TimingMode::SelectIo);
    let (satellite, ear) = node.with(|cx| {
        let satellite = SkFlowSat::connect(cx, &address);
        let ear = cx.spawn(Ear { lost: 0 });
        attach!(cx, satellite.lost => ear.lose());
        (satellite, ear)
    });
    simulation.run_for_nodes(Duration::from_secs(1)).expect("time passes");
    let connected = node.with(|cx| {
        // The hub refuses to repeat what is not there.
        let _ = satellite.open(cx, "twice", SkVariant::map([("format", SkVariant::from("x"))]));
        let twin = SkFlowSat::connect(cx, &address);
        let _ = twin.open(cx, "twice", SkVariant::map([("format", SkVariant::from("x"))]));
        satellite.connection(cx).is_some()
    });
    assert!(connected);
    plant(Some(Bug::PanicAtRefusal));
    simulation.run_for_nodes(Duration::from_secs(1)).expect("time passes");
    plant(None);
    let (alive, panics) = hub_node.with(|cx| (cx.is_alive(server), cx.counters().panics));
    assert_eq!((alive, panics, hub_node.has_ended()), (false, 1, false));
    let lost = node.with(|cx| cx.with(ear, |ear, _| ear.lost));
    assert!(lost.is_ok_and(|lost| lost > 0), "its satellite looks for it in vain, again and again");
}
