//! The end of channels of every kind that a satellite opened: at the hub, for everybody else, and for their names.

use bytes::Bytes;
use sk_core::attach;
use sk_core::flow::blob::BlobStore;
use sk_core::flow::satellite::ChannelInfo;
use sk_core::flow::server::Settings;
use sk_core::flow::{HubAddress, Rights, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Simulation, USER_ID};

const ADDRESS: &str = "/hub.sock";

fn start_hub(cx: &mut Cx) -> Handle<SkFlowServer> {
    let settings = Settings { user: "robot".parse().unwrap(), token: None, owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    server.listen(cx, &HubAddress::Unix(ADDRESS.into())).unwrap();
    let store = BlobStore::open(cx.world().storage.clone(), "/state/blobs".into()).unwrap();
    server.keep_blobs(cx, store).unwrap();
    server
}

fn connect(cx: &mut Cx) -> Handle<SkFlowSat> {
    SkFlowSat::connect(cx, &HubAddress::Unix(ADDRESS.into()))
}

/// Writes down which channels come and go, and what is refused.
#[derive(Default)]
struct Witness {
    seen: Vec<String>,
}
impl Witness {
    fn added(&mut self, _cx: &mut Cx, channel: &ChannelInfo) {
        self.seen.push(format!("+{} {}", channel.name, channel.kind));
    }
    fn removed(&mut self, _cx: &mut Cx, channel: &ChannelInfo) {
        self.seen.push(format!("-{}", channel.name));
    }
    fn refused(&mut self, _cx: &mut Cx, why: &str) {
        self.seen.push(format!("refused: {why}"));
    }
}
object! { Witness { slots { added(&ChannelInfo) removed(&ChannelInfo) refused(&str) } } }

struct Stage {
    simulation: Simulation,
    app: SkApp,
    server: Handle<SkFlowServer>,
    owner: Handle<SkFlowSat>,
    witness: Handle<Witness>,
}

impl Stage {
    fn new(seed: u64) -> Stage {
        let simulation = Simulation::new(seed);
        let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
        let cx = app.cx();
        let server = start_hub(cx);
        let (owner, other) = (connect(cx), connect(cx));
        let witness = cx.spawn(Witness::default());
        attach!(cx, other.channel_added => witness.added);
        attach!(cx, other.channel_removed => witness.removed);
        attach!(cx, owner.refused => witness.refused);
        let mut stage = Stage { simulation, app, server, owner, witness };
        stage.run();
        stage
    }

    fn run(&mut self) {
        self.simulation.run_for(&mut self.app, Duration::from_secs(1));
    }

    fn seen(&mut self) -> Vec<String> {
        let taken = self.app.cx().with(self.witness, |witness, _| std::mem::take(&mut witness.seen));
        taken.unwrap()
    }

    fn channels(&mut self) -> Vec<String> {
        let channels = self.server.channels(self.app.cx()).unwrap();
        channels.into_iter().map(|(name, _)| name.to_string()).collect()
    }

    fn open_all(&mut self) {
        let (owner, cx) = (self.owner, self.app.cx());
        owner.open(cx, "a", SkVariant::map([("latch", true.into())])).unwrap();
        owner.serve(cx, "b", "nothing").unwrap();
        owner.blob(cx, "c").unwrap();
        owner.sync_source(cx, "d").unwrap();
    }

    fn close_all(&mut self) {
        for name in ["a", "b", "c", "d"] {
            self.owner.close_channel(self.app.cx(), name).unwrap();
        }
    }
}

const ADDED: [&str; 4] = ["+robot.a stream", "+robot.b service", "+robot.c blob", "+robot.d sync"];
const REMOVED: [&str; 4] = ["-robot.a", "-robot.b", "-robot.c", "-robot.d"];

#[test]
fn a_channel_of_every_kind_is_closed_and_everybody_hears_so() {
    let mut stage = Stage::new(1);
    stage.open_all();
    stage.run();
    assert_eq!(stage.seen(), ADDED);
    stage.close_all();
    stage.run();
    assert_eq!(stage.seen(), REMOVED);
    assert_eq!(stage.channels(), [""; 0]);
    for name in ["a", "b", "c", "d", "e"] {
        let error = stage.owner.close_channel(stage.app.cx(), name).unwrap_err().to_string();
        assert!(error.contains(&format!("opened no channel `{name}`")), "{error}");
    }
}

#[test]
fn what_was_closed_before_the_hub_answered_or_while_it_was_gone_does_not_come_to_be() {
    let mut stage = Stage::new(2);
    // The commands go out together, before the hub has said anything.
    stage.open_all();
    stage.close_all();
    stage.run();
    let mut seen = stage.seen();
    seen.sort();
    let mut both: Vec<&str> = ADDED.into_iter().chain(REMOVED).collect();
    both.sort_unstable();
    assert_eq!(seen, both);
    assert_eq!(stage.channels(), [""; 0]);

    // Without a link there is nobody to tell; with the next one nothing comes back.
    stage.open_all();
    stage.run();
    let (server, cx) = (stage.server, stage.app.cx());
    cx.destroy_later(server);
    stage.run();
    stage.close_all();
    stage.server = start_hub(stage.app.cx());
    stage.simulation.run_for(&mut stage.app, Duration::from_secs(12));
    assert_eq!(stage.channels(), [""; 0]);
}

#[test]
fn a_name_may_be_used_again_at_once_for_another_kind_too() {
    let mut stage = Stage::new(3);
    for known_to_the_hub in [true, false] {
        stage.open_all();
        if known_to_the_hub {
            stage.run();
        }
        stage.close_all();
        let (owner, cx) = (stage.owner, stage.app.cx());
        owner.serve(cx, "a", "nothing").unwrap();
        owner.blob(cx, "b").unwrap();
        owner.sync_source(cx, "c").unwrap();
        owner.open(cx, "d", SkVariant::map([("format", "bytes".into())])).unwrap();
        stage.run();
        let seen = stage.seen();
        assert!(!seen.iter().any(|what| what.starts_with("refused")), "{seen:?}");
        for again in ["+robot.a service", "+robot.b blob", "+robot.c sync", "+robot.d stream"] {
            assert!(seen.iter().any(|what| what == again), "{again}: {seen:?}");
        }
        let mut channels = stage.channels();
        channels.sort();
        assert_eq!(channels, ["robot.a", "robot.b", "robot.c", "robot.d"]);
        stage.close_all();
        stage.run();
        stage.seen();
    }
}

#[test]
fn the_files_of_a_closed_blob_channel_are_found_again_under_its_name() {
    let mut stage = Stage::new(5);
    let (owner, cx) = (stage.owner, stage.app.cx());
    let blob = owner.blob(cx, "maps").unwrap();
    assert!(blob.upload(cx, "floor", Bytes::from_static(b"plan")));
    stage.run();
    owner.close_channel(stage.app.cx(), "maps").unwrap();
    stage.run();
    assert!(!stage.app.cx().is_alive(blob), "it stood for the channel");
    owner.blob(stage.app.cx(), "maps").unwrap();
    let found = std::rc::Rc::new(std::cell::RefCell::new(None));
    let answer = found.clone();
    let put = move |_: &mut Cx, told| *answer.borrow_mut() = Some(told);
    owner.list_blob(stage.app.cx(), "robot.maps", "", put).unwrap();
    stage.run();
    let entries = found.borrow_mut().take().unwrap().unwrap();
    assert_eq!(entries.iter().map(|entry| entry.name.as_str()).collect::<Vec<_>>(), ["floor"]);
}

#[test]
fn a_module_closes_what_it_opened_by_its_own_name() {
    let mut stage = Stage::new(6);
    let cx = stage.app.cx();
    let pipe = stage.server.pipe(cx, Rights::ALL).unwrap();
    let flow = SkFlowSat::inside(cx, pipe).flow("arm");
    flow.open(cx, "angle", SkVariant::map([("unit", "rad".into())])).unwrap();
    stage.run();
    assert_eq!(stage.channels(), ["robot.arm.angle"]);
    flow.close_channel(stage.app.cx(), "angle").unwrap();
    assert!(flow.close_channel(stage.app.cx(), "angle").is_err());
    stage.run();
    assert_eq!(stage.channels(), [""; 0]);
}
