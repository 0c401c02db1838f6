//! What goes wrong in a simulated world: ways, disks, and the ends of machines.

use sk_core::prelude::*;
use sk_core::testing::{Node, Simulation};
use sk_core::world::{
    Datagram, Death, DiskFaults, Endpoint, LinkFaults, Listener, SimulatedWorld, Storage, Stream, Token,
    World,
};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io::{ErrorKind, IoSlice};
use std::path::Path;
use std::rc::Rc;
use std::sync::{Arc, Mutex};

fn loopback() -> std::net::SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

/// Two machines with a stream between them.
struct Pair {
    here: SimulatedWorld,
    there: SimulatedWorld,
    client_world: World,
    server_world: World,
    listener: Box<dyn Listener>,
    client: Box<dyn Stream>,
    server: Box<dyn Stream>,
}

impl Pair {
    fn new(seed: u64, faults: LinkFaults) -> Pair {
        let here = SimulatedWorld::new(seed);
        let there = here.machine();
        here.set_link(0, there.machine_number(), faults);
        let (mut client_world, mut server_world) = (here.world(), there.world());
        let mut listener = server_world.net.listen(&Endpoint::Ip(loopback()), Token(1)).unwrap();
        let mut client = client_world.net.connect(&listener.local(), Token(2)).unwrap();
        while !client.connected().unwrap() {
            pass(&here, [&mut client_world, &mut server_world]);
        }
        let server = listener.accept(Token(3)).unwrap();
        Pair { here, there, client_world, server_world, listener, client, server }
    }

    fn pass(&mut self) -> bool {
        pass(&self.here, [&mut self.client_world, &mut self.server_world])
    }

    /// Everything that arrives at the server, each read as one text.
    fn heard(&mut self) -> Vec<Vec<u8>> {
        let mut heard = Vec::new();
        while self.pass() {
            let mut room = [0; 4096];
            while let Ok(count @ 1..) = self.server.read(&mut room) {
                heard.push(room[..count].to_vec());
            }
        }
        heard
    }
}

/// Goes on to the next moment at which something happens; answers whether there was one.
fn pass(simulation: &SimulatedWorld, worlds: [&mut World; 2]) -> bool {
    let next = worlds
        .iter()
        .filter_map(|world| world.simulated_share().unwrap().next_event())
        .min();
    let Some(next) = next else { return false };
    simulation.clock().set(next);
    for world in worlds {
        world.net.wait(None, &mut Vec::new()).unwrap();
    }
    true
}

fn write(stream: &mut dyn Stream, bytes: &[u8]) -> usize {
    stream.write_vectored(&[IoSlice::new(bytes)]).unwrap()
}

#[test]
fn a_stream_comes_whole_and_in_order_whatever_the_pieces() {
    let faults = LinkFaults {
        delay: Duration::from_millis(3),
        jitter_max: Duration::from_millis(5),
        piece_bytes_max: 7,
        ..LinkFaults::default()
    };
    let mut pair = Pair::new(3, faults);
    let text: Vec<u8> = (0..=255).cycle().take(9000).collect();
    let (mut sent, mut heard, mut short_writes) = (0, Vec::new(), 0);
    while sent < text.len() {
        let wanted = 300.min(text.len() - sent);
        let count = write(&mut *pair.client, &text[sent..sent + wanted]);
        short_writes += usize::from(count < wanted);
        sent += count;
        heard.extend(pair.heard());
    }
    assert!(short_writes > 2 && heard.len() > 20, "{short_writes} short writes, {} reads", heard.len());
    assert_eq!(heard.concat(), text);
}

#[test]
fn a_write_cut_short_hears_of_room() {
    let mut pair = Pair::new(1, LinkFaults { piece_bytes_max: 3, ..LinkFaults::default() });
    while write(&mut *pair.client, &[7; 100]) == 100 {}
    let mut ready = Vec::new();
    while !ready.iter().any(|ready: &sk_core::world::Readiness| ready.writable) {
        let next = pair
            .client_world
            .simulated_share()
            .unwrap()
            .next_event()
            .expect("it will be told");
        pair.here.clock().set(next);
        pair.client_world.net.wait(None, &mut ready).unwrap();
    }
}

#[test]
fn a_partition_holds_streams_and_heals() {
    let mut pair = Pair::new(1, LinkFaults::default());
    let other = pair.there.machine_number();
    write(&mut *pair.client, b"before ");
    pair.here.partition(0, other);
    write(&mut *pair.client, b"within ");
    write(&mut *pair.client, b"it ");
    assert_eq!(pair.heard().concat(), b"before ");
    pair.here.heal(0, other);
    write(&mut *pair.client, b"after");
    assert_eq!(pair.heard().concat(), b"within it after");
}

#[test]
fn a_partition_has_a_direction_and_what_was_closed_within_it_still_arrives() {
    let mut pair = Pair::new(1, LinkFaults::default());
    let other = pair.there.machine_number();
    pair.here.partition(other, 0);
    write(&mut *pair.client, b"there");
    assert_eq!(pair.heard().concat(), b"there");
    pair.here.partition(0, other);
    write(&mut *pair.client, b"last words");
    drop(std::mem::replace(
        &mut pair.client,
        pair.client_world.net.connect(&pair.listener.local(), Token(9)).unwrap(),
    ));
    assert!(pair.heard().is_empty());
    pair.here.heal(0, other);
    assert_eq!(pair.heard().concat(), b"last words");
    assert_eq!(pair.server.read(&mut [0; 9]).unwrap(), 0);
}

#[test]
fn a_reset_breaks_both_ends_and_loses_what_was_under_way() {
    let mut pair = Pair::new(1, LinkFaults::default());
    write(&mut *pair.client, b"lost");
    pair.here.reset(pair.there.machine_number(), 0);
    assert!(pair.heard().is_empty());
    for end in [&mut pair.client, &mut pair.server] {
        assert_eq!(end.read(&mut [0; 9]).unwrap_err().kind(), ErrorKind::ConnectionReset);
        assert!(end.write_vectored(&[IoSlice::new(b"x")]).is_err());
    }
}

#[test]
fn a_wish_to_connect_is_refused_where_the_way_says_so() {
    let mut pair = Pair::new(1, LinkFaults::default());
    pair.here
        .set_link(0, pair.there.machine_number(), LinkFaults { refuse: true, ..LinkFaults::default() });
    let mut late = pair.client_world.net.connect(&pair.listener.local(), Token(5)).unwrap();
    while pair.pass() {}
    assert_eq!(late.connected().unwrap_err().kind(), ErrorKind::ConnectionRefused);
}

#[test]
fn a_killed_process_resets_its_streams_and_a_vanished_one_says_nothing() {
    for (death, said) in [(Death::Killed, true), (Death::Vanished, false), (Death::PowerCut, false)] {
        let mut pair = Pair::new(1, LinkFaults::default());
        let to = pair.listener.local();
        pair.there.die(death, &mut pair.here.rng(1 << 32));
        assert!(pair.server.write_vectored(&[IoSlice::new(b"from beyond")]).is_err());
        assert!(pair.server_world.net.connect(&to, Token(8)).is_err(), "a dead process connects to nobody");
        while pair.pass() {}
        let heard = pair.client.read(&mut [0; 20]).unwrap_err().kind();
        assert_eq!(heard == ErrorKind::ConnectionReset, said);
        let mut again = pair.client_world.net.connect(&to, Token(5)).unwrap();
        while pair.pass() {}
        assert_eq!(again.connected().is_err(), said, "{death:?}: refused, or without an answer");
        // The machine comes back.
        let mut next = pair.there.restarted().world();
        next.net.listen(&to, Token(6)).unwrap();
        assert!(pair.client_world.net.connect(&to, Token(7)).is_ok());
    }
}

#[test]
fn datagrams_are_lost_doubled_and_overtaken() {
    let here = SimulatedWorld::new(5);
    let there = here.machine();
    let faults = LinkFaults {
        loss: 200,
        duplication: 200,
        jitter_max: Duration::from_millis(4),
        ..LinkFaults::default()
    };
    here.set_link(0, there.machine_number(), faults);
    let (mut near, mut far) = (here.world(), there.world());
    let mut sender = near.net.bind(loopback(), Token(1)).unwrap();
    let mut receiver: Box<dyn Datagram> = far.net.bind(loopback(), Token(2)).unwrap();
    for number in 0..200_u8 {
        sender.send(receiver.local(), &[number]).unwrap();
    }
    let mut heard = Vec::new();
    while pass(&here, [&mut near, &mut far]) {
        let mut room = [0; 9];
        while receiver.receive(&mut room).is_ok() {
            heard.push(room[0]);
        }
    }
    let different: BTreeSet<u8> = heard.iter().copied().collect();
    assert!(different.len() < 190 && different.len() > 120, "{} arrived", different.len());
    assert!(heard.len() > different.len() + 10, "some came twice");
    assert!(!heard.is_sorted(), "some overtook others");
}

#[test]
fn a_power_cut_tears_long_writes_at_the_borders_of_sectors() {
    let simulation = SimulatedWorld::new(1);
    let (storage, mut rng, path) = (simulation.storage(), simulation.rng(1 << 32), Path::new("/file"));
    let (mut prefixes, mut holes) = (0, 0);
    for _ in 0..200 {
        storage.replace(path, &[0; 2048]).unwrap();
        storage.open(path, false).unwrap().write_at(100, &[1; 1800]).unwrap();
        storage.power_cut_by_chance(&mut rng);
        let bytes = storage.read(path, 9999).unwrap();
        assert!(bytes[..100].iter().chain(&bytes[1900..]).all(|byte| *byte == 0));
        let sectors: Vec<u8> = [100, 512, 1024, 1536].iter().map(|start| bytes[*start]).collect();
        for (sector, value) in bytes[100..1900].chunk_by(|a, b| a == b).map(|run| (run.len(), run[0])) {
            assert!(
                value == 1 || sector == 1800 || [412, 924, 1436, 512, 1024, 364, 876, 1388].contains(&sector)
            );
        }
        prefixes += usize::from(sectors == [1, 1, 0, 0]);
        holes += usize::from(sectors[0] == 0 && sectors.contains(&1));
    }
    assert!(prefixes > 5 && holes > 5, "{prefixes} prefixes, {holes} holes");
}

#[test]
fn a_faulty_disk_fails_some_operations_and_a_full_one_all_that_grow() {
    let simulation = SimulatedWorld::new(1);
    let (storage, path) = (simulation.storage(), Path::new("/file"));
    let file = storage.open(path, true).unwrap();
    file.write_at(0, b"12345678").unwrap();
    storage.set_faults(DiskFaults { bytes_max: Some(8), ..DiskFaults::default() }, simulation.rng(1 << 32));
    file.write_at(4, b"abcd").unwrap();
    assert_eq!(file.write_at(5, b"abcd").unwrap_err().kind(), ErrorKind::StorageFull);
    assert_eq!(file.set_len(9).unwrap_err().kind(), ErrorKind::StorageFull);
    let half = DiskFaults { write_errors: 512, read_errors: 512, sync_errors: 512, bytes_max: None };
    storage.set_faults(half, simulation.rng(1 << 32));
    let outcomes: BTreeSet<(bool, bool)> = (0..50)
        .map(|_| (file.write_at(0, b"x").is_ok(), file.read_at(0, &mut [0]).is_ok()))
        .collect();
    assert_eq!(outcomes.len(), 4, "each by a chance of its own");
    while file.sync().is_ok() {}
    storage.set_faults(DiskFaults::default(), simulation.rng(1 << 32));
    assert!(
        file.sync().is_err(),
        "after a failed synchronisation no later one of the handle is to be trusted"
    );
}

#[test]
fn work_of_a_dead_process_is_lost_done_or_half_done_and_reaches_the_disk_no_more() {
    let mut outcomes = BTreeSet::new();
    for seed in 0..64 {
        let simulation = SimulatedWorld::new(seed);
        let world = simulation.world();
        let storage = world.storage.clone();
        let said = Arc::new(Mutex::new(String::new()));
        let heard = said.clone();
        let job = move || {
            for name in ["/a", "/b", "/c"] {
                let done = storage.replace(Path::new(name), b"x").is_ok();
                heard.lock().unwrap().push(if done { 'x' } else { '-' });
            }
        };
        assert!(world.worker.run(Box::new(job)).is_ok());
        simulation.die(Death::Killed, &mut simulation.rng(1 << 32));
        let said = said.lock().unwrap().clone();
        let there = simulation.storage().list(Path::new("")).unwrap_or_default().len();
        assert!(there <= said.matches('x').count());
        outcomes.insert(said);
        assert!(world.storage.replace(Path::new("/late"), b"x").is_err());
        let next = simulation.restarted().world();
        assert!(next.storage.replace(Path::new("/new"), b"x").is_ok());
    }
    for expected in ["", "---", "x--", "xx-", "xxx"] {
        assert!(outcomes.contains(expected), "{outcomes:?}");
    }
}

/// Says on a shared list when it is destroyed, and then tries to write down that it was.
struct Witness {
    seen: Rc<RefCell<Vec<String>>>,
}
impl Witness {
    fn on_destroy(&mut self, cx: &mut Cx) {
        let wrote = cx.world().storage.replace(Path::new("/goodbye"), b"x").is_ok();
        self.seen.borrow_mut().push(format!("{} wrote: {wrote}", cx.loop_name()));
    }
}
object! { Witness { hooks { on_destroy } } }

#[test]
fn a_node_that_dies_leaves_no_trace_and_one_that_quits_does() {
    let simulation = Simulation::new(1);
    let seen = Rc::new(RefCell::new(Vec::new()));
    let start = |machine: &SimulatedWorld, name: &str| -> Node {
        let node = simulation.node(machine, name, |settings| settings.mode = TimingMode::SelectIo);
        node.with(|cx| cx.spawn(Witness { seen: seen.clone() }));
        node
    };
    let machine = simulation.world().machine();
    let node = start(&machine, "first");
    simulation.run_for_nodes(Duration::from_millis(30)).unwrap();
    let machine = node.die(Death::Killed, &mut simulation.world().rng(1 << 32));
    assert!(machine.storage().list(Path::new("/")).unwrap().is_empty());
    let node = start(&machine, "second");
    simulation.run_for_nodes(Duration::from_millis(30)).unwrap();
    assert!(!node.has_ended());
    let machine = node.quit();
    assert_eq!(machine.storage().list(Path::new("/")).unwrap(), [Path::new("goodbye")]);
    assert_eq!(*seen.borrow(), ["first wrote: false", "second wrote: true"]);
}
