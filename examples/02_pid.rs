//! A PID controller at 1 kHz; its set point is changed by name while it runs; overruns stop the motor.
use sk_core::prelude::*;

#[derive(Default)]
struct Sensor {
    angle: f64,
    speed: f64,
    measured: Signal<f64>,
}
impl Sensor {
    fn sample(&mut self, cx: &mut Cx) {
        self.angle += self.speed * 0.001;
        self.measured.emit(cx, self.angle)
    }
    fn drive(&mut self, _cx: &mut Cx, power: f64) {
        self.speed += (power - self.speed) * 0.05
    }
}
object! { Sensor { signals { measured(f64) } slots { sample() drive(f64) } } }

#[derive(Default)]
struct Pid {
    kp: f64,
    ki: f64,
    kd: f64,
    target: f64,
    sum: f64,
    last: f64,
    output: Signal<f64>,
}
impl Pid {
    fn on_measured(&mut self, cx: &mut Cx, angle: f64) {
        let dt = cx.pulse().interval.as_secs_f64();
        let error = self.target - angle;
        self.sum += error * dt;
        let slope = (error - self.last) / dt;
        self.last = error;
        self.output.emit(cx, self.kp * error + self.ki * self.sum + self.kd * slope);
    }
    fn set_target(&mut self, _cx: &mut Cx, target: f64) {
        self.target = target;
        self.sum = 0.0
    }
    /// Attached to the loop's `overrun` signal.
    fn on_overrun(&mut self, cx: &mut Cx) {
        self.output.emit(cx, 0.0)
    }
}
object! { Pid { signals { output(f64) } slots { on_measured(f64) set_target(f64) on_overrun() } } }

fn main() -> Result<(), AppError> {
    let mut app = SkApp::builder()
        .mode(TimingMode::Realtime)
        .interval(Duration::from_millis(1))
        .build()?;
    let cx = app.cx();
    let sensor = cx.spawn(Sensor::default());
    let pid = cx
        .named("pid")
        .spawn(Pid { kp: 20.0, ki: 1.0, kd: 0.01, target: 1.0, ..Default::default() });
    attach!(cx, cx.fast_zone().pulse => sensor.sample);
    attach!(cx, sensor.measured => pid.on_measured);
    attach!(cx, pid.output => sensor.drive); // a cycle: the sensor is still emitting
    attach!(cx, cx.event_loop().overrun => pid.on_overrun());

    let step = cx.spawn(Operator);
    attach!(cx, cx.one_sec_zone().pulse => step.act);
    app.run();
    let stats = app.cx().stats();
    println!("overruns {}, parked calls {}", stats.overruns, stats.counters.parked);
    Ok(())
}

struct Operator;
impl Operator {
    fn act(&mut self, cx: &mut Cx) -> Result<(), String> {
        let pid = cx.find("pid").ok_or("no pid")?;
        cx.invoke_method(pid, "set_target", &[2i64.into()])
            .map_err(|e| format!("{e:?}"))?; // a whole number where a float is due
        cx.invoke_method(pid, "set_taget", &[2.0.into()]).unwrap_err();
        if cx.pulse().number > 1500 {
            cx.quit()
        }
        Ok(())
    }
}
object! { Operator { signals {} slots { act() } } }
