//! `skrobot`: the hub.
#![forbid(unsafe_code)]

use clap::Parser;
use sk_core::prelude::*;
use sk_core::world::OsSignal;
use sk_robot::hub::{ACCOUNT_DEFAULT, TCP_DEFAULT};
use sk_robot::{Hub, logging, registry};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The longest wait of the hub's loop; traffic wakes it earlier.
const INTERVAL: Duration = Duration::from_millis(10);
/// Rounds in which the modules' channels come to be before the hub says what there is.
const ROUNDS_BEFORE_GREETING: u32 = 8;

/// The hub: satellites join it, its modules sense this machine, data flows through it.
#[derive(Parser, Debug)]
#[command(version)]
struct Arguments {
    /// Where the hub keeps its files [default: $SKROBOT_STATE_DIR, else skrobot in the user's state folder]
    #[arg(long, value_name = "DIR")]
    state_dir: Option<PathBuf>,
    /// Where to listen for TCP: HOST:PORT with a numeric host, or `off`. Anything but loopback is reachable
    /// from the network, and the link is not encrypted
    #[arg(long, env = "SKROBOT_TCP", default_value = TCP_DEFAULT, value_name = "ADDRESS", value_parser = tcp)]
    tcp: Tcp,
    /// The account that owns the hub; its name begins its channels' names
    #[arg(long, default_value = ACCOUNT_DEFAULT, value_name = "NAME")]
    account: String,
    /// Leave a module out; can be given several times
    #[arg(long, value_name = "MODULE")]
    without: Vec<String>,
    /// What is logged to standard error: a level, or levels for parts such as info,sk_core::flow=debug
    #[arg(long, env = "SKROBOT_LOG", default_value = "info", value_name = "FILTER")]
    log: String,
}

#[derive(Clone, Copy, Debug)]
enum Tcp {
    Off,
    At(std::net::SocketAddr),
}

fn tcp(text: &str) -> Result<Tcp, String> {
    match text {
        "off" => Ok(Tcp::Off),
        at => at
            .parse()
            .map(Tcp::At)
            .map_err(|_| "write HOST:PORT with a numeric host, or off".to_owned()),
    }
}

/// Ends the hub in good order at the first signal. The second one ends the process.
struct Farewell {
    hub: Hub,
}

object! { Farewell { slots { on_signal(OsSignal) on_ended() } } }

impl Farewell {
    fn on_signal(&mut self, cx: &mut Cx, signal: OsSignal) -> std::io::Result<()> {
        tracing::info!(?signal, "ending; a second signal ends at once");
        if !self.hub.stop(cx) {
            cx.quit();
        }
        cx.world().net.release_os_signals()
    }

    fn on_ended(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}

/// Whoever started the hub may have closed its output: it runs on all the same.
fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    if let Err(error) = out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        tracing::warn!("standard output: {error}");
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("skrobot: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    logging::to_stderr(&arguments.log).map_err(|error| format!("--log {:?}: {error}", arguments.log))?;
    let mut app = SkApp::builder().name("hub").mode(TimingMode::SelectIo).interval(INTERVAL);
    app = app.configure(|settings| settings.slow_interval = Duration::from_millis(250));
    let mut app = app.build().map_err(|error| error.to_string())?;
    let cx = app.cx();

    let mut hub = registry::builtin(Hub::builder()).account(&arguments.account);
    for name in &arguments.without {
        if !hub.module_names().any(|known| known == name) {
            let known: Vec<_> = hub.module_names().collect();
            return Err(format!("--without {name}: there is no such module; there are {}", known.join(", ")));
        }
        hub = hub.without(name);
    }
    if let Some(state_dir) = &arguments.state_dir {
        hub = hub.state_dir(state_dir);
    }
    let hub = match arguments.tcp {
        Tcp::Off => hub.no_tcp(),
        Tcp::At(at) => hub.tcp(at),
    };
    let hub = hub.start(cx).map_err(|error| error.to_string())?;
    let server = hub.server;

    // The modules' channels are there after a few rounds: the greeting tells of them.
    let farewell_hub = cx.spawn_with(|cx, this: Handle<Farewell>| {
        attach!(cx, cx.event_loop().os_signal => this.on_signal);
        attach!(cx, server.ended => this.on_ended);
        let watch = cx.watch(server);
        attach!(cx, watch.buried => this.on_ended());
        Farewell { hub }
    });
    for _ in 0..ROUNDS_BEFORE_GREETING {
        app.pulse();
    }
    let greeting = greeting(app.cx(), farewell_hub).map_err(|error| error.to_string())?;
    say(&greeting);
    app.run();
    say("\nskrobot has ended\n");
    Ok(())
}

/// What it listens on, what is pulsing and what to type next.
fn greeting(cx: &mut Cx, farewell: Handle<Farewell>) -> Result<String, Access> {
    let (server, addresses, token, failures) = cx.with(farewell, |farewell, _| {
        let hub = &farewell.hub;
        (hub.server, hub.addresses().to_vec(), hub.places().token(), hub.failures().to_vec())
    })?;
    let mut text = format!("skrobot {} is pulsing\n", env!("CARGO_PKG_VERSION"));
    let channels = server.channels(cx)?;
    // Writing to a string cannot fail.
    for address in &addresses {
        let how = match address {
            sk_core::flow::HubAddress::Unix(_) => "programs of this user come in as they are".to_owned(),
            _ => format!("with the token in {}", token.display()),
        };
        let _ = writeln!(text, "  listens on  {address}  ({how})");
    }
    let names: Vec<&str> = channels.iter().map(|(name, _)| name.as_str()).collect();
    let _ = writeln!(
        text,
        "  channels    {}",
        if names.is_empty() { "none yet".into() } else { names.join("  ") }
    );
    for (module, why) in &failures {
        let _ = writeln!(text, "  left out    module {module}: {why}");
    }
    let sk = tool();
    let first = names
        .iter()
        .find(|name| name.ends_with(".cpu"))
        .or(names.first())
        .copied()
        .unwrap_or("CHANNEL");
    let _ = writeln!(text, "  try         {sk} ls\n              {sk} echo {first}\n  stop        Ctrl-C");
    Ok(text)
}

/// How the tool is called from here: beside this program if it was built, else through cargo.
fn tool() -> String {
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.join("sk")));
    let Some(beside) = beside.filter(|path| path.exists()) else {
        return "cargo run --release --bin sk --".to_owned();
    };
    let on_path = std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join("sk") == beside));
    let here = std::env::current_dir().unwrap_or_default();
    let shown: &Path = beside.strip_prefix(&here).unwrap_or(&beside);
    if on_path { "sk".to_owned() } else { shown.display().to_string() }
}
