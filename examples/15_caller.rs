//! A satellite that asks the service of the example before, shows what it answers, and ends.
//!
//! xtask: run by `example_service_answers_its_caller`
use sk_core::{flow::Answer, flow::SkFlowSat, prelude::*};
use sk_robot::places::Places;

struct Operator;
impl Operator {
    fn on_answer(&mut self, cx: &mut Cx, answer: &Answer) {
        match answer.value() {
            Ok(metres) if answer.is_last() => println!("{} reached {metres} m", answer.service()),
            Ok(metres) => println!("{} at {metres} m", answer.service()),
            Err(error) => println!("{}: {error}", answer.service()),
        }
        if answer.is_last() {
            cx.quit();
        }
    }
}
object! { Operator { slots { on_answer(&Answer) } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let metres: f64 = std::env::args().nth(1).map_or(Ok(0.04), |metres| metres.parse())?;
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    let operator = cx.spawn(Operator);
    let call = hub.call(cx, "robot.gripper", metres); // waits for the service if it is not there yet
    attach!(cx, call.answered => operator.on_answer);
    app.run();
    Ok(())
}
