//! Modules on threads of their own, in virtual time: all that holds for a module of the hub's loop holds there.

use crate::probe::{Ear, Hub, POLICY, book, failed};
use sk_core::SkVariant;
use sk_core::flow::{Rights, SkFlowSat};
use sk_core::module::*;
use sk_core::prelude::*;

fn change(name: &str, value: impl Into<SkVariant>) -> ModuleOrder {
    ModuleOrder::Change(SkVariant::map([(name, value.into())]))
}

fn control(command: &str) -> ModuleOrder {
    ModuleOrder::Control(command.into())
}

#[test]
fn a_module_on_a_thread_is_made_started_and_heard() {
    let mut hub = Hub::new();
    let a = hub.add_there("a", "none", POLICY);
    let cx = hub.app.cx();
    let seed = hub.server.pipe(cx, Rights::ALL).unwrap();
    let other = SkFlowSat::inside(cx, seed);
    let ear = cx.spawn(Ear::default());
    other.subscribe(cx, "robot.a.level").unwrap();
    attach!(cx, other.message => ear.hear);
    assert_eq!(hub.state(a), ModuleState::Beginning);
    hub.run_ms(100);
    assert_eq!(hub.state(a), ModuleState::Made, "it is not started before it shall be");
    assert_eq!(hub.modules.start(hub.app.cx()), []);
    hub.run_ms(500);
    assert_eq!(hub.state(a), ModuleState::Running);
    assert_eq!(book(), ["a new", "a start"]);
    assert_eq!(hub.ask(a, control("loop")), Ok("a".into()), "its loop has its name");
    let heard = hub.app.cx().with(ear, |ear, _| ear.values.len()).unwrap();
    assert!(heard > 5, "{heard}");
    let status = a.status(hub.app.cx()).unwrap();
    assert_eq!(status.thread.map(|place| place.mode), Some(TimingMode::SelectIo));
    assert_eq!((status.name.as_str(), status.silent, status.late), ("a", false, 0));
    assert_eq!(a.module(hub.app.cx()), None, "it is no object of this loop");
}

#[test]
fn what_a_module_on_a_thread_is_told_is_checked_here_and_answered_later() {
    let mut hub = Hub::new();
    let a = hub.add_there("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    let cx = hub.app.cx();
    assert_eq!(a.set(cx, "level", &7.into()), Err(ModuleError::OnThread));
    assert_eq!(a.control(cx, &"level".into()), Err(ModuleError::OnThread));
    let refused = hub.ask(a, change("level", 11)).unwrap_err().to_string();
    assert_eq!(refused, "parameter `level` takes i64 in 0..=10 dB, found 11");
    assert_eq!(hub.ask(a, change("level", 7)), Ok(SkVariant::Null));
    assert_eq!(hub.ask(a, control("level")), Ok(7i64.into()));
    assert_eq!(a.parameters(hub.app.cx()).unwrap().get("level"), Some(&7i64.into()));
    let refused = hub.ask(a, change("level", 9)).unwrap_err().to_string();
    assert_eq!(refused, "reconfigure failed: nine is one too many");
    assert_eq!(a.parameters(hub.app.cx()).unwrap().get("level"), Some(&7i64.into()), "the old set stays");
    assert!(hub.ask(a, control("dance")).is_err());
    assert_eq!(hub.state(a), ModuleState::Running);
}

#[test]
fn what_a_stopped_module_is_told_holds_for_its_next_thread() {
    let mut hub = Hub::new();
    let a = hub.add_there("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    a.stop(hub.app.cx()).unwrap();
    assert_eq!(hub.state(a), ModuleState::Stopping);
    hub.run_ms(50);
    assert_eq!(hub.state(a), ModuleState::Stopped);
    assert_eq!(hub.ask(a, control("level")), Err(ModuleError::NotRunning));
    assert_eq!(hub.ask(a, change("level", 8)), Ok(SkVariant::Null));
    a.start(hub.app.cx()).unwrap();
    hub.run_ms(50);
    assert_eq!(hub.ask(a, control("level")), Ok(8i64.into()));
    assert_eq!(book(), ["a new", "a start", "a stop", "a new", "a start"]);
    a.restart(hub.app.cx()).unwrap();
    hub.run_ms(50);
    assert_eq!(hub.state(a), ModuleState::Running);
    assert_eq!(book()[5..], ["a stop", "a new", "a start"]);
}

#[test]
fn a_module_that_fails_or_panics_on_its_thread_is_begun_again_and_then_given_up() {
    for fault in ["new", "start", "panic new", "panic start", "panic tick"] {
        let mut hub = Hub::new();
        let (a, b) = (hub.add_there("a", fault, POLICY), hub.add("b", "none", POLICY));
        hub.modules.start(hub.app.cx());
        hub.run_ms(5000);
        let state = hub.state(a);
        let (reason, retried) = failed(&state);
        assert!(!retried, "{fault}: {reason}");
        assert_eq!(a.restarts(hub.app.cx()), Ok(4), "{fault}");
        let made = book().iter().filter(|line| *line == "a new").count();
        assert_eq!(made, 5, "{fault}: once and four retries");
        let status = a.status(hub.app.cx()).unwrap();
        assert_eq!(status.last_error.as_deref(), Some(reason));
        assert_eq!(hub.state(b), ModuleState::Running, "the others run on");
    }
}

#[test]
fn a_module_that_ends_its_own_loop_is_begun_again_on_a_new_one() {
    let mut hub = Hub::new();
    let a = hub.add_there("a", "none", POLICY);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    assert_eq!(hub.ask(a, control("quit")), Ok(SkVariant::Null));
    assert_eq!(failed(&hub.state(a)), ("the loop of its thread has ended", true));
    hub.run_ms(300);
    assert_eq!(hub.state(a), ModuleState::Running);
    assert_eq!(hub.ask(a, control("level")), Ok(5i64.into()));
    assert_eq!(book(), ["a new", "a start", "a stop", "a new", "a start"]);
}

/// Hears that the modules have stopped.
#[derive(Default)]
struct Listener(u32);
impl Listener {
    fn hear(&mut self, _cx: &mut Cx) {
        self.0 += 1;
    }
}
object! { Listener { slots { hear() } } }

#[test]
fn s168_modules_here_and_there_stop_in_reverse_order_and_it_is_told_once() {
    let mut hub = Hub::new();
    hub.add("a", "none", POLICY);
    hub.add_there("b", "none", POLICY);
    hub.add("c", "none", POLICY);
    hub.add_there("d", "none", POLICY);
    let cx = hub.app.cx();
    let listener = cx.spawn(Listener::default());
    attach!(cx, hub.modules.stopped => listener.hear);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    hub.modules.stop(hub.app.cx());
    hub.run_ms(100);
    let stops: Vec<String> = book().into_iter().filter(|line| line.ends_with("stop")).collect();
    assert_eq!(stops, ["d stop", "c stop", "b stop", "a stop"]);
    assert_eq!(hub.app.cx().with(listener, |listener, _| listener.0), Ok(1));
    let list = hub.modules.list(hub.app.cx()).unwrap();
    assert!(list.iter().all(|module| module.state == ModuleState::Stopped), "{list:?}");
}

#[test]
fn a_loop_that_ends_stops_the_threads_of_its_modules_too_in_order() {
    let mut hub = Hub::new();
    hub.add_there("a", "none", POLICY);
    hub.add("b", "none", POLICY);
    hub.add_there("c", "none", POLICY);
    hub.modules.start(hub.app.cx());
    hub.run_ms(50);
    drop(hub);
    let stops: Vec<String> = book().into_iter().filter(|line| line.ends_with("stop")).collect();
    assert_eq!(stops, ["c stop", "b stop", "a stop"]);
}

#[test]
fn modules_are_found_by_name_and_one_that_is_added_stopped_waits() {
    let mut hub = Hub::new();
    let runner = Runner::<crate::probe::Plain>::new(hub.inside.flow("plain"), ());
    let plain = hub.modules.add_stopped(hub.app.cx(), runner, POLICY).unwrap();
    assert_eq!(hub.modules.start(hub.app.cx()), []);
    assert_eq!(hub.modules.find(hub.app.cx(), "plain"), Some(plain));
    assert_eq!(hub.modules.find(hub.app.cx(), "plane"), None);
    assert_eq!(hub.state(plain), ModuleState::Stopped);
    plain.start(hub.app.cx()).unwrap();
    assert_eq!(hub.state(plain), ModuleState::Running);
    // A module on this loop answers a question at once.
    assert!(matches!(
        hub.ask(plain, control("dance")),
        Err(ModuleError::Failed { step: "control", .. })
    ));
}

#[test]
fn runs_with_modules_on_threads_repeat_exactly() {
    let run = || {
        let mut hub = Hub::new();
        hub.add_there("a", "panic tick", POLICY);
        hub.add_there("b", "none", POLICY);
        hub.modules.start(hub.app.cx());
        hub.run_ms(2000);
        hub.simulation.trace_hash()
    };
    assert_eq!(run(), run());
}
