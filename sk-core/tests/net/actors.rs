//! The objects that the tests put behind sockets, and the two places where they run.

use bytes::{Bytes, BytesMut};
use sk_core::prelude::*;
use sk_core::testing::Simulation;
use std::time::Instant as WallClock;

/// Far longer than anything here takes: reaching it means that something never came.
const WATCHDOG: Duration = Duration::from_secs(30);

/// Where a test runs.
pub struct Stage {
    pub app: SkApp,
    simulation: Option<Simulation>,
}

impl Stage {
    pub fn real(mode: TimingMode) -> Stage {
        let app = SkApp::builder()
            .mode(mode)
            .interval(Duration::from_millis(2))
            .build()
            .expect("descriptors are left");
        Stage { app, simulation: None }
    }

    pub fn simulated(mode: TimingMode) -> Stage {
        let simulation = Simulation::new(11);
        let app = simulation.app_with(|settings| settings.mode = mode);
        Stage { app, simulation: Some(simulation) }
    }

    pub fn cx(&mut self) -> &mut Cx {
        self.app.cx()
    }

    /// Runs until somebody quits.
    pub fn play(&mut self) {
        match &self.simulation {
            Some(simulation) => {
                simulation.run_for(&mut self.app, Duration::from_secs(600));
                assert!(self.app.cx().is_quitting(), "nothing ended it in ten minutes of virtual time");
            }
            None => {
                let began = WallClock::now();
                while !self.app.cx().is_quitting() {
                    assert!(began.elapsed() < WATCHDOG, "something never came");
                    self.app.pulse();
                }
            }
        }
    }
}

/// Each test, in both worlds and in the modes that look at sockets differently.
pub fn everywhere(test: impl Fn(&mut Stage)) {
    for mode in [TimingMode::Coarse, TimingMode::SelectIo] {
        test(&mut Stage::simulated(mode));
        test(&mut Stage::real(mode));
    }
}

pub fn any_port() -> Endpoint {
    Endpoint::Ip("127.0.0.1:0".parse().expect("an address"))
}

/// Accepts, and puts an [`Echo`] behind each socket.
pub struct Door {
    pub listener: Handle<Listener>,
    pub sockets: Vec<Handle<Socket>>,
    pub uids: Vec<Option<u32>>,
}

impl Door {
    pub fn open(cx: &mut Cx, at: &Endpoint) -> (Handle<Door>, Endpoint) {
        let listener = Listener::on(cx, at).expect("the address is free");
        let door = cx.spawn(Door { listener, sockets: Vec::new(), uids: Vec::new() });
        attach!(cx, listener.incoming => door.accept);
        (door, listener.local(cx).expect("it lives"))
    }

    fn accept(&mut self, cx: &mut Cx) -> std::io::Result<()> {
        let this = cx.this(self);
        while let Some(socket) = self.listener.accept_under(cx, this)? {
            self.uids.push(socket.peer_uid(cx).expect("it was made just now"));
            let echo = cx.under(socket).spawn(Echo { socket, held: None });
            attach!(cx, socket.readable => echo.answer);
            attach!(cx, socket.drained => echo.go_on);
            attach!(cx, socket.closed => echo.leave);
            self.sockets.push(socket);
        }
        Ok(())
    }
}
object! { Door { slots { accept() } } }

/// Sends back what it reads, and lets the peer wait while its own queue is full.
pub struct Echo {
    pub socket: Handle<Socket>,
    held: Option<Bytes>,
}

/// What an echo lets wait before it stops reading.
const ECHO_QUEUED_MAX: usize = 128 * 1024;

impl Echo {
    fn answer(&mut self, cx: &mut Cx) -> Result<(), Box<dyn std::error::Error>> {
        self.socket.set_queued_bytes_max(cx, ECHO_QUEUED_MAX)?;
        if self.held.is_some() {
            return Ok(());
        }
        let mut text = BytesMut::new();
        if self.socket.read_into(cx, &mut text)? > 0 {
            let text = text.freeze();
            match self.socket.write(cx, text.clone()) {
                Err(WriteError::Full { .. }) => self.held = Some(text),
                other => other?,
            }
        }
        Ok(())
    }

    fn go_on(&mut self, cx: &mut Cx) -> Result<(), WriteError> {
        if let Some(held) = self.held.take() {
            self.socket.write(cx, held)?;
            self.socket.resume(cx)?;
        }
        Ok(())
    }

    fn leave(&mut self, cx: &mut Cx, _why: CloseReason) -> Result<(), Access> {
        self.socket.close(cx)
    }
}
object! { Echo { slots { answer() go_on() leave(CloseReason) } } }

/// What a [`Visitor`] does with its socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Then {
    /// Nothing: it watches.
    Watch,
    /// Closes it once everything came back.
    Close,
    /// Destroys it once everything came back.
    Destroy,
}

/// Connects, sends, compares what comes back and remembers everything.
pub struct Visitor {
    pub socket: Handle<Socket>,
    pub wanted: usize,
    pub then: Then,
    pub got: Vec<u8>,
    pub connected: u32,
    pub drained: u32,
    pub closed: Vec<CloseReason>,
    pub buried: bool,
}

impl Visitor {
    pub fn send(cx: &mut Cx, to: &Endpoint, bytes: Bytes, then: Then) -> Handle<Visitor> {
        let socket = Socket::connect(cx, to).expect("a connection can be begun");
        let visitor = Visitor::over(cx, socket, bytes.len(), then);
        // Several parts, so that several go out in one call.
        for start in (0..bytes.len()).step_by(10_000) {
            let part = bytes.slice(start..bytes.len().min(start + 10_000));
            socket.write(cx, part).expect("the queue has room");
        }
        visitor
    }

    pub fn over(cx: &mut Cx, socket: Handle<Socket>, wanted: usize, then: Then) -> Handle<Visitor> {
        let visitor = cx.spawn(Visitor {
            socket,
            wanted,
            then,
            got: Vec::new(),
            connected: 0,
            drained: 0,
            closed: Vec::new(),
            buried: false,
        });
        attach!(cx, socket.connected => visitor.on_connected);
        attach!(cx, socket.readable => visitor.on_readable);
        attach!(cx, socket.drained => visitor.on_drained);
        attach!(cx, socket.closed => visitor.on_closed);
        let watch = cx.watch(socket);
        attach!(cx, watch.buried => visitor.on_buried());
        visitor
    }

    fn on_connected(&mut self, _cx: &mut Cx) {
        self.connected += 1;
    }

    fn on_readable(&mut self, cx: &mut Cx) {
        let mut room = [0; 3000];
        while let Ok(count @ 1..) = self.socket.read(cx, &mut room) {
            self.got.extend_from_slice(&room[..count]);
        }
        if self.got.len() < self.wanted {
            return;
        }
        match self.then {
            Then::Watch => {}
            Then::Close => self.socket.close(cx).expect("it lives"),
            Then::Destroy => cx.destroy_later(self.socket),
        }
    }

    fn on_drained(&mut self, _cx: &mut Cx) {
        self.drained += 1;
    }

    fn on_closed(&mut self, cx: &mut Cx, why: CloseReason) {
        self.closed.push(why);
        if self.then == Then::Watch {
            cx.quit();
        }
    }

    fn on_buried(&mut self, cx: &mut Cx) {
        self.buried = true;
        cx.quit();
    }
}
object! {
    Visitor { slots { on_connected() on_readable() on_drained() on_closed(CloseReason) on_buried() } }
}
