//! Logs: to standard error, with a level for each part of the program.

use std::io::IsTerminal;
use tracing_subscriber::filter::{ParseError, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Sends logs to standard error. `filter` is a level (`warn`, `info`, `debug`), or levels for parts:
/// `info,sk_core::flow=debug`.
///
/// # Errors
/// If the filter cannot be read.
pub fn to_stderr(filter: &str) -> Result<(), ParseError> {
    let filter: Targets = filter.parse()?;
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false);
    // A program that embeds the hub may have its own subscriber: that one stays.
    let _ = tracing_subscriber::registry().with(lines).with(filter).try_init();
    Ok(())
}
