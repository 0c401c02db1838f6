//! A database that survives a kill: a counter that goes on where it stopped, however the program ended.
//!
//! The hub lives in this program. What it has said to be saved is on the disk.
//! xtask: run by `example_odometer_goes_on_after_a_kill`
use sk_core::{flow::FlowDatabase, flow::SkFlowSat, prelude::*};
use sk_robot::Hub;

struct Odometer {
    database: Handle<FlowDatabase>,
    /// How far it has gone; none until the database has said.
    metres: Option<i64>,
    saved: i64,
}
impl Odometer {
    fn on_ready(&mut self, cx: &mut Cx) {
        let this = cx.this(self);
        self.database.get(cx, "metres", move |cx, found| {
            let metres = found.ok().flatten().and_then(|found| i64::try_from(&found).ok()).unwrap_or(0);
            println!("found {metres}");
            // This program never destroys it.
            let _ = cx.with(this, |odometer, _| (odometer.metres, odometer.saved) = (Some(metres), metres));
        });
    }
    fn drive(&mut self, cx: &mut Cx) {
        if let Some(metres) = &mut self.metres {
            *metres += 1;
            self.database.set(cx, "metres", *metres);
        }
    }
    fn on_saved(&mut self, _cx: &mut Cx) {
        self.saved += 1;
        println!("saved {}", self.saved);
    }
}
object! { Odometer { slots { on_ready() drive() on_saved() } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder().interval(Duration::from_millis(20)).build()?;
    let cx = app.cx();
    let hub = Hub::builder().no_tcp().start(cx)?;
    let satellite = SkFlowSat::connect(cx, &hub.addresses()[0]);
    let database = satellite.database(cx, "odometer")?;
    database.create(cx, true);
    let odometer = cx.spawn(Odometer { database, metres: None, saved: 0 });
    attach!(cx, satellite.ready => odometer.on_ready);
    attach!(cx, cx.fast_zone().pulse => odometer.drive);
    attach!(cx, database.done => odometer.on_saved());
    app.run();
    Ok(())
}
