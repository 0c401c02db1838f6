//! What a running module is told: parameters and commands.

use crate::probe::{Hub, POLICY, Plain, ProbeParameters, book};
use sk_core::SkVariant;
use sk_core::module::*;

#[test]
fn a_parameter_is_checked_before_the_module_sees_it() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    let cx = hub.app.cx();
    let refused = a.set(cx, "level", &11.into()).unwrap_err().to_string();
    assert_eq!(refused, "parameter `level` takes i64 in 0..=10 dB, found 11");
    assert!(a.set(cx, "levle", &1.into()).is_err() && a.set(cx, "level", &"1".into()).is_err());
    let half = SkVariant::map([("fault", "tick".into()), ("level", 11.into())]);
    assert!(a.change(cx, &half).is_err(), "all or none");
    assert_eq!(a.parameters(cx).unwrap(), ProbeParameters::default().to_variant());
    assert_eq!(book(), ["a new", "a start"]);
    assert_eq!(a.set(cx, "level", &7.into()), Ok(()));
    assert_eq!(a.control(cx, &"level".into()), Ok(7i64.into()));
    assert_eq!(a.set(cx, "level", &7.into()), Ok(()));
    assert_eq!(book(), ["a new", "a start", "a reconfigure"], "what changes nothing is not handed on");
}

#[test]
fn an_error_of_reconfigure_keeps_the_old_set() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    let cx = hub.app.cx();
    let error = a.set(cx, "level", &9.into()).unwrap_err().to_string();
    assert_eq!(error, "reconfigure failed: nine is one too many");
    assert_eq!(a.parameters(cx).unwrap().get("level"), Some(&5i64.into()));
    assert_eq!(a.control(cx, &"level".into()), Ok(5i64.into()));
    assert_eq!(hub.state(a), ModuleState::Running);
}

#[test]
fn a_panic_in_reconfigure_ends_there_and_the_module_is_begun_again_with_the_old_set() {
    let mut hub = Hub::new();
    let fault = ProbeParameters { fault: "panic reconfigure".to_owned(), faults: 1, ..Default::default() };
    let (a, b) = (hub.add_with("a", fault, POLICY), hub.add("b", "none", POLICY));
    hub.modules.start(hub.app.cx());
    let error = a.set(hub.app.cx(), "level", &7.into()).unwrap_err().to_string();
    assert_eq!(error, "reconfigure panicked: reconfigure of a breaks");
    hub.run_ms(500);
    assert_eq!((hub.state(a), hub.state(b)), (ModuleState::Running, ModuleState::Running));
    let cx = hub.app.cx();
    assert_eq!(a.control(cx, &"level".into()), Ok(5i64.into()));
    assert_eq!(a.set(cx, "level", &7.into()), Ok(()));
    assert!(a.control(cx, &"panic".into()).is_err());
    hub.run_ms(500);
    assert_eq!(a.control(hub.app.cx(), &"level".into()), Ok(7i64.into()), "what was accepted is kept");
}

#[test]
fn what_a_stopped_module_is_told_holds_for_its_next_life() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    a.stop(hub.app.cx()).unwrap();
    assert_eq!(a.control(hub.app.cx(), &"level".into()), Err(ModuleError::NotRunning));
    a.set(hub.app.cx(), "level", &8.into()).unwrap();
    a.start(hub.app.cx()).unwrap();
    assert_eq!(hub.state(a), ModuleState::Stopped, "its predecessor still has the name");
    hub.run_ms(50);
    assert_eq!(hub.state(a), ModuleState::Running);
    assert_eq!(a.control(hub.app.cx(), &"level".into()), Ok(8i64.into()));
    assert_eq!(hub.app.cx().find("modules/a/module"), a.module(hub.app.cx()));
}

#[test]
fn a_module_refuses_commands_it_does_not_know() {
    let mut hub = Hub::new();
    let runner = Runner::<Plain>::new(hub.inside.flow("plain"), ());
    let plain = hub.modules.add(hub.app.cx(), runner, POLICY).unwrap();
    let cx = hub.app.cx();
    assert_eq!(plain.control(cx, &"dance".into()), Err(ModuleError::NotRunning));
    hub.modules.start(cx);
    let refused = plain.control(cx, &"dance".into()).unwrap_err().to_string();
    assert_eq!(refused, r#"control failed: no command "dance""#);
    let long = plain.control(cx, &"x".repeat(100_000).as_str().into()).unwrap_err().to_string();
    assert!(long.len() < 200, "{long}");
}

#[test]
fn a_module_may_ask_for_its_own_supervisor_but_not_change_itself_by_it() {
    let mut hub = Hub::new();
    let a = hub.add("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    let answer = a.control(hub.app.cx(), &"supervisor".into());
    assert_eq!(answer, Ok("running, Err(Busy)".into()));
}
