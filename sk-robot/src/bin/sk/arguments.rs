//! What can be typed.

use crate::call::Call;
use crate::database::Database;
use crate::echo::Echo;
use crate::graph::Graph;
use crate::hz::Hz;
use crate::info::Info;
use crate::ls::Ls;
use crate::module::Module;
use crate::publish::Publish;
use crate::why::Why;
use clap::{Args, Parser, Subcommand};
use sk_core::flow::HubAddress;
use sk_flat::SkVariant;
use std::path::PathBuf;

/// Look into a running hub.
#[derive(Parser, Debug)]
#[command(version, arg_required_else_help = true)]
pub struct Arguments {
    /// The hub's state folder [default: $SKROBOT_STATE_DIR, else skrobot in the user's state folder]
    #[arg(long, global = true, value_name = "DIR")]
    pub state_dir: Option<PathBuf>,
    /// Where the hub is reached: unix:PATH, tcp:HOST:PORT, ws:HOST:PORT/flow, tls:HOST:PORT, wss:HOST:PORT/flow or
    /// tty:DEVICE?baud=115200 [default: the hub of the state folder]
    #[arg(long, global = true, env = "SKROBOT_HUB", value_name = "ADDRESS")]
    pub hub: Option<HubAddress>,
    /// The PEM file of the authority that the certificate of a hub at a tls: or wss: address must come from
    #[arg(long, global = true, env = "SKROBOT_TLS_CA", value_name = "FILE", conflicts_with = "tls_pin")]
    pub tls_ca: Option<PathBuf>,
    /// The SHA-256 that the certificate of such a hub must have
    #[arg(long, global = true, env = "SKROBOT_TLS_PIN", value_name = "FINGERPRINT")]
    pub tls_pin: Option<String>,
    /// Answers for programs: one JSON object a line
    #[arg(long, global = true)]
    pub json: bool,
    /// What is logged to standard error: a level, or levels for parts
    #[arg(
        long,
        global = true,
        env = "SKROBOT_LOG",
        default_value = "warn,sk_core::eventloop=error",
        value_name = "FILTER"
    )]
    pub log: String,
    #[command(subcommand)]
    pub task: Task,
}

#[derive(Subcommand, Debug)]
pub enum Task {
    /// List the channels
    Ls(Ls),
    /// Tell of the hub, of a channel or of a flow
    Info(Info),
    /// Draw who publishes to whom
    Graph(Graph),
    /// Print what flows on channels
    Echo(Echo),
    /// Publish a value on a channel of one's own
    Pub(Publish),
    /// Measure how often messages come, how regularly, and how many bytes
    Hz(Hz),
    /// Ask a service
    Call(Call),
    /// Databases: look into them and change them
    #[command(subcommand)]
    Db(Database),
    /// Modules: those of the hub, and one of your own
    #[command(subcommand)]
    Module(Module),
    /// Say why data of a channel or flow does or does not reach a flow
    Why(Why),
    /// Look for what keeps a hub from running, or from running well
    Doctor,
    /// Write the completions of a shell to standard output
    Completions(Completions),
}

#[derive(Args, Debug)]
pub struct Completions {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// JSON of the command line.
pub fn json(text: &str) -> Result<SkVariant, String> {
    let hint = "a text stands between quotes, which the shell takes away: '\"text\"'";
    SkVariant::from_json(text).map_err(|error| format!("this is no JSON: {error}; {hint}"))
}

#[derive(Args, Debug)]
pub struct ModuleNew {
    /// What it is called: lower-case letters, digits, `_` and `-`
    pub name: String,
    /// The folder to write to; it must be empty or not be there [default: the name]
    #[arg(long, value_name = "DIR")]
    pub path: Option<PathBuf>,
    /// The SpecialK sources to build with [default: those this tool was built from, else the published ones]
    #[arg(long, value_name = "DIR")]
    pub tree: Option<PathBuf>,
}
