//! A satellite that subscribes: it prints what the pendulum of the publisher does.
//!
//! xtask: run by `example_satellites_talk_through_the_hub`
use sk_core::{flow::FlowMessage, flow::SkFlowSat, prelude::*};
use sk_robot::places::Places;

struct Display;

impl Display {
    fn show(&mut self, _cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        let angle = f64::try_from(&message.value()?)?;
        println!("{}: {angle:+.3} {}", message.name(), "·".repeat((20.0 + 20.0 * angle) as usize));
        Ok(())
    }
}
object! { Display { slots { show(&FlowMessage) } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    hub.subscribe(cx, "robot.pendulum")?;
    let display = cx.spawn(Display);
    attach!(cx, hub.message => display.show);
    app.run();
    Ok(())
}
