//! A module that goes wrong on request, and a hub in a box that runs it.

use sk_core::flow::server::Settings;
use sk_core::flow::{Flow, FlowMessage, Rights, SkFlowSat, SkFlowServer};
use sk_core::module::*;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::{SkVariant, parameters};
use std::cell::RefCell;

parameters! {
    /// What goes wrong.
    pub struct ProbeParameters {
        /// Which of its steps goes wrong.
        fault: String = "none";
        /// How often it does, before it goes well.
        faults: u32 = u32::MAX;
        level: i64 = 5, 0..=10, "dB";
    }
}

thread_local! {
    /// What the probes of the running test did, in order: `name step`.
    static BOOK: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
    /// Faults still to come.
    static FAULTS: RefCell<u32> = const { RefCell::new(u32::MAX) };
}

pub fn book() -> Vec<String> {
    BOOK.with(|book| book.borrow().clone())
}

/// A module that writes down what is asked of it and goes wrong on request.
pub struct Probe {
    name: String,
    flow: Flow,
    parameters: ProbeParameters,
    ticks: u64,
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
        Ok(Probe { name, flow, parameters: parameters.clone(), ticks: 0 })
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
            Some("quit") => {
                cx.quit();
                Ok(SkVariant::Null)
            }
            Some("loop") => Ok(cx.loop_name().into()),
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
        self.ticks += 1;
        if self.parameters.fault == "slow" && self.ticks.is_multiple_of(10) {
            cx.world().clock.sleep(Duration::from_millis(150));
        }
        if self.parameters.fault.ends_with("tick") {
            let _ = note(&self.name, "tick", &self.parameters);
        }
        self.flow.publish(cx, "level", self.parameters.level);
    }
}
object! { Probe { slots { tick() } } }

/// A module that knows no commands and has nothing to be told.
pub struct Plain;
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
pub struct Ear {
    pub values: Vec<i64>,
    pub states: Vec<String>,
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
pub struct Hub {
    pub simulation: Simulation,
    pub app: SkApp,
    pub server: Handle<SkFlowServer>,
    pub inside: Handle<SkFlowSat>,
    pub modules: Handle<Modules>,
}

pub const POLICY: RestartPolicy =
    RestartPolicy { first: Duration::from_millis(100), factor: 2, max: Duration::from_millis(300), tries: 4 };

impl Hub {
    pub fn new() -> Hub {
        BOOK.with(|book| book.borrow_mut().clear());
        FAULTS.with(|left| *left.borrow_mut() = u32::MAX);
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

    pub fn add(&mut self, name: &str, fault: &str, policy: RestartPolicy) -> Handle<ModuleSupervisor> {
        let parameters = ProbeParameters { fault: fault.to_owned(), ..Default::default() };
        self.add_with(name, parameters, policy)
    }

    pub fn add_with(
        &mut self,
        name: &str,
        parameters: ProbeParameters,
        policy: RestartPolicy,
    ) -> Handle<ModuleSupervisor> {
        let runner = Runner::<Probe>::new(self.inside.flow(name), parameters).named(name);
        self.modules.add(self.app.cx(), runner, policy).unwrap()
    }

    /// As [`add`](Hub::add), on a thread of the module's own.
    pub fn add_there(&mut self, name: &str, fault: &str, policy: RestartPolicy) -> Handle<ModuleSupervisor> {
        let server = self.server;
        let place = ThreadPlace { mode: TimingMode::SelectIo, interval: Duration::from_millis(10) };
        let link = move |cx: &mut Cx| server.pipe(cx, Rights::ALL);
        let module = ThreadedModule::new(ModuleClass::of::<Probe>(), place, link).named(name);
        let fault = SkVariant::map([("fault", fault.into())]);
        let module = module.configured(&fault).unwrap();
        self.modules.add_on_thread(self.app.cx(), module, policy).unwrap()
    }

    /// What a module answers in the rounds that follow.
    pub fn ask(
        &mut self,
        module: Handle<ModuleSupervisor>,
        order: ModuleOrder,
    ) -> Result<SkVariant, ModuleError> {
        let answer = Rc::new(RefCell::new(None));
        let place = answer.clone();
        module.ask(self.app.cx(), order, move |_, answer| *place.borrow_mut() = Some(answer));
        self.run_ms(50);
        answer.borrow_mut().take().expect("it was answered")
    }

    pub fn run_ms(&mut self, ms: u64) {
        self.simulation.run_for(&mut self.app, Duration::from_millis(ms));
    }

    pub fn state(&mut self, supervisor: Handle<ModuleSupervisor>) -> ModuleState {
        supervisor.state(self.app.cx()).unwrap()
    }

    pub fn watch(&mut self, supervisor: Handle<ModuleSupervisor>) -> Handle<Ear> {
        let cx = self.app.cx();
        let ear = cx.spawn(Ear::default());
        attach!(cx, supervisor.changed => ear.see);
        ear
    }

    pub fn seen(&mut self, ear: Handle<Ear>) -> Vec<String> {
        self.app.cx().with(ear, |ear, _| ear.states.clone()).unwrap()
    }
}

pub fn failed(state: &ModuleState) -> (&str, bool) {
    match state {
        ModuleState::Failed { reason, retry_at } => (reason, retry_at.is_some()),
        other => panic!("{other:?} is no failure"),
    }
}
