//! Publishing by UDP between two simulated machines, over a network that loses, doubles and swaps datagrams.

use bytes::Bytes;
use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::Credentials;
use sk_core::flow::server::{DatagramCounts, Settings};
use sk_core::flow::{FlowMessage, HubAddress, SkFlowSat, SkFlowServer};
use sk_core::prelude::*;
use sk_core::testing::{Node, Simulation};
use sk_core::world::LinkFaults;

/// Remembers what it hears, and what its satellite was refused.
#[derive(Default)]
struct Ear {
    heard: Vec<Bytes>,
    refused: Vec<String>,
}

impl Ear {
    fn hear(&mut self, _cx: &mut Cx, message: &FlowMessage) {
        self.heard.push(message.payload().clone());
    }
    fn on_refused(&mut self, _cx: &mut Cx, why: &str) {
        self.refused.push(why.to_owned());
    }
}

object! { Ear { slots { hear(&FlowMessage) on_refused(&str) } } }

/// A hub with a listener on one machine, a publisher on another.
struct Stage {
    simulation: Simulation,
    hub: Node,
    arm: Node,
    server: Handle<SkFlowServer>,
    listener: Handle<Ear>,
    publisher: Handle<SkFlowSat>,
    publishers_ear: Handle<Ear>,
}

fn token() -> OwnerToken {
    OwnerToken::new([7; 32])
}

fn serve(cx: &mut Cx, with_udp: bool) -> Handle<SkFlowServer> {
    let settings = Settings { user: "robot".parse().unwrap(), token: Some(token()), owner_uid: None };
    let server = SkFlowServer::start(cx, settings);
    server.listen(cx, &tcp()).unwrap();
    if with_udp {
        let at: HubAddress = "udp:127.0.0.1:7110".parse().unwrap();
        assert_eq!(server.listen(cx, &at).unwrap(), at);
    }
    server
}

fn tcp() -> HubAddress {
    "tcp:127.0.0.1:7100".parse().unwrap()
}

fn satellite(cx: &mut Cx) -> (Handle<SkFlowSat>, Handle<Ear>) {
    let satellite = SkFlowSat::connect_as(cx, &tcp(), Credentials::Token(token()));
    let ear = cx.spawn(Ear::default());
    attach!(cx, satellite.message => ear.hear);
    attach!(cx, satellite.refused => ear.on_refused);
    (satellite, ear)
}

impl Stage {
    fn new(seed: u64, with_udp: bool, faults: LinkFaults) -> Stage {
        let simulation = Simulation::new(seed);
        let world = simulation.world();
        let there = world.machine();
        world.set_link(world.machine_number(), there.machine_number(), faults);
        let change = |settings: &mut LoopSettings| settings.mode = TimingMode::SelectIo;
        let hub = simulation.node(world, "hub", change);
        let arm = simulation.node(&there, "arm", change);
        let (server, listener) = hub.with(|cx| {
            let server = serve(cx, with_udp);
            let (listener, ear) = satellite(cx);
            listener.subscribe_to_all(cx, "robot.pose", 1000).unwrap();
            (server, ear)
        });
        let (publisher, publishers_ear) = arm.with(|cx| {
            let (publisher, ear) = satellite(cx);
            publisher
                .open(cx, "pose", SkVariant::map([("format", "bytes".into())]))
                .unwrap();
            publisher.publish_by_udp(cx, "pose").unwrap();
            assert!(publisher.publish_by_udp(cx, "another").is_err(), "there is no such channel");
            (publisher, ear)
        });
        let mut stage = Stage { simulation, hub, arm, server, listener, publisher, publishers_ear };
        stage.run(2000);
        stage
    }

    fn run(&mut self, ms: u64) {
        self.simulation.run_for_nodes(Duration::from_millis(ms)).unwrap();
    }

    fn publish(&mut self, payload: Vec<u8>) {
        let publisher = self.publisher;
        assert!(self.arm.with(|cx| publisher.publish_bytes(cx, "pose", payload)), "somebody listens");
        self.run(10);
    }

    fn heard(&mut self) -> Vec<Bytes> {
        let listener = self.listener;
        self.hub
            .with(|cx| cx.with(listener, |ear, _| std::mem::take(&mut ear.heard)).unwrap())
    }

    fn counts(&mut self) -> DatagramCounts {
        let server = self.server;
        self.hub
            .with(|cx| cx.with(server, |server, _| server.core().datagram_counts()).unwrap())
    }
}

/// A message that shows which one it is and whether it is whole.
fn message(number: u8, length: usize) -> Vec<u8> {
    let mut bytes = vec![number; length];
    bytes.extend_from_slice(&(length as u32).to_le_bytes());
    bytes
}

#[test]
fn s71_over_a_good_network_all_messages_arrive_by_datagram() {
    let mut stage = Stage::new(1, true, LinkFaults::default());
    let publisher = stage.publisher;
    assert!(stage.arm.with(|cx| publisher.is_udp_open(cx)));
    let lengths = [0, 1, 1100, 1200, 5000, 65_536, 200_000];
    for (number, length) in lengths.into_iter().enumerate() {
        stage.publish(message(number as u8, length));
        stage.run(100);
    }
    let expected: Vec<Vec<u8>> = lengths
        .iter()
        .enumerate()
        .map(|(number, length)| message(number as u8, *length))
        .collect();
    assert!(stage.heard() == expected);
    // Of 1,200 bytes 32 are the datagram's own and 18 the frame's.
    let pieces = lengths.map(|length| (length + 4).div_ceil(1150) as u64);
    assert_eq!(stage.counts(), DatagramCounts { taken: pieces.iter().sum(), ..DatagramCounts::default() });
}

#[test]
fn s71_over_a_bad_network_messages_are_lost_and_none_is_cut_doubled_or_swapped() {
    let faults = LinkFaults {
        jitter_max: Duration::from_micros(300),
        loss: 50,
        duplication: 200,
        ..LinkFaults::default()
    };
    for seed in 0..5 {
        let mut stage = Stage::new(seed, true, faults);
        let mut sent = Vec::new();
        for number in 0..200 {
            let payload = message(number, if number % 4 == 0 { 3000 } else { 100 });
            stage.publish(payload.clone());
            sent.push(payload);
        }
        stage.run(1000);
        let heard = stage.heard();
        let mut rest = sent.iter();
        for payload in &heard {
            assert!(rest.any(|sent| sent == payload), "seed {seed}: not whole, or out of order");
        }
        let counts = stage.counts();
        assert!(counts.replayed > 10 && counts.forged == 0 && counts.malformed == 0, "{counts:?}");
        // Of a thousand datagrams 49 are lost, so 49 of a thousand small messages; of large ones more.
        assert!((100..200).contains(&heard.len()), "seed {seed}: {} of 200 arrived", heard.len());
        let server = stage.server;
        let totals = stage
            .hub
            .with(|cx| cx.with(server, |server, _| server.core().totals()).unwrap());
        assert!(totals.balance() && totals.delivered == heard.len() as u64, "{totals:?}");
    }
}

#[test]
fn a_hub_without_udp_says_so_and_messages_go_over_the_connection() {
    let mut stage = Stage::new(3, false, LinkFaults { loss: 1024, ..LinkFaults::default() });
    let (publisher, ear) = (stage.publisher, stage.publishers_ear);
    assert!(!stage.arm.with(|cx| publisher.is_udp_open(cx)));
    assert_eq!(stage.arm.with(|cx| cx.with(ear, |ear, _| ear.refused.len()).unwrap()), 1);
    stage.publish(message(1, 3000));
    assert_eq!(stage.heard(), [message(1, 3000)]);
}

#[test]
fn a_hub_that_comes_back_opens_a_session_again() {
    let mut stage = Stage::new(4, true, LinkFaults::default());
    stage.publish(message(1, 3000));
    let old = stage.server;
    stage.hub.with(|cx| cx.destroy_later(old));
    stage.run(50);
    stage.server = stage.hub.with(|cx| serve(cx, true));
    stage.run(20_000);
    stage.publish(message(2, 3000));
    assert_eq!(stage.heard(), [message(1, 3000), message(2, 3000)]);
    assert_eq!(stage.counts(), DatagramCounts { taken: 3, ..DatagramCounts::default() });
}
