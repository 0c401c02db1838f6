//! Modules under their supervisors, in virtual time: each test is one of the rules.

mod hanging;
mod network;
mod orders;
mod probe;
mod restart;
mod threads;

use probe::{Hub, POLICY, Plain, Probe, ProbeParameters, book, failed};
use sk_core::module::*;

#[test]
fn all_modules_exist_before_the_first_is_started_and_they_stop_in_reverse_order() {
    let mut hub = Hub::new();
    let all = [hub.add("a", "none", POLICY), hub.add("b", "none", POLICY), hub.add("c", "none", POLICY)];
    assert_eq!(hub.state(all[0]), ModuleState::Made);
    assert_eq!(hub.modules.start(hub.app.cx()), []);
    assert_eq!(hub.state(all[2]), ModuleState::Running);
    hub.run_ms(50);
    hub.modules.stop(hub.app.cx());
    hub.run_ms(50);
    assert_eq!(
        book(),
        ["a new", "b new", "c new", "a start", "b start", "c start", "c stop", "b stop", "a stop"]
    );
    for supervisor in all {
        assert_eq!(hub.state(supervisor), ModuleState::Stopped);
        assert_eq!(supervisor.module(hub.app.cx()), None);
    }
    assert_eq!(hub.app.cx().find("modules/a/module"), None, "a stopped module is buried");
}

#[test]
fn a_loop_that_ends_stops_its_modules_in_reverse_order() {
    let mut hub = Hub::new();
    hub.add("a", "none", POLICY);
    hub.add("b", "none", POLICY);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    drop(hub);
    assert_eq!(book()[4..], ["b stop", "a stop"]);
}

#[test]
fn a_module_is_found_by_its_path() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    let cx = hub.app.cx();
    assert_eq!(cx.find("modules/a"), Some(a.id()));
    assert_eq!(cx.class_of(a).map(|class| class.name), Some("ModuleSupervisor"));
    assert_eq!(cx.find("modules/a/module"), a.module(cx));
    assert!(cx.find("modules/a/module/part").is_some());
    assert!(a.module_as::<Probe>(cx).is_some() && a.module_as::<Plain>(cx).is_none());
    let flow = hub.inside.flow("a");
    let again = Runner::<Probe>::new(flow, ProbeParameters::default()).named("a");
    assert!(hub.modules.add(hub.app.cx(), again, POLICY).is_err(), "names are unique");
    assert_eq!(book(), ["a new"]);
}

#[test]
fn a_stopped_module_stays_stopped() {
    let mut hub = Hub::new();
    let a = hub.add("a", "start", POLICY);
    hub.modules.start(hub.app.cx());
    assert!(failed(&hub.state(a)).1);
    a.stop(hub.app.cx()).unwrap();
    hub.run_ms(2000);
    assert_eq!(hub.state(a), ModuleState::Stopped);
    assert_eq!(book(), ["a new", "a start"], "no retry is left over");
}
