//! A hub that many ask at once: what flows through it is not held up (S159).

use sk_core::SkVariant;
use sk_core::flow::{FlowMessage, HubAddress, SkFlowSat, SkFlowServer, server::Settings};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};

/// How many satellites ask, and how many questions each asks at every tick.
const ASKERS: usize = 100;
const QUESTIONS_EACH: usize = 2;
/// How long is measured.
const TICKS: u32 = 10;

/// Publishes the number of the round at each tick.
struct Speaker {
    hub: Handle<SkFlowSat>,
}
impl Speaker {
    fn speak(&mut self, cx: &mut Cx) {
        let round = cx.stats().rounds;
        self.hub.publish(cx, "round", round);
    }
}
object! { Speaker { slots { speak() } } }

/// Notes how many rounds later each was heard.
#[derive(Default)]
struct Ear {
    rounds: Vec<u64>,
}
impl Ear {
    fn hear(&mut self, cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        self.rounds.push(cx.stats().rounds - u64::try_from(&message.value()?)?);
        Ok(())
    }
}
object! { Ear { slots { hear(&FlowMessage) } } }

/// Asks for the largest answer there is at each tick.
struct Asker {
    hub: Handle<SkFlowSat>,
    answers: u64,
}
impl Asker {
    fn ask(&mut self, cx: &mut Cx) {
        for _ in 0..QUESTIONS_EACH {
            let asker = cx.this(self);
            self.hub.inspect(cx, "graph", move |cx, answer| {
                assert!(answer.is_ok(), "{answer:?}");
                // Whoever asked lives as long as the test.
                let _ = cx.with(asker, |asker, _| asker.answers += 1);
            });
        }
    }
}
object! { Asker { slots { ask() } } }

fn join(simulation: &Simulation, app: &mut SkApp, hub: &HubAddress) -> Handle<SkFlowSat> {
    let satellite = SkFlowSat::connect(app.cx(), hub);
    simulation.run_for(app, Duration::from_millis(20));
    satellite
}

/// The rounds that each message took in a hub that so many ask.
fn rounds_beside(askers: usize) -> Vec<u64> {
    let simulation = Simulation::new(1);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::Realtime);
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) };
    let hub = HubAddress::Unix("/hub".into());
    let server = SkFlowServer::start(app.cx(), settings);
    server.listen(app.cx(), &hub).unwrap();
    let speaker = join(&simulation, &mut app, &hub);
    let listener = join(&simulation, &mut app, &hub);
    let askers: Vec<_> = (0..askers)
        .map(|_| {
            let hub = join(&simulation, &mut app, &hub);
            app.cx().spawn(Asker { hub, answers: 0 })
        })
        .collect();
    let cx = app.cx();
    let ear = cx.spawn(Ear::default());
    attach!(cx, listener.message => ear.hear);
    speaker.open(cx, "round", SkVariant::map([] as [(&str, SkVariant); 0])).unwrap();
    simulation.run_for(&mut app, Duration::from_millis(50));
    listener.subscribe(app.cx(), "robot.round").unwrap();
    simulation.run_for(&mut app, Duration::from_millis(50));
    let cx = app.cx();
    // Those who ask are attached first, so that their questions stand before the message.
    for asker in &askers {
        attach!(cx, cx.fast_zone().pulse => asker.ask);
    }
    let voice = cx.spawn(Speaker { hub: speaker });
    attach!(cx, cx.fast_zone().pulse => voice.speak);
    let interval = app.cx().settings().interval;
    simulation.run_for(&mut app, interval * TICKS);
    for asker in askers {
        let answers = app.cx().with(asker, |asker, _| asker.answers).unwrap();
        assert!(answers >= u64::from(TICKS / 2), "everybody is answered as well: {answers}");
    }
    let rounds = app.cx().with(ear, |ear, _| std::mem::take(&mut ear.rounds)).unwrap();
    assert!(rounds.len() >= TICKS as usize / 2, "{rounds:?}");
    rounds
}

#[test]
fn s159_a_hundred_satellites_that_ask_at_every_tick_do_not_hold_up_a_flow() {
    let quiet = rounds_beside(0);
    let busy = rounds_beside(ASKERS);
    assert!(busy.iter().max() <= quiet.iter().max(), "beside many: {busy:?}, alone: {quiet:?}");
}
