//! What can be typed.

use clap::{Args, Parser, Subcommand};
use sk_core::flow::HubAddress;
use std::path::PathBuf;

/// Look into a running hub.
#[derive(Parser, Debug)]
#[command(version, arg_required_else_help = true)]
pub struct Arguments {
    /// The hub's state folder [default: $SKROBOT_STATE_DIR, else skrobot in the user's state folder]
    #[arg(long, global = true, value_name = "DIR")]
    pub state_dir: Option<PathBuf>,
    /// Where the hub is reached: tcp:HOST:PORT or unix:PATH [default: the hub of the state folder]
    #[arg(long, global = true, env = "SKROBOT_HUB", value_name = "ADDRESS")]
    pub hub: Option<HubAddress>,
    /// What is logged to standard error: a level, or levels for parts
    #[arg(long, global = true, env = "SKROBOT_LOG", default_value = "warn", value_name = "FILTER")]
    pub log: String,
    #[command(subcommand)]
    pub task: Task,
}

#[derive(Subcommand, Debug)]
pub enum Task {
    /// List the channels
    Ls(Ls),
    /// Print what flows on a channel
    Echo(Echo),
    /// Files that blob channels hold
    #[command(subcommand)]
    Blob(Blob),
    /// Modules: make one of your own
    #[command(subcommand)]
    Module(Module),
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
    /// One JSON object a line
    #[arg(long)]
    pub json: bool,
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

#[derive(Subcommand, Debug)]
pub enum Module {
    /// Write the skeleton of a module: a crate that builds, has a test, and runs in a hub or as a satellite
    New(ModuleNew),
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

#[derive(Args, Debug)]
pub struct Ls {
    /// Only channels whose name contains this
    pub part: Option<String>,
    /// One JSON object a line, with all properties
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Debug)]
pub struct Echo {
    /// The channel, with or without the account: robot.host.cpu or host.cpu
    pub channel: String,
    /// End after this many messages
    #[arg(short = 'n', long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Wait for a channel that does not exist yet
    #[arg(long)]
    pub wait: bool,
}
