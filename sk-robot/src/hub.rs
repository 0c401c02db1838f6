//! A hub: a server, its addresses, and its modules.

use crate::owner::{self, TokenFileError};
use crate::places::{Places, PlacesError};
use sk_core::flow::database::disk::{Store, StoreError};
use sk_core::flow::server::Settings;
use sk_core::flow::{Flow, HubAddress, Rights, SkFlowSat, SkFlowServer};
use sk_core::module::{AbstractModule, AnyRunner, Modules, RestartPolicy, Runner};
use sk_core::object::NameError;
use sk_core::prelude::*;
use sk_flat::Name;
use std::io::{self, ErrorKind};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// The account that owns the hub unless told otherwise; its name begins its channels' names.
pub const ACCOUNT_DEFAULT: &str = "robot";
/// Where the hub listens for TCP unless told otherwise.
pub const TCP_DEFAULT: &str = "127.0.0.1:4141";

/// A hub that runs on a loop. Dropping this value does not stop it: [`stop`](Hub::stop) does, or the end of
/// the loop.
pub struct Hub {
    /// The server.
    pub server: Handle<SkFlowServer>,
    /// The modules.
    pub modules: Handle<Modules>,
    satellites: Vec<Handle<SkFlowSat>>,
    addresses: Vec<HubAddress>,
    places: Places,
    failures: Vec<(String, String)>,
}

/// What a hub is made of.
///
/// ```
/// use sk_core::prelude::*;
/// use sk_robot::Hub;
///
/// let folder = std::env::temp_dir().join(format!("skrobot-doc-{}", std::process::id()));
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let hub = Hub::builder().state_dir(&folder).no_tcp().start(app.cx())?;
/// assert_eq!(hub.addresses().len(), 1, "a Unix socket for programs of the same user");
/// hub.stop(app.cx());
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct HubBuilder {
    account: String,
    state_dir: Option<PathBuf>,
    tcp: Option<SocketAddr>,
    unix: bool,
    modules: Vec<Entry>,
}

/// A module that is to be added.
struct Entry {
    name: &'static str,
    runner: fn(Flow) -> Box<dyn AnyRunner>,
}

/// Why a hub could not be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HubError {
    /// No place for its files.
    #[error(transparent)]
    Places(#[from] PlacesError),
    /// No owner's token.
    #[error(transparent)]
    Token(#[from] TokenFileError),
    /// Its databases cannot be opened.
    #[error(transparent)]
    Databases(#[from] StoreError),
    /// It cannot listen.
    #[error("{address} is in use: another hub runs there; give this one another {option}")]
    Taken {
        /// Where.
        address: HubAddress,
        /// Which option chooses another.
        option: &'static str,
    },
    /// It cannot listen.
    #[error("cannot listen at {address}: {error}")]
    Listen {
        /// Where.
        address: HubAddress,
        /// What the system said.
        #[source]
        error: io::Error,
    },
    /// The account's name cannot be.
    #[error("the account {0:?} cannot be: {1}")]
    Account(String, #[source] sk_flat::NameError),
    /// A module's name cannot be or is given twice.
    #[error("module {0}: {1}")]
    Module(&'static str, #[source] NameError),
    /// A link inside the process could not be made.
    #[error("a module cannot be linked to the hub: {0}")]
    Link(#[source] io::Error),
}

impl HubBuilder {
    /// The account that owns the hub: its name begins its channels' names. Letters, digits, `_` and `-`.
    pub fn account(mut self, account: &str) -> Self {
        self.account = account.to_owned();
        self
    }

    /// The folder of the hub's files.
    pub fn state_dir(mut self, state_dir: &Path) -> Self {
        self.state_dir = Some(state_dir.to_owned());
        self
    }

    /// Where to listen for TCP; port 0 takes any free one. The default is loopback only.
    pub fn tcp(mut self, at: SocketAddr) -> Self {
        self.tcp = Some(at);
        self
    }

    /// Does not listen for TCP.
    pub fn no_tcp(mut self) -> Self {
        self.tcp = None;
        self
    }

    /// Does not listen on a Unix socket.
    pub fn no_unix(mut self) -> Self {
        self.unix = false;
        self
    }

    /// Adds a module of one's own, with its default parameters. It lives on the hub's loop.
    pub fn module<M: AbstractModule>(mut self) -> Self {
        let runner = |flow| Runner::<M>::new(flow, M::Parameters::default()).into();
        self.modules.push(Entry { name: M::NAME, runner });
        self
    }

    /// Leaves a module out that was added before.
    pub fn without(mut self, name: &str) -> Self {
        self.modules.retain(|module| module.name != name);
        self
    }

    /// The names of the modules that will be added.
    pub fn module_names(&self) -> impl Iterator<Item = &'static str> {
        self.modules.iter().map(|module| module.name)
    }

    /// Starts the hub on this loop: makes the owner's token at first start, listens, and starts the modules.
    /// Reads and writes files: before the loop runs. A module that does not start is left out and told by
    /// [`Hub::failures`].
    ///
    /// # Errors
    /// If the hub has no place for its files, cannot listen, or a module's name is given twice.
    pub fn start(self, cx: &mut Cx) -> Result<Hub, HubError> {
        let refused = |error| HubError::Account(self.account.clone(), error);
        let account: Name = self.account.parse().map_err(refused)?;
        // The account stands before the first dot of its channels' names, so it cannot have one.
        Name::compose(&account, &account).map_err(refused)?;
        let places = Places::find(self.state_dir.as_deref())?;
        let token = owner::read_or_make(cx.world(), &places)?;
        // Programs of the user whose files these are may come in without a token.
        let owner_uid = cx.world().storage.owner_and_mode(places.state()).ok().map(|(owner, _)| owner);
        let server = SkFlowServer::start(cx, Settings { user: account, token: Some(token), owner_uid });
        let unix = self.unix.then(|| (places.address(), "--state-dir"));
        let tcp = self.tcp.map(|at| (HubAddress::Tcp(at), "--tcp"));
        let mut addresses = Vec::new();
        for (address, option) in [unix, tcp].into_iter().flatten() {
            match server.listen(cx, &address) {
                Ok(local) => addresses.push(local),
                Err(error) => {
                    cx.destroy_later(server);
                    return Err(match error.kind() {
                        ErrorKind::AddrInUse => HubError::Taken { address, option },
                        _ => HubError::Listen { address, error },
                    });
                }
            }
        }
        // Whoever has the addresses has the files, so that two hubs never write to one store.
        if let Err(error) = keep_databases(cx, server, &places) {
            cx.destroy_later(server);
            return Err(error);
        }
        let modules = Modules::spawn(cx);
        let mut satellites = Vec::new();
        for module in &self.modules {
            let pipe = server.pipe(cx, Rights::ALL).map_err(HubError::Link)?;
            let satellite = SkFlowSat::inside(cx, pipe);
            satellites.push(satellite);
            let flow = satellite.flow(module.name);
            modules
                .add(cx, (module.runner)(flow), RestartPolicy::default())
                .map_err(|error| HubError::Module(module.name, error))?;
        }
        let failed = modules.start(cx);
        let failures = failed
            .into_iter()
            .map(|(at, why)| (cx.name_of(at).unwrap_or("?").to_owned(), why))
            .collect();
        Ok(Hub { server, modules, satellites, addresses, places, failures })
    }
}

/// Opens the databases of this hub. Damaged ones are set aside and told of in the log.
fn keep_databases(cx: &mut Cx, server: Handle<SkFlowServer>, places: &Places) -> Result<(), HubError> {
    let opened = Store::open(cx.world().storage.clone(), places.databases())?;
    if let Some(damage) = &opened.damage {
        tracing::error!("{damage}");
    }
    server
        .keep_databases(cx, opened.store, opened.saved)
        .map_err(|error| HubError::Link(io::Error::other(error)))
}

impl Hub {
    /// A hub without modules; the default account, loopback TCP and a Unix socket.
    pub fn builder() -> HubBuilder {
        HubBuilder {
            account: ACCOUNT_DEFAULT.to_owned(),
            state_dir: None,
            tcp: TCP_DEFAULT.parse().ok(),
            unix: true,
            modules: Vec::new(),
        }
    }

    /// Where it listens.
    pub fn addresses(&self) -> &[HubAddress] {
        &self.addresses
    }

    /// Its files.
    pub fn places(&self) -> &Places {
        &self.places
    }

    /// The modules that did not start, with the reason.
    pub fn failures(&self) -> &[(String, String)] {
        &self.failures
    }

    /// Begins to stop it: modules in reverse order, then their links, whose last words go out, then the server,
    /// which tells everybody. The loop must go on pulsing until the server emits
    /// [`ended`](SkFlowServer::ended); that takes some rounds, and two and a half seconds at most. Answers `false`
    /// if the server is gone already, so that nothing will be emitted.
    pub fn stop(&self, cx: &mut Cx) -> bool {
        self.modules.stop(cx);
        cx.destroy_later(self.modules);
        for satellite in &self.satellites {
            cx.destroy_later(*satellite);
        }
        let ending = self.server.shut_down(cx).is_ok();
        if !ending {
            // It has died before, or this is one of its own slots: the end of the loop does the rest.
            cx.destroy_later(self.server);
        }
        ending
    }
}
