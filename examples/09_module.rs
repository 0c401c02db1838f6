//! A module with declared parameters that reacts to a change and publishes. Without an argument it runs inside
//! a small hub; with the address of a hub, such as `unix:PATH`, the same source is a satellite of that hub.
use sk_core::flow::{Rights, server::Settings};
use sk_core::{SkFlowSat, SkFlowServer, module::*, parameters, prelude::*};

parameters! {
    pub struct BatteryParameters {
        /// Time between two readings.
        period_ms: u64 = 20, 5..=1000, "ms";
        /// Below this the alarm rings.
        low: f64 = 11.0, 9.0..=13.0, "V";
    }
}

pub struct Battery {
    flow: Flow,
    timer: Handle<Timer>,
    volts: f64,
    parameters: BatteryParameters,
    low_battery: Signal<f64>,
}

impl AbstractModule for Battery {
    const NAME: &'static str = "battery";
    type Parameters = BatteryParameters;
    type Error = String;

    fn new(
        cx: &mut Cx,
        this: Handle<Self>,
        flow: Flow,
        parameters: &BatteryParameters,
    ) -> Result<Self, String> {
        let timer = cx.under(this).spawn(Timer::default());
        attach!(cx, timer.timeout => this.read);
        Ok(Battery { flow, timer, volts: 12.0, parameters: parameters.clone(), low_battery: Signal::new() })
    }
    fn start(&mut self, cx: &mut Cx) -> Result<(), String> {
        let period = Duration::from_millis(self.parameters.period_ms);
        self.timer.start(cx, period).map_err(|error| error.to_string())
    }
    fn reconfigure(&mut self, cx: &mut Cx, parameters: &BatteryParameters) -> Result<(), String> {
        self.parameters = parameters.clone();
        self.start(cx)
    }
}
impl Battery {
    fn read(&mut self, cx: &mut Cx) {
        self.volts -= 0.3;
        self.flow.publish(cx, "volts", self.volts);
        if self.volts < self.parameters.low {
            self.low_battery.emit(cx, self.volts)
        }
    }
}
object! { Battery { signals { low_battery(f64) } slots { read() } } }

struct Alarm;
impl Alarm {
    fn ring(&mut self, cx: &mut Cx) {
        println!("ring");
        cx.quit()
    }
}
object! { Alarm { signals {} slots { ring() } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    if let Some(address) = std::env::args().nth(1) {
        return Ok(SkFlowSat::run::<Battery>(&address)?);
    }
    for line in BatteryParameters::describe() {
        println!("{line:?}")
    }
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    let cx = app.cx();
    let server = SkFlowServer::start(cx, Settings { user: "robot".parse()?, token: None, owner_uid: None });
    let pipe = server.pipe(cx, Rights::ALL)?;
    let inside = SkFlowSat::inside(cx, pipe);

    let modules = Modules::spawn(cx);
    let runner = Runner::<Battery>::new(inside.flow(Battery::NAME), BatteryParameters::default());
    let battery = modules.add(cx, runner, RestartPolicy::default())?;
    modules.start(cx);

    let alarm = cx.spawn(Alarm);
    let module = battery.module_as::<Battery>(cx).ok_or("the battery has no module")?;
    attach!(cx, module.low_battery => alarm.ring()); // the slot takes nothing
    println!("{:?}", battery.set(cx, "low", &20.0.into()).map_err(|error| error.to_string()));
    println!("{:?}", battery.set(cx, "low", &11.5.into()));
    println!("{:?}", battery.set(cx, "period_ms", &10i64.into()));
    app.run();
    Ok(())
}
