//! What can be typed, and the configuration that follows from it, the environment and the file.

use clap::Parser;
use sk_core::flow::HubAddress;
use sk_core::module::ModuleClass;
use sk_core::world::Storage;
use sk_flat::Name;
use sk_robot::config::{Config, ListenAddress, TcpAddress};
use sk_robot::{places, supervise};
use std::path::PathBuf;
use std::process::Command;

/// The hub: satellites join it, its modules sense this machine, data flows through it.
///
/// What is typed here goes before the environment, that before the configuration, and that before the defaults.
#[derive(Parser, Clone, Debug)]
#[command(version)]
pub struct Arguments {
    /// The configuration, a JSON file [default: $SKROBOT_CONFIG, else skrobot/skrobot.json in the user's configuration
    /// folder, if it is there]. SIGHUP reads it again
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Print the whole configuration, with the defaults of what was not said, and end
    #[arg(long)]
    pub print_config: bool,
    /// Where the hub keeps its files [default: $SKROBOT_STATE_DIR, else skrobot in the user's state folder]
    #[arg(long, value_name = "DIR")]
    pub state_dir: Option<PathBuf>,
    /// Where to listen for TCP: HOST:PORT with a numeric host, several with commas, or `off` [default:
    /// 127.0.0.1:4141]. Anything but loopback is reachable from the network, and the link is not encrypted
    #[arg(long, env = "SKROBOT_TCP", value_name = "ADDRESS", value_parser = tcp)]
    pub tcp: Option<Tcp>,
    /// One more address to listen at, of any kind: ws:HOST:PORT/flow, tls:HOST:PORT, wss:HOST:PORT/flow,
    /// tty:DEVICE?baud=115200, tcp:HOST:PORT, unix:PATH, udp:HOST:PORT for
    /// publishing by datagrams; can be given several times
    #[arg(long, value_name = "ADDRESS")]
    pub listen: Vec<HubAddress>,
    /// The PEM files of the certificate that is shown at tls: and wss: addresses, and of its key
    #[arg(long, num_args = 2, value_names = ["CERTIFICATE", "KEY"])]
    pub tls: Vec<PathBuf>,
    /// The account that owns the hub; its name begins its channels' names [default: robot]
    #[arg(long, env = "SKROBOT_ACCOUNT", value_name = "NAME")]
    pub account: Option<String>,
    /// Leave a module out; can be given several times
    #[arg(long, value_name = "MODULE")]
    pub without: Vec<String>,
    /// What is logged to standard error: a level, or levels for parts such as info,sk_core::flow=debug [default: info]
    #[arg(long, env = "SKROBOT_LOG", value_name = "FILTER")]
    pub log: Option<String>,
    /// Start the hub in a child process, and again whenever it crashes
    #[arg(long)]
    pub supervise: bool,
}

/// Where to listen for TCP; nowhere if there is none.
#[derive(Clone, Debug)]
pub struct Tcp(Vec<TcpAddress>);

fn tcp(text: &str) -> Result<Tcp, String> {
    match text {
        "off" => Ok(Tcp(Vec::new())),
        all => all.split(',').map(str::parse).collect::<Result<_, _>>().map(Tcp),
    }
}

/// The command line of the hub below its supervisor: the same without that option.
pub fn child(restarts: u64) -> Command {
    let program = std::env::current_exe().unwrap_or_else(|_| "skrobot".into());
    let mut command = Command::new(program);
    command.args(std::env::args_os().skip(1).filter(|argument| argument != "--supervise"));
    command.env(supervise::SUPERVISOR_VARIABLE, std::process::id().to_string());
    command.env(supervise::RESTARTS_VARIABLE, restarts.to_string());
    // The signs of life that were asked of this process are the hub's.
    command.env_remove("WATCHDOG_PID");
    command
}

impl Arguments {
    /// The configuration that follows from the file, the environment and what was typed. Blocks on the disk.
    pub fn config(&self, storage: &dyn Storage, classes: &[ModuleClass]) -> Result<Config, String> {
        let mut config = match self.file(storage) {
            Some(file) => Config::read_file(storage, &file, classes).map_err(|error| error.to_string())?,
            None => Config::new(classes),
        };
        if let Some(state_dir) = &self.state_dir {
            config.hub.state_dir = Some(state_dir.display().to_string());
        } else if std::env::var_os("SKROBOT_STATE_DIR").is_some() {
            config.hub.state_dir = None;
        }
        if let Some(tcp) = &self.tcp {
            config.listen.tcp.clone_from(&tcp.0);
        }
        if !self.listen.is_empty() {
            config.listen.addresses = self.listen.iter().cloned().map(ListenAddress).collect();
        }
        if let [certificate, key] = self.tls.as_slice() {
            config.listen.tls_certificate = Some(certificate.display().to_string());
            config.listen.tls_key = Some(key.display().to_string());
        }
        if let Some(account) = &self.account {
            let name = account.parse::<Name>().and_then(|name| Name::compose(&name, &name));
            name.map_err(|error| format!("--account {account:?}: {error}"))?;
            config.hub.account.clone_from(account);
        }
        if let Some(log) = &self.log {
            config.hub.log.clone_from(log);
        }
        for name in &self.without {
            match config.modules.get_mut(name) {
                Some(module) => module.enabled = false,
                None => {
                    let hint = sk_robot::config::hint(name, config.modules.keys().map(String::as_str));
                    return Err(format!("--without {name}: there is no such module; {hint}"));
                }
            }
        }
        Ok(config)
    }

    /// The file to read: one that was named must be there.
    fn file(&self, storage: &dyn Storage) -> Option<PathBuf> {
        if let Some(file) = &self.config {
            return Some(file.clone());
        }
        let (file, must_exist) = places::config_file()?;
        let folder = file.parent()?;
        let is_there = || {
            let names = storage.list(folder).unwrap_or_default();
            names.iter().any(|name| name.file_name() == file.file_name())
        };
        (must_exist || is_there()).then_some(file)
    }
}
