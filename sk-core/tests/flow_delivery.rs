//! Policies, latches, credit, repeating, names and sessions, as a satellite's user meets them.

use sk_core::flow::satellite::ChannelInfo;
use sk_core::flow::server::Settings;
use sk_core::flow::{FlowMessage, HubAddress, SkFlowSat, SkFlowServer};
use sk_core::net::{Listener, Socket};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};
use sk_core::world::Endpoint;
use sk_core::{SkVariant, attach};

struct Stage {
    simulation: Simulation,
    app: SkApp,
    hub: HubAddress,
    server: Handle<SkFlowServer>,
}

impl Stage {
    fn new(seed: u64) -> Stage {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let hub = HubAddress::Unix("/hub".into());
        let server = serve(app.cx(), &hub);
        Stage { simulation, app, hub, server }
    }

    fn satellite(&mut self) -> (Handle<SkFlowSat>, Handle<Ear>) {
        let hub = self.hub.clone();
        self.satellite_at(&hub)
    }

    fn satellite_at(&mut self, hub: &HubAddress) -> (Handle<SkFlowSat>, Handle<Ear>) {
        let cx = self.app.cx();
        let satellite = SkFlowSat::connect(cx, hub);
        let ear = cx.spawn(Ear::default());
        attach!(cx, satellite.message => ear.hear);
        attach!(cx, satellite.ready => ear.ready);
        attach!(cx, satellite.lost => ear.lost);
        attach!(cx, satellite.refused => ear.refused);
        attach!(cx, satellite.channel_removed => ear.removed);
        attach!(cx, satellite.header_changed => ear.changed);
        (satellite, ear)
    }

    fn run(&mut self, ms: u64) {
        self.simulation.run_for(&mut self.app, Duration::from_millis(ms));
    }

    fn ear<R>(&mut self, ear: Handle<Ear>, look: impl FnOnce(&mut Ear) -> R) -> R {
        self.app.cx().with(ear, |ear, _| look(ear)).unwrap()
    }
}

fn serve(cx: &mut Cx, at: &HubAddress) -> Handle<SkFlowServer> {
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    server.listen(cx, at).unwrap();
    server
}

/// Remembers what a satellite hears.
#[derive(Default)]
struct Ear {
    values: Vec<i64>,
    seen: Vec<String>,
}
impl Ear {
    fn hear(&mut self, _cx: &mut Cx, message: &FlowMessage) -> Result<(), sk_flat::VariantError> {
        self.values.push(i64::try_from(&message.value()?)?);
        Ok(())
    }
    fn ready(&mut self, _cx: &mut Cx) {
        self.seen.push("ready".into());
    }
    fn lost(&mut self, _cx: &mut Cx, _why: &str) {
        self.seen.push("lost".into());
    }
    fn refused(&mut self, _cx: &mut Cx, why: &str) {
        self.seen.push(format!("refused: {why}"));
    }
    fn removed(&mut self, _cx: &mut Cx, channel: &ChannelInfo) {
        self.seen.push(format!("removed {}", channel.name));
    }
    fn changed(&mut self, _cx: &mut Cx, channel: &ChannelInfo) {
        let unit = channel.properties.variant().get("unit").map(ToString::to_string);
        self.seen.push(format!("{} in {}", channel.name, unit.unwrap_or_default()));
    }
}
object! {
    Ear {
        slots { hear(&FlowMessage) ready() lost(&str) refused(&str) removed(&ChannelInfo) changed(&ChannelInfo) }
    }
}

fn map(of: impl IntoIterator<Item = (&'static str, SkVariant)>) -> SkVariant {
    SkVariant::map(of)
}

#[test]
fn a_latched_value_is_told_to_who_comes_late_and_to_a_hub_that_comes_back() {
    let mut stage = Stage::new(1);
    let (source, _) = stage.satellite();
    let cx = stage.app.cx();
    source.open(cx, "map", map([("latch", true.into())])).unwrap();
    assert!(!source.publish(cx, "map", 7), "there is no hub yet; it is kept for it");
    stage.run(100);
    let (late, ear) = stage.satellite();
    late.subscribe(stage.app.cx(), "robot.map").unwrap();
    stage.run(100);
    assert_eq!(stage.ear(ear, |ear| ear.values.clone()), [7]);
    let (cx, server) = (stage.app.cx(), stage.server);
    cx.destroy_later(server);
    stage.run(100);
    source.publish(stage.app.cx(), "map", 8);
    let at = stage.hub.clone();
    stage.server = serve(stage.app.cx(), &at);
    stage.run(12_000);
    assert_eq!(stage.ear(ear, |ear| ear.values.clone()), [7, 8], "what was said while there was no hub");
}

#[test]
fn a_changed_header_is_heard_and_survives_the_hub() {
    let mut stage = Stage::new(2);
    let (source, _) = stage.satellite();
    let (_, ear) = stage.satellite();
    source.open(stage.app.cx(), "imu", map([("unit", "g".into())])).unwrap();
    assert!(source.change_header(stage.app.cx(), "gyro", map([])).is_err(), "it has no such channel");
    stage.run(100);
    source
        .change_header(stage.app.cx(), "imu", map([("unit", "m".into())]))
        .unwrap();
    stage.run(100);
    assert!(stage.ear(ear, |ear| ear.seen.contains(&r#"robot.imu in "m""#.to_owned())));
    let (cx, server) = (stage.app.cx(), stage.server);
    cx.destroy_later(server);
    stage.run(100);
    let at = stage.hub.clone();
    stage.server = serve(stage.app.cx(), &at);
    stage.run(12_000);
    let known = source.channels(stage.app.cx());
    assert_eq!(known[0].properties.variant(), map([("unit", "m".into())]));
}

/// Publishes numbers as fast as it may, again whenever there is room.
struct Pump {
    hub: Handle<SkFlowSat>,
    next: i64,
    end: i64,
    turned_away: u32,
}
impl Pump {
    fn go(&mut self, cx: &mut Cx) {
        while self.next < self.end {
            if !self.hub.publish(cx, "log", self.next) {
                self.turned_away += 1;
                return;
            }
            self.next += 1;
        }
    }
}
object! { Pump { slots { go() } } }

#[test]
fn on_a_reliable_channel_a_publisher_that_waits_for_room_loses_nothing() {
    let mut stage = Stage::new(3);
    let (source, _) = stage.satellite();
    let (sink, ear) = stage.satellite();
    let cx = stage.app.cx();
    source.open(cx, "log", map([("delivery", "reliable".into())])).unwrap();
    let count = 60_000;
    let pump = cx.spawn(Pump { hub: source, next: 0, end: count, turned_away: 0 });
    attach!(cx, source.start_publishing => pump.go());
    attach!(cx, source.room => pump.go());
    sink.subscribe_to_all(cx, "robot.log", 1).unwrap();
    stage.run(5000);
    let turned_away = stage.app.cx().with(pump, |pump, _| pump.turned_away).unwrap();
    assert!(turned_away > 0, "it was faster than its listener");
    let values = stage.ear(ear, |ear| std::mem::take(&mut ear.values));
    assert!(values.iter().copied().eq(0..count), "{} of {count}", values.len());
}

/// Publishes a rising number now and again. Not on each pulse: in this mode traffic makes the loop pulse.
struct Source {
    hub: Handle<SkFlowSat>,
    name: &'static str,
    count: i64,
}
impl Source {
    fn tick(&mut self, cx: &mut Cx) {
        self.count += i64::from(self.hub.publish(cx, self.name, self.count));
    }
}
object! { Source { slots { tick() } } }

impl Source {
    fn start(cx: &mut Cx, hub: Handle<SkFlowSat>, name: &'static str) {
        let source = cx.under(hub).spawn(Source { hub, name, count: 0 });
        let timer = cx.under(hub).spawn(Timer::default());
        attach!(cx, timer.timeout => source.tick);
        timer.start(cx, Duration::from_millis(5)).unwrap();
    }
}

#[test]
fn s131_a_channel_repeats_another_one_now_later_and_again() {
    let mut stage = Stage::new(4);
    let (repeater, repeaters) = stage.satellite();
    let (sink, ear) = stage.satellite();
    let cx = stage.app.cx();
    assert!(repeater.repeat(cx, "view", "robot.camera").is_err(), "it has no such channel");
    repeater.open(cx, "view", map([])).unwrap();
    repeater.repeat(cx, "view", "robot.camera").unwrap();
    sink.subscribe(cx, "robot.view").unwrap();
    stage.run(100);
    for _ in 0..2 {
        let (camera, _) = stage.satellite();
        let cx = stage.app.cx();
        Source::start(cx, camera, "camera");
        stage.run(500);
        assert!(!stage.ear(ear, |ear| std::mem::take(&mut ear.values)).is_empty());
        assert!(!repeater.publish(stage.app.cx(), "view", 9), "nobody waits for what it says itself");
        stage.app.cx().destroy_later(camera);
        stage.run(500);
        stage.ear(ear, |ear| ear.values.clear());
    }
    assert!(repeater.is_listened(stage.app.cx(), "view"), "it may speak for itself again");
    repeater.repeat_no_more(stage.app.cx(), "view").unwrap();
    repeater.publish(stage.app.cx(), "view", 5);
    stage.run(100);
    assert_eq!(stage.ear(ear, |ear| ear.values.clone()), [5]);
    let seen = stage.ear(repeaters, |ear| ear.seen.clone());
    assert!(!seen.iter().any(|what| what.starts_with("refused")), "{seen:?}");
}

#[test]
fn a_flow_of_a_name_that_is_taken_comes_in_when_it_is_free() {
    let mut stage = Stage::new(5);
    let (first, firsts) = stage.satellite();
    let (second, ear) = stage.satellite();
    let cx = stage.app.cx();
    assert!(first.name_flow(cx, "not a name").is_err());
    first.name_flow(cx, "arm").unwrap();
    second.name_flow(cx, "arm").unwrap();
    stage.run(3000);
    assert_eq!(stage.ear(firsts, |ear| ear.seen.clone()), ["ready"]);
    let seen = stage.ear(ear, |ear| std::mem::take(&mut ear.seen));
    assert!(
        seen.iter().any(|what| what.starts_with("refused")) && !seen.contains(&"ready".into()),
        "{seen:?}"
    );
    stage.app.cx().destroy_later(first);
    stage.run(6000);
    assert!(stage.ear(ear, |ear| ear.seen.contains(&"ready".into())));
}

/// Stands between satellites and a hub. It can let a satellite's connections break while the hub sees nothing.
struct Relay {
    listener: Handle<Listener>,
    to: Endpoint,
    pairs: Vec<(Handle<Socket>, Handle<Socket>)>,
    held: Vec<Handle<Socket>>,
}
impl Relay {
    fn accept(&mut self, cx: &mut Cx) -> Result<(), Box<dyn std::error::Error>> {
        while let Some(near) = self.listener.accept(cx)? {
            let far = Socket::connect(cx, &self.to)?;
            for (from, to) in [(near, far), (far, near)] {
                let wire = cx.under(near).spawn(Wire { from, to });
                attach!(cx, from.readable => wire.pass);
            }
            self.pairs.push((near, far));
        }
        Ok(())
    }

    fn cut(&mut self, cx: &mut Cx) {
        for (near, far) in self.pairs.drain(..) {
            cx.destroy_later(near);
            self.held.push(far);
        }
    }
}
object! { Relay { slots { accept() cut() } } }

struct Wire {
    from: Handle<Socket>,
    to: Handle<Socket>,
}
impl Wire {
    fn pass(&mut self, cx: &mut Cx) -> Result<(), Box<dyn std::error::Error>> {
        let mut bytes = Default::default();
        while self.from.read_into(cx, &mut bytes)? > 0 {}
        if !bytes.is_empty() {
            self.to.write(cx, bytes.freeze())?;
        }
        Ok(())
    }
}
object! { Wire { slots { pass() } } }

#[test]
fn a_satellite_whose_link_broke_unseen_takes_its_place_again_and_nobody_hears_of_it() {
    let mut stage = Stage::new(6);
    let front = Endpoint::Unix("/front".into());
    let cx = stage.app.cx();
    let listener = Listener::on(cx, &front).unwrap();
    let to = Endpoint::Unix("/hub".into());
    let relay = cx.spawn(Relay { listener, to, pairs: Vec::new(), held: Vec::new() });
    attach!(cx, listener.incoming => relay.accept);
    let (arm, arms) = stage.satellite_at(&HubAddress::Unix("/front".into()));
    let (other, others) = stage.satellite();
    let cx = stage.app.cx();
    arm.name_flow(cx, "arm").unwrap();
    arm.open(cx, "joints", map([("unit", "rad".into())])).unwrap();
    for (hub, name) in [(arm, "joints"), (other, "camera")] {
        Source::start(cx, hub, name);
    }
    arm.subscribe(cx, "robot.camera").unwrap();
    arm.subscribe(cx, "robot.unwanted").unwrap();
    other.subscribe(cx, "robot.joints").unwrap();
    stage.run(1000);
    for round in 0..3 {
        for ear in [arms, others] {
            let heard = stage.ear(ear, |ear| std::mem::take(&mut ear.values));
            assert!(heard.len() > 10, "round {round}: {heard:?}");
            assert!(heard.is_sorted(), "round {round}");
        }
        stage.app.cx().with(relay, |relay, cx| relay.cut(cx)).unwrap();
        // Long before the hub would miss the satellite it is back.
        stage.run(1000);
    }
    let seen = stage.ear(arms, |ear| ear.seen.clone());
    assert_eq!(seen, ["ready", "lost", "ready", "lost", "ready", "lost", "ready"]);
    assert_eq!(stage.ear(others, |ear| ear.seen.clone()), ["ready"], "its channel was never gone");
    let cx = stage.app.cx();
    assert_eq!(stage.server.channels(cx).unwrap().len(), 2);
    let flows = cx
        .with(stage.server, |server, _| server.core().report("graph"))
        .unwrap()
        .unwrap();
    let flows = flows.get("flows").and_then(SkVariant::as_list).unwrap().len();
    assert_eq!(flows, 2, "the former ones are gone");
}
