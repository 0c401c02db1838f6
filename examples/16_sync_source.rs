//! A source of ticks: its fast tick is the clock of every satellite that follows it, and it shows how they keep up.
//!
//! xtask: run by `example_targets_follow_their_source`
use sk_core::{flow::SkFlowSat, flow::TickReport, prelude::*};
use sk_robot::places::Places;

struct Conductor;
impl Conductor {
    fn show(&mut self, _cx: &mut Cx, report: TickReport) {
        let TickReport { target, lag, done, missed, divisor, .. } = report;
        println!("target {target}: lag {lag:?}, {done} done, {missed} missed, every {divisor}. tick");
    }
}
object! { Conductor { slots { show(TickReport) } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder()
        .mode(TimingMode::Realtime)
        .interval(Duration::from_millis(20))
        .build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    hub.sync_source(cx, "clock")?;
    let conductor = cx.spawn(Conductor);
    attach!(cx, hub.sync_report => conductor.show);
    app.run();
    Ok(())
}
