//! What can be typed.

use clap::{Args, Parser, Subcommand};
use sk_core::flow::rights::Pattern;
use sk_core::flow::{HubAddress, Right};
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
    /// The account to log in to, by password [default: the owner's]
    #[arg(long, global = true, env = "SKROBOT_USER", value_name = "NAME")]
    pub user: Option<String>,
    /// The file with the account's password, which nobody else may read [default: it is asked for]
    #[arg(long, global = true, requires = "user", value_name = "FILE")]
    pub password_file: Option<PathBuf>,
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
    /// Accounts and their rights
    #[command(subcommand)]
    User(User),
    /// Modules: make one of your own
    #[command(subcommand)]
    Module(Module),
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
    List {
        /// One JSON object a line
        #[arg(long)]
        json: bool,
    },
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
