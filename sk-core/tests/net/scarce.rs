//! Accepting: in turns, and when the process has no descriptors left.

use crate::actors::any_port;
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use sk_core::world::{self, Datagram, Net, OsSignals, Readiness, Stream, Token, Wake};
use std::cell::Cell;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

/// A net whose listeners find no descriptors as often as it is told.
struct Scarce {
    inner: Option<Box<dyn Net>>,
    refusals: Rc<Cell<u32>>,
}

struct ScarceListener {
    inner: Box<dyn world::Listener>,
    refusals: Rc<Cell<u32>>,
}

impl world::Listener for ScarceListener {
    fn local(&self) -> Endpoint {
        self.inner.local()
    }
    fn accept(&mut self, token: Token) -> io::Result<Box<dyn Stream>> {
        const EMFILE: i32 = 24;
        match self.refusals.get() {
            0 => self.inner.accept(token),
            left => {
                self.refusals.set(left - 1);
                Err(io::Error::from_raw_os_error(EMFILE))
            }
        }
    }
}

impl Scarce {
    /// Takes the place of the loop's net.
    fn wrap(cx: &mut Cx, refusals: &Rc<Cell<u32>>) {
        let scarce = Scarce { inner: None, refusals: refusals.clone() };
        let inner = std::mem::replace(&mut cx.world().net, Box::new(scarce));
        cx.world().net = Box::new(Scarce { inner: Some(inner), refusals: refusals.clone() });
    }
    fn inner(&mut self) -> &mut dyn Net {
        &mut **self.inner.as_mut().expect("it was wrapped")
    }
}

impl Net for Scarce {
    fn wait(&mut self, timeout: Option<Duration>, ready: &mut Vec<Readiness>) -> io::Result<()> {
        self.inner().wait(timeout, ready)
    }
    fn waker(&self) -> Arc<dyn Wake> {
        self.inner.as_ref().expect("it was wrapped").waker()
    }
    fn listen(&mut self, at: &Endpoint, token: Token) -> io::Result<Box<dyn world::Listener>> {
        let inner = self.inner().listen(at, token)?;
        Ok(Box::new(ScarceListener { inner, refusals: self.refusals.clone() }))
    }
    fn connect(&mut self, to: &Endpoint, token: Token) -> io::Result<Box<dyn Stream>> {
        self.inner().connect(to, token)
    }
    fn bind(&mut self, at: SocketAddr, token: Token) -> io::Result<Box<dyn Datagram>> {
        self.inner().bind(at, token)
    }
    fn watch_os_signals(&mut self, token: Token) -> io::Result<Box<dyn OsSignals>> {
        self.inner().watch_os_signals(token)
    }
    fn block_os_signals(&mut self) -> io::Result<()> {
        self.inner().block_os_signals()
    }
    fn release_os_signals(&mut self) -> io::Result<()> {
        self.inner().release_os_signals()
    }
}

/// Accepts, and notes when it was asked to.
#[derive(Default)]
struct Gate {
    listener: Handle<Listener>,
    asked: Vec<(u64, usize)>,
    failed: usize,
}
impl Gate {
    fn accept(&mut self, cx: &mut Cx) {
        let before = self.asked.len();
        self.asked.push((cx.now().as_nanos() / 1_000_000, 0));
        loop {
            match self.listener.accept(cx) {
                Ok(Some(_)) => self.asked[before].1 += 1,
                Ok(None) => return,
                Err(_) => {
                    self.failed += 1;
                    return;
                }
            }
        }
    }
}
object! { Gate { slots { accept() } } }

fn crowd(cx: &mut Cx, guests: usize) -> Handle<Gate> {
    let listener = Listener::on(cx, &any_port()).expect("a port is free");
    let gate = cx.spawn(Gate { listener, ..Gate::default() });
    attach!(cx, listener.incoming => gate.accept);
    let at = listener.local(cx).expect("it lives");
    for _ in 0..guests {
        Socket::connect(cx, &at).expect("a connection can be begun");
    }
    gate
}

#[test]
fn many_connections_are_accepted_in_turns_of_one_round() {
    let simulation = Simulation::new(4);
    let mut app = simulation.app();
    let gate = crowd(app.cx(), 150);
    simulation.run_for(&mut app, Duration::from_secs(1));
    let asked = app.cx().with(gate, |gate, _| gate.asked.clone()).expect("it lives");
    let full: Vec<_> = asked.iter().filter(|(_, accepted)| *accepted > 0).collect();
    assert_eq!(full.iter().map(|(_, accepted)| *accepted).collect::<Vec<_>>(), [64, 64, 22]);
    assert!(full.iter().all(|(at, _)| *at == full[0].0), "{asked:?}");
}

#[test]
fn without_descriptors_accepting_is_tried_again_later_and_not_in_a_spin() {
    for mode in [TimingMode::Coarse, TimingMode::SelectIo] {
        let simulation = Simulation::new(4);
        let mut app = simulation.app_with(|settings| settings.mode = mode);
        let refusals = Rc::new(Cell::new(5));
        Scarce::wrap(app.cx(), &refusals);
        let gate = crowd(app.cx(), 1);
        simulation.run_for(&mut app, Duration::from_secs(2));
        let cx = app.cx();
        let (asked, failed) = cx.with(gate, |gate, _| (gate.asked.clone(), gate.failed)).expect("it lives");
        assert_eq!(failed, 5);
        assert_eq!(asked.last().map(|(_, accepted)| *accepted), Some(1), "{asked:?}");
        let tail = &asked[asked.len() - 5..];
        assert!(tail.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 100), "{asked:?}");
        assert!(asked.len() <= 8, "{asked:?}");
    }
}
