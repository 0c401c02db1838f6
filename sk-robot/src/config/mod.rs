//! The hub's configuration: one JSON file, in which everything has a default.
//!
//! Every section is declared with [`parameters!`](sk_core::parameters), as modules declare theirs, so that type,
//! range, unit, default and meaning stand once: the check of a file, the JSON Schema and what `--print-config`
//! shows come from the declarations.

mod place;
mod problem;
mod read;
mod schema;
mod values;

pub use crate::hint::hint;
pub use problem::{ConfigError, Problem};
pub use read::FILE_BYTES_MAX;
pub use schema::schema;
pub use values::{ListenAddress, LoopMode, TCP_DEFAULT, TcpAddress};

use sk_core::module::{ModuleClass, Parameters, RestartPolicy, ThreadPlace};
use sk_core::parameters;
use sk_core::prelude::*;
use std::collections::BTreeMap;

parameters! {
    /// What concerns the hub as a whole; these stand at the top of the file.
    pub struct HubSection {
        /// The account that owns the hub; its name begins its channels' names.
        account: String = "robot";
        /// Where the hub keeps its files; null is skrobot in the user's state folder.
        state_dir: Option<String> = None;
        /// What is logged to standard error: a level, or levels for parts such as info,sk_core::flow=debug.
        log: String = "info";
    }
}

parameters! {
    /// Where the hub listens.
    pub struct ListenSection {
        /// TCP, as HOST:PORT with a numeric host. Anything but loopback is reachable from the network, and the link is not encrypted.
        tcp: Vec<TcpAddress> = vec![TcpAddress(TCP_DEFAULT)];
        /// The Unix socket hub.sock in the state folder, for programs of the same user.
        unix: bool = true;
        /// Further addresses of any kind: tcp:HOST:PORT, ws:HOST:PORT/flow, tls:HOST:PORT, wss:HOST:PORT/flow, tty:DEVICE?baud=115200, unix:PATH, udp:HOST:PORT for publishing by datagrams.
        addresses: Vec<ListenAddress> = Vec::new();
        /// The PEM file of the certificate that is shown at tls: and wss: addresses, followed by those that lead to the authority.
        tls_certificate: Option<String> = None;
        /// The PEM file of the certificate's key.
        tls_key: Option<String> = None;
        /// Whether a login at tls: and wss: addresses must be bound to its connection. Satellites in Python cannot bind theirs.
        require_channel_binding: bool = false;
    }
}

parameters! {
    /// How the hub's own loop keeps time.
    pub struct LoopSection {
        /// How the loop waits; select-io is woken by traffic.
        mode: LoopMode = LoopMode::SelectIo;
        /// The interval of the fast tick, and the longest wait.
        interval_us: u64 = 10_000, 50..=10_000_000, "us";
        /// The interval of the slow tick; not below that of the fast one.
        slow_interval_us: u64 = 250_000, 50..=60_000_000, "us";
    }
}

parameters! {
    /// Whether a module runs.
    pub struct ModuleSection {
        /// Whether the module is started.
        enabled: bool = true;
    }
}

parameters! {
    /// How a module's own thread keeps time.
    pub struct ThreadSection {
        /// How the loop of the thread waits.
        mode: LoopMode = LoopMode::Coarse;
        /// The interval of the fast tick of the thread.
        interval_us: u64 = 10_000, 50..=10_000_000, "us";
    }
}

parameters! {
    /// How soon and how often a module that failed is begun again.
    pub struct RestartSection {
        /// The wait before the first try.
        first_ms: u64 = 500, 0..=3_600_000, "ms";
        /// By how much each further wait is longer.
        factor: u32 = 2, 1..=100;
        /// The longest wait; a module that ran so long begins counting anew.
        max_ms: u64 = 60_000, 0..=86_400_000, "ms";
        /// How many tries in a row are made; 0 is never.
        tries: u32 = 10;
    }
}

/// What is configured of one module.
#[derive(Clone, Debug, PartialEq)]
pub struct ModuleConfig {
    /// Whether it is started.
    pub enabled: bool,
    /// How its own thread keeps time; none if it lives on the loop of the hub.
    pub thread: Option<ThreadSection>,
    /// What follows a failure.
    pub restart: RestartSection,
    /// All its parameters, as a map.
    pub parameters: SkVariant,
}

/// The whole configuration: what the file says, and the default of everything it does not.
///
/// ```
/// use sk_robot::{Hub, config::Config, registry};
///
/// let classes = registry::builtin(Hub::builder()).classes();
/// let config = Config::read(r#"{"modules": {"host": {"parameters": {"period_factor": 2}}}}"#, &classes)?;
/// assert_eq!(config.hub.account, "robot");
///
/// let refused = Config::read("{\n  \"modules\": {\"hots\": {}}\n}", &classes).unwrap_err();
/// assert_eq!(refused.problems()[0].to_string(), "2:15: no module `hots`; did you mean `host`?");
/// # Ok::<(), sk_robot::config::ConfigError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// What concerns the hub as a whole.
    pub hub: HubSection,
    /// Where it listens.
    pub listen: ListenSection,
    /// How its loop keeps time.
    pub event_loop: LoopSection,
    /// Every module the hub was built with, by name.
    pub modules: BTreeMap<String, ModuleConfig>,
}

impl ModuleConfig {
    /// The defaults for a class of modules.
    pub fn new(class: &ModuleClass) -> ModuleConfig {
        ModuleConfig {
            enabled: ModuleSection::default().enabled,
            thread: None,
            restart: RestartSection::default(),
            // An empty map names nothing that could be refused.
            parameters: class.complete(&SkVariant::map::<&str>([])).unwrap_or_default(),
        }
    }

    fn to_variant(&self) -> SkVariant {
        SkVariant::map([
            ("enabled", self.enabled.into()),
            ("thread", self.thread.as_ref().map_or(SkVariant::Null, Parameters::to_variant)),
            ("restart", self.restart.to_variant()),
            ("parameters", self.parameters.clone()),
        ])
    }
}

impl RestartSection {
    /// The same, as modules know it.
    pub fn policy(&self) -> RestartPolicy {
        RestartPolicy {
            first: Duration::from_millis(self.first_ms),
            factor: self.factor,
            max: Duration::from_millis(self.max_ms),
            tries: self.tries,
        }
    }
}

impl ThreadSection {
    /// The same, as threads know it.
    pub fn place(&self) -> ThreadPlace {
        ThreadPlace { mode: self.mode.timing(), interval: Duration::from_micros(self.interval_us) }
    }
}

impl LoopSection {
    /// Takes these settings over.
    pub fn apply(&self, settings: &mut LoopSettings) {
        settings.mode = self.mode.timing();
        settings.interval = Duration::from_micros(self.interval_us);
        settings.slow_interval = Duration::from_micros(self.slow_interval_us);
    }
}

impl Config {
    /// The defaults of everything, for a hub with these modules.
    pub fn new(classes: &[ModuleClass]) -> Config {
        let module = |class: &ModuleClass| (class.name().to_owned(), ModuleConfig::new(class));
        Config {
            hub: HubSection::default(),
            listen: ListenSection::default(),
            event_loop: LoopSection::default(),
            modules: classes.iter().map(module).collect(),
        }
    }

    /// The whole as a map, in the shape of the file.
    pub fn to_variant(&self) -> SkVariant {
        let mut whole = self.hub.to_variant();
        let modules = self.modules.iter().map(|(name, module)| (name.as_str(), module.to_variant()));
        let sections = [
            ("listen", self.listen.to_variant()),
            ("loop", self.event_loop.to_variant()),
            ("modules", SkVariant::map(modules)),
        ];
        if let Some(whole) = whole.as_map_mut() {
            whole.extend(sections.map(|(name, section)| (name.to_owned(), section)));
        }
        whole
    }
}
