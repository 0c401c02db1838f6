//! What every command is told, and values that several take.

use clap::Args;
use sk_core::flow::HubAddress;
use sk_flat::SkVariant;
use std::path::PathBuf;

/// What every command is told: how the hub is reached, and how to answer.
#[derive(Args, Debug)]
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
}

/// JSON of the command line.
pub fn json(text: &str) -> Result<SkVariant, String> {
    let hint = "a text stands between quotes, which the shell takes away: '\"text\"'";
    SkVariant::from_json(text).map_err(|error| format!("this is no JSON: {error}; {hint}"))
}
