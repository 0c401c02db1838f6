//! A module whose slot does not return, on a real thread: it is marked, and the hub goes on.

use sk_core::flow::server::Settings;
use sk_core::flow::{Flow, Rights, SkFlowServer};
use sk_core::module::*;
use sk_core::prelude::*;
use std::sync::{Mutex, mpsc};

/// Holds the module's slot until the test lets it go.
static GATE: Mutex<Option<mpsc::Receiver<()>>> = Mutex::new(None);

/// Hangs when it is told to.
struct Hanger;
impl AbstractModule for Hanger {
    const NAME: &'static str = "hanger";
    type Parameters = ();
    type Error = String;
    fn new(_: &mut Cx, _: Handle<Self>, _: Flow, _: &()) -> Result<Self, String> {
        Ok(Hanger)
    }
    fn reconfigure(&mut self, _: &mut Cx, _: &()) -> Result<(), String> {
        Ok(())
    }
    fn control(&mut self, _: &mut Cx, _: &SkVariant) -> Result<SkVariant, String> {
        let gate = GATE.lock().unwrap().take().ok_or("no gate")?;
        // A gate whose keeper is gone is open.
        let _ = gate.recv();
        Ok(SkVariant::Null)
    }
}
object! { Hanger {} }

/// Ends the run when the module is in the state it waits for, or, if it waits for none, when its thread is silent.
/// It looks at each tick: what changed before its first round would be told to nobody.
struct Watcher {
    module: Handle<ModuleSupervisor>,
    wanted: Option<ModuleState>,
}
impl Watcher {
    fn look(&mut self, cx: &mut Cx) -> Result<(), Access> {
        let status = self.module.status(cx)?;
        match &self.wanted {
            Some(wanted) if *wanted == status.state => cx.quit(),
            None if status.silent => {
                assert!(status.late >= 1);
                cx.quit();
            }
            _ => {}
        }
        Ok(())
    }
    fn stopped(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}
object! { Watcher { slots { look() stopped() } } }

#[test]
fn a_module_that_hangs_is_marked_given_up_and_stopped_when_it_ends_after_all() {
    let (open, gate) = mpsc::channel();
    *GATE.lock().unwrap() = Some(gate);
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build().unwrap();
    let cx = app.cx();
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: None };
    let server = SkFlowServer::start(cx, settings);
    let modules = Modules::spawn(cx);
    let place = ThreadPlace { mode: TimingMode::SelectIo, interval: Duration::from_millis(5) };
    let class = ModuleClass::of::<Hanger>();
    let mut add = |name: &str| {
        let link = move |cx: &mut Cx| server.pipe(cx, Rights::ALL);
        let module = ThreadedModule::new(class, place, link).named(name);
        modules.add_on_thread(cx, module, RestartPolicy::default()).unwrap()
    };
    let (other, hanging) = (add("other"), add("hanging"));
    modules.start(cx);
    let watcher = cx.spawn(Watcher { module: hanging, wanted: Some(ModuleState::Running) });
    attach!(cx, cx.fast_zone().pulse => watcher.look());
    app.run();

    // It hangs: first it is noticed that it is silent.
    let wait_for = |app: &mut SkApp, wanted| {
        app.cx().with(watcher, |watcher, _| watcher.wanted = wanted).unwrap();
        app.run();
    };
    let (tell, answered) = mpsc::channel();
    hanging.ask(app.cx(), ModuleOrder::Control("hang".into()), move |_, answer| tell.send(answer).unwrap());
    wait_for(&mut app, None);
    // Told to stop, it does not: the modules before it are stopped all the same.
    let cx = app.cx();
    attach!(cx, modules.stopped => watcher.stopped);
    cx.with(watcher, |watcher, _| watcher.wanted = Some(ModuleState::Made)).unwrap();
    modules.stop(cx);
    assert_eq!(hanging.state(cx), Ok(ModuleState::Stopping));
    assert_ne!(other.state(cx), Ok(ModuleState::Stopping), "it waits for its turn");
    app.run();
    assert_eq!(hanging.state(app.cx()), Ok(ModuleState::Stuck));
    assert_eq!(other.state(app.cx()), Ok(ModuleState::Stopped));
    // What hangs is not begun twice: it would be there twice when it wakes.
    hanging.start(app.cx()).unwrap();
    assert_eq!(hanging.state(app.cx()), Ok(ModuleState::Stuck));
    open.send(()).unwrap();
    wait_for(&mut app, Some(ModuleState::Running));
    assert_eq!(answered.recv(), Ok(Ok(SkVariant::Null)), "what it had to say came still");
}
