//! Modules under their supervisors, in virtual time: each test is one of the rules.

use sk_core::flow::server::Settings;
use sk_core::flow::{Flow, FlowMessage, Rights, SkFlowSat, SkFlowServer};
use sk_core::module::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::{SkVariant, parameters};
use std::cell::RefCell;

parameters! {
    struct ProbeParameters {
        /// Which of its steps goes wrong.
        fault: String = "none";
        /// How often it does, before it goes well.
        faults: u32 = u32::MAX;
        level: i64 = 5, 0..=10, "dB";
    }
}

thread_local! {
    /// What the probes of the running test did, in order: `name step`. Every test has a thread of its own.
    static BOOK: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
    /// Faults still to come.
    static FAULTS: RefCell<u32> = const { RefCell::new(u32::MAX) };
}

fn book() -> Vec<String> {
    BOOK.with(|book| book.borrow().clone())
}

/// A module that writes down what is asked of it and goes wrong on request.
struct Probe {
    name: String,
    flow: Flow,
    parameters: ProbeParameters,
    beat: Signal<()>,
}

fn note(name: &str, step: &str, parameters: &ProbeParameters) -> Result<(), String> {
    BOOK.with(|book| book.borrow_mut().push(format!("{name} {step}")));
    let faulty = parameters.fault.strip_prefix("panic ").unwrap_or(&parameters.fault) == step;
    let fails = faulty
        && FAULTS.with(|left| {
            let mut left = left.borrow_mut();
            *left = (*left).min(parameters.faults);
            let fails = *left > 0;
            *left = left.saturating_sub(1);
            fails
        });
    match fails {
        true if parameters.fault.starts_with("panic") => panic!("{step} of {name} breaks"),
        true => Err(format!("{step} of {name} is refused")),
        false => Ok(()),
    }
}

impl AbstractModule for Probe {
    const NAME: &'static str = "probe";
    type Parameters = ProbeParameters;
    type Error = String;

    fn new(
        cx: &mut Cx,
        this: Handle<Self>,
        flow: Flow,
        parameters: &ProbeParameters,
    ) -> Result<Self, String> {
        let path = cx.path_of(this);
        let name = path.split('/').nth(1).unwrap_or("alone").to_owned();
        cx.under(this).named("part").spawn(Timer::default());
        note(&name, "new", parameters)?;
        attach!(cx, cx.fast_zone().pulse => this.tick);
        Ok(Probe { name, flow, parameters: parameters.clone(), beat: Signal::new() })
    }
    fn start(&mut self, _cx: &mut Cx) -> Result<(), String> {
        note(&self.name, "start", &self.parameters)
    }
    fn reconfigure(&mut self, _cx: &mut Cx, parameters: &ProbeParameters) -> Result<(), String> {
        note(&self.name, "reconfigure", &self.parameters)?;
        if parameters.level == 9 {
            return Err("nine is one too many".to_owned());
        }
        self.parameters = parameters.clone();
        Ok(())
    }
    fn control(&mut self, cx: &mut Cx, command: &SkVariant) -> Result<SkVariant, String> {
        match command.as_str() {
            Some("level") => Ok(self.parameters.level.into()),
            Some("supervisor") => {
                let supervisor = cx.find_as::<ModuleSupervisor>(&format!("modules/{}", self.name));
                let supervisor = supervisor.ok_or("no supervisor")?;
                let state = supervisor.state(cx).map_err(|error| error.to_string())?;
                let refused = supervisor.set(cx, "level", &1.into());
                Ok(format!("{state}, {refused:?}").into())
            }
            Some("panic") => panic!("as commanded"),
            _ => Err(format!("no command {command}")),
        }
    }
    fn stop(&mut self, _cx: &mut Cx) {
        // A refusal has no meaning here.
        let _ = note(&self.name, "stop", &self.parameters);
    }
}

impl Probe {
    fn tick(&mut self, cx: &mut Cx) {
        if self.parameters.fault.ends_with("tick") {
            let _ = note(&self.name, "tick", &self.parameters);
        }
        self.flow.publish(cx, "level", self.parameters.level);
        self.beat.emit(cx, ());
    }
}
object! { Probe { signals { beat() } slots { tick() } } }

/// A module that knows no commands and has nothing to be told.
struct Plain;
impl AbstractModule for Plain {
    const NAME: &'static str = "plain";
    type Parameters = ();
    type Error = String;
    fn new(_: &mut Cx, _: Handle<Self>, _: Flow, _: &()) -> Result<Self, String> {
        Ok(Plain)
    }
    fn reconfigure(&mut self, _: &mut Cx, _: &()) -> Result<(), String> {
        Ok(())
    }
}
object! { Plain { slots {} } }

/// Hears what a hub's subscriber would, and every state of the supervisors it is attached to.
#[derive(Default)]
struct Ear {
    values: Vec<i64>,
    states: Vec<String>,
}
impl Ear {
    fn hear(&mut self, _cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        assert_eq!(message.name(), "robot.a.level");
        self.values.push(i64::try_from(&message.value()?)?);
        Ok(())
    }
    fn see(&mut self, cx: &mut Cx, state: &ModuleState) {
        self.states.push(format!("{} ms: {state}", cx.now().as_nanos() / 1_000_000));
    }
}
object! { Ear { slots { hear(&FlowMessage) see(&ModuleState) } } }

/// A hub in a box with its modules.
struct Hub {
    simulation: Simulation,
    app: SkApp,
    server: Handle<SkFlowServer>,
    inside: Handle<SkFlowSat>,
    modules: Handle<Modules>,
}

const POLICY: RestartPolicy =
    RestartPolicy { first: Duration::from_millis(100), factor: 2, max: Duration::from_millis(300), tries: 4 };

impl Hub {
    fn new() -> Hub {
        let simulation = Simulation::new(1);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let cx = app.cx();
        let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: None };
        let server = SkFlowServer::start(cx, settings);
        let seed = server.pipe(cx, Rights::ALL).unwrap();
        let inside = SkFlowSat::inside(cx, seed);
        let modules = Modules::spawn(cx);
        Hub { simulation, app, server, inside, modules }
    }

    fn add(&mut self, name: &str, fault: &str, policy: RestartPolicy) -> Handle<ModuleSupervisor> {
        let parameters = ProbeParameters { fault: fault.to_owned(), ..Default::default() };
        self.add_with(name, parameters, policy)
    }

    fn add_with(
        &mut self,
        name: &str,
        parameters: ProbeParameters,
        policy: RestartPolicy,
    ) -> Handle<ModuleSupervisor> {
        let runner = Runner::<Probe>::new(self.inside.flow(name), parameters).named(name);
        self.modules.add(self.app.cx(), runner, policy).unwrap()
    }

    fn run_ms(&mut self, ms: u64) {
        self.simulation.run_for(&mut self.app, Duration::from_millis(ms));
    }

    fn state(&mut self, supervisor: Handle<ModuleSupervisor>) -> ModuleState {
        supervisor.state(self.app.cx()).unwrap()
    }

    fn watch(&mut self, supervisor: Handle<ModuleSupervisor>) -> Handle<Ear> {
        let cx = self.app.cx();
        let ear = cx.spawn(Ear::default());
        attach!(cx, supervisor.changed => ear.see);
        ear
    }

    fn seen(&mut self, ear: Handle<Ear>) -> Vec<String> {
        self.app.cx().with(ear, |ear, _| ear.states.clone()).unwrap()
    }
}

fn failed(state: &ModuleState) -> (&str, bool) {
    match state {
        ModuleState::Failed { reason, retry_at } => (reason, retry_at.is_some()),
        other => panic!("{other:?} is no failure"),
    }
}

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
    assert_eq!(cx.find("modules/a/module"), a.module(cx));
    assert!(cx.find("modules/a/module/part").is_some());
    assert!(a.module_as::<Probe>(cx).is_some() && a.module_as::<Plain>(cx).is_none());
    let flow = hub.inside.flow("a");
    let again = Runner::<Probe>::new(flow, ProbeParameters::default()).named("a");
    assert!(hub.modules.add(hub.app.cx(), again, POLICY).is_err(), "names are unique");
    assert_eq!(book(), ["a new"]);
}

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
        FAULTS.with(|left| *left.borrow_mut() = u32::MAX);
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

#[test]
fn runs_with_failing_modules_repeat_exactly() {
    let run = || {
        FAULTS.with(|left| *left.borrow_mut() = u32::MAX);
        let mut hub = Hub::new();
        let fault = ProbeParameters { fault: "panic tick".to_owned(), faults: 3, ..Default::default() };
        hub.add_with("a", fault, POLICY);
        hub.modules.start(hub.app.cx());
        hub.run_ms(2000);
        hub.simulation.trace_hash()
    };
    assert_eq!(run(), run());
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
