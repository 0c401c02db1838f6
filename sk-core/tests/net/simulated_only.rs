//! What can be said exactly only under a virtual clock.

use crate::actors::{Door, Then, Visitor, any_port};
use bytes::Bytes;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::world::{NetworkSettings, SimulatedWorld};

/// Notes in which order sockets are served, reading one turn's worth each time.
#[derive(Default)]
struct Bench {
    listener: Handle<Listener>,
    sockets: Vec<Handle<Socket>>,
    served: Vec<(u64, usize, usize)>,
}
struct Seat {
    bench: Handle<Bench>,
    number: usize,
    socket: Handle<Socket>,
}
impl Bench {
    fn accept(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let this = cx.this(self);
        while let Some(socket) = self.listener.accept(cx)? {
            let number = self.sockets.len();
            self.sockets.push(socket);
            let seat = cx.spawn(Seat { bench: this, number, socket });
            attach!(cx, socket.readable => seat.read);
        }
        Ok(())
    }
}
impl Seat {
    fn read(&mut self, cx: &mut Cx) -> Result<(), Box<dyn std::error::Error>> {
        let mut room = bytes::BytesMut::new();
        let count = self.socket.read_into(cx, &mut room)?;
        let (round, number) = (cx.pulse().round, self.number);
        if count > 0 {
            cx.with(self.bench, |bench, _| bench.served.push((round, number, count)))?;
        }
        Ok(())
    }
}
object! { Bench { slots { accept() } } }
object! { Seat { slots { read() } } }

#[test]
fn a_heavy_stream_does_not_starve_a_light_one_in_the_same_round() {
    let network = NetworkSettings { window_bytes: 1 << 20, ..NetworkSettings::default() };
    let simulation = Simulation::in_world(SimulatedWorld::with_network(3, network));
    let mut app = simulation.app();
    let cx = app.cx();
    let listener = Listener::on(cx, &any_port()).expect("a port is free");
    let bench = cx.spawn(Bench { listener, ..Bench::default() });
    attach!(cx, listener.incoming => bench.accept);
    let at = listener.local(cx).expect("it lives");
    let heavy = Socket::connect(cx, &at).expect("a connection can be begun");
    let light = Socket::connect(cx, &at).expect("a connection can be begun");
    simulation.run_for(&mut app, Duration::from_millis(100));
    let cx = app.cx();
    heavy.write(cx, vec![1; 200 * 1024]).expect("the queue has room");
    light.write(cx, "short").expect("the queue has room");
    simulation.run_for(&mut app, Duration::from_millis(100));
    let served = app.cx().with(bench, |bench, _| bench.served.clone()).expect("it lives");
    let round = served[0].0;
    let expected = [(0, 65536), (1, 5), (0, 65536), (0, 65536), (0, 8192)];
    assert_eq!(served, expected.map(|(number, count)| (round, number, count)));
}

#[test]
fn nobody_who_listens_costs_no_rounds() {
    let simulation = Simulation::new(5);
    let mut app = simulation.app_with(|settings| settings.mode = TimingMode::SelectIo);
    let cx = app.cx();
    let (door, at) = Door::open(cx, &any_port());
    let deaf = Socket::connect(cx, &at).expect("a connection can be begun");
    deaf.write(cx, "hello").expect("the queue has room");
    simulation.run_for(&mut app, Duration::from_secs(1));
    let before = app.cx().stats().rounds;
    simulation.run_for(&mut app, Duration::from_secs(1));
    let rounds = app.cx().stats().rounds - before;
    assert!(rounds <= 101, "{rounds} rounds in a second of 10 ms each, with an echo that nobody reads");
    // Whoever comes late hears of what waits.
    let visitor = Visitor::over(app.cx(), deaf, 5, Then::Close);
    simulation.run_for(&mut app, Duration::from_secs(10));
    let cx = app.cx();
    assert_eq!(cx.with(visitor, |v, _| v.got.clone()), Ok(b"hello".to_vec()));
    assert_eq!(cx.with(visitor, |v, _| v.closed.clone()), Ok(vec![CloseReason::Local]));
    assert!(cx.with(door, |door, _| door.sockets[0]).is_ok_and(|echo| !cx.exists(echo)));
}

#[test]
fn an_end_that_nobody_heard_is_told_to_the_first_who_listens() {
    let simulation = Simulation::new(5);
    let mut app = simulation.app();
    let cx = app.cx();
    let (door, at) = Door::open(cx, &any_port());
    let socket = Socket::connect(cx, &at).expect("a connection can be begun");
    simulation.run_for(&mut app, Duration::from_secs(1));
    let cx = app.cx();
    let far = cx.with(door, |door, _| door.sockets[0]).expect("it lives");
    cx.destroy_later(far);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let visitor = Visitor::over(app.cx(), socket, 1, Then::Watch);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let cx = app.cx();
    assert_eq!(cx.with(visitor, |v, _| v.closed.clone()), Ok(vec![CloseReason::Ended]));
}

#[test]
fn traffic_ends_the_wait_of_select_io_before_its_interval() {
    let simulation = Simulation::new(9);
    let mut app = simulation.app_with(|settings| {
        settings.mode = TimingMode::SelectIo;
        settings.interval = Duration::from_secs(1);
        settings.slow_interval = Duration::from_secs(1);
    });
    let cx = app.cx();
    let (_, at) = Door::open(cx, &any_port());
    let visitor = Visitor::send(cx, &at, Bytes::from_static(b"quick"), Then::Close);
    simulation.run_for(&mut app, Duration::from_millis(500));
    let cx = app.cx();
    assert_eq!(cx.with(visitor, |v, _| v.closed.clone()), Ok(vec![CloseReason::Local]));
    assert!(cx.pulse().round > 3, "the traffic pulsed the loop: {:?}", cx.pulse());
}

#[test]
fn a_peer_that_never_closes_is_given_up() {
    let simulation = Simulation::new(9);
    let mut app = simulation.app();
    let cx = app.cx();
    let listener = Listener::on(cx, &any_port()).expect("a port is free");
    let at = listener.local(cx).expect("it lives");
    let visitor = Visitor::send(cx, &at, Bytes::from_static(b"unheard"), Then::Close);
    let socket = cx.with(visitor, |v, _| v.socket).expect("it lives");
    simulation.run_for(&mut app, Duration::from_secs(1));
    socket.close(app.cx()).expect("it lives");
    simulation.run_for(&mut app, Duration::from_secs(4));
    assert!(app.cx().exists(socket));
    simulation.run_for(&mut app, Duration::from_secs(2));
    assert!(!app.cx().exists(socket));
    assert_eq!(app.cx().with(visitor, |v, _| v.closed.clone()), Ok(vec![CloseReason::Local]));
}

fn two_loops(seed: u64) -> (u64, Vec<u8>) {
    let simulation = Simulation::new(seed);
    let mut app = simulation.app();
    let cx = app.cx();
    let thread = SkThread::new("echo").start(cx).expect("it starts");
    let at = thread.build(|cx| Door::open(cx, &any_port()).1).expect("it runs");
    let cx = app.cx();
    let visitor = Visitor::send(cx, &at, Bytes::from(vec![7; 40_000]), Then::Close);
    simulation.run_for(&mut app, Duration::from_secs(20));
    let got = app.cx().with(visitor, |v, _| v.got.clone()).expect("it lives");
    (simulation.trace_hash(), got)
}

#[test]
fn the_same_seed_gives_the_same_run_of_two_loops() {
    let (hash, got) = two_loops(42);
    assert_eq!(got, vec![7; 40_000]);
    assert_eq!(two_loops(42).0, hash);
    assert_ne!(two_loops(43).0, hash);
}
