//! A satellite that follows the source of the example before: its loop ticks when the source's does.
//!
//! xtask: run by `example_targets_follow_their_source`
use sk_core::{flow::Divisor, flow::SkFlowSat, prelude::*};
use sk_robot::places::Places;

struct Player {
    beats: u64,
}
impl Player {
    fn on_synced(&mut self, _cx: &mut Cx, synced: bool) {
        println!("{}", if synced { "following" } else { "on its own" });
    }
    fn beat(&mut self, cx: &mut Cx) {
        self.beats += 1;
        if self.beats.is_multiple_of(10) {
            println!("beat {} every {:?}", self.beats, cx.pulse().interval);
        }
    }
}
object! { Player { slots { on_synced(bool) beat() } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_secs(1))
        .build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    hub.sync_to(cx, "robot.clock", Divisor::Auto)?;
    let player = cx.spawn(Player { beats: 0 });
    attach!(cx, hub.synced => player.on_synced);
    attach!(cx, cx.fast_zone().pulse => player.beat);
    app.run();
    Ok(())
}
