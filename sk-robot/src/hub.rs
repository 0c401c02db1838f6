//! A hub: a server, its addresses, and its modules.

use crate::config::{Config, ListenAddress, ModuleConfig, TcpAddress};
use crate::listening;
use crate::module_service;
use crate::owner;
use crate::places::Places;
use sk_core::flow::blob::BlobStore;
use sk_core::flow::database::disk::Store;
use sk_core::flow::server::Settings;
use sk_core::flow::{HubAddress, Rights, SkFlowSat, SkFlowServer};
use sk_core::module::{AbstractModule, ModuleClass, ModuleSupervisor, Modules, ThreadedModule};
use sk_core::prelude::*;
use sk_flat::Name;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

pub use crate::config::TCP_DEFAULT;
pub use crate::hub_error::HubError;

/// A hub that runs on a loop. Dropping this value does not stop it: [`stop`](Hub::stop) does, or the end of
/// the loop.
pub struct Hub {
    /// The server.
    pub server: Handle<SkFlowServer>,
    /// The modules.
    pub modules: Handle<Modules>,
    pub(crate) config: Config,
    ender: Handle<Ender>,
    addresses: Vec<HubAddress>,
    fingerprint: Option<String>,
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
    config: Config,
    /// As it was given: a path need not be text.
    state_dir: Option<PathBuf>,
    classes: Vec<ModuleClass>,
}

impl HubBuilder {
    /// The account that owns the hub: its name begins its channels' names. Letters, digits, `_` and `-`.
    pub fn account(mut self, account: &str) -> Self {
        self.config.hub.account = account.to_owned();
        self
    }

    /// The folder of the hub's files.
    pub fn state_dir(mut self, state_dir: &Path) -> Self {
        self.state_dir = Some(state_dir.to_owned());
        self
    }

    /// Where to listen for TCP, and nowhere else; port 0 takes any free one. The default is loopback only.
    pub fn tcp(mut self, at: SocketAddr) -> Self {
        self.config.listen.tcp = vec![TcpAddress(at)];
        self
    }

    /// Does not listen for TCP.
    pub fn no_tcp(mut self) -> Self {
        self.config.listen.tcp.clear();
        self
    }

    /// Listens at one more address, of any kind; `tls:` and `wss:` need [`tls`](HubBuilder::tls).
    pub fn listen(mut self, at: HubAddress) -> Self {
        self.config.listen.addresses.push(ListenAddress(at));
        self
    }

    /// What those are shown who come by TLS: the PEM files of the certificate, with those that lead to the authority,
    /// and of its key.
    pub fn tls(mut self, certificate: &Path, key: &Path) -> Self {
        self.config.listen.tls_certificate = Some(certificate.display().to_string());
        self.config.listen.tls_key = Some(key.display().to_string());
        self
    }

    /// Does not listen on a Unix socket.
    pub fn no_unix(mut self) -> Self {
        self.config.listen.unix = false;
        self
    }

    /// Adds a module of one's own, with its default parameters, on the hub's loop. [`configure`] and
    /// [`change_module`] say otherwise.
    ///
    /// [`configure`]: HubBuilder::configure
    /// [`change_module`]: HubBuilder::change_module
    pub fn module<M: AbstractModule>(mut self) -> Self {
        let class = ModuleClass::of::<M>();
        self.config
            .modules
            .entry(class.name().to_owned())
            .or_insert_with(|| ModuleConfig::new(&class));
        self.classes.push(class);
        self
    }

    /// Leaves a module out that was added before.
    pub fn without(mut self, name: &str) -> Self {
        self.classes.retain(|class| class.name() != name);
        self.config.modules.remove(name);
        self
    }

    /// Changes what is configured of a module that was added before: its parameters, its thread, its restarts.
    ///
    /// ```
    /// use sk_robot::config::{LoopMode, ThreadSection};
    /// use sk_robot::{Hub, registry};
    ///
    /// let hub = registry::builtin(Hub::builder()).change_module("host", |host| {
    ///     host.thread = Some(ThreadSection { mode: LoopMode::Coarse, interval_us: 50_000 });
    /// });
    /// # let _ = hub;
    /// ```
    pub fn change_module(mut self, name: &str, change: impl FnOnce(&mut ModuleConfig)) -> Self {
        if let Some(module) = self.config.modules.get_mut(name) {
            change(module);
        }
        self
    }

    /// Takes a whole configuration over; of modules that were not added it takes nothing. A state folder that was
    /// given by [`state_dir`](HubBuilder::state_dir) stays.
    pub fn configure(mut self, config: &Config) -> Self {
        let mut modules = std::mem::take(&mut self.config.modules);
        for (name, module) in &mut modules {
            if let Some(configured) = config.modules.get(name) {
                module.clone_from(configured);
            }
        }
        self.config = Config { modules, ..config.clone() };
        self
    }

    /// The whole configuration, as it is so far.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The names of the modules that will be added.
    pub fn module_names(&self) -> impl Iterator<Item = &'static str> {
        self.classes.iter().map(ModuleClass::name)
    }

    /// The classes of the modules that will be added: what a configuration is read for.
    pub fn classes(&self) -> Vec<ModuleClass> {
        self.classes.clone()
    }

    /// Starts the hub on this loop: makes the owner's token at first start, listens, and starts the modules.
    /// Reads and writes files: before the loop runs. A module that does not start is left out and told by
    /// [`Hub::failures`].
    ///
    /// # Errors
    /// If the hub has no place for its files, cannot listen, or a module's name is given twice.
    pub fn start(self, cx: &mut Cx) -> Result<Hub, HubError> {
        let HubBuilder { config, state_dir, classes } = self;
        let refused = |error| HubError::Account(config.hub.account.clone(), error);
        let account: Name = config.hub.account.parse().map_err(refused)?;
        // The account stands before the first dot of its channels' names, so it cannot have one.
        Name::compose(&account, &account).map_err(refused)?;
        let configured = config.hub.state_dir.as_deref().map(Path::new);
        let places = Places::find(state_dir.as_deref().or(configured))?;
        let token = owner::read_or_make(cx.world(), &places)?;
        // Programs of the user whose files these are may come in without a token.
        let owner_uid = cx.world().storage.owner_and_mode(places.state()).ok().map(|(owner, _)| owner);
        let server = SkFlowServer::start(cx, Settings { user: account, token: Some(token), owner_uid });
        // It was made just now.
        let _ = server.require_channel_binding(cx, config.listen.require_channel_binding);
        let (addresses, fingerprint) = match listening::listen(cx, server, &config, &places) {
            Ok(listening) => listening,
            Err(error) => {
                cx.destroy_later(server);
                return Err(error);
            }
        };
        // Whoever has the addresses has the files, so that two hubs never write to one store.
        let kept = keep_databases(cx, server, &places).and_then(|()| keep_blobs(cx, server, &places));
        if let Err(error) = kept {
            cx.destroy_later(server);
            return Err(error);
        }
        let modules = Modules::spawn(cx);
        module_service::offer(cx, server, modules, &config.hub.account).map_err(HubError::Link)?;
        let ender = cx.spawn_with(|cx, this: Handle<Ender>| {
            attach!(cx, modules.stopped => this.on_stopped);
            Ender { server, modules, satellites: Vec::new() }
        });
        for class in &classes {
            if let Some(module) = config.modules.get(class.name()) {
                let satellite = add(cx, server, modules, *class, module)?;
                // It was made just now.
                let _ = cx.with(ender, |ender, _| ender.satellites.extend(satellite));
            }
        }
        let failed = modules.start(cx);
        let failures = failed
            .into_iter()
            .map(|(at, why)| (cx.name_of(at).unwrap_or("?").to_owned(), why))
            .collect();
        Ok(Hub { server, modules, config, ender, addresses, fingerprint, places, failures })
    }
}

/// Adds one module, on this loop or on a thread. On this loop it has a satellite, which is answered.
fn add(
    cx: &mut Cx,
    server: Handle<SkFlowServer>,
    modules: Handle<Modules>,
    class: ModuleClass,
    config: &ModuleConfig,
) -> Result<Option<Handle<SkFlowSat>>, HubError> {
    let name = class.name();
    let refused = |error| HubError::Module(name, error);
    let policy = config.restart.policy();
    if let Some(thread) = &config.thread {
        let link = move |cx: &mut Cx| server.pipe(cx, Rights::ALL);
        let module = ThreadedModule::new(class, thread.place(), link)
            .configured(&config.parameters)
            .map_err(|error| HubError::Parameters(name, error.into()))?;
        let added = match config.enabled {
            true => modules.add_on_thread(cx, module, policy),
            false => modules.add_on_thread_stopped(cx, module, policy),
        };
        added.map_err(refused)?;
        return Ok(None);
    }
    let pipe = server.pipe(cx, Rights::ALL).map_err(HubError::Link)?;
    let satellite = SkFlowSat::of_module(cx, pipe, name);
    let runner = class
        .runner(name, satellite.flow(name), &config.parameters)
        .map_err(|error| HubError::Parameters(name, error))?;
    let added = match config.enabled {
        true => modules.add(cx, runner, policy),
        false => modules.add_stopped(cx, runner, policy),
    };
    added.map_err(refused)?;
    Ok(Some(satellite))
}

/// What is left to do when the modules have stopped.
struct Ender {
    server: Handle<SkFlowServer>,
    modules: Handle<Modules>,
    satellites: Vec<Handle<SkFlowSat>>,
}

object! { Ender { slots { on_stopped() } } }

impl Ender {
    /// The links of the modules go, with their last words, and then the server.
    fn on_stopped(&mut self, cx: &mut Cx) {
        cx.destroy_later(self.modules);
        for satellite in self.satellites.drain(..) {
            cx.destroy_later(satellite);
        }
        if self.server.shut_down(cx).is_err() {
            // It is gone: its burial is what the program waits for.
            cx.destroy_later(self.server);
        }
    }
}

/// Opens the databases of this hub. Damaged ones are set aside and told of in the log.
fn keep_databases(cx: &mut Cx, server: Handle<SkFlowServer>, places: &Places) -> Result<(), HubError> {
    let opened = Store::open(cx.world().storage.clone(), places.databases())?;
    if let Some(damage) = &opened.damage {
        tracing::error!("{damage}");
    }
    server.keep_databases(cx, opened.store, opened.saved)?;
    Ok(())
}

/// Opens the folder of this hub's blob channels.
fn keep_blobs(cx: &mut Cx, server: Handle<SkFlowServer>, places: &Places) -> Result<(), HubError> {
    let folder = places.blobs();
    let store = BlobStore::open(cx.world().storage.clone(), folder.clone())
        .map_err(|error| HubError::Blobs { folder: folder.display().to_string(), error })?;
    server
        .keep_blobs(cx, store)
        .map_err(|error| HubError::Link(io::Error::other(error)))
}

impl Hub {
    /// A hub without modules; the default account, loopback TCP and a Unix socket.
    pub fn builder() -> HubBuilder {
        HubBuilder { config: Config::new(&[]), state_dir: None, classes: Vec::new() }
    }

    /// What it was started with, and what was changed since.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Where it listens.
    pub fn addresses(&self) -> &[HubAddress] {
        &self.addresses
    }

    /// The SHA-256 of the certificate that is shown at `tls:` and `wss:` addresses, for satellites that pin it.
    pub fn fingerprint(&self) -> Option<&str> {
        self.fingerprint.as_deref()
    }

    /// Its files.
    pub fn places(&self) -> &Places {
        &self.places
    }

    /// The modules that did not start, with the reason. Those on threads start later and tell by their state.
    pub fn failures(&self) -> &[(String, String)] {
        &self.failures
    }

    /// A module, to be asked, told, stopped and started.
    pub fn module(&self, cx: &mut Cx, name: &str) -> Option<Handle<ModuleSupervisor>> {
        self.modules.find(cx, name)
    }

    /// Begins to stop it: modules in reverse order, each when its successor has stopped; then their links, whose
    /// last words go out; then the server, which tells everybody. The loop must go on pulsing until the server
    /// emits [`ended`](SkFlowServer::ended). A module on a thread that does not end in time is left behind; else
    /// it takes some rounds, and two and a half seconds at most. Answers `false` if the server is gone already,
    /// so that nothing will be emitted.
    pub fn stop(&self, cx: &mut Cx) -> bool {
        if cx.is_alive(self.modules) {
            self.modules.stop(cx);
        } else {
            // Somebody destroyed them, so they have stopped.
            let _ = cx.with(self.ender, |ender, cx| ender.on_stopped(cx));
        }
        cx.is_alive(self.server)
    }
}
