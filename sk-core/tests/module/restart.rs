//! What fails is contained, reported, and begun again.

use crate::probe::{Hub, POLICY, ProbeParameters, book, failed};
use sk_core::module::*;
use sk_core::prelude::*;

#[test]
fn a_module_that_cannot_be_made_or_started_is_reported_and_the_others_run() {
    for (fault, reason) in [
        ("new", "new failed: new of b is refused"),
        ("start", "start failed: start of b is refused"),
        ("panic new", "new panicked: new of b breaks"),
        ("panic start", "start panicked: start of b breaks"),
    ] {
        let mut hub = Hub::new();
        let (a, b, c) = (
            hub.add("a", "none", POLICY),
            hub.add("b", fault, RestartPolicy::NEVER),
            hub.add("c", "none", POLICY),
        );
        assert_eq!(hub.modules.start(hub.app.cx()), [(b, reason.to_owned())]);
        hub.run_ms(1000);
        assert_eq!(failed(&hub.state(b)), (reason, false));
        assert_eq!((hub.state(a), hub.state(c)), (ModuleState::Running, ModuleState::Running));
        assert_eq!(hub.app.cx().find("modules/b/module"), None, "nothing of it is left: {fault}");
        assert_eq!(b.restarts(hub.app.cx()), Ok(0));
        let panics = u64::from(fault.starts_with("panic"));
        assert_eq!(hub.app.cx().counters().panics, panics, "{fault}");
        assert_eq!(book().iter().filter(|line| *line == "b stop").count(), 0);
    }
}

#[test]
fn a_module_that_fails_is_begun_again_after_waits_that_grow_and_then_given_up() {
    let mut hub = Hub::new();
    let a = hub.add("a", "start", POLICY);
    let ear = hub.watch(a);
    hub.run_ms(30);
    let error = a.start(hub.app.cx()).unwrap_err();
    assert_eq!(error.to_string(), "start failed: start of a is refused");
    hub.run_ms(5000);
    assert_eq!(book().iter().filter(|line| *line == "a new").count(), 5, "once and four retries");
    assert_eq!(failed(&hub.state(a)), ("start failed: start of a is refused", false));
    let seen = hub.seen(ear);
    let at: Vec<u64> = seen
        .iter()
        .map(|line| line.split(' ').next().unwrap().parse().unwrap())
        .collect();
    let waits: Vec<u64> = at.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // Virtual time: timers fire at rounds of 10 ms, and the retry runs in the round after.
    let wanted = [100, 200, 300, 300];
    assert_eq!(waits.len(), wanted.len());
    for (wait, wanted) in waits.iter().zip(wanted) {
        assert!((wanted..=wanted + 20).contains(wait), "{waits:?}");
    }
    assert!(seen.last().unwrap().contains("given up"), "{seen:?}");
}

#[test]
fn a_module_that_goes_well_at_the_third_try_runs() {
    for fault in ["new", "start", "panic new", "panic start"] {
        let mut hub = Hub::new();
        let fault = ProbeParameters { fault: fault.to_owned(), faults: 2, ..Default::default() };
        let a = hub.add_with("a", fault, POLICY);
        hub.modules.start(hub.app.cx());
        hub.run_ms(1000);
        assert_eq!(hub.state(a), ModuleState::Running);
        assert_eq!(a.restarts(hub.app.cx()), Ok(2));
    }
}

#[test]
fn a_retry_without_any_wait_is_not_lost_before_the_first_round() {
    let mut hub = Hub::new();
    let fault = ProbeParameters { fault: "new".to_owned(), faults: 1, ..Default::default() };
    let a = hub.add_with("a", fault, RestartPolicy { first: Duration::ZERO, ..POLICY });
    let waiting = hub.modules.start(hub.app.cx());
    assert_eq!(waiting, [(a, "new failed: new of a is refused".to_owned())]);
    hub.run_ms(100);
    assert_eq!(hub.state(a), ModuleState::Running, "the start that was asked for is made up for");
}

#[test]
fn a_module_that_is_given_up_can_be_started_by_hand() {
    let mut hub = Hub::new();
    let fault = ProbeParameters { fault: "start".to_owned(), faults: 1, ..Default::default() };
    let a = hub.add_with("a", fault, RestartPolicy::NEVER);
    hub.modules.start(hub.app.cx());
    hub.run_ms(100);
    assert!(!failed(&hub.state(a)).1);
    assert_eq!(a.start(hub.app.cx()), Ok(()));
    assert_eq!(hub.state(a), ModuleState::Running);
}

#[test]
fn a_module_that_dies_is_begun_again_and_the_hub_runs_on() {
    let mut hub = Hub::new();
    let fault = ProbeParameters { fault: "panic tick".to_owned(), faults: 1, ..Default::default() };
    let (a, b) = (hub.add_with("a", fault, POLICY), hub.add("b", "none", POLICY));
    let ear = hub.watch(a);
    let first = a.module(hub.app.cx());
    hub.modules.start(hub.app.cx());
    hub.run_ms(1000);
    assert_eq!((hub.state(a), hub.state(b)), (ModuleState::Running, ModuleState::Running));
    assert_ne!(a.module(hub.app.cx()), first, "it is another object");
    assert_eq!(hub.app.cx().find("modules/a/module"), a.module(hub.app.cx()));
    let seen = hub.seen(ear);
    assert_eq!(seen.len(), 2, "{seen:?}");
    assert!(seen[0].ends_with("failed, tried again: a slot of it failed"), "{seen:?}");
    assert!(seen[1].ends_with("running"), "{seen:?}");
}

#[test]
fn a_module_that_somebody_destroyed_is_begun_again() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    let module = a.module(hub.app.cx()).unwrap();
    hub.app.cx().destroy_later(module);
    hub.run_ms(50);
    assert_eq!(failed(&hub.state(a)), ("somebody destroyed it", true));
    hub.run_ms(200);
    assert_eq!(hub.state(a), ModuleState::Running);
}

#[test]
fn a_module_that_ran_long_enough_begins_counting_anew() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", RestartPolicy { tries: 1, ..POLICY });
    hub.modules.start(hub.app.cx());
    for _ in 0..3 {
        hub.run_ms(600);
        let module = a.module(hub.app.cx()).expect("runs");
        hub.app.cx().destroy_later(module);
    }
    hub.run_ms(150);
    assert_eq!(hub.state(a), ModuleState::Running);
    let module = a.module(hub.app.cx()).expect("runs");
    hub.app.cx().destroy_later(module);
    hub.run_ms(600);
    assert!(!failed(&hub.state(a)).1, "but not one that dies at once");
}

#[test]
fn a_module_whose_slot_keeps_the_loop_is_marked_and_no_other() {
    let mut hub = Hub::new();
    let (a, b) = (hub.add("a", "slow", POLICY), hub.add("b", "none", POLICY));
    hub.modules.start(hub.app.cx());
    hub.run_ms(3000);
    let late = |module: Handle<ModuleSupervisor>, hub: &mut Hub| module.status(hub.app.cx()).unwrap().late;
    assert!(late(a, &mut hub) >= 1);
    assert_eq!(late(b, &mut hub), 0);
    assert_eq!(hub.state(a), ModuleState::Running, "it is only marked");
}

#[test]
fn runs_with_failing_modules_repeat_exactly() {
    let run = || {
        let mut hub = Hub::new();
        let fault = ProbeParameters { fault: "panic tick".to_owned(), faults: 3, ..Default::default() };
        hub.add_with("a", fault, POLICY);
        hub.modules.start(hub.app.cx());
        hub.run_ms(2000);
        hub.simulation.trace_hash()
    };
    assert_eq!(run(), run());
}
