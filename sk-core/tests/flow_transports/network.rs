//! A hub, satellites and listeners on one loop of the real world, stepped until something is so.

use super::plug::Cable;
use super::supply::{self, PushedClock};
use super::wire::Wire;
use bytes::Bytes;
use sk_core::flow::login::OwnerToken;
use sk_core::flow::satellite::Credentials;
use sk_core::flow::server::Settings;
use sk_core::flow::{FlowMessage, HubAddress, Rights, SkFlowSat, SkFlowServer};
#[cfg(feature = "tls")]
use sk_core::flow::{TlsIdentity, TlsTrust};
use sk_core::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Far longer than anything here takes: reaching it means that something never came.
const WATCHDOG: Duration = Duration::from_secs(30);

/// What connects satellites and hub.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Tcp,
    Unix,
    Pipe,
    Tty,
    #[cfg(feature = "websocket")]
    WebSocket,
    #[cfg(feature = "tls")]
    Tls,
    #[cfg(all(feature = "tls", feature = "websocket"))]
    SecureWebSocket,
}

/// Everything that a satellite has told.
#[derive(Default)]
pub struct Ear {
    pub messages: Vec<(String, Bytes)>,
    pub ready: usize,
    pub lost: Vec<String>,
    pub refused: Vec<String>,
}

impl Ear {
    fn hear(&mut self, _cx: &mut Cx, message: &FlowMessage) {
        self.messages.push((message.name().to_owned(), message.payload().clone()));
    }
    fn on_ready(&mut self, _cx: &mut Cx) {
        self.ready += 1;
    }
    fn on_lost(&mut self, _cx: &mut Cx, why: &str) {
        self.lost.push(why.to_owned());
    }
    fn on_refused(&mut self, _cx: &mut Cx, why: &str) {
        self.refused.push(why.to_owned());
    }
}

object! { pub Ear { slots { hear(&FlowMessage) on_ready() on_lost(&str) on_refused(&str) } } }

/// A satellite and what it has told.
#[derive(Clone, Copy)]
pub struct Station {
    pub hub: Handle<SkFlowSat>,
    pub ear: Handle<Ear>,
}

pub struct Network {
    pub app: SkApp,
    pub clock: Arc<PushedClock>,
    pub kind: Kind,
    pub server: Handle<SkFlowServer>,
    /// Where the hub is reached; none for a pipe.
    pub address: Option<HubAddress>,
    wire: Option<Wire>,
    #[cfg(feature = "tls")]
    pub secrets: Secrets,
}

/// The certificate of the hub, and the key to it.
#[cfg(feature = "tls")]
pub struct Secrets {
    pub identity: TlsIdentity,
    pub certificate: String,
}

#[cfg(feature = "tls")]
impl Secrets {
    pub fn new() -> Secrets {
        let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_owned()]).expect("a certificate");
        let certificate = made.cert.pem();
        let key = made.signing_key.serialize_pem();
        let identity = TlsIdentity::from_pem(certificate.as_bytes(), key.as_bytes()).expect("they fit");
        Secrets { identity, certificate }
    }
}

/// A path in the temporary folder that nobody else uses.
pub fn fresh_path(what: &str) -> PathBuf {
    static MADE: AtomicU32 = AtomicU32::new(0);
    let number = MADE.fetch_add(1, Ordering::Relaxed);
    std::env::temp_dir().join(format!("sk-transports-{}-{number}-{what}", std::process::id()))
}

fn token() -> OwnerToken {
    OwnerToken::new([7; 32])
}

fn settings() -> Settings {
    let uid = nix::unistd::getuid().as_raw();
    Settings { user: "robot".parse().expect("a name"), token: Some(token()), owner_uid: Some(uid) }
}

impl Network {
    pub fn new(kind: Kind) -> Network {
        let (world, clock) = supply::world();
        let builder = SkApp::builder().mode(TimingMode::SelectIo).interval(Duration::from_millis(2));
        let mut app = builder.world(world).build().expect("descriptors are left");
        let server = SkFlowServer::start(app.cx(), settings());
        let mut network = Network {
            app,
            clock,
            kind,
            server,
            address: None,
            wire: None,
            #[cfg(feature = "tls")]
            secrets: Secrets::new(),
        };
        let wanted = match kind {
            Kind::Tcp => Some("tcp:127.0.0.1:0".parse().expect("an address")),
            Kind::Unix => Some(HubAddress::Unix(fresh_path("hub.sock"))),
            Kind::Pipe => None,
            Kind::Tty => Some(network.wire.insert(Wire::new()).hub()),
            #[cfg(feature = "websocket")]
            Kind::WebSocket => Some("ws:127.0.0.1:0/flow".parse().expect("an address")),
            #[cfg(feature = "tls")]
            Kind::Tls => Some("tls:127.0.0.1:0".parse().expect("an address")),
            #[cfg(all(feature = "tls", feature = "websocket"))]
            Kind::SecureWebSocket => Some("wss:127.0.0.1:0".parse().expect("an address")),
        };
        network.address = wanted.map(|at| network.listen(&at));
        network
    }

    fn listen(&mut self, at: &HubAddress) -> HubAddress {
        #[cfg(feature = "tls")]
        if at.to_string().starts_with("tls:") || at.to_string().starts_with("wss:") {
            let identity = self.secrets.identity.clone();
            return self
                .server
                .listen_secured(self.app.cx(), at, identity)
                .expect("the place is free");
        }
        self.server.listen(self.app.cx(), at).expect("the place is free")
    }

    /// Destroys the hub and makes another in the same place.
    pub fn replace_hub(&mut self) {
        let at = self.address.clone().expect("a pipe's hub never comes back");
        let old = self.server;
        self.app.cx().destroy_later(old);
        self.until("the old hub is buried", |cx| !cx.exists(old));
        self.server = SkFlowServer::start(self.app.cx(), settings());
        self.listen(&at);
    }

    pub fn wire(&self) -> &Wire {
        self.wire.as_ref().expect("a serial line")
    }

    pub fn cable(&mut self) -> Cable {
        Cable::to(self.address.as_ref().expect("a pipe is no cable"), fresh_path("cable.sock"))
    }

    pub fn satellite(&mut self) -> Station {
        let line = self.wire.as_ref().map(Wire::satellite);
        match line.or_else(|| self.address.clone()) {
            Some(address) => self.satellite_at(&address),
            None => {
                let cx = self.app.cx();
                let seed = self.server.pipe(cx, Rights::ALL).expect("the hub has room");
                let hub = SkFlowSat::inside(cx, seed);
                self.station(hub)
            }
        }
    }

    pub fn satellite_at(&mut self, address: &HubAddress) -> Station {
        let credentials = match self.kind {
            Kind::Unix => Credentials::Peer,
            _ => Credentials::Token(token()),
        };
        #[cfg(feature = "tls")]
        if let Some(trust) = self.trust() {
            return self.secured(address, trust);
        }
        let hub = SkFlowSat::connect_as(self.app.cx(), address, credentials);
        self.station(hub)
    }

    /// One way of trusting for TCP, the other for WebSocket.
    #[cfg(feature = "tls")]
    fn trust(&self) -> Option<TlsTrust> {
        match self.kind {
            Kind::Tls => TlsTrust::authority_pem(self.secrets.certificate.as_bytes()).ok(),
            #[cfg(feature = "websocket")]
            Kind::SecureWebSocket => TlsTrust::pinned(&self.secrets.identity.fingerprint()).ok(),
            _ => None,
        }
    }

    #[cfg(feature = "tls")]
    pub fn satellite_without_trust(&mut self, address: &HubAddress) -> Station {
        let hub = SkFlowSat::connect_as(self.app.cx(), address, Credentials::Token(token()));
        self.station(hub)
    }

    #[cfg(feature = "tls")]
    pub fn secured(&mut self, address: &HubAddress, trust: TlsTrust) -> Station {
        let hub = SkFlowSat::connect_secured(self.app.cx(), address, Credentials::Token(token()), trust);
        self.station(hub)
    }

    fn station(&mut self, hub: Handle<SkFlowSat>) -> Station {
        let cx = self.app.cx();
        let ear = cx.spawn(Ear::default());
        attach!(cx, hub.message => ear.hear);
        attach!(cx, hub.ready => ear.on_ready);
        attach!(cx, hub.lost => ear.on_lost);
        attach!(cx, hub.refused => ear.on_refused);
        Station { hub, ear }
    }

    /// Steps the loop until `done` holds.
    pub fn until(&mut self, what: &str, mut done: impl FnMut(&mut Cx) -> bool) {
        let started = std::time::Instant::now();
        while !done(self.app.cx()) {
            assert!(started.elapsed() < WATCHDOG, "{:?}: never came: {what}", self.kind);
            self.app.pulse();
        }
    }

    pub fn until_ready(&mut self, station: Station) {
        self.until("the satellite is let in", |cx| station.with(cx, |ear| ear.ready > 0));
    }

    /// A publisher of `robot.NAME` with that listener to it.
    pub fn pair(&mut self, name: &str) -> (Station, Station) {
        let (publisher, listener) = (self.satellite(), self.satellite());
        self.join(publisher, listener, name);
        (publisher, listener)
    }

    pub fn join(&mut self, publisher: Station, listener: Station, name: &str) {
        let cx = self.app.cx();
        publisher
            .hub
            .open(cx, name, SkVariant::map([("format", "bytes".into())]))
            .expect("a name");
        listener.hub.subscribe(cx, &format!("robot.{name}")).expect("a name");
        self.until("somebody listens", |cx| publisher.hub.is_listened(cx, name));
    }

    /// One message from one to the other, as a sign that both live.
    pub fn passes(&mut self, publisher: Station, listener: Station, name: &str) {
        let heard = listener.with(self.app.cx(), |ear| ear.messages.len());
        assert!(publisher.hub.publish_bytes(self.app.cx(), name, &b"sign"[..]), "{name}");
        self.until("the message arrives", |cx| listener.with(cx, |ear| ear.messages.len() > heard));
    }

    pub fn connections(&mut self) -> usize {
        let server = self.server;
        self.app
            .cx()
            .with(server, |server, _| server.core().connections())
            .expect("it lives")
    }

    pub fn until_connections(&mut self, count: usize) {
        let server = self.server;
        self.until("only the others are connected", |cx| {
            cx.with(server, |server, _| server.core().connections()) == Ok(count)
        });
    }
}

impl Station {
    pub fn with<R>(self, cx: &mut Cx, look: impl FnOnce(&mut Ear) -> R) -> R {
        cx.with(self.ear, |ear, _| look(ear)).expect("ears live as long as the test")
    }
}
