//! Services and their askers as objects: over sockets and pipes, in the real and the simulated world.

use sk_core::flow::server::Settings;
use sk_core::flow::{Answer, Call, CallError, HubAddress, Request, Rights, Service, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_core::world::Rng as _;

fn settings() -> Settings {
    Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) }
}

/// What the gripper does with a request says the request itself.
#[derive(Default)]
struct Gripper {
    kept: Vec<Request>,
    over: usize,
}
impl Gripper {
    fn on_request(&mut self, cx: &mut Cx, request: &Request) -> Result<(), sk_flat::VariantError> {
        let value = request.value()?;
        match value.as_str() {
            Some("stream") => {
                for line in 0..3 {
                    assert!(request.answer_more(cx, line));
                }
                assert!(request.answer(cx, "end"));
                assert!(!request.answer(cx, "after the end") && !request.is_open(cx));
            }
            Some("decline") => assert!(request.decline(cx, "the hand is full")),
            Some("silence") => self.kept.push(request.clone()),
            Some("leave") => cx.destroy_later(cx.find("service").unwrap()),
            _ => assert!(request.answer(cx, value)),
        }
        Ok(())
    }
    fn on_over(&mut self, cx: &mut Cx, request: &Request) {
        assert!(!request.is_open(cx) && !request.answer(cx, "for nobody"));
        self.over += 1;
    }
}
object! { Gripper { slots { on_request(&Request) on_over(&Request) } } }

#[derive(Default)]
struct Asker {
    heard: Vec<String>,
    at: Vec<Instant>,
    quit_after: usize,
}
impl Asker {
    fn hear(&mut self, cx: &mut Cx, answer: &Answer) {
        let said = match answer.value() {
            Ok(value) => value.to_json().unwrap(),
            Err(error) => error.to_string(),
        };
        self.heard.push(format!("{said}{}", if answer.is_last() { "" } else { " …" }));
        self.at.push(cx.now());
        if self.heard.len() == self.quit_after {
            cx.quit();
        }
    }
}
object! { Asker { slots { hear(&Answer) } } }

fn serve(cx: &mut Cx, hub: Handle<SkFlowSat>) -> (Handle<Service>, Handle<Gripper>) {
    let service = hub
        .serve(cx, "gripper", "a width in metres; answers the width that it has")
        .unwrap();
    let gripper = cx.spawn(Gripper::default());
    attach!(cx, service.request => gripper.on_request);
    attach!(cx, service.request_over => gripper.on_over);
    (service, gripper)
}

fn ask(cx: &mut Cx, hub: Handle<SkFlowSat>, asker: Handle<Asker>, what: &str) -> Handle<Call> {
    let call = hub.call(cx, "robot.gripper", what);
    attach!(cx, call.answered => asker.hear);
    call
}

fn heard(app: &mut SkApp, asker: Handle<Asker>) -> Vec<String> {
    app.cx().with(asker, |asker, _| std::mem::take(&mut asker.heard)).unwrap()
}

/// A hub with two satellites, over a simulated socket or over pipes of the hub's own loop.
struct Parties {
    simulation: Simulation,
    app: SkApp,
    server: Handle<SkFlowServer>,
    owner: Handle<SkFlowSat>,
    other: Handle<SkFlowSat>,
    asker: Handle<Asker>,
}

impl Parties {
    fn new(seed: u64, pipes: bool) -> Parties {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let cx = app.cx();
        let server = SkFlowServer::start(cx, settings());
        let [owner, other] = if pipes {
            [(); 2]
                .map(|()| server.pipe(cx, Rights::ALL).unwrap())
                .map(|pipe| SkFlowSat::inside(cx, pipe))
        } else {
            let at = server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
            [(); 2].map(|()| SkFlowSat::connect(cx, &at))
        };
        let asker = cx.spawn(Asker::default());
        Parties { simulation, app, server, owner, other, asker }
    }

    fn run(&mut self, ms: u64) {
        self.simulation.run_for(&mut self.app, Duration::from_millis(ms));
    }

    fn ask(&mut self, what: &str) -> Handle<Call> {
        ask(self.app.cx(), self.other, self.asker, what)
    }

    fn heard(&mut self) -> Vec<String> {
        heard(&mut self.app, self.asker)
    }
}

#[test]
fn s136_answers_come_as_events_while_work_goes_on_over_sockets_and_pipes() {
    for pipes in [false, true] {
        let mut parties = Parties::new(1, pipes);
        let (_, gripper) = serve(parties.app.cx(), parties.owner);
        let calls: Vec<Handle<Call>> = ["width", "stream", "decline", "silence"]
            .into_iter()
            .map(|what| parties.ask(what))
            .collect();
        parties.run(1000);
        // Answers to one call keep their order, those to different ones need not.
        let mut said = parties.heard();
        assert_eq!(said.len(), 6);
        said.retain(|line| *line != "the service declined: the hand is full");
        assert_eq!(said, ["\"width\"", "0 …", "1 …", "2 …", "\"end\""], "pipes: {pipes}");
        let alive: Vec<bool> = calls.iter().map(|call| parties.app.cx().is_alive(*call)).collect();
        assert_eq!(alive, [false, false, false, true], "what is over buries itself");
        parties.run(5000);
        assert_eq!(parties.heard(), ["the service did not answer in time"]);
        let late = parties
            .app
            .cx()
            .with(gripper, |gripper, cx| (gripper.over, gripper.kept.pop().unwrap().answer(cx, "too late")));
        assert_eq!(late, Ok((1, false)));
    }
}

#[test]
fn a_deadline_is_kept_to_the_round_and_not_to_the_quarter_of_a_second() {
    let mut parties = Parties::new(2, true);
    serve(parties.app.cx(), parties.owner);
    parties.run(1000);
    let cx = parties.app.cx();
    let (asker, asked) = (parties.asker, cx.now());
    let call = parties
        .other
        .call_within(cx, "robot.gripper", "silence", Duration::from_millis(40));
    attach!(cx, call.answered => asker.hear);
    parties.run(1000);
    assert_eq!(parties.heard(), ["the service did not answer in time"]);
    let at = parties.app.cx().with(asker, |asker, _| asker.at[0]).unwrap();
    let waited = at.since(asked);
    assert!((40..=70).contains(&waited.as_millis()), "{waited:?} of simulated time");
}

#[test]
fn a_call_waits_for_its_service_until_the_deadline() {
    let mut parties = Parties::new(3, false);
    parties.ask("early");
    parties.run(3000);
    serve(parties.app.cx(), parties.owner);
    parties.run(1000);
    assert_eq!(parties.heard(), ["\"early\""]);
    let cx = parties.app.cx();
    let call = parties.other.call_within(cx, "robot.griper", 1, Duration::from_millis(100));
    let asker = parties.asker;
    attach!(cx, call.answered => asker.hear);
    let call = parties.other.call(cx, "no name at all", 1);
    attach!(cx, call.answered => asker.hear);
    parties.run(99);
    assert!(parties.heard().is_empty());
    parties.run(30);
    assert_eq!(parties.heard(), ["there is no such service"]);
    parties.run(6000);
    assert_eq!(parties.heard(), ["there is no such service"]);
}

#[test]
fn what_cannot_be_sent_is_told_in_the_next_round() {
    let mut parties = Parties::new(4, true);
    parties
        .owner
        .open(parties.app.cx(), "imu", SkVariant::map([("unit", "m".into())]))
        .unwrap();
    parties.run(100);
    let (asker, other, cx) = (parties.asker, parties.other, parties.app.cx());
    let call = other.call(cx, "robot.imu", 1);
    attach!(cx, call.answered => asker.hear);
    parties.run(100);
    assert_eq!(parties.heard(), ["the channel is no service"]);
    serve(parties.app.cx(), parties.owner);
    parties.run(100);
    let cx = parties.app.cx();
    let call = other.call_bytes(cx, "robot.gripper", vec![0; (16 << 20) + 1], Duration::from_secs(1));
    attach!(cx, call.answered => asker.hear);
    parties.run(100);
    let heard = parties.heard();
    assert!(
        heard.len() == 1 && heard[0].starts_with("the call cannot be sent: a message of"),
        "{heard:?}"
    );
}

#[test]
fn a_service_that_is_buried_leaves_its_askers_in_the_same_round_as_everybody() {
    let mut parties = Parties::new(5, false);
    let (service, _) = serve(parties.app.cx(), parties.owner);
    parties.run(100);
    parties.ask("silence");
    parties.ask("silence");
    parties.run(100);
    parties.app.cx().destroy_later(service);
    parties.run(100);
    assert_eq!(parties.heard(), ["the owner of the service went before it answered"; 2]);
    assert!(parties.server.channels(parties.app.cx()).unwrap().is_empty());
}

#[test]
fn a_call_that_is_buried_is_waited_for_no_more() {
    let mut parties = Parties::new(6, false);
    let (_, gripper) = serve(parties.app.cx(), parties.owner);
    parties.run(100);
    let call = parties.ask("silence");
    parties.run(100);
    parties.app.cx().destroy_later(call);
    parties.run(100);
    assert_eq!(parties.app.cx().with(gripper, |gripper, _| gripper.over), Ok(1));
    parties.run(6000);
    assert!(parties.heard().is_empty());
}

#[test]
fn a_lost_hub_ends_what_was_open_and_services_come_back_with_the_next() {
    let mut parties = Parties::new(7, false);
    let (_, gripper) = serve(parties.app.cx(), parties.owner);
    parties.run(100);
    parties.ask("silence");
    parties.run(100);
    let server = parties.server;
    parties.app.cx().destroy_later(server);
    parties.run(100);
    assert_eq!(parties.heard(), ["the hub was lost"]);
    assert_eq!(parties.app.cx().with(gripper, |gripper, _| gripper.over), Ok(1));
    let (asker, other, cx) = (parties.asker, parties.other, parties.app.cx());
    let call = other.call_within(cx, "robot.gripper", 1, Duration::from_millis(50));
    attach!(cx, call.answered => asker.hear);
    let call = other.call_within(cx, "robot.gripper", "width", Duration::from_secs(20));
    attach!(cx, call.answered => asker.hear);
    parties.run(200);
    assert_eq!(parties.heard(), ["the hub was lost"]);
    let cx = parties.app.cx();
    let server = SkFlowServer::start(cx, settings());
    server.listen(cx, &HubAddress::Unix("/hub".into())).unwrap();
    parties.run(15_000);
    assert_eq!(parties.heard(), ["\"width\""]);
    // A request of the first hub's is not answered at the second one, whatever its id.
    let stale = parties.app.cx().with(gripper, |gripper, cx| gripper.kept[0].answer(cx, 1));
    assert_eq!(stale, Ok(false));
}

#[test]
fn the_hub_serves_as_a_satellite_does() {
    let mut parties = Parties::new(8, false);
    let (server, asker, other, cx) = (parties.server, parties.asker, parties.other, parties.app.cx());
    let service = server
        .serve(cx, "hub.modules", SkVariant::map([("doc", "controls them".into())]))
        .unwrap();
    assert!(server.serve(cx, "hub.modules", "again").is_err(), "the name is taken");
    let gripper = cx.spawn(Gripper::default());
    attach!(cx, service.request => gripper.on_request);
    attach!(cx, service.request_over => gripper.on_over);
    for what in ["list", "stream", "decline", "silence"] {
        let call = other.call_within(cx, "hub.modules", what, Duration::from_millis(300));
        attach!(cx, call.answered => asker.hear);
    }
    parties.run(1000);
    let heard = parties.heard();
    assert_eq!(heard.len(), 7, "{heard:?}");
    assert_eq!(heard.last().unwrap(), "the service did not answer in time");
    assert_eq!(parties.app.cx().with(gripper, |gripper, _| gripper.over), Ok(1));
    parties.app.cx().destroy_later(service);
    parties.run(100);
    assert!(parties.server.channels(parties.app.cx()).unwrap().is_empty());
}

#[test]
fn s132_services_are_called_over_real_tcp() {
    let mut app = SkApp::builder()
        .mode(TimingMode::SelectIo)
        .interval(Duration::from_millis(2))
        .build()
        .unwrap();
    let cx = app.cx();
    let token = sk_core::flow::login::OwnerToken::new([7; 32]);
    let server = SkFlowServer::start(
        cx,
        Settings { user: "robot".parse().unwrap(), token: Some(token.clone()), owner_uid: None },
    );
    let at = server.listen(cx, &"tcp:127.0.0.1:0".parse().unwrap()).unwrap();
    let credentials = sk_core::flow::satellite::Credentials::Token(token);
    let [owner, other] = [(); 2].map(|()| SkFlowSat::connect_as(cx, &at, credentials.clone()));
    serve(cx, owner);
    let asker = cx.spawn(Asker { quit_after: 7, ..Asker::default() });
    for what in ["width", "stream", "decline", "silence"] {
        let call = other.call_within(cx, "robot.gripper", what, Duration::from_millis(500));
        attach!(cx, call.answered => asker.hear);
    }
    app.run();
    let heard = heard(&mut app, asker);
    assert_eq!(heard.last().unwrap(), &CallError::NoAnswer.to_string());
}

/// Counts the ends of each call.
#[derive(Default)]
struct Ends {
    of: std::collections::BTreeMap<String, u32>,
}
impl Ends {
    fn hear(&mut self, _cx: &mut Cx, answer: &Answer) {
        let ends = self.of.entry(format!("{:?}", answer.call())).or_default();
        assert_eq!(*ends, 0, "nothing follows the end: {answer:?}");
        *ends += u32::from(answer.is_last());
    }
}
object! { Ends { slots { hear(&Answer) } } }

#[test]
fn every_call_has_one_end_though_hubs_and_services_come_and_go() {
    for seed in 0..30 {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let at = HubAddress::Unix("/hub".into());
        let cx = app.cx();
        let [owner, other] = [(); 2].map(|()| SkFlowSat::connect(cx, &at));
        let ends = cx.spawn(Ends::default());
        let (mut server, mut service) = (None, None);
        let (mut calls, mut dice) = (Vec::new(), simulation.world().rng(1 << 32));
        for _ in 0..300 {
            let cx = app.cx();
            match dice.next_u64() % 12 {
                0 => match server.take() {
                    Some(server) => cx.destroy_later(server),
                    None => {
                        let new = SkFlowServer::start(cx, settings());
                        new.listen(cx, &at).unwrap();
                        server = Some(new);
                    }
                },
                1 => match service.take() {
                    Some(service) => cx.destroy_later(service),
                    None => service = Some(serve(cx, owner).0),
                },
                what => {
                    let what = ["width", "stream", "decline", "silence"][what as usize % 4];
                    let call = other.call_within(cx, "robot.gripper", what, Duration::from_millis(700));
                    attach!(cx, call.answered => ends.hear);
                    calls.push(format!("{call:?}"));
                }
            }
            simulation.run_for(&mut app, Duration::from_millis(11 + dice.next_u64() % 50));
        }
        simulation.run_for(&mut app, Duration::from_secs(10));
        let told = app.cx().with(ends, |ends, _| ends.of.clone()).unwrap();
        assert!(calls.len() > 200);
        for call in &calls {
            assert_eq!(told.get(call), Some(&1), "seed {seed}: {call}");
        }
    }
}
