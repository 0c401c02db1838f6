//! What only the simulated world has: exact virtual times, repetition, power cuts.

#[path = "util/mod.rs"]
mod util;

use sk_core::Instant;
use sk_core::world::{
    Clock, Endpoint, JOBS_WAITING_MAX, NetworkSettings, OsSignal, Readiness, Rng, SimulatedWorld, Storage,
    Token, Worker, World,
};
use std::fmt::Write;
use std::io::{ErrorKind, IoSlice};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use util::{look, told};

fn micros(count: u64) -> Instant {
    Instant::ZERO + Duration::from_micros(count)
}

fn loopback() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

fn next(world: &World) -> Option<Instant> {
    world.simulated_share().unwrap().next_event()
}

#[test]
fn a_connection_takes_exactly_one_way_and_one_way_back() {
    let unix = Endpoint::Unix("/run/hub".into());
    for (at, one_way) in [(Endpoint::Ip(loopback()), 50), (unix, 5)] {
        let simulation = SimulatedWorld::new(1);
        let (mut here, mut there) = (simulation.world(), simulation.world());
        let mut listener = there.net.listen(&at, Token(1)).unwrap();
        let mut client = here.net.connect(&listener.local(), Token(2)).unwrap();
        assert_eq!((next(&here), next(&there)), (Some(micros(2 * one_way)), Some(micros(one_way))));
        assert_eq!(look(&mut *there.net), [], "looking moves no clock");

        simulation.clock().set(micros(one_way));
        assert!(told(&look(&mut *there.net), Token(1)).0);
        let mut server = listener.accept(Token(3)).unwrap();
        server.write_vectored(&[IoSlice::new(b"hello")]).unwrap();
        assert!(!client.connected().unwrap());
        assert_eq!(next(&here), Some(micros(2 * one_way)), "the answer and the bytes together");
        assert_eq!(next(&there), Some(micros(one_way)), "the accepted stream is writable now");

        simulation.clock().set(micros(2 * one_way));
        let expected = Readiness { token: Token(2), readable: true, writable: true };
        assert_eq!(look(&mut *here.net), [expected]);
        assert!(client.connected().unwrap());
        assert_eq!((client.read(&mut [0; 9]).unwrap(), next(&here)), (5, None));
    }
}

#[test]
fn a_refusal_is_foreseen_too() {
    let simulation = SimulatedWorld::new(1);
    let mut world = simulation.world();
    let nobody = Endpoint::Ip("127.0.0.1:9".parse().unwrap());
    let _client = world.net.connect(&nobody, Token(1)).unwrap();
    assert_eq!(next(&world), Some(micros(100)));
}

#[test]
fn who_gives_up_before_he_arrives_is_not_heard_of() {
    let simulation = SimulatedWorld::new(1);
    let (mut here, mut there) = (simulation.world(), simulation.world());
    let mut listener = there.net.listen(&Endpoint::Ip(loopback()), Token(1)).unwrap();
    drop(here.net.connect(&listener.local(), Token(2)).unwrap());
    assert_eq!((next(&here), next(&there)), (None, None));
    simulation.clock().advance(Duration::from_secs(1));
    assert_eq!(listener.accept(Token(3)).err().map(|e| e.kind()), Some(ErrorKind::WouldBlock));
}

#[test]
fn the_window_is_exact_and_opens_when_the_news_of_reading_arrives() {
    let simulation = SimulatedWorld::new(1);
    let (mut here, mut there) = (simulation.world(), simulation.world());
    let mut listener = there.net.listen(&Endpoint::Ip(loopback()), Token(1)).unwrap();
    let mut client = here.net.connect(&listener.local(), Token(2)).unwrap();
    simulation.clock().set(micros(100));
    let mut server = listener.accept(Token(3)).unwrap();
    let big = vec![7; 100_000];
    assert_eq!(client.write_vectored(&[IoSlice::new(&big)]).unwrap(), 65_536);
    assert_eq!(client.write_vectored(&[IoSlice::new(b"x")]).unwrap_err().kind(), ErrorKind::WouldBlock);
    look(&mut *here.net);
    simulation.clock().set(micros(150));
    assert_eq!((server.read(&mut [0; 1000]).unwrap(), next(&here)), (1000, Some(micros(200))));
    simulation.clock().set(micros(200));
    assert!(told(&look(&mut *here.net), Token(2)).1);
    assert_eq!(client.write_vectored(&[IoSlice::new(&big)]).unwrap(), 1000);
}

#[test]
fn datagrams_beyond_the_room_of_the_receiver_are_lost() {
    let simulation = SimulatedWorld::new(1);
    let (mut here, mut there) = (simulation.world(), simulation.world());
    let mut receiver = there.net.bind(loopback(), Token(1)).unwrap();
    let mut sender = here.net.bind(loopback(), Token(2)).unwrap();
    for _ in 0..300 {
        sender.send(receiver.local(), &[0; 1000]).unwrap();
    }
    simulation.clock().advance(Duration::from_secs(1));
    let received = std::iter::from_fn(|| receiver.receive(&mut [0; 1000]).ok()).count();
    assert_eq!(received, 212, "of 1000 bytes each in 212,992");
}

#[test]
fn a_signal_is_pending_once_until_it_is_taken() {
    let simulation = SimulatedWorld::new(1);
    let mut world = simulation.world();
    simulation.raise(OsSignal::Interrupt);
    world.net.block_os_signals().unwrap();
    let mut signals = world.net.watch_os_signals(Token(1)).unwrap();
    simulation.raise(OsSignal::Interrupt);
    simulation.raise(OsSignal::Terminate);
    assert_eq!(next(&world), Some(Instant::ZERO));
    assert!(told(&look(&mut *world.net), Token(1)).0);
    let taken: Vec<_> = (0..3).map(|_| signals.take().unwrap()).collect();
    assert_eq!(taken, [Some(OsSignal::Interrupt), Some(OsSignal::Terminate), None]);
}

#[test]
fn the_clock_never_goes_back() {
    let simulation = SimulatedWorld::new(1);
    simulation.clock().set(micros(10));
    simulation.clock().set(micros(3));
    assert_eq!(simulation.clock().now(), micros(10));
    simulation.clock().advance(Duration::MAX);
    assert_eq!(simulation.clock().now(), Instant::FAR);
}

#[test]
fn ports_run_out_as_an_error_and_come_back() {
    let simulation = SimulatedWorld::new(1);
    let mut world = simulation.world();
    let listener = world.net.listen(&Endpoint::Ip(loopback()), Token(1)).unwrap();
    let to = listener.local();
    let mut clients = Vec::new();
    let refused = loop {
        match world.net.connect(&to, Token(2)) {
            Ok(client) => clients.push(client),
            Err(error) => break error.kind(),
        }
    };
    assert_eq!((refused, clients.len()), (ErrorKind::AddrNotAvailable, 32_767));
    let other = world.net.listen(&Endpoint::Ip(loopback()), Token(3));
    assert_eq!(other.err().map(|e| e.kind()), Some(ErrorKind::AddrNotAvailable));
    clients.pop();
    world.net.connect(&to, Token(2)).unwrap();
}

#[test]
fn a_power_cut_leaves_what_was_synchronised() {
    let simulation = SimulatedWorld::new(1);
    let storage = simulation.storage();
    storage.create_dir(Path::new("/state")).unwrap();
    let (log, settings) = (Path::new("/state/log"), Path::new("/state/settings"));
    storage.replace(settings, b"new").unwrap();
    let file = storage.open(log, true).unwrap();
    file.write_at(0, b"durable").unwrap();
    file.sync().unwrap();
    file.write_at(0, b"DUR").unwrap();
    file.set_len(4).unwrap();
    assert_eq!(storage.read(log, 10).unwrap(), b"DURa");
    storage.power_cut();
    assert_eq!(storage.read(log, 10).unwrap(), b"durable");
    assert_eq!(storage.read(settings, 10).unwrap(), b"new");
    assert!(file.write_at(0, b"late").is_err() && file.sync().is_err());
    drop(file);
    assert_eq!(storage.open(log, false).unwrap().len().unwrap(), 7);
}

#[test]
fn a_power_cut_by_chance_keeps_or_loses_whole_writes() {
    let simulation = SimulatedWorld::new(1);
    let (storage, mut rng, path) = (simulation.storage(), simulation.rng(1 << 32), Path::new("/file"));
    let mut outcomes = std::collections::BTreeSet::new();
    for _ in 0..64 {
        storage.replace(path, b"------").unwrap();
        let file = storage.open(path, false).unwrap();
        file.write_at(0, b"aaa").unwrap();
        file.write_at(3, b"bbb").unwrap();
        storage.power_cut_by_chance(&mut rng);
        outcomes.insert(String::from_utf8(storage.read(path, 9).unwrap()).unwrap());
    }
    let all: Vec<&str> = outcomes.iter().map(String::as_str).collect();
    assert_eq!(all, ["------", "---bbb", "aaa---", "aaabbb"]);
}

#[test]
fn a_removed_file_lives_until_it_is_closed() {
    let (simulation, path) = (SimulatedWorld::new(1), Path::new("/file"));
    let storage = simulation.storage();
    let file = storage.open(path, true).unwrap();
    storage.remove(path).unwrap();
    file.write_at(0, b"x").unwrap();
    assert_eq!(file.len().unwrap(), 1);
    assert!(storage.open(path, true).unwrap().is_empty().unwrap(), "a new file of the same name");
}

#[test]
fn too_many_jobs_are_given_back() {
    let simulation = SimulatedWorld::new(1);
    for _ in 0..JOBS_WAITING_MAX {
        assert!(simulation.worker().run(Box::new(|| {})).is_ok());
    }
    assert!(simulation.worker().run(Box::new(|| {})).is_err());
    let due = simulation.worker().next_due().unwrap();
    assert!(due >= micros(1_000) && due < micros(5_000));
    assert_eq!(simulation.worker().run_due(micros(5_000)), JOBS_WAITING_MAX);
    assert!(simulation.worker().run(Box::new(|| {})).is_ok());
}

#[test]
fn shares_have_numbers_and_randomness_in_order_of_creation() {
    let simulation = SimulatedWorld::new(5);
    let mut first = simulation.world();
    let mut second = first.for_thread().unwrap().grow().unwrap();
    assert_eq!(second.simulated_share().unwrap().number(), 1);
    for (number, world) in [&mut first, &mut second].into_iter().enumerate() {
        assert_eq!(world.rng.next_u64(), simulation.rng(number as u64).next_u64());
    }
    assert_eq!(second.clock.now(), Instant::ZERO);
    first.clock.sleep(Duration::from_micros(4));
    assert_eq!(second.clock.now(), micros(4), "one clock");
}

/// Two loops talk over TCP and UDP while jobs run; everything that anybody sees is written down.
fn transcript(seed: u64) -> String {
    let settings = NetworkSettings { jitter_max: Duration::from_micros(300), ..NetworkSettings::default() };
    let simulation = SimulatedWorld::with_network(seed, settings);
    let (mut here, mut there) = (simulation.world(), simulation.world());
    let mut listener = there.net.listen(&Endpoint::Ip(loopback()), Token(1)).unwrap();
    let mut client = here.net.connect(&listener.local(), Token(2)).unwrap();
    let mut sender = here.net.bind(loopback(), Token(3)).unwrap();
    let mut receiver = there.net.bind(loopback(), Token(4)).unwrap();
    let (mut server, mut seen) = (None, String::new());
    let jobs = Arc::new(Mutex::new(Vec::new()));
    for round in 0..40_u64 {
        let number = here.rng.next_u64();
        sender.send(receiver.local(), &number.to_le_bytes()).unwrap();
        if client.connected().unwrap() {
            client.write_vectored(&[IoSlice::new(&number.to_le_bytes())]).unwrap();
        }
        let jobs_done = jobs.clone();
        assert!(here.worker.run(Box::new(move || jobs_done.lock().unwrap().push(round))).is_ok());

        let due = [next(&here), next(&there), simulation.worker().next_due()]
            .into_iter()
            .flatten()
            .min();
        simulation.clock().set(due.unwrap());
        simulation.worker().run_due(simulation.clock().now());
        for world in [&mut here, &mut there] {
            writeln!(seen, "{} {:?}", simulation.clock().now(), look(&mut *world.net)).unwrap();
        }
        server = server.or_else(|| listener.accept(Token(5)).ok());
        let mut bytes = [0; 64];
        while let Ok((count, from)) = receiver.receive(&mut bytes) {
            writeln!(seen, "{from} {:?}", &bytes[..count]).unwrap();
        }
        if let Some(Ok(count)) = server.as_mut().map(|server| server.read(&mut bytes)) {
            writeln!(seen, "{:?}", &bytes[..count]).unwrap();
        }
    }
    writeln!(seen, "{:?}", jobs.lock().unwrap()).unwrap();
    seen
}

#[test]
fn the_same_seed_gives_the_same_bytes_at_the_same_times() {
    let first = transcript(11);
    assert!(first.lines().count() > 100, "something happened");
    assert_eq!(first, transcript(11));
    assert_ne!(first, transcript(12));
}
