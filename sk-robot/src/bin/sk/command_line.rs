//! What can be typed.

use crate::arguments::Arguments;
use crate::commands::blob::Blob;
use crate::commands::call::Call;
use crate::commands::completions::Completions;
use crate::commands::database::Database;
use crate::commands::echo::Echo;
use crate::commands::graph::Graph;
use crate::commands::hz::Hz;
use crate::commands::info::Info;
use crate::commands::ls::Ls;
use crate::commands::module::Module;
use crate::commands::publish::Publish;
use crate::commands::user::User;
use crate::commands::why::Why;
use clap::{Parser, Subcommand};

/// Look into a running hub.
#[derive(Parser, Debug)]
#[command(version, arg_required_else_help = true)]
pub struct CommandLine {
    #[command(flatten)]
    pub arguments: Arguments,
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
