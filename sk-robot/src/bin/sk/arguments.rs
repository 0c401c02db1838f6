//! What can be typed.

use crate::commands::call::Call;
use crate::commands::database::Database;
use crate::commands::echo::Echo;
use crate::commands::graph::Graph;
use crate::commands::hz::Hz;
use crate::commands::info::Info;
use crate::commands::ls::Ls;
use crate::commands::module::Module;
use crate::commands::publish::Publish;
use crate::commands::why::Why;
use clap::{Args, Parser, Subcommand};
use sk_core::flow::rights::Pattern;
use sk_core::flow::{HubAddress, Right};
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
    /// The account to log in to, by password [default: the owner's]
    #[arg(long, global = true, env = "SKROBOT_USER", value_name = "NAME")]
    pub user: Option<String>,
    /// The file with the account's password, which nobody else may read [default: it is asked for]
    #[arg(long, global = true, requires = "user", value_name = "FILE")]
    pub password_file: Option<PathBuf>,
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
    /// Files that blob channels hold
    #[command(subcommand)]
    Blob(Blob),
    /// Accounts and their rights
    #[command(subcommand)]
    User(User),
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

#[derive(Subcommand, Clone, Debug)]
pub enum User {
    /// Add an account; its password is asked for, or is a line of standard input
    Add {
        /// Its name: lower-case letters, digits, `_` and `-`
        name: String,
    },
    /// Change the password of an account: asked for, or a line of standard input
    Passwd {
        /// Its name
        name: String,
    },
    /// Give an account a right for some names
    Grant(Granted),
    /// Take a right for some names away again
    Revoke(Granted),
    /// Show the rights of an account
    Rights {
        /// Its name
        name: String,
    },
    /// List the accounts
    List,
    /// Remove an account with its rights; its connections end
    Remove {
        /// Its name
        name: String,
    },
}

#[derive(Args, Clone, Debug)]
pub struct Granted {
    /// The account
    pub name: String,
    /// list, publish, subscribe, serve, call, blob_read, blob_write, database_read, database_write or administer
    #[arg(value_parser = right)]
    pub right: Right,
    /// Names of channels or databases; one with `*` at its end is all names that begin so. To revoke without any is
    /// to take all
    pub patterns: Vec<Pattern>,
}

fn right(text: &str) -> Result<Right, String> {
    let names: Vec<&str> = Right::ALL.into_iter().map(Right::name).collect();
    Right::by_name(text).ok_or_else(|| format!("there are {}", names.join(", ")))
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

#[derive(Subcommand, Debug)]
pub enum Blob {
    /// List a folder
    Ls(BlobLook),
    /// Tell the length and the checksum of a file
    Stat(BlobLook),
    /// Download a file; it appears when it is whole
    Get(BlobGet),
    /// Open a blob channel of your own, with what it held before and these files, until Ctrl-C
    Serve(BlobServe),
}

#[derive(Args, Debug, Clone)]
pub struct BlobPlace {
    /// The channel, with or without the account: robot.maps or maps
    pub channel: String,
    /// The path inside it
    #[arg(default_value = "")]
    pub path: String,
}

#[derive(Args, Debug)]
pub struct BlobLook {
    #[command(flatten)]
    pub place: BlobPlace,
}

#[derive(Args, Debug)]
pub struct BlobGet {
    #[command(flatten)]
    pub place: BlobPlace,
    /// Where to write it: a file or a folder [default: its name, here]
    pub file: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub struct BlobServe {
    /// The channel's name without the account
    pub name: String,
    /// Files to upload
    pub files: Vec<PathBuf>,
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
