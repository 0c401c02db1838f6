//! A satellite that publishes: the angle of a pendulum, 20 times a second.
//! xtask: run by `example_satellites_talk_through_the_hub`
use sk_core::{flow::SkFlowSat, prelude::*};
use sk_robot::places::Places;

struct Pendulum {
    hub: Handle<SkFlowSat>,
    seconds: f64,
}
impl Pendulum {
    fn swing(&mut self, cx: &mut Cx) {
        self.seconds += cx.pulse().interval.as_secs_f64();
        self.hub.publish(cx, "pendulum", (self.seconds * 2.0).sin());
    }
}
object! { Pendulum { slots { swing() } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder().interval(Duration::from_millis(50)).build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    let pendulum = cx.spawn(Pendulum { hub, seconds: 0.0 });
    attach!(cx, cx.fast_zone().pulse => pendulum.swing);
    app.run();
    Ok(())
}
