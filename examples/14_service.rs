//! A service: it moves a gripper to the width that it is asked for and answers the width that it has reached.
//!
//! xtask: run by `example_service_answers_its_caller`
use sk_core::{flow::Request, flow::SkFlowSat, prelude::*};
use sk_robot::places::Places;

struct Gripper {
    metres: f64,
}
impl Gripper {
    fn on_request(&mut self, cx: &mut Cx, request: &Request) -> Result<(), sk_flat::VariantError> {
        let wanted = f64::try_from(&request.value()?)?;
        if !(0.0..=0.08).contains(&wanted) {
            request.decline(cx, "the gripper opens from 0 to 0.08 m");
            return Ok(());
        }
        while (self.metres - wanted).abs() > 0.01 {
            self.metres += 0.01_f64.copysign(wanted - self.metres);
            request.answer_more(cx, self.metres); // on the way: a stream for the one who asked
        }
        self.metres = wanted;
        request.answer(cx, self.metres);
        Ok(())
    }
}
object! { Gripper { slots { on_request(&Request) } } }

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
    let cx = app.cx();
    let hub = SkFlowSat::connect(cx, &Places::find(None)?.address());
    let service = hub.serve(cx, "gripper", "a width in metres; answers the width that was reached")?;
    let gripper = cx.spawn(Gripper { metres: 0.0 });
    attach!(cx, service.request => gripper.on_request);
    app.run();
    Ok(())
}
