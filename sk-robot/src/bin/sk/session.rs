//! One visit to a hub: connect, and end with a sentence if there is none.

use crate::arguments::Arguments;
use crate::output::print;
use crate::password;
use sk_core::flow::satellite::{Credentials, PasswordLogin};
use sk_core::flow::{HubAddress, SkFlowSat, TlsTrust};
use sk_core::prelude::*;
use sk_core::world::World;
use sk_robot::{owner, places::Places};

/// How long a hub has to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);
/// The longest wait of the tool's loop; traffic wakes it earlier.
const INTERVAL: Duration = Duration::from_millis(50);

/// Watches over the link of a visit and keeps how it ended.
pub struct Session {
    address: HubAddress,
    hub: Handle<SkFlowSat>,
    deadline: Handle<Timer>,
    refusal: Option<String>,
    answered: bool,
    /// Why the visit failed.
    pub failure: Option<String>,
    /// The hub let us in and has told of all its channels.
    pub entered: Signal<()>,
}

object! {
    pub Session {
        signals { entered() }
        slots { on_ready() on_lost(&str) on_refused(&str) on_deadline() }
    }
}

impl Session {
    fn on_ready(&mut self, cx: &mut Cx) -> Result<(), Access> {
        self.answered = true;
        self.entered.emit(cx, ());
        self.deadline.stop(cx)
    }

    fn on_lost(&mut self, cx: &mut Cx, why: &str) {
        let address = &self.address;
        let failure = match (&self.refusal, self.answered) {
            (Some(refusal), _) => format!("the hub at {address} refused: {refusal}"),
            (None, true) => format!("the hub at {address} is gone: {why}"),
            (None, false) if self.hub.is_unusable(cx) => {
                format!("the hub at {address} cannot be used: {why}")
            }
            (None, false) => format!("no hub answers at {address} ({why}): is skrobot running?"),
        };
        self.fail(cx, failure);
    }

    fn on_refused(&mut self, _cx: &mut Cx, why: &str) {
        self.refusal = Some(why.to_owned());
    }

    fn on_deadline(&mut self, cx: &mut Cx) {
        let failure = format!("the hub at {} does not answer", self.address);
        self.fail(cx, failure);
    }

    /// Ends the visit with this sentence, unless there is one already.
    pub fn fail(&mut self, cx: &mut Cx, failure: String) {
        self.failure.get_or_insert(failure);
        cx.quit();
    }
}

fn places(arguments: &Arguments) -> Result<Places, String> {
    Places::find(arguments.state_dir.as_deref()).map_err(|error| error.to_string())
}

fn address(arguments: &Arguments, places: &Places) -> HubAddress {
    arguments.hub.clone().unwrap_or_else(|| places.address())
}

/// How this program logs in: to the account that was named, or as the owner. A password may have to be typed.
pub fn credentials(arguments: &Arguments) -> Result<Credentials, String> {
    let world = World::real().map_err(|error| error.to_string())?;
    let places = places(arguments)?;
    if let Some(user) = &arguments.user {
        let name = user
            .parse()
            .map_err(|error: sk_flat::NameError| format!("--user {user}: {error}"))?;
        let password = match &arguments.password_file {
            Some(path) => password::from_file(&world, path)?,
            None => password::known(user)?,
        };
        return Ok(Credentials::Password(PasswordLogin::new(name, password)));
    }
    if matches!(address(arguments, &places), HubAddress::Unix(_)) {
        return Ok(Credentials::Peer);
    }
    match owner::read(&world, &places).map_err(|error| error.to_string())? {
        Some(token) => Ok(Credentials::Token(token)),
        None => Err(format!(
            "a hub that is not reached over a Unix socket asks for the owner's token, and there is none at {}: name the hub's state folder with --state-dir, copy the token there, or log in to an account with --user",
            places.token().display()
        )),
    }
}

/// The way to the hub, for whoever waits for answers.
#[derive(Clone, Copy)]
pub struct Link {
    /// The satellite.
    pub hub: Handle<SkFlowSat>,
    /// Its watcher.
    pub session: Handle<Session>,
}

impl Link {
    /// Ends the visit with this sentence. Not from within a slot of the session.
    pub fn fail(self, cx: &mut Cx, failure: impl Into<String>) {
        let failure = failure.into();
        // It lives as long as the program, and none of its slots calls this.
        let _ = cx.with(self.session, |session, cx| session.fail(cx, failure));
    }

    /// Ends the visit with a text or a failure.
    pub fn end(self, cx: &mut Cx, outcome: Result<String, String>) {
        match outcome.and_then(|text| print(cx, &text)) {
            Ok(()) => cx.quit(),
            Err(failure) => self.fail(cx, failure),
        }
    }
}

type Begin = Box<dyn FnOnce(&mut Cx, Link)>;

/// Waits for the hub to let us in.
struct Opening {
    link: Link,
    begin: Option<Begin>,
}

object! { Opening { slots { on_entered() } } }

impl Opening {
    fn on_entered(&mut self, cx: &mut Cx) {
        if let Some(begin) = self.begin.take() {
            begin(cx, self.link);
        }
    }
}

/// A program on its way to a hub.
pub struct Visit {
    /// The program.
    pub app: SkApp,
    /// The link.
    pub hub: Handle<SkFlowSat>,
    /// Its watcher.
    pub session: Handle<Session>,
}

impl Visit {
    /// Begins to connect.
    pub fn begin(arguments: &Arguments) -> Result<Visit, String> {
        Visit::begin_as(arguments, credentials(arguments)?)
    }

    /// The same with what [`credentials`] answered earlier: the hub waits for a login only so long.
    pub fn begin_as(arguments: &Arguments, credentials: Credentials) -> Result<Visit, String> {
        let world = World::real().map_err(|error| error.to_string())?;
        let address = address(arguments, &places(arguments)?);
        let trust = trust(&world, arguments, &address)?;
        let app = SkApp::builder()
            .name("sk")
            .mode(TimingMode::SelectIo)
            .interval(INTERVAL)
            .world(world);
        let mut app = app.build().map_err(|error| error.to_string())?;
        let cx = app.cx();
        let hub = match trust {
            Some(trust) => SkFlowSat::connect_secured(cx, &address, credentials, trust),
            None => SkFlowSat::connect_as(cx, &address, credentials),
        };
        // So that `sk graph` and `sk why` of others show it as what it is; another visit has another name.
        let mut number = [0; 4];
        cx.world().rng.fill(&mut number);
        let name = format!("sk-{:08x}", u32::from_le_bytes(number));
        hub.name_flow(cx, &name).map_err(|error| error.to_string())?;
        let session = cx.spawn_with(|cx, this: Handle<Session>| {
            let deadline = cx.under(this).spawn(Timer::default());
            attach!(cx, deadline.timeout => this.on_deadline);
            attach!(cx, hub.ready => this.on_ready);
            attach!(cx, hub.lost => this.on_lost);
            attach!(cx, hub.refused => this.on_refused);
            // The timer was made just now.
            let _ = deadline.start_once(cx, ANSWER_WITHIN);
            Session {
                address,
                hub,
                deadline,
                refusal: None,
                answered: false,
                failure: None,
                entered: Signal::new(),
            }
        });
        Ok(Visit { app, hub, session })
    }

    /// One visit: `begin` is called when the hub has let us in and has told of all its channels.
    pub fn once(arguments: &Arguments, begin: impl FnOnce(&mut Cx, Link) + 'static) -> Result<(), String> {
        let mut visit = Visit::begin(arguments)?;
        let link = visit.link();
        let cx = visit.app.cx();
        let opening = cx.spawn(Opening { link, begin: Some(Box::new(begin)) });
        // The session's slot is over by then, so that the visit can be ended.
        attach!(cx, link.session.entered => opening.on_entered, Queued);
        visit.run()
    }

    /// The way to the hub.
    pub fn link(&self) -> Link {
        Link { hub: self.hub, session: self.session }
    }

    /// Runs to the end of the visit.
    pub fn run(mut self) -> Result<(), String> {
        self.app.run();
        match self.app.cx().with(self.session, |session, _| session.failure.take()) {
            Ok(Some(failure)) => Err(failure),
            _ => Ok(()),
        }
    }
}

/// The longest file of certificates that is read.
const PEM_BYTES_MAX: u64 = 1024 * 1024;

/// What a hub at an address with TLS has to show.
fn trust(world: &World, arguments: &Arguments, address: &HubAddress) -> Result<Option<TlsTrust>, String> {
    if !matches!(address, HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. }) {
        return Ok(None);
    }
    let trust = match (&arguments.tls_ca, &arguments.tls_pin) {
        (Some(file), _) => {
            let told = |error: &dyn std::fmt::Display| format!("--tls-ca {}: {error}", file.display());
            let text = world.storage.read(file, PEM_BYTES_MAX).map_err(|error| told(&error))?;
            TlsTrust::authority_pem(&text).map_err(|error| told(&error))?
        }
        (None, Some(pin)) => TlsTrust::pinned(pin).map_err(|error| format!("--tls-pin: {error}"))?,
        (None, None) => {
            return Err(format!(
                "how is the hub at {address} known? Give the file of its authority with --tls-ca, or the fingerprint of its certificate, which the hub says when it starts, with --tls-pin"
            ));
        }
    };
    Ok(Some(trust))
}
